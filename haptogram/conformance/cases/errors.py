"""Chapters 10 and 11: errors, versions, what is reserved; and what only a document can show."""

from __future__ import annotations

from haptogram_protocol.messages import (
    MESSAGES,
    VERSION_MAJOR,
    VERSION_MINOR,
    Config,
    ConfigReply,
    Error,
    ErrorCode,
    Feature,
    GetConfig,
    GetGeometry,
    Hello,
    HelloReply,
    Mute,
    MuteReply,
    Ping,
    Pong,
    SetConfig,
    UploadCommit,
)

from ..case import about_host, about_text, case
from ..client.board_client import Bench
from ..client.dialogue import frames_in, talk
from ..client.latching import latch_now
from ..client.recording import describe, type_name
from ..outcome import SELF_REPORTED, check

unknown_codes = about_host("HG-10.1/3")
minor_rules = about_text("HG-11.2/1")
host_warns = about_host("HG-11.3/1")
deprecation = about_text("HG-11.4/1")
numbers_gone = about_text("HG-11.4/2")
host_versions = about_host("HG-11.4/3")


@case("HG-10.1/1", "refused requests leave state, configuration, queue and stream numbers alone")
def refusals_change_nothing(bench: Bench) -> None:
    bench.arm()
    before, config = bench.status(), bench.call(GetConfig(), ConfigReply)
    t_us = bench.soon_us(bytes(2000)) + 40_000
    with bench.counting(latched=2, bad_length=1, unsupported=1, stale_session=1):
        bench.send(bench.stream_wire(bench.flat_phases(), t_us))
        bench.refused_raw(0x43, b"\x00", ErrorCode.BAD_LENGTH, 0)
        bench.refused_raw(0x43, b"", ErrorCode.UNSUPPORTED, 0x20, flags=0x20)
        bench.refused_raw(0x43, b"", ErrorCode.STALE_SESSION, session=bench.session ^ 3)
        bench.refused(GetGeometry(0xFFFF, 1), ErrorCode.NOT_FOUND)
        bench.in_time(t_us)
        bench.until(t_us + 100)
        latch_now(bench, bench.flat_phases())
    after = bench.status()
    check(after.state is before.state, f"a refusal has led to {after.state.name}")
    check(bench.call(GetConfig(), ConfigReply) == config, "a refusal has changed the configuration")


@case("HG-10.1/2", "stream frames, good ones and bad ones of every kind, get no answer")
def stream_is_not_answered(bench: Bench) -> None:
    bench.arm()
    good = bench.flat_phases()
    frames = [
        bench.stream_wire(good),
        bench.stream_wire(good, flags=0x80),
        bench.stream_wire(good, seq=bench.stream_next - 1),
        bench.stream_wire(good, session=0),
        bench.stream_wire(good, bench.device_us() - 10_000),
        bench.stream_wire(good, bench.device_us() + bench.identity.max_horizon_us * 2),
        bench.stream_raw(0x3C, b"abc"),
        bench.stream_raw(good.TYPE, b""),
        bench.stream_raw(good.TYPE, b"\x07" + good.serialize()[1:]),
    ]
    bench.unanswered("a stream frame", *frames)
    bench.disarm()
    bench.unanswered("a stream frame while DISARMED", bench.stream_wire(good))


@case("HG-10.2/1", "ten cases are each refused with the code that the text gives; never BUSY")
def uses_the_right_codes(bench: Bench) -> None:
    bench.refused_raw(0x7B, b"", ErrorCode.UNSUPPORTED, 0x7B)
    bench.refused(Ping(0), ErrorCode.UNSUPPORTED, 0x80, flags=0x80)
    bench.refused_raw(Ping.TYPE, b"", ErrorCode.BAD_LENGTH, 8)
    bench.refused(bench.hello_message(0), ErrorCode.BAD_VALUE, 2, session=0)
    hello = Hello(VERSION_MAJOR + 5, 0, bench.new_nonce(), 0)
    bench.refused(hello, ErrorCode.VERSION, VERSION_MAJOR, session=0)
    bench.refused(Ping(0), ErrorCode.STALE_SESSION, bench.session, session=bench.session ^ 9)
    bench.call(Ping(1), Pong)
    seq = bench.seq & 0xFFFF
    bench.refused(Ping(2), ErrorCode.SEQUENCE_REUSED, seq, seq=seq)
    count = bench.identity.transducers
    bench.refused(GetGeometry(count, 1), ErrorCode.NOT_FOUND, count)
    if bench.has(Feature.CONFIG):
        wrong = Config(hold_ms=0)
        bench.refused(SetConfig(wrong), ErrorCode.BAD_VALUE, Config.WIRE["hold_ms"].offset)
    if bench.identity.features & (Feature.SEQUENCE_PHASES | Feature.CORRECTION):
        bench.refused(UploadCommit(1), ErrorCode.BAD_STATE, 0)
    busy = [
        piece
        for piece in bench.wire.received
        if isinstance(piece.message, Error) and piece.message.code == ErrorCode.BUSY
    ]
    check(not busy, "BUSY for what does not pass by itself")


@case("HG-11.1/1", "HELLO of major 0 to 255 and MUTE with a longer payload are understood")
def keeps_what_never_changes(bench: Bench) -> None:
    for major in (0, 2, 3, 127, 255):
        hello = Hello(major, 99, bench.new_nonce(), 0xFFFFFFFF)
        bench.refused(hello, ErrorCode.VERSION, VERSION_MAJOR, session=0)
    bench.arm()
    answer = bench.ask_raw(Mute.TYPE, b"of another version", flags=0xF0, session=0x7777)
    check(isinstance(answer.message, MuteReply), "MUTE of another version is not carried out")
    reply = bench.ask(bench.hello_message(bench.new_nonce()), session=0)
    check(reply.body[10] == VERSION_MAJOR, f"byte 0 of HELLO_REPLY is {reply.body[10]}")


@case("HG-11.2/2", "a host of minor version 255 is answered; the board sends what 1.0 has")
def uses_the_smaller_minor(bench: Bench) -> None:
    hello = Hello(VERSION_MAJOR, 255, bench.new_nonce(), bench.description_hash ^ 1)
    reply = bench.call(hello, HelloReply, session=0)
    bench.adopt(reply)
    check(reply.minor >= VERSION_MINOR, f"HELLO_REPLY says minor {reply.minor}")
    bench.hello()
    unknown = [p for p in frames_in(talk(bench)) if p.reason == "unknown_type"]
    check(
        not unknown,
        f"to a host of {VERSION_MAJOR}.{VERSION_MINOR}: "
        f"{describe(unknown[0].piece) if unknown else ''}",
    )


@case("HG-11.5/1", "SYNC_IN and COMMIT are not advertised")
def advertises_nothing_reserved(bench: Bench) -> None:
    reserved = Feature.SYNC_IN | Feature.COMMIT
    found = Feature(bench.identity.features & int(reserved))
    check(not found, f"{found.name} is reserved in this version")


@case(
    "HG-11.5/2",
    "in a whole conversation no type, flag, code, value or capability that no table names",
    evidence=SELF_REPORTED,
)
def sends_nothing_reserved(bench: Bench) -> None:
    known = sum(int(feature) for feature in Feature)
    spare = bench.identity.features & ~known
    check(not spare, f"capability bits {spare:#x} are in no table")
    for piece in frames_in(talk(bench)):
        header = piece.header
        assert header is not None  # frames_in
        check(header.type in MESSAGES, f"{type_name(header.type)} is in no table")
        check(piece.reason != "bad_value", f"{describe(piece.piece)}")
        if isinstance(piece.message, Error):
            code = piece.message.code
            check(code in ErrorCode._value2member_map_, f"error code {code} is in no table")
    check(bench.identity.phase_formats & ~7 == 0, "phase_formats has bits that no table names")
    check(bench.identity.banks == 1, f"banks is {bench.identity.banks}; 1 in this version")

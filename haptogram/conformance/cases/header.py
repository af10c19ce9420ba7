"""Chapter 3, header, values, types and flags."""

from __future__ import annotations

import math
from typing import Final

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    MESSAGES,
    MUST_UNDERSTAND,
    REQUEST_RANGE,
    RESPONSE_OFFSET,
    STREAM_RANGE,
    Arm,
    ConfigReply,
    Disarm,
    Drives,
    ErrorCode,
    Feature,
    Flag,
    GeometryReply,
    GetConfig,
    GetGeometry,
    GetStatus,
    Hello,
    Message,
    MessageType,
    Mute,
    Phases,
    Ping,
    Play,
    Points,
    Pong,
    ReadDrive,
    ReadTrace,
    SetConfig,
    Stop,
    UploadBegin,
    UploadCommit,
    signed_difference,
)

from ..case import about_host, case
from ..client.board_client import Bench
from ..client.dialogue import frames_in, talk
from ..client.latching import latch_now
from ..client.recording import describe, type_name
from ..outcome import SELF_REPORTED, check

_PLAYBACK: Final = Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS
#: Requests that every board takes, and what others need one of.
_NEEDS: Final[dict[type[Message], Feature]] = {
    Hello: Feature(0),
    Arm: Feature(0),
    Disarm: Feature(0),
    Ping: Feature(0),
    GetStatus: Feature(0),
    GetConfig: Feature(0),
    GetGeometry: Feature(0),
    SetConfig: Feature.CONFIG,
    ReadDrive: Feature.READ_LATCHED | Feature.READ_RADIATED,
    ReadTrace: Feature.TRACE_RING,
    UploadBegin: _PLAYBACK | Feature.CORRECTION,
    UploadCommit: _PLAYBACK | Feature.CORRECTION,
    Play: _PLAYBACK,
    Stop: _PLAYBACK,
}
_UNKNOWN_REQUESTS: Final = (0x50, 0x7E, 0x7F)


def requests_of(bench: Bench) -> list[type[Message]]:
    """Return the kinds of requests of fixed length that the board takes."""
    features = bench.identity.features
    return [kind for kind, any_of in _NEEDS.items() if not any_of or any_of & features]


def _session_for(bench: Bench, kind: type[Message]) -> int:
    return 0 if kind is Hello else bench.session


@case("HG-3.2/1", "numbers of 16, 32 and 64 bits, signed ones too, make sense lowest byte first")
def is_little_endian(bench: Bench) -> None:
    nonce = 0x1FE2 if bench.session != 0x1FE2 else 0x1FE3
    reply = bench.hello(nonce)
    check(reply.nonce == nonce, f"HELLO_REPLY has the nonce {reply.nonce:#06x}, not {nonce:#06x}")
    check(reply.clock_hz == 1_000_000, f"clock_hz is {reply.clock_hz:#x}, not 1000000 = 0xf4240")
    echo = 0x0123456789ABCDEF
    pong = bench.call(Ping(echo), Pong)
    check(pong.echo == echo, f"PONG has {pong.echo:016x}, sent was {echo:016x}")
    apart_us = signed_difference(pong.t_tx_us, pong.t_rx_us, 32)
    check(0 <= apart_us < 1_000_000, f"t_rx {pong.t_rx_us:#x} and t_tx {pong.t_tx_us:#x} disagree")
    bench.refused(Ping(0), ErrorCode.STALE_SESSION, nonce, session=nonce ^ 0x0101)
    _check_frames_counted(bench)
    _check_geometry(bench)


def _check_frames_counted(bench: Bench) -> None:
    first, second = bench.status().counters.frames, bench.status().counters.frames
    check((second - first) & 0xFFFFFFFF == 1, f"frames: {first:#x}, one request later {second:#x}")


def _check_geometry(bench: Bench) -> None:
    reply = bench.call(GetGeometry(0, 0xFFFF), GeometryReply)
    far = [e for e in reply.elements if max(abs(e.x_um), abs(e.y_um), abs(e.z_um)) > 5_000_000]
    check(not far, f"a transducer 5 m away: {far[:1]}")
    bent = [e for e in reply.elements if not 0.98 < _length(e.nx, e.ny, e.nz) / 32767 < 1.02]
    check(not bent, f"a normal that is not of length 1 (32767): {bent[:1]}")
    if bench.identity.transducers > 2:
        some = bench.call(GetGeometry(1, 2), GeometryReply)
        got = (some.first, len(some.elements))
        check(got == (1, 2), f"GET_GEOMETRY of 2 from 1: {got[1]} from {got[0]}")


def _length(*parts: int) -> float:
    return math.hypot(*parts)


@case(
    "HG-3.2/1",
    "a configuration of six different numbers comes back as it was sent",
    variant="config",
    needs=Feature.CONFIG,
)
def takes_little_endian(bench: Bench) -> None:
    sent = bench.configure(
        hold_ms=0x0102, ramp_ms=0x0304, host_timeout_ms=0x0506, status_period_ms=0x0708
    )
    got = bench.call(GetConfig(), ConfigReply).config
    check(got == sent, f"sent was {sent}, in force is {got}")


@case("HG-3.2/2", "the firmware's name is UTF-8 and filled with zeros to 16 bytes")
def text_is_filled(bench: Bench) -> None:
    answer = bench.ask(bench.hello_message(bench.session), session=0)
    raw = answer.body[-16:]
    name = raw.rstrip(b"\x00")
    check(b"\x00" not in name, f"{raw!r} has something behind its first zero")
    try:
        name.decode()
    except UnicodeDecodeError as error:
        check(False, f"{raw!r} is no UTF-8: {error}")


@case("HG-3.2/3", "every payload of a whole conversation has the length of its type")
def payloads_have_their_length(bench: Bench) -> None:
    wrong = [piece for piece in talk(bench) if piece.reason == "bad_length"]
    check(not wrong, f"{describe(wrong[0].piece) if wrong else ''}")


@case("HG-3.2/4", "requests a byte too long and too short are refused with their right length")
def refuses_a_wrong_length(bench: Bench) -> None:
    kinds = requests_of(bench)
    wrong = [(kind, size) for kind in kinds for size in _wrong_sizes(kind.LAYOUT.size)]
    with bench.counting(bad_length=len(wrong)):
        for kind, size in wrong:
            right = kind.LAYOUT.size
            session = _session_for(bench, kind)
            bench.refused_raw(kind.TYPE, bytes(size), ErrorCode.BAD_LENGTH, right, session=session)


def _wrong_sizes(right: int) -> tuple[int, ...]:
    return (right + 1,) if right == 0 else (right - 1, right + 1)


@case(
    "HG-3.2/4",
    "stream frames a byte too long and too short are counted in bad_length and not answered",
    variant="stream",
    evidence=SELF_REPORTED,
)
def drops_a_wrong_length(bench: Bench) -> None:
    right = bench.flat_phases()
    payloads = [right.serialize() + b"\x00", right.serialize()[:-1], b"\x08"]
    bodies = [(Phases.TYPE, payload) for payload in payloads]
    if bench.has(Feature.AMPLITUDE):
        bodies += [(Drives.TYPE, b"\x08\x00" + bytes(2 * bench.identity.transducers - 2))]
    if bench.has(Feature.POINTS):
        bodies += [(Points.TYPE, b""), (Points.TYPE, bytes(15)), (Points.TYPE, bytes(17))]
    with bench.counting(bad_length=len(bodies)):
        bench.unanswered(
            "a stream frame of a wrong length",
            *(bench.stream_raw(kind, payload) for kind, payload in bodies),
        )


@case("HG-3.2/5", "values that no table has are refused with BAD_VALUE and the field's offset")
def refuses_a_wrong_value(bench: Bench) -> None:
    wrong: list[tuple[int, bytes, int]] = [(Hello.TYPE, b"\x01\x00\x00\x00" + bytes(4), 2)]
    if bench.has(Feature.READ_LATCHED):
        wrong.append((ReadDrive.TYPE, b"\x07\x00\x00\x01\x00", 0))
    if bench.identity.features & (_PLAYBACK | Feature.CORRECTION):
        wrong.append((UploadBegin.TYPE, b"\x09" + bytes(11), 0))
    if bench.has(Feature.CONFIG):
        payload = bytearray(bench.config.pack())
        payload[16] = 0x77
        wrong.append((SetConfig.TYPE, bytes(payload), 16))
    with bench.counting(bad_value=len(wrong)):
        for kind, value, offset in wrong:
            session = 0 if kind == Hello.TYPE else bench.session
            bench.refused_raw(kind, value, ErrorCode.BAD_VALUE, offset, session=session)


@case("HG-3.3/1", "each request is answered by its type + 0x40, or by ERROR")
def answers_with_the_right_type(bench: Bench) -> None:
    kinds: list[type[Message]] = [*requests_of(bench), Mute]
    for kind in kinds:
        payload = bytes(kind.LAYOUT.size)
        if kind is Hello:
            payload = bench.hello_message(bench.session).serialize()
        answer = bench.ask_raw(kind.TYPE, payload, session=_session_for(bench, kind))
        got = bench.type_of(answer)
        check(
            got in (kind.TYPE + RESPONSE_OFFSET, MessageType.ERROR),
            f"{kind.TYPE.name} is answered by {type_name(got)}",
        )


@case(
    "HG-3.3/2",
    "stream, response and event frames of unknown types are counted in unknown_type, unanswered",
    evidence=SELF_REPORTED,
)
def drops_unknown_types(bench: Bench) -> None:
    kinds = (0x00, 0x04, 0x3F, 0x80, 0xBE, 0xBF, 0xC0, 0xFF)
    frames = [
        bench.stream_raw(kind, bytes(5))
        if kind in STREAM_RANGE
        else encode_frame(bench.body(kind, bytes(5), seq=kind))
        for kind in kinds
    ]
    with bench.counting(unknown_type=len(kinds)):
        bench.unanswered("a frame of an unknown type", *frames)


@case("HG-3.3/3", "unknown requests are refused with UNSUPPORTED and their type, and counted")
def refuses_unknown_requests(bench: Bench) -> None:
    unknown = [kind for kind in _UNKNOWN_REQUESTS if kind not in MESSAGES]
    with bench.counting(unsupported=len(unknown)):
        for kind in unknown:
            assert kind in REQUEST_RANGE  # the tuple above says so
            bench.refused_raw(kind, bytes(3), ErrorCode.UNSUPPORTED, kind)


@case("HG-3.4/1", "each must-understand flag that is unknown refuses a request, by its bit")
def refuses_unknown_flags(bench: Bench) -> None:
    flags = (0x20, 0x40, 0x80, 0xE0, 0x21)
    with bench.counting(unsupported=len(flags)):
        for flag in flags:
            bench.refused(Ping(0), ErrorCode.UNSUPPORTED, flag & MUST_UNDERSTAND, flags=flag)


@case(
    "HG-3.4/1",
    "each must-understand flag that is unknown drops a stream frame",
    variant="stream",
    evidence=SELF_REPORTED,
)
def drops_unknown_flags(bench: Bench) -> None:
    bench.arm()
    with bench.counting(unsupported=3, latched=0):
        for flag in (0x20, 0x40, 0x80):
            bench.send(bench.stream_wire(bench.flat_phases(), flags=flag | Flag.IMMEDIATE))
        bench.rest()


@case("HG-3.4/2", "PING with each bit of the low nibble is answered; a stream frame is latched")
def ignores_the_low_nibble(bench: Bench) -> None:
    for flag in (1, 2, 4, 8, 15):
        bench.call(Ping(flag), Pong, flags=flag)
    bench.arm()
    with bench.counting(latched=1):
        bench.send(bench.stream_wire(bench.flat_phases(), flags=Flag.IMMEDIATE | 0x0F))
        bench.rest()


@case("HG-3.4/3", "no frame of a whole conversation has a flag but LATE, and that in traces only")
def sends_no_flags(bench: Bench) -> None:
    traces = {MessageType.TRACE, MessageType.TRACE_PLAYBACK, MessageType.TRACE_DRIVE}
    for piece in frames_in(talk(bench)):
        if piece.header is not None:
            allowed = Flag.LATE if piece.header.type in traces else 0
            check(not piece.header.flags & ~allowed, f"flags: {describe(piece.piece)}")


@case("HG-3.5/1", "IMMEDIATE on any request but PLAY is refused with UNSUPPORTED, detail 0x10")
def takes_immediate_where_it_belongs(bench: Bench) -> None:
    kinds = [kind for kind in requests_of(bench) if kind is not Play]
    for kind in kinds:
        bench.refused_raw(
            kind.TYPE,
            bytes(kind.LAYOUT.size),
            ErrorCode.UNSUPPORTED,
            Flag.IMMEDIATE,
            flags=Flag.IMMEDIATE,
            session=_session_for(bench, kind),
        )
    bench.arm()
    with bench.counting(latched=1):
        latch_now(bench, bench.flat_phases())


@case(
    "HG-3.5/2",
    "with IMMEDIATE a frame is latched at once, whatever time it carries",
    evidence=SELF_REPORTED,
)
def ignores_the_time_of_immediate(bench: Bench) -> None:
    bench.arm()
    now_us = bench.device_us()
    for time_us in (0, 1, now_us - 1_000_000, now_us + 5_000_000, now_us + 2**31, 0xFFFFFFFF):
        with bench.counting(latched=1):
            bench.send(
                bench.stream_wire(bench.flat_phases(), time_us & 0xFFFFFFFF, flags=Flag.IMMEDIATE)
            )
            bench.rest()


@case("HG-3.7/1", "every frame of a whole conversation carries its session, ERROR at times 0")
def carries_the_session(bench: Bench) -> None:
    for piece in frames_in(talk(bench)):
        header = piece.header
        assert header is not None  # frames_in
        stale = header.type == MessageType.ERROR and header.session == 0
        check(
            header.session == bench.session or stale,
            f"another session than {bench.session:#06x}: {describe(piece.piece)}",
        )


@case(
    "HG-3.7/2",
    "a stream frame of another session is counted in stale_session and uses up no number",
    evidence=SELF_REPORTED,
)
def drops_another_session(bench: Bench) -> None:
    old = bench.session
    bench.hello()
    bench.arm()
    sessions = (old, bench.session ^ 0x0100, bench.session ^ 0x0001, 0)
    with bench.counting(stale_session=len(sessions), latched=1):
        for session in sessions:
            bench.send(
                bench.stream_wire(bench.flat_phases(), seq=bench.stream_next, session=session)
            )
        bench.send(bench.stream_wire(bench.flat_phases()))
        bench.rest()


not_host_response = about_host("HG-3.3/4")
not_host_session = about_host("HG-3.7/3")

"""Chapter 4, sessions: HELLO and what it starts anew."""

from __future__ import annotations

import zlib
from typing import Final

from haptogram_protocol.messages import (
    VERSION_MAJOR,
    Arm,
    ConfigReply,
    Element,
    ErrorCode,
    Feature,
    GeometryReply,
    GetConfig,
    GetGeometry,
    Hello,
    Mute,
    Ping,
    PlaybackEnded,
    Pong,
    ReadTrace,
    TraceMode,
    TraceReply,
    UploadChunk,
    UploadCommit,
    UploadKind,
)
from haptogram_protocol.state import MuteReason, OutputState

from ..case import about_host, case
from ..client.board_client import Bench
from ..client.latching import latch_now
from ..client.playback import play_now, store_phases
from ..outcome import SELF_REPORTED, check

_LISTEN_US: Final = 300_000

host_opens = about_host("HG-4.1/1")
host_chooses = about_host("HG-4.1/2")
host_stops = about_host("HG-4.4/2")
host_uses = about_host("HG-4.5/1")
host_ignores = about_host("HG-4.5/2")


@case("HG-4.1/3", "HELLO with the nonce 0 is refused with BAD_VALUE, detail 2; nothing changes")
def refuses_nonce_0(bench: Bench) -> None:
    bench.refused(bench.hello_message(0), ErrorCode.BAD_VALUE, 2, session=0)
    bench.call(Ping(1), Pong)


@case("HG-4.1/4", "after a second HELLO the first session is stale, for requests and stream")
def has_one_session(bench: Bench) -> None:
    old = bench.session
    bench.hello()
    bench.refused(Ping(0), ErrorCode.STALE_SESSION, bench.session, session=old)
    with bench.counting(stale_session=1):
        bench.send(bench.stream_wire(bench.flat_phases(), seq=0xFFF0, session=old))


@case("HG-4.1/4", "after a reset no session is open", variant="reset", needs_reset=True)
def has_no_session_after_reset(bench: Bench) -> None:
    bench.refused(Ping(0), ErrorCode.STALE_SESSION, 0, session=bench.new_nonce())


@case("HG-4.2/1", "HELLO_REPLY states the version that the board has")
def states_its_version(bench: Bench) -> None:
    reply = bench.hello()
    check(reply.major == VERSION_MAJOR, f"HELLO_REPLY says version {reply.major}.{reply.minor}")
    hello = Hello(VERSION_MAJOR + 1, 0, bench.new_nonce(), 0)
    bench.refused(hello, ErrorCode.VERSION, reply.major, session=0)


@case("HG-4.3/1", "HELLO is answered while DISARMED, ARMED and MUTED")
def greets_in_every_state(bench: Bench) -> None:
    bench.hello()
    bench.arm()
    bench.hello()
    bench.ask(Mute())
    state = bench.hello().state
    check(state is OutputState.MUTED, f"HELLO_REPLY of a muted board says {state.name}")


@case("HG-4.3/2", "carrier_hz divides 1000000")
def carrier_divides(bench: Bench) -> None:
    carrier = bench.identity.carrier_hz
    check(0 < carrier <= 1_000_000 and 1_000_000 % carrier == 0, f"carrier_hz is {carrier}")


@case("HG-4.3/3", "clock_hz is 1000000")
def clock_is_a_megahertz(bench: Bench) -> None:
    check(bench.identity.clock_hz == 1_000_000, f"clock_hz is {bench.identity.clock_hz}")


@case("HG-4.3/4", "grid_nx grid_ny is N, or both are 0")
def grid_is_whole(bench: Bench) -> None:
    nx, ny, count = (
        bench.identity.grid_nx,
        bench.identity.grid_ny,
        bench.identity.transducers,
    )
    check((nx, ny) == (0, 0) or nx * ny == count, f"grid of {nx} x {ny}, {count} transducers")


@case("HG-4.3/5", "boot_id after a reset is not the one before", needs_reset=True)
def boot_id_differs(bench: Bench) -> None:
    bench.hello()
    now = bench.identity.boot_id
    check(now != bench.last_boot_id, f"boot_id is {now:#x} after a reset, as before")


@case("HG-4.3/6", "geometry_hash is the CRC-32 of what GET_GEOMETRY shows of all transducers")
def geometry_hash_is_right(bench: Bench) -> None:
    records = b"".join(element.pack() for element in read_geometry(bench))
    got, due = bench.identity.geometry_hash, zlib.crc32(records)
    check(got == due, f"geometry_hash is {got:#010x}, that of the records {due:#010x}")


def read_geometry(bench: Bench) -> list[Element]:
    """Return the positions of all transducers; FAILED if they cannot be read."""
    elements: list[Element] = []
    while len(elements) < bench.identity.transducers:
        reply = bench.call(GetGeometry(len(elements), 0xFFFF), GeometryReply)
        check(bool(reply.elements), f"GET_GEOMETRY from {len(elements)} shows nothing")
        elements += reply.elements
    return elements


@case("HG-4.4/1", "HELLO of other major versions is refused with VERSION; the session goes on")
def refuses_other_versions(bench: Bench) -> None:
    bench.arm()
    with bench.counting(unsupported=3):
        for major in (0, VERSION_MAJOR + 1, 255):
            hello = Hello(major, 0, bench.new_nonce(), 0)
            bench.refused(hello, ErrorCode.VERSION, VERSION_MAJOR, session=0)
    state = bench.status().state
    check(state is OutputState.ARMED, f"a refused HELLO has moved the state to {state.name}")


@case(
    "HG-4.6/1",
    "HELLO with the open nonce: same reply, ARMED stays, queue and numbers go on; repeated + 1",
)
def the_same_nonce(bench: Bench) -> None:
    first = bench.hello()
    bench.arm()
    t_us = bench.soon_us(bytes(2000))
    with bench.counting(repeated=1, latched=2):
        bench.send(bench.stream_wire(bench.flat_phases(), t_us))
        again = bench.hello(bench.session)
        bench.in_time(t_us)
        bench.until(t_us)
        latch_now(bench, bench.flat_phases())
    check(again == first, f"HELLO_REPLY was {first}, then {again}")
    state = bench.status().state
    check(state is OutputState.ARMED, f"HELLO of the open session has led to {state.name}")


@case("HG-4.6/2", "a new nonce: ARMED becomes DISARMED (NEW_SESSION), MUTED stays MUTED")
def a_new_nonce_and_the_state(bench: Bench) -> None:
    bench.arm()
    latch_now(bench, bench.flat_phases())
    status = (bench.hello(), bench.status())[1]
    found = (status.state, status.reason)
    due = (OutputState.DISARMED, MuteReason.NEW_SESSION)
    check(found == due, f"ARMED, then a new session: {found[0].name}, {found[1].name}")
    bench.ask(Mute())
    state = bench.hello().state
    check(state is OutputState.MUTED, f"MUTED, then a new session: {state.name}")
    bench.ask(Arm())


@case("HG-4.6/3", "a new nonce flushes the queue; nothing of it is latched", evidence=SELF_REPORTED)
def a_new_nonce_flushes(bench: Bench) -> None:
    bench.arm()
    start_us = bench.soon_us(bytes(4000))
    with bench.counting(flushed=3, latched=0):
        for number in range(3):
            bench.send(bench.stream_wire(bench.flat_phases(), start_us + number * 1000))
        bench.in_time(start_us)
        bench.hello()
        bench.arm()
        bench.until(start_us + 5000)


@case(
    "HG-4.6/3",
    "a new nonce ends playback and abandons an upload",
    variant="playback",
    needs=Feature.SEQUENCE_PHASES,
)
def a_new_nonce_ends_playback(bench: Bench) -> None:
    store_phases(bench, 3, frames=4)
    bench.arm()
    play_now(bench, 3, loops=0)
    bench.hello()
    bench.arm()
    with bench.counting(latched=0):
        bench.wire.idle(20_000)
    data = bytes(bench.identity.transducers)
    bench.begin_upload(UploadKind.PHASES, 4, data)
    bench.hello()
    bench.refused(UploadChunk(0, data[:1]), ErrorCode.BAD_STATE)
    bench.refused(UploadCommit(4), ErrorCode.BAD_STATE)
    check(not bench.events(PlaybackEnded, bench.mark()), "an event of the old session came")


@case("HG-4.6/4", "a new nonce: requests and stream count anew, an old reply is forgotten")
def a_new_nonce_starts_anew(bench: Bench) -> None:
    bench.arm()
    for _ in range(20):
        latch_now(bench, bench.flat_phases())
    bench.seq = 500
    nonce = bench.new_nonce()
    bench.hello(nonce, seq=3)
    bench.call(Ping(1), Pong, seq=4)  # far behind 500
    bench.arm_at(5)
    with bench.counting(latched=1):
        index = latch_now(bench, bench.flat_phases())
    last = bench.status().last_seq
    check(last == index, f"first frame of a session has the number {index}, last_seq is {last}")


@case(
    "HG-4.6/4",
    "a new nonce empties the trace ring",
    variant="ring",
    needs=Feature.TRACE_RING | Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def a_new_nonce_empties_the_ring(bench: Bench) -> None:
    bench.configure(trace_mode=TraceMode.RING)
    bench.arm()
    for _ in range(3):
        latch_now(bench, bench.flat_phases())
    bench.hello()
    reply = bench.call(ReadTrace(0, 100), TraceReply)
    check(not reply.records and reply.next == 0, f"the ring still holds {len(reply.records)}")


@case("HG-4.6/5", "a new nonce keeps configuration and counters", needs=Feature.CONFIG)
def a_new_nonce_keeps(bench: Bench) -> None:
    sent = bench.configure(hold_ms=4321, ramp_ms=77)
    before = bench.status()
    bench.hello()
    after = bench.status()
    got = bench.call(GetConfig(), ConfigReply).config
    check(got == sent, f"configuration was {sent}, after HELLO {got}")
    check(after.config_crc == before.config_crc, "config_crc has changed: the correction is gone")
    grown = after.counters.requests - before.counters.requests
    check(grown == 2, f"requests went up by {grown} over HELLO and GET_STATUS")


@case(
    "HG-4.6/5",
    "a new nonce keeps stored sequences",
    variant="sequences",
    needs=Feature.SEQUENCE_PHASES,
)
def a_new_nonce_keeps_sequences(bench: Bench) -> None:
    store_phases(bench, 9, frames=2)
    bench.hello()
    bench.arm()
    with bench.counting(latched=2):
        play_now(bench, 9, loops=1)
        bench.wire.idle(10_000)


@case(
    "HG-4.6/6", "HELLO of number 0, 0x8000, 0xFFFF, ...: accepted; the next request is ahead of it"
)
def a_hello_of_any_number(bench: Bench) -> None:
    for seq in (0, 0x8000, 0xFFFF, 0x7FFF, 1):
        bench.hello(seq=seq)
        bench.refused(Ping(1), ErrorCode.SEQUENCE_REUSED, seq, seq=seq)
        bench.call(Ping(2), Pong, seq=seq + 1)
        bench.seq = seq + 1


@case(
    "HG-4.7/1",
    "for 0.3 s after a reset, and a PING of no session, no event comes",
    needs_reset=True,
)
def no_event_without_a_session(bench: Bench) -> None:
    bench.refused(Ping(0), ErrorCode.STALE_SESSION, 0, session=77)
    bench.ask(Mute(), session=0)
    bench.wire.idle(_LISTEN_US)
    events = [piece for piece in bench.wire.received if piece.is_event]
    check(not events, f"{len(events)} events came before the first HELLO")

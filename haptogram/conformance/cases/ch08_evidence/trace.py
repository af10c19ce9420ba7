"""HG-8.1, HG-8.2, HG-8.3, HG-8.4, HG-8.7: traces of latches agree with the frames sent."""

from __future__ import annotations

import zlib
from typing import Final

from haptogram_protocol.messages import (
    Feature,
    Trace,
    TraceDrive,
    TraceMode,
    TracePlayback,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import (
    ask_for_board_latches,
    full_client_drive,
    latch_now,
    latches_received_from_board,
)
from ...client.playback import (
    flood_with_traces,
    play_out,
    send_phases_to_store,
)
from ...outcome import SELF_REPORTED, check, check_equal, require

_KINDS: Final = (Trace, TracePlayback, TraceDrive)


def _trace_events(board: BoardClient, since: int) -> int:
    board.link.barrier()
    return sum(len(board.link.events(kind, since)) for kind in _KINDS)


@case("HG-8.1/1", needs=Feature.CONFIG, evidence=SELF_REPORTED)
def traces_by_its_mode(board: BoardClient) -> None:
    """of 6 latches the trace modes OFF and RING report none, CRC and DRIVE report 6"""
    modes = {
        TraceMode.OFF: (Feature(0), 0),
        TraceMode.CRC: (Feature.TRACE, 6),
        TraceMode.DRIVE: (Feature.TRACE_DRIVE, 6),
        TraceMode.RING: (Feature.TRACE_RING, 0),
    }
    for mode, (feature, due) in modes.items():
        if not board.has(feature):
            continue
        board.configure(trace_mode=mode)
        board.arm()
        since = board.link.mark()
        for _ in range(6):
            latch_now(board)
        got = _trace_events(board, since)
        check(got == due, f"trace_mode {mode.name}: {got} events of 6 latches, due are {due}")


@case("HG-8.2/1", needs=Feature.CONFIG, evidence=SELF_REPORTED)
def trace_keys_are_unique(board: BoardClient) -> None:
    """40 stream latches across 0xFFFF and two passes of a sequence have unique keys"""
    mode = ask_for_board_latches(board)
    board.arm()
    since, first = board.link.mark(), board.link.stream_next
    for _ in range(40):
        latch_now(board)
    due = [(0, 0, first + number) for number in range(40)]
    if board.has(Feature.SEQUENCE_PHASES):
        send_phases_to_store(board, 4, frames=3)
        play_out(board, 4, 3, loops=2)
        due += [(4, loop, index) for loop in range(2) for index in range(3)]
    if mode is TraceMode.RING:
        due = due[-board.identity.trace_ring :]
    got = [
        (latch.sequence, latch.loop, latch.index)
        for latch in latches_received_from_board(board, since, mode)
    ]
    check_equal(len(set(got)), len(got), f"{len(got)} latches have {len(set(got))} keys")
    wrong = [pair for pair in zip(got, due, strict=False) if pair[0] != pair[1]]
    check(got == due, f"keys seen and due: {wrong[:2]}, {len(got)} of {len(due)}")


@case("HG-8.3/1", needs=Feature.TRACE | Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def traces_tell_the_time(board: BoardClient) -> None:
    """the time in a trace is the carrier period at or after t_apply, as in STATUS"""
    board.configure(trace_mode=TraceMode.CRC)
    board.arm()
    for offset_us in (0, 3, 990):
        since = board.link.mark()
        t_us = board.clock.soon_us(bytes(400), ahead_us=offset_us)
        board.link.stream(board.flat_phases(), t_us)
        board.clock.wait_until(board.clock.on_carrier(t_us) + 100)
        seen = latches_received_from_board(board, since, TraceMode.CRC)
        check_equal(len(seen), 1, f"one latch gives {len(seen)} TRACE")
        latch = seen[0]
        due_us = board.clock.on_carrier(t_us)
        check(latch.t_us == due_us, f"traced at {latch.t_us} µs, due is {due_us} µs")
        status_us = board.clock.unwrap(board.status().last_latch_us)
        check_equal(latch.t_us, status_us, f"TRACE says {latch.t_us} µs, STATUS {status_us} µs")


@case("HG-8.3/2", needs=Feature.TRACE | Feature.CONFIG, evidence=SELF_REPORTED)
def traces_hash_the_drive(board: BoardClient) -> None:
    """the CRC in TRACE is that of N phases and N amplitudes 255, of 8 random drives and a
    sequence
    """
    board.configure(trace_mode=TraceMode.CRC, amplitude_ceiling=99)
    board.arm()
    since = board.link.mark()
    drives = [board.random_registers() for _ in range(8)]
    for registers in drives:
        latch_now(board, board.phases(registers))
    if board.has(Feature.SEQUENCE_PHASES):
        drives += send_phases_to_store(board, 3, frames=3)
        play_out(board, 3, 3)
    got = [latch.crc for latch in latches_received_from_board(board, since, TraceMode.CRC)]
    due = [zlib.crc32(full_client_drive(registers)) for registers in drives]
    wrong = sum(a != b for a, b in zip(got, due, strict=False))
    check(len(got) == len(due), f"{len(got)} of {len(due)} latches are traced")
    check(wrong == 0, f"{wrong} of {len(due)} traced CRCs are not those of the drives sent")


@case("HG-8.4/1", needs=Feature.TRACE_DRIVE | Feature.CONFIG, evidence=SELF_REPORTED)
def traces_every_third(board: BoardClient) -> None:
    """with trace_divider 3 only latches 0, 3, 6 and 9 are traced, and so again after HELLO"""
    board.configure(trace_mode=TraceMode.DRIVE, trace_divider=3)
    for anew in range(2):
        if anew:
            board.hello()
        board.arm()
        since, first = board.link.mark(), board.link.stream_next
        drives = [board.random_registers() for _ in range(10)]
        for registers in drives:
            latch_now(board, board.phases(registers))
        board.link.barrier()
        found = board.link.events(TraceDrive, since)
        got = [event.key.index - first for _, event in found]
        check_equal(got, [0, 3, 6, 9], f"of latches 0 to 9 these are traced: {got}")
        check_equal(
            _trace_events(board, since), 4, "a trace of another kind reports latches as well"
        )
        for number, (_, event) in zip(got, found, strict=True):
            same = event.data == full_client_drive(drives[number])
            check(same, f"TRACE_DRIVE of latch {number} shows another drive than was sent")


@case(
    "HG-8.7/1",
    needs=Feature.TRACE_DRIVE | Feature.SEQUENCE_PHASES | Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def traces_delay_nothing(board: BoardClient) -> None:
    """while traces fill the line all of 400 frames are latched at the highest rate, in time"""
    before = board.status().counters
    _, frames = flood_with_traces(board)
    counted = board.counted_since(before)
    check_equal(counted["latched"], frames, f"{counted['latched']} of {frames} frames were latched")
    times = [board.clock.unwrap(header.time_us) for header, _ in board.link.events(TraceDrive)]
    start = times[0] if times else 0
    off = [t_us for t_us in times if (t_us - start) % board.clock.carrier_us]
    check(not off, "a trace that waits for the line tells another time than that of its latch")


@case(
    "HG-8.7/2",
    needs=Feature.TRACE_DRIVE | Feature.SEQUENCE_PHASES | Feature.CONFIG,
    evidence=SELF_REPORTED,
)
def traces_give_way(board: BoardClient) -> None:
    """traces that find no room are counted in trace_dropped; PONG and PLAYBACK_ENDED get through"""
    before = board.status().counters
    seen, frames = flood_with_traces(board)
    dropped = board.counted_since(before)["trace_dropped"]
    check_equal(
        seen + dropped,
        frames,
        f"{frames} latches: {seen} TRACE_DRIVE came, {dropped} are counted as dropped",
    )
    require(bool(dropped), "this line is fast enough for every trace: none had to give way")

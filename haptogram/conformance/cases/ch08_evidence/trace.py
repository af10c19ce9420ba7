"""HG-8.1, HG-8.2, HG-8.3, HG-8.4, HG-8.7: traces of latches agree with the frames sent."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    DriveKind,
    DriveReply,
    Feature,
    Ping,
    Pong,
    ReadDrive,
    Trace,
    TraceDrive,
    TraceMode,
    TracePlayback,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import trace_modes
from ...client.latching import (
    ask_for_board_latches,
    drive_crc,
    full_client_drive,
    latch_in_time,
    latch_now,
    latch_random,
    latches_received_from_board,
    read_back,
    read_ring,
)
from ...client.playback import flood_with_traces, play_out, send_phases_to_store
from ...outcome import SELF_REPORTED, check, check_equal, require

_KINDS: Final = (Trace, TracePlayback, TraceDrive)
_SEQUENCE: Final = 7
_FRAMES: Final = 3
_OFFSETS_US: Final = (0, 3, 24)
_MOMENTS_US: Final = (-40, 0, 10, 30, 60, 100, 150, 250, 400)  # around the latch that is due
_TRACED: Final = Feature.TRACE | Feature.CONFIG
_READ: Final = _TRACED | Feature.READ_LATCHED
_PLAYED: Final = Feature.CONFIG | Feature.SEQUENCE_PHASES
_FLOODED: Final = _PLAYED | Feature.TRACE_DRIVE


def _trace_events(board: BoardClient, since: int) -> int:
    board.link.barrier()
    return sum(len(board.link.events(kind, since)) for kind in _KINDS)


@case("HG-8.1/1", needs=Feature.CONFIG, evidence=SELF_REPORTED)
def traces_by_its_mode(board: BoardClient) -> None:
    """of 6 latches the trace modes OFF and RING report none, CRC and DRIVE report 6"""
    for mode in trace_modes(board, *TraceMode):
        since = board.arm(trace_mode=mode)
        latch_random(board, 6)
        got, due = _trace_events(board, since), 6 * (mode in (TraceMode.CRC, TraceMode.DRIVE))
        check(got == due, f"trace_mode {mode.name}: {got} events of 6 latches, due are {due}")


@case("HG-8.1/1-divider", needs=_PLAYED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_trace_undivided(board: BoardClient) -> None:
    """in modes CRC and RING every latch of stream and playback is told, whatever trace_divider
    is
    """
    send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
    for mode in trace_modes(board, TraceMode.CRC, TraceMode.RING):
        board.hello()
        since = board.arm(trace_mode=mode, trace_divider=3)
        due = [(0, latch_now(board)) for _ in range(4)]
        play_out(board, _SEQUENCE, _FRAMES)
        due += [(_SEQUENCE, number) for number in range(_FRAMES)]
        seen = latches_received_from_board(board, since, mode)
        got = [(latch.sequence, latch.index) for latch in seen]
        check(got == due, f"mode {mode.name}, trace_divider 3: told are {got}, due {due}")


@case("HG-8.2/1", needs=Feature.CONFIG, evidence=SELF_REPORTED)
def trace_keys_are_unique(board: BoardClient) -> None:
    """40 stream latches across 0xFFFF and two passes of a sequence have unique keys"""
    mode = ask_for_board_latches(board)
    board.arm()
    since, first = board.link.mark(), board.link.stream_next
    latch_random(board, 40)
    due = [(0, 0, first + number) for number in range(40)]
    if board.has(Feature.SEQUENCE_PHASES):
        send_phases_to_store(board, 4, frames=3)
        play_out(board, 4, 3, loops=2)
        due += [(4, loop, index) for loop in range(2) for index in range(3)]
    if mode is TraceMode.RING:
        due = due[-board.identity.trace_ring :]
    seen = latches_received_from_board(board, since, mode)
    got = [(latch.sequence, latch.loop, latch.index) for latch in seen]
    check_equal(len(set(got)), len(got), f"{len(got)} latches have {len(set(got))} keys")
    wrong = [pair for pair in zip(got, due, strict=False) if pair[0] != pair[1]]
    check(got == due, f"keys seen and due: {wrong[:2]}, {len(got)} of {len(due)}")


# --- Times -------------------------------------------------------------------------------------


@case("HG-8.3/1", needs=_TRACED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def traces_tell_the_time(board: BoardClient) -> None:
    """the time in a trace is the carrier period at or after t_apply, as in STATUS"""
    board.arm(trace_mode=TraceMode.CRC)
    for offset_us in (0, 3, 990):
        since = board.link.mark()
        due_us = board.clock.on_carrier(latch_in_time(board, board.flat_phases(), offset_us))
        seen = latches_received_from_board(board, since, TraceMode.CRC)
        check_equal(len(seen), 1, f"one latch gives {len(seen)} TRACE")
        told_us = seen[0].t_us
        check(told_us == due_us, f"traced at {told_us} µs, due is {due_us} µs")
        status_us = board.last_latch_us()
        check_equal(told_us, status_us, f"TRACE says {told_us} µs, STATUS {status_us} µs")


@case("HG-8.3/3", needs=Feature.CONFIG, evidence=SELF_REPORTED)
def evidence_names_one_time(board: BoardClient) -> None:
    """the time of a latch in TRACE or the ring, in a read-back and in STATUS is the same"""
    for mode in trace_modes(board, TraceMode.CRC, TraceMode.RING):
        for offset_us in _OFFSETS_US:
            board.hello()
            since, index = board.arm(trace_mode=mode), board.link.stream_next
            latch_in_time(board, board.flat_phases(), offset_us)
            times = {"STATUS": board.last_latch_us()}
            if board.has(Feature.READ_LATCHED):
                shown = read_back(board).reply
                check(shown.key.index == index, f"read back is {shown.key.index}, not {index}")
                times["DRIVE_REPLY"] = board.clock.unwrap(shown.t_latch_us)
            (latch,) = latches_received_from_board(board, since, mode)
            times[mode.name] = latch.t_us
            check_equal(len(set(times.values())), 1, f"one latch at different times: {times}")


@case("HG-8.3/3-before", needs=Feature.CONFIG | Feature.TRACE_RING, evidence=SELF_REPORTED)
def no_latch_before_time(board: BoardClient) -> None:
    """while a frame waits for its time, neither STATUS nor trace nor read-back knows of its
    latch
    """
    board.arm(trace_mode=TraceMode.RING)
    latch_now(board)
    before = board.status()
    t_us = board.clock.soon_us(bytes(2000), ahead_us=50_000)
    board.link.stream(board.flat_phases(), t_us)
    waiting, ring = board.status(), read_ring(board)
    board.clock.end_exchange()
    for name in ("last_seq", "last_latch_us"):
        got, due = getattr(waiting, name), getattr(before, name)
        check(got == due, f"{name} is {got} before the latch, was {due}")
    got, due = waiting.counters.latched, before.counters.latched
    check_equal(got, due, "latched counts a frame that waits")
    check_equal(ring.next, 1, f"the ring says that latch {ring.next} is next, before latch 1")
    if board.has(Feature.READ_LATCHED):
        index = read_back(board).reply.key.index
        check_equal(index, before.last_seq, "a read-back shows the drive of a frame that waits")
    board.clock.wait_until(t_us + 200)


@case("HG-8.3/1-measured", needs=_READ, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def drives_there_in_time(board: BoardClient) -> None:
    """read-backs right behind the time that the trace tells of a latch show its drive"""
    board.arm(trace_mode=TraceMode.CRC)
    latch_now(board)
    size = len(board.link.request_wire(Ping(0))[0])
    for moment_us in _MOMENTS_US:
        index, since = board.link.stream_next, board.link.mark()
        t_us = board.clock.soon_us(bytes(1000), ahead_us=2000)
        board.link.stream(board.flat_phases(), t_us)
        board.clock.end_exchange()
        ping, _ = board.link.request_wire(Ping(moment_us & 0xFFFF))
        read, _ = board.link.request_wire(ReadDrive(DriveKind.LATCHED, 0, 0xFFFF))
        sent_us = board.clock.device_estimate_us() + board.wire.period_us(2 * size)
        board.wire.idle(max(0, t_us + moment_us - sent_us))
        answers = board.link.exchange(ping, read)
        pong = board.link.reply_in(answers[0], Pong)
        told = board.link.reply_in(answers[1], DriveReply).key.index
        board.clock.wait_until(t_us + 500)
        latches = latches_received_from_board(board, since, TraceMode.CRC)
        (latch,) = (latch for latch in latches if latch.index == index)
        behind_us = board.clock.unwrap(pong.t_rx_us) - latch.t_us
        check(
            behind_us < 0 or told == index,
            f"frame {index} was latched at {latch.t_us} µs, says the trace; a read-back asked for "
            f"{behind_us} µs later shows frame {told}",
        )


# --- Drives ------------------------------------------------------------------------------------


@case("HG-8.3/2", needs=_TRACED, evidence=SELF_REPORTED)
def traces_hash_the_drive(board: BoardClient) -> None:
    """the CRC in TRACE is that of N phases and N amplitudes 255, of 8 random drives and a
    sequence
    """
    since = board.arm(trace_mode=TraceMode.CRC, amplitude_ceiling=99)
    drives = latch_random(board, 8)
    if board.has(Feature.SEQUENCE_PHASES):
        drives += send_phases_to_store(board, 3, frames=3)
        play_out(board, 3, 3)
    got = [latch.crc for latch in latches_received_from_board(board, since, TraceMode.CRC)]
    due = [drive_crc(registers) for registers in drives]
    check(len(got) == len(due), f"{len(got)} of {len(due)} latches are traced")
    check_equal(got, due, "TRACE: CRCs that are not those of the drives sent")


@case("HG-8.4/1", needs=Feature.TRACE_DRIVE | Feature.CONFIG, evidence=SELF_REPORTED)
def traces_every_third(board: BoardClient) -> None:
    """with trace_divider 3 only latches 0, 3, 6 and 9 are traced, and so again after HELLO"""
    board.configure(trace_mode=TraceMode.DRIVE, trace_divider=3)
    for anew in range(2):
        if anew:
            board.hello()
        board.arm()
        since, first = board.link.mark(), board.link.stream_next
        drives = latch_random(board, 10)
        board.link.barrier()
        found = board.link.events(TraceDrive, since)
        got = [event.key.index - first for _, event in found]
        check_equal(got, [0, 3, 6, 9], f"of latches 0 to 9 these are traced: {got}")
        events = _trace_events(board, since)
        check_equal(events, 4, "a trace of another kind reports latches as well")
        for number, (_, event) in zip(got, found, strict=True):
            same = event.data == full_client_drive(drives[number])
            check(same, f"TRACE_DRIVE of latch {number} shows another drive than was sent")


@case("HG-8.7/1", needs=_FLOODED, evidence=SELF_REPORTED)
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


@case("HG-8.7/2", needs=_FLOODED, evidence=SELF_REPORTED)
def traces_give_way(board: BoardClient) -> None:
    """traces that find no room are counted in trace_dropped; PONG and PLAYBACK_ENDED get through"""
    before = board.status().counters
    seen, frames = flood_with_traces(board)
    dropped = board.counted_since(before)["trace_dropped"]
    text = f"{frames} latches: {seen} TRACE_DRIVE came, {dropped} are counted as dropped"
    check_equal(seen + dropped, frames, text)
    require(bool(dropped), "this line is fast enough for every trace: none had to give way")

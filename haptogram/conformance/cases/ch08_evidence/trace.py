"""HG-8.1, HG-8.2, HG-8.3, HG-8.4, HG-8.6, HG-8.7: traces and read-backs of every latch."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, Final

from haptogram_protocol import messages as m

from ...case import Depth, case
from ...client import latching, playback, uploads
from ...client.board_client import BoardClient
from ...client.capabilities import drive_kinds, trace_modes
from ...client.drive_paths import drive_paths, registers_asked_for
from ...client.stream_kinds import stream_kinds
from ...judge.events import judge_division, played_keys
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, named, require
from .read_back import judge_spans

_KINDS: Final = (m.Trace, m.TracePlayback, m.TraceDrive)
_SEQUENCE: Final = 7
_FRAMES: Final = 3
_OFFSETS_US: Final = (0, 3, 24)
_MOMENTS_US: Final = (-40, 0, 10, 30, 60, 100, 150, 250, 400)  # around the latch that is due
_TRACED: Final = m.Feature.TRACE | m.Feature.CONFIG
_READ: Final = _TRACED | m.Feature.READ_LATCHED
_PLAYED: Final = m.Feature.CONFIG | m.Feature.SEQUENCE_PHASES
_FLOODED: Final = _PLAYED | m.Feature.TRACE_DRIVE
_MS: Final = 1000
_CEILING: Final = 100
_SHOWN: Final = m.Feature.CONFIG | m.Feature.READ_LATCHED
_DIMMED: Final = _SHOWN | m.Feature.AMPLITUDE
#: Sequences of one frame each, whose keys differ in nothing else.
_ALIKE: Final = (2, 3, 0x0101)
#: Which of them is played, and whether it is stored anew before; None: a frame of the stream.
_STEPS_WITH_LIKE_KEYS: Final = (
    *((number, False) for number in (2, 3, 0x0101, 2, 2)),
    *((2, True), (3, True), (3, True), None, (3, False), None, (2, True)),
)


def _trace_events(board: BoardClient, since: int) -> int:
    """Return the number of trace events from received frame *since* on."""
    board.link.barrier()
    return sum(len(board.link.events(kind, since)) for kind in _KINDS)


@case("HG-8.1/1", needs=m.Feature.CONFIG, evidence=SELF_REPORTED)
def traces_by_its_mode(board: BoardClient) -> None:
    """of 6 latches the trace modes OFF and RING report none, CRC and DRIVE report 6"""
    for mode in trace_modes(board, *m.TraceMode):
        since = board.arm(trace_mode=mode)
        latching.latch_random(board, 6)
        got, due = _trace_events(board, since), 6 * (mode in (m.TraceMode.CRC, m.TraceMode.DRIVE))
        check(got == due, f"trace_mode {mode.name}: {got} events of 6 latches, due are {due}")


@case("HG-8.1/1-divider", needs=_PLAYED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_trace_undivided(board: BoardClient) -> None:
    """in modes CRC and RING every latch of stream and playback is told, whatever trace_divider
    is
    """
    for mode in trace_modes(board, m.TraceMode.CRC, m.TraceMode.RING):
        board.hello()
        since = board.arm(trace_mode=mode, trace_divider=3)
        due = _latch_and_play(board, 4)
        _judge_traced_keys(board, since, mode, due)


def _latch_and_play(board: BoardClient, number: int) -> list[m.LatchKey]:
    """Latch *number* frames, then play a sequence twice if supported; return what identifies each.

    That is the key of a latch: sequence, loop and index.
    """
    due = [m.LatchKey(0, 0, latching.latch_now(board)) for _ in range(number)]
    if board.has(m.Feature.SEQUENCE_PHASES):
        playback.send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
        playback.play_out(board, _SEQUENCE, _FRAMES, loops=2)
        due += played_keys(_SEQUENCE, _FRAMES, 2)
    return due


def _judge_traced_keys(
    board: BoardClient, since: int, mode: m.TraceMode, due: list[m.LatchKey]
) -> None:
    """FAILED unless the traced latches have the keys *due* (sequence, loop, index), in order.

    They count from received frame *since* on.  In trace mode RING only the last ones are due, as
    many as the ring keeps.
    """
    due = due[-board.identity.trace_ring :] if mode is m.TraceMode.RING else due
    got = [latch.key for latch in latching.latches_received_from_board(board, since, mode)]
    check_equal(got, due, f"mode {mode.name}: keys of {len(due)} latches")


@case("HG-8.2/1", needs=m.Feature.CONFIG, evidence=SELF_REPORTED)
def trace_keys_are_unique(board: BoardClient) -> None:
    """40 stream latches across 0xFFFF and two passes of a sequence have unique keys"""
    mode = latching.ask_for_board_latches(board)
    since = board.arm()
    _judge_traced_keys(board, since, mode, _latch_and_play(board, 40))


# --- Times -------------------------------------------------------------------------------------


@case("HG-8.3/1", needs=_TRACED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def traces_tell_the_time(board: BoardClient) -> None:
    """the time in a trace is the carrier period at or after t_apply, as in STATUS"""
    _judge_latch_times(board, m.TraceMode.CRC, (0, 3, 990))


@case("HG-8.3/3", needs=m.Feature.CONFIG, evidence=SELF_REPORTED)
def evidence_names_one_time(board: BoardClient) -> None:
    """the time of a latch in TRACE or the ring, in a read-back and in STATUS is the same"""
    for mode in trace_modes(board, m.TraceMode.CRC, m.TraceMode.RING):
        _judge_latch_times(board, mode, _OFFSETS_US)


def _judge_latch_times(board: BoardClient, mode: m.TraceMode, offsets_us: Sequence[int]) -> None:
    """FAILED unless all evidence dates a latch to the first carrier boundary from t_apply on.

    Evidence is STATUS, read-back and trace; t_apply is each of *offsets_us* behind a boundary.
    """
    for offset_us in offsets_us:
        board.hello()
        since = board.arm(trace_mode=mode)
        due_us = board.clock.on_carrier(
            latching.latch_in_time(board, board.flat_phases(), offset_us)
        )
        times = {"STATUS": [board.last_latch_us()]}
        if board.has(m.Feature.READ_LATCHED):
            shown_us = latching.read_back(board).reply.t_latch_us
            times["DRIVE_REPLY"] = [board.clock.unwrap(shown_us)]
        latches = latching.latches_received_from_board(board, since, mode)
        times[mode.name] = [latch.t_us for latch in latches]
        check_equal(times, {name: [due_us] for name in times}, "times of one latch")


@case("HG-8.3/3-before", needs=m.Feature.CONFIG | m.Feature.TRACE_RING, evidence=SELF_REPORTED)
def no_latch_before_time(board: BoardClient) -> None:
    """while a frame waits for its time, neither STATUS nor trace nor read-back knows of its
    latch
    """
    board.arm(trace_mode=m.TraceMode.RING)
    latching.latch_now(board)
    before = board.status()
    t_us = board.clock.soon_us(bytes(2000), ahead_us=50_000)
    board.link.stream(board.flat_phases(), t_us)
    waiting, ring = board.status(), latching.read_ring(board)
    board.clock.end_exchange()
    last = before.last_seq
    due = {"last_seq": last, "last_latch_us": before.last_latch_us}
    check_fields(waiting, "before a latch: STATUS_REPLY", **due)
    check_fields(waiting.counters, "a frame that waits", latched=before.counters.latched)
    check_fields(ring, "before latch 1: the ring", next=1)
    if board.has(m.Feature.READ_LATCHED):
        check_fields(
            latching.read_back(board).reply.key, "a frame waits: the key read back", index=last
        )
    board.clock.wait_until(t_us + 200)


@case("HG-8.3/1-measured", needs=_READ, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def drives_there_in_time(board: BoardClient) -> None:
    """read-backs right behind the time that the trace tells of a latch show its drive"""
    board.arm(trace_mode=m.TraceMode.CRC)
    latching.latch_now(board)
    size = len(board.link.request_wire(m.Ping(0))[0])
    for moment_us in _MOMENTS_US:
        index, since = board.link.stream_next, board.link.mark()
        t_us = board.clock.soon_us(bytes(1000), ahead_us=2000)
        board.link.stream(board.flat_phases(), t_us)
        board.clock.end_exchange()
        ping, _ = board.link.request_wire(m.Ping(moment_us & 0xFFFF))
        read, _ = board.link.request_wire(m.ReadDrive(m.DriveKind.LATCHED, 0, 0xFFFF))
        sent_us = board.clock.device_estimate_us() + board.wire.period_us(2 * size)
        board.wire.idle(max(0, t_us + moment_us - sent_us))
        answers = board.link.exchange(ping, read)
        pong = board.link.reply_in(answers[0], m.Pong)
        told = board.link.reply_in(answers[1], m.DriveReply).key.index
        board.clock.wait_until(t_us + 500)
        latches = latching.latches_received_from_board(board, since, m.TraceMode.CRC)
        (latch,) = (latch for latch in latches if latch.index == index)
        behind_us = board.clock.unwrap(pong.t_rx_us) - latch.t_us
        text = f"frame {index}, by its trace: a read-back {behind_us} µs later shows frame {told}"
        check(behind_us < 0 or told == index, text)


# --- Drives ------------------------------------------------------------------------------------


@case("HG-8.3/2", needs=_TRACED, evidence=SELF_REPORTED)
def traces_hash_the_drive(board: BoardClient) -> None:
    """the CRC in TRACE is that of N phases and N amplitudes 255, of 8 random drives and a
    sequence
    """
    since = board.arm(trace_mode=m.TraceMode.CRC, amplitude_ceiling=99)
    drives = latching.latch_random(board, 8)
    if board.has(m.Feature.SEQUENCE_PHASES):
        drives += playback.send_phases_to_store(board, 3, frames=3)
        playback.play_out(board, 3, 3)
    got = [
        latch.crc for latch in latching.latches_received_from_board(board, since, m.TraceMode.CRC)
    ]
    check_equal(got, list(map(latching.drive_crc, drives)), "TRACE: CRC-32 of the drives sent")


@case("HG-8.4/1", needs=m.Feature.TRACE_DRIVE | m.Feature.CONFIG, evidence=SELF_REPORTED)
def traces_every_third(board: BoardClient) -> None:
    """with trace_divider 3 only latches 0, 3, 6 and 9 are traced, and so again after HELLO"""
    board.configure(trace_mode=m.TraceMode.DRIVE, trace_divider=3)
    for anew in range(2):
        if anew:
            board.hello()
        since, first = board.arm(), board.link.stream_next
        drives = latching.latch_random(board, 10)
        judge_division(board, since, [m.LatchKey(0, 0, first + n) for n in range(10)], 3)
        events = _trace_events(board, since)
        check_equal(events, 4, "a trace of another kind reports latches as well")
        for _, event in board.link.events(m.TraceDrive, since):
            number = event.key.index - first
            same = event.data == latching.full_client_drive(drives[number])
            check(same, f"TRACE_DRIVE of latch {number} shows another drive than was sent")


@case("HG-8.7/1", needs=_FLOODED, evidence=SELF_REPORTED)
def traces_delay_nothing(board: BoardClient) -> None:
    """while traces fill the line all of 400 frames are latched at the highest rate, in time"""
    before = board.status().counters
    _, frames = playback.flood_with_traces(board)
    board.check_counted(before, f"{frames} frames", {"latched": frames})
    times = [board.clock.unwrap(header.time_us) for header, _ in board.link.events(m.TraceDrive)]
    start = times[0] if times else 0
    off = [t_us for t_us in times if (t_us - start) % board.clock.carrier_us]
    check(not off, "a trace that waits for the line tells another time than that of its latch")


@case("HG-8.7/2", needs=_FLOODED, evidence=SELF_REPORTED)
def traces_give_way(board: BoardClient) -> None:
    """traces that find no room are counted in trace_dropped; PONG and PLAYBACK_ENDED get through"""
    before = board.status().counters
    seen, frames = playback.flood_with_traces(board)
    dropped = board.counted_since(before)["trace_dropped"]
    text = f"{frames} latches: {seen} TRACE_DRIVE came, {dropped} are counted as dropped"
    check_equal(seen + dropped, frames, text)
    require(bool(dropped), "this line is fast enough for every trace: none had to give way")


def _show_under_ceiling(board: BoardClient, **changes: Any) -> None:
    """Configure ceiling, correction and *changes* so that radiated and latched drives differ."""
    if board.has(m.Feature.AMPLITUDE):
        changes = {"amplitude_ceiling": _CEILING} | changes
    if board.has(m.Feature.CORRECTION):
        uploads.upload_correction(board)
    board.configure(**changes)


@case("HG-8.3/2-paths", needs=_SHOWN, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_trace_shows_the_latched_drive(board: BoardClient) -> None:
    """drives of every format and path, under ceiling and correction: every trace shows the
    latched
    """
    for mode in trace_modes(board):
        _show_under_ceiling(board, trace_mode=mode)
        board.arm()
        for path in drive_paths(board):
            since = board.link.mark()
            due = registers_asked_for(board, path.latch())
            shown = latching.read_back(board)
            name = f"{path.name}, trace {mode.name}"
            if due is not None:
                check_equal((shown.phases, shown.amplitudes), due, f"{name}: drive read back")
            seen = latching.latches_received_from_board(board, since, mode)
            crcs = [latch.crc for latch in seen[-1:]]
            check_equal(crcs, [shown.crc], f"{name}: CRC-32 of the drive read back")


@case("HG-8.6/1-shaded", needs=_SHOWN, evidence=SELF_REPORTED)
def every_span_under_a_ceiling(board: BoardClient) -> None:
    """READ_DRIVE of every span, of drives of every format under ceiling, correction and a ramp"""
    _show_under_ceiling(board)
    for stream in stream_kinds(board):
        message = stream.make()
        codes = registers_asked_for(board, message)
        for kind in drive_kinds(board):
            due = b"".join(codes) if codes and kind is m.DriveKind.LATCHED else None
            with named(stream.name):
                judge_spans(board, kind, message, due)


@case("HG-8.3/2-ramp", needs=_DIMMED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_trace_in_a_ramp(board: BoardClient) -> None:
    """latches in a ramp, and while the ceiling is 0 and changes, are traced as they are latched"""
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=4)
    for mode in trace_modes(board):
        for ceiling in (0, _CEILING):
            # The host is silent, so that the lease's ramp goes on while queued frames are latched.
            board.hello()
            changes = {"amplitude_ceiling": ceiling, "host_timeout_ms": 30, "ramp_ms": 400}
            since, first = board.arm(trace_mode=mode, **changes), board.link.stream_next
            registers = [board.random_registers() for _ in range(3)]
            last_us = board.clock.soon_us(bytes(4 * board.identity.transducers), ahead_us=120 * _MS)
            times = [last_us - 20 * _MS * place for place in (2, 1, 0)]
            frames = zip(map(board.phases, registers), times, strict=True)
            board.link.send(*(board.link.stream_wire(frame, t_us) for frame, t_us in frames))
            board.clock.end_exchange()
            board.wire.idle(max(0, times[-1] + 5 * _MS - board.clock.device_estimate_us()))
            seen = latching.latches_received_from_board(board, since, mode)
            got = [latch.crc for latch in seen if latch.index >= first]
            text = f"trace {mode.name}, ceiling {ceiling}, during a ramp: other drives"
            check_equal(got, list(map(latching.drive_crc, registers)), text)


@case("HG-8.3/2-keys", needs=_PLAYED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_trace_of_like_keys(board: BoardClient) -> None:
    """sequences of one frame, played in turn, stored anew, stream frames between: each has its
    CRC
    """
    for mode in trace_modes(board):
        board.hello()
        since, due = board.arm(trace_mode=mode), []
        stored = {
            number: playback.send_phases_to_store(board, number, frames=1) for number in _ALIKE
        }
        for step in _STEPS_WITH_LIKE_KEYS:
            if step is None:
                latching.latch_random(board, 1)
                continue
            number, is_new = step
            if is_new:
                stored[number] = playback.send_phases_to_store(board, number, frames=1)
            playback.play_out(board, number, 1)
            due.append(latching.drive_crc(stored[number][0]))
            if board.has(m.Feature.READ_LATCHED):
                name = f"trace {mode.name}: sequence {number}, read back"
                check_fields(latching.read_back(board), name, crc=due[-1])
        seen = latching.latches_received_from_board(board, since, mode)
        got = [latch.crc for latch in seen if latch.sequence]
        check_equal(got, due, f"trace {mode.name}: CRC-32 of playbacks of one frame")


@case("HG-8.4/1-restarts", needs=_FLOODED, evidence=SELF_REPORTED)
def every_division_starts_anew(board: BoardClient) -> None:
    """a divider counts the latches of stream and playback from SET_CONFIG and from HELLO on,
    each
    """
    playback.send_phases_to_store(board, _SEQUENCE, frames=2)
    for before, name in itertools.product(range(4), ("SET_CONFIG", "HELLO")):
        board.arm(trace_mode=m.TraceMode.DRIVE, trace_divider=3)
        latching.latch_random(board, before)
        if name == "HELLO":
            board.hello()
        else:
            board.configure(trace_mode=m.TraceMode.DRIVE, trace_divider=3)
        since = board.arm()
        keys = [m.LatchKey(0, 0, latching.latch_now(board)), *played_keys(_SEQUENCE, 2, 3)]
        playback.play_out(board, _SEQUENCE, 2, loops=3)
        judge_division(board, since, keys, 3, f"{before} latches, {name}, ")

"""HG-5.7, HG-5.8, HG-5.9: when a frame is latched, and as a whole."""

from __future__ import annotations

import itertools
import zlib
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Final

from haptogram_protocol import messages as m

from ...case import Depth, case
from ...client import latching, playback
from ...client.board_client import BoardClient
from ...client.stream_kinds import StreamKind, points_of_stream_kind, stream_kinds
from ...judge.witness import JudgeWitness
from ...outcome import SELF_REPORTED, check, check_equal, fail, require

_OFFSETS_US: Final = (0, 1, 7, 12, 24, 25, 26, 49, 1000)
_BURST: Final = 48
_READS: Final = 12
_SEQUENCE: Final = 5
_WINDOW_US: Final = 100_000
_AHEAD_US: Final = 400_000
_TRIES: Final = 3
_LONGEST: Final = 4096
_HELLO: Final = "HELLO of a new session"
#: Requests that switch the output off, beside HELLO of a new session.
_OFFS_OF_BURST: Final[dict[str, m.Message]] = {
    "MUTE": m.Mute(),
    "MUTE without a session": m.Mute(),
    "DISARM": m.Disarm(),
}
#: By how much a moment is missed at most: the host's estimate and the line are rounded.
_ROUNDED_US: Final = range(4)
#: Decorates a case that no wall clock shows soon: no frame arrives there to the microsecond.
_at_the_microsecond: Final = partial(
    case,
    "HG-5.8/3",
    needs=m.Feature.CONFIG,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
    wall_depth=Depth.FULL,
)


@case("HG-5.8/1", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def latches_on_carrier_boundaries(board: BoardClient) -> None:
    """frames for 0 to 49 µs past a carrier period are latched on the next one, none before"""
    for offset_us in _OFFSETS_US:
        board.arm_anew()
        t_us = board.clock.soon_us(bytes(400), ahead_us=offset_us)
        before = board.status().counters.latched
        board.link.stream(board.flat_phases(), t_us)
        early = board.status()
        if (
            board.clock.unwrap(early.last_latch_us) < t_us
            and board.clock.device_estimate_us() < t_us - 500
        ):
            check_equal(early.counters.latched, before, "a frame is latched before its t_apply")
        due_us = board.clock.on_carrier(t_us)
        board.clock.wait_until(due_us + 100)
        late_us = board.last_latch_us() - due_us
        check_equal(late_us, 0, f"t_apply {t_us} µs, due {due_us} µs: latched {late_us:+d} µs off")


@case("HG-5.8/1-immediate", evidence=SELF_REPORTED)
def latches_immediate_frames_on_the_carrier(board: BoardClient) -> None:
    """frames latched as soon as complete lie on multiples of the carrier period"""
    board.arm()
    for _ in range(12):
        t_us = latching.latch_timed(board)
        off_us = t_us % board.clock.carrier_us
        check_equal(off_us, 0, f"latched at {t_us} µs, {off_us} µs past a carrier period")


@case("HG-5.8/2", needs=m.Feature.READ_LATCHED, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def latches_all_elements_at_once(board: BoardClient) -> None:
    """two drives that alternate on every carrier period are never mixed in a read-back or a
    trace
    """
    count = board.identity.transducers
    mode = latching.ask_for_board_latches_if_supported(board, m.Feature.TRACE)
    drives = (bytes([0x08]) * count, bytes([0xF0]) * count)
    since = board.link.mark()
    board.arm()
    for _ in range(3):
        _check_burst(board, drives)
    if mode is not m.TraceMode.OFF:
        seen = {latch.crc for latch in latching.latches_received_from_board(board, since, mode)}
        mixed = seen - set(map(latching.drive_crc, drives))
        check(not mixed, f"traced drives are neither of the two: CRC-32 {mixed}")


def _check_burst(board: BoardClient, drives: tuple[bytes, bytes]) -> None:
    """FAILED if a read-back mixes the two *drives* while frames latch them in turn.

    Each drive is one phase code for all; the frames come at the board's highest rate.
    """
    rate = max(1, board.identity.max_frame_rate_hz)
    step_us = board.clock.on_carrier(-(-1_000_000 // rate))
    number = min(_BURST, board.identity.queue_depth)
    message = [board.phases(drive) for drive in drives]
    start_us = board.clock.soon_us(bytes(number * len(board.link.stream_wire(message[0], seq=0))))
    board.link.send(
        *(board.link.stream_wire(message[n % 2], start_us + n * step_us) for n in range(number))
    )
    board.clock.end_exchange()
    board.wire.idle(max(0, start_us - board.clock.device_estimate_us()))
    since = board.link.mark()
    reads = [
        board.link.request_wire(m.ReadDrive(m.DriveKind.LATCHED, 0, len(drives[0])))
        for _ in range(_READS)
    ]
    board.link.send(*(wire for wire, _ in reads))
    board.link.answer_to(m.ReadDrive.TYPE, reads[0][1], since)
    for _, seq in reads:
        answer = board.link.try_answer(seq, since)
        if answer is None:
            continue  # it found no room on the uplink: HG-9.6/1
        shown = latching.client_drive_of_reply(
            board.link.reply_in(answer, m.DriveReply, m.ReadDrive.TYPE)
        )
        if len(set(shown.phases)) > 1:
            share = shown.phases.count(drives[0][0]), shown.phases.count(drives[1][0])
            fail(f"non-atomic latch: one read-back shows two drives mixed, {share} transducers")
    board.clock.wait_until(start_us + number * step_us)


@case("HG-5.8/3", evidence=SELF_REPORTED)
def latches_once_a_period(board: BoardClient) -> None:
    """of two frames for the same carrier period the later is latched, the other flushed"""
    replace_in_period(board, [2 * (stream_kinds(board)[0],)], m.TraceMode.OFF)
    with board.counting(latched=1):
        latching.latch_now(board)


@case("HG-5.8/4", evidence=SELF_REPORTED)
def counts_latches(board: BoardClient) -> None:
    """25 frames add 25 to latched"""
    board.arm()
    with board.counting(latched=25):
        for _ in range(25):
            latching.latch_now(board)


@case("HG-5.8/5", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def holds_the_last_latched_drive(board: BoardClient) -> None:
    """each of 8 drives stays in the registers until the next is latched"""
    witness = JudgeWitness.of(board)
    board.arm()
    before = board.random_registers()
    latching.latch_now(board, board.phases(before))
    for _ in range(8):
        registers = board.random_registers()
        ahead_us = 10_000 + board.wire.limits.lead_us
        t_us = board.clock.soon_us(bytes(1000), ahead_us=ahead_us)
        since = board.link.mark()
        board.link.stream(board.phases(registers), t_us)
        if witness.mode is None:
            witness.expect(before)
        board.clock.wait_until(t_us + 100)
        witness.expect(registers, since=since)
        before = registers
    board.wire.idle(200_000)
    if witness.mode is None:
        witness.expect(before)


@case("HG-5.9/1", evidence=SELF_REPORTED)
def immediate_frames_flush_the_queue(board: BoardClient) -> None:
    """IMMEDIATE flushes 3 queued frames and is latched at once"""
    board.arm()
    t_us = board.clock.soon_us(board.bytes_of_frames(4), ahead_us=10_000)
    board.require_hold(t_us + 5000 - board.clock.device_us(), "a slow line")
    with board.counting(flushed=3, latched=1):
        latching.queue_frames(board, t_us, 3)
        index = latching.latch_now(board)
        board.check_status("a frame as soon as complete", last_seq=index, queued=0)
        board.clock.wait_until(t_us + 5000)


def _off_in_a_burst(board: BoardClient, name: str) -> bytes:
    """Return the frame called *name* that switches the output off: MUTE, DISARM or HELLO."""
    if name == _HELLO:
        nonce = board.new_nonce()
        request, _ = board.link.request_wire(board.hello_message(nonce), session=0)
        board.link.session, board.link.stream_next = nonce, m.FIRST_STREAM_SEQ
        return request
    session = 0 if name == "MUTE without a session" else board.link.session
    return board.link.request_wire(_OFFS_OF_BURST[name], session=session)[0]


def _flush_in_a_burst(board: BoardClient, name: str) -> bytes:
    """Return the frame called *name* that flushes: IMMEDIATE, PLAY, MUTE, DISARM or HELLO."""
    if name == "IMMEDIATE":
        return board.link.stream_wire(board.flat_phases())
    if name == "PLAY":
        play = playback.play_request(board, _SEQUENCE, loops=1, unattended_ms=500)
        return board.link.request_wire(play, time_us=_time_behind_burst_us(board))[0]
    return _off_in_a_burst(board, name)


def _time_behind_burst_us(board: BoardClient) -> int:
    """Return the device time 0.4 s from now, by when a burst that is sent now has arrived."""
    return board.clock.device_estimate_us() + _AHEAD_US


@case("HG-5.7/6-flushed", needs=m.Feature.CONFIG, evidence=SELF_REPORTED)
def every_flushed_frame_is_not_late(board: BoardClient) -> None:
    """a late frame that is flushed before its latch counts in flushed alone, whatever flushes it"""
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    board.configure(late_window_us=_WINDOW_US)
    plays = ["PLAY"] if board.has(m.Feature.SEQUENCE_PHASES) else []
    names = ["IMMEDIATE", *_OFFS_OF_BURST, *plays, _HELLO]
    for name, _ in itertools.product(names, range(_TRIES)):
        board.arm()
        board.wire.idle(board.clock.carrier_us + 7)  # another moment of the carrier period
        before = board.status().counters
        late = board.link.stream_wire(board.flat_phases(), board.late_time_us(1000))
        board.link.send(late + _flush_in_a_burst(board, name))
        board.clock.wait_latched(0)
        board.clock.end_exchange()
        others = int(name == "IMMEDIATE")
        none = dict.fromkeys(("late", "flushed", "dropped_state", "dropped_late"), 0)
        none["latched"] = others
        due = [none | {"late": 1, "latched": 1 + others}, none | {"flushed": 1}]
        if "MUTE" in name:  # which may have overtaken the frame: HG-3.8/4
            due.append(none | {"dropped_state": 1})
        board.check_counted(before, f"a late frame and {name} at once", *due)
        board.stop()


@case("HG-5.7/6-first", needs=m.Feature.CONFIG, evidence=SELF_REPORTED)
def every_lateness_is_of_one_frame(board: BoardClient) -> None:
    """of a late frame and two for later, sent at once, the late one alone is told and counted
    late
    """
    mode = latching.ask_for_board_latches(board)
    board.arm(late_window_us=_WINDOW_US, trace_mode=mode)
    kinds = stream_kinds(board)
    for kind in kinds if board.thorough else kinds[:1]:
        since, first = board.link.mark(), board.link.stream_next
        with board.counting(late=1, latched=3):
            frames = [kind.make() for _ in range(3)]
            late_us = board.late_time_us(1000, points_of_stream_kind(frames[0]))
            soon_us = latching.time_for_frames(board, frames)
            times = (late_us, soon_us, soon_us + 1000)
            board.link.send(*map(board.link.stream_wire, frames, times))
            board.clock.wait_until(soon_us + 2000)
        late = [
            x.late
            for x in latching.latches_received_from_board(board, since, mode)
            if x.index >= first
        ]
        text = f"{kind.name}, late, and two for later: LATE {late}"
        check_equal(late, [True, False, False], text)


@case("HG-5.8/3-replaced", evidence=SELF_REPORTED)
def every_kind_of_stream_frame_replaces_every_other(board: BoardClient) -> None:
    """of frames of every two kinds for one carrier period the later is latched, the other
    flushed
    """
    kinds = stream_kinds(board)
    mode = latching.ask_for_board_latches_if_supported(board)
    board.arm()
    room = board.identity.queue_depth - 1  # a frame that meets a full queue replaces none
    for turn in range(len(kinds)) if board.thorough else range(1):
        pairs = list(zip(kinds, kinds[turn:] + kinds[:turn], strict=True))
        for first in range(0, len(pairs), room):
            replace_in_period(board, pairs[first : first + room], mode)
    if mode is not m.TraceMode.OFF and board.has(m.Feature.SEQUENCE_PHASES):
        for kind in kinds:
            _replace_by_playback(board, kind, mode)


def _replace_by_playback(board: BoardClient, kind: StreamKind, mode: m.TraceMode) -> None:
    """FAILED unless a playback that flushes a queued frame latches its own stored frames."""
    stored = playback.send_phases_to_store(board, _SEQUENCE, frames=2)
    board.link.stream(kind.make(), _time_behind_burst_us(board))
    since = board.link.mark()
    playback.play_out(board, _SEQUENCE, 2)
    seen = latching.latches_received_from_board(board, since, mode)
    got = [latch.crc for latch in seen if latch.sequence == _SEQUENCE][-2:]
    text = f"PHASES, played, flush {kind.name}: CRC-32 of the drives stored"
    check_equal(got, list(map(latching.drive_crc, stored)), text)


def replace_in_period(
    board: BoardClient, pairs: list[tuple[StreamKind, StreamKind]], mode: m.TraceMode
) -> None:
    """FAILED unless the later frame of each pair for one carrier period is latched, as sent."""
    board.clock.require_times_in_carrier()
    since, number = board.link.mark(), board.link.stream_next
    frames = [(first.make(), second.make()) for first, second in pairs]
    messages = [one for pair in frames for one in pair]
    board.arm_anew()
    with board.counting(latched=len(frames), flushed=len(frames), late=0):
        start_us = latching.time_for_frames(board, messages)
        for place, message in enumerate(messages):
            board.link.stream(message, start_us + 1000 * (place // 2) - (2, 1)[place % 2])
        board.clock.wait_until(start_us + 1000 * len(frames))
    board.check_status(f"{pairs[-1][1].name}, in one period", last_seq=board.link.stream_next - 1)
    if mode is m.TraceMode.OFF:
        return
    alone = {  # points, whose drive is that of the same points alone
        place: latching.latch_now(board, message)
        for place, (_, message) in enumerate(frames)
        if points_of_stream_kind(message)
    }
    seen = {x.index: x.crc for x in latching.latches_received_from_board(board, since, mode)}
    for place, (_, message) in enumerate(frames):
        got = seen.get(number + 2 * place + 1)
        registers = m.drive_codes(message, board.identity.transducers)
        due_crc = seen.get(alone[place]) if registers is None else zlib.crc32(b"".join(registers))
        text = f"CRC-32 of {pairs[place][1].name} that replaces {pairs[place][0].name}"
        check_equal(got, due_crc, text)


@case("HG-5.8/3-pairs", needs=m.Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_pair_of_a_burst_takes_two_periods(board: BoardClient) -> None:
    """frames of every two kinds that come at once, on a latch, with PLAY or STOP: one in a
    period
    """
    mode = latching.ask_for_board_latches(board)
    kinds = stream_kinds(board)
    since = board.arm()
    for first, second in itertools.product(kinds, repeat=2):
        for off_us in _ROUNDED_US:
            wires = board.link.stream_wire(first.make()) + board.link.stream_wire(second.make())
            is_exact = board.wire.is_virtual
            boundary_us = board.clock.soon_us() if is_exact else board.clock.device_us()
            latching.send_to_arrive_at(board, boundary_us + off_us, wires)
            board.clock.wait_latched()
    for kind in kinds:
        for off_us in board.sample(_ROUNDED_US):
            t_us = board.clock.soon_us(bytes(4000))
            board.link.stream(kind.make(), t_us)
            latching.send_to_arrive_at(board, t_us + off_us, board.link.stream_wire(kind.make()))
            board.clock.wait_latched()
    if board.has(m.Feature.SEQUENCE_PHASES):
        _play_and_stop_in_a_burst(board)
    _check_one_latch_a_period(board, since, mode, "pairs of frames on latches")


def _check_one_latch_a_period(board: BoardClient, since: int, mode: m.TraceMode, text: str) -> None:
    """FAILED if two latches from received frame *since* on are under half a carrier period apart.

    *mode* is the trace mode that reports them; *text* begins the finding.
    """
    times = sorted(latch.t_us for latch in latching.latches_received_from_board(board, since, mode))
    near = [b for a, b in itertools.pairwise(times) if 2 * (b - a) < board.clock.carrier_us]
    told = f"of {len(times)} latches {len(near)} are in the carrier period of another"
    check(not near, f"{text}: {told}, at {near[:1]} µs")


@case("HG-5.7/2-immediate", needs=m.Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_frame_behind_an_immediate_one(board: BoardClient) -> None:
    """a frame for before and behind an IMMEDIATE one that waits for its carrier period, every
    kind
    """
    carrier_us = board.clock.carrier_us
    board.clock.require_frames_in_carrier(_LONGEST, 4)
    board.arm(late_window_us=_WINDOW_US)
    for first, second in itertools.product(stream_kinds(board), repeat=2):
        for later_us in (-1000, -1, 0, 1):
            message, behind = first.make(), second.make()
            points = points_of_stream_kind(message)
            both = points + points_of_stream_kind(behind)
            computed_us = (both - points) * board.identity.point_time_us
            if later_us > 0 and 0 < computed_us < carrier_us:
                continue  # it may be ready within the carrier period, or behind it
            ready_us = board.clock.ready_us(board.clock.device_us(), points)
            board.wire.idle((carrier_us // 2 - ready_us) % carrier_us)
            t_us = board.late_time_us(-later_us, points)
            wires = board.link.stream_wire(message) + board.link.stream_wire(behind, t_us)
            before = board.status().counters
            board.link.send(wires)
            board.clock.wait_latched(both)
            due = {"latched": 1, "dropped_order": 1, "flushed": 0}
            if later_us > 0:  # the later one replaces the other, unless it has to be computed first
                latched = 2 if computed_us else 1
                due = {"latched": latched, "dropped_order": 0, "flushed": 2 - latched}
            text = f"{first.name}, IMMEDIATE, and {second.name} for {later_us} µs later"
            board.check_counted(before, text, due)


@_at_the_microsecond(variant="off")
def every_output_off_between_two_latches(board: BoardClient) -> None:
    """a latch, the output off, ARM and a latch at one moment, on a latch: one in a period"""
    mode = latching.ask_for_board_latches(board)
    for _ in board.wire.ways_of_mute():
        _judge_latches_around_offs(board, _OFFS_OF_BURST, mode)


@_at_the_microsecond(variant="session")
def every_session_between_two_latches(board: BoardClient) -> None:
    """a latch, HELLO of a new session, ARM and a latch at one moment, on a latch: one in a
    period
    """
    mode = latching.ask_for_board_latches_if_supported(
        board, m.Feature.TRACE | m.Feature.TRACE_DRIVE
    )
    text = "the trace ring of a new session tells of no latch before it (HG-8.5/1)"
    require(mode is not m.TraceMode.OFF, text)
    _judge_latches_around_offs(board, (_HELLO,), mode)


def _judge_latches_around_offs(board: BoardClient, names: Iterable[str], mode: m.TraceMode) -> None:
    """FAILED if a latch before and one after the output is switched off are in one carrier period.

    Each way of *names* to switch it off is tried, with either latch streamed or played.
    """
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    played = (False, True) if board.has(m.Feature.SEQUENCE_PHASES) else (False,)
    for name, *plays in itertools.product(names, played, played):
        for off_us in board.sample(_ROUNDED_US):
            _judge_latches_around_off(board, name, plays, off_us, mode)


def _judge_latches_around_off(
    board: BoardClient, name: str, plays: Sequence[bool], off_us: int, mode: m.TraceMode
) -> None:
    """Switch the output off between two latches; FAILED if both are in one carrier period.

    *plays*: for each latch, whether it is a playback's.  The burst comes *off_us* after a boundary
    between carrier periods.
    """
    board.hello()
    board.arm()
    since, boundary_us = board.link.mark(), board.clock.soon_us(bytes(4000))
    first, off = _latch_in_a_burst(board, is_played=plays[0]), _off_in_a_burst(board, name)
    arm, _ = board.link.request_wire(m.Arm())
    rest = off + arm + _latch_in_a_burst(board, is_played=plays[1])
    if board.wire.is_virtual:
        board.clock.require_frames_in_carrier(len(rest), 2)
    latching.send_to_arrive_at(board, boundary_us + off_us, first + rest)
    board.clock.wait_latched()
    _check_one_latch_a_period(board, since, mode, f"latch, {name}, ARM, latch at once")
    board.stop()


def _latch_in_a_burst(board: BoardClient, *, is_played: bool) -> bytes:
    """Return the frame that latches at once: of the stream, or PLAY."""
    if not is_played:
        return board.link.stream_wire(board.flat_phases())
    play = playback.play_request(board, _SEQUENCE, loops=1, unattended_ms=2000)
    return board.link.request_wire(play, flags=m.Flag.IMMEDIATE)[0]


def _play_and_stop_in_a_burst(board: BoardClient) -> None:
    """Send PLAY together with a frame, then STOP and a frame at the time of a playback latch."""
    playback.send_phases_that_fit(board, _SEQUENCE, frames=2)
    play = playback.play_request(board, _SEQUENCE, loops=0, unattended_ms=2000)
    for off_us in board.sample(_ROUNDED_US):
        boundary_us = board.clock.soon_us(bytes(2000))
        wires = board.link.stream_wire(board.flat_phases())
        wires += board.link.request_wire(play, flags=m.Flag.IMMEDIATE)[0]
        latching.send_to_arrive_at(board, boundary_us + off_us, wires)
        board.clock.wait_latched()
        board.stop()
        start_us = board.clock.soon_us(bytes(200))
        playback.play_at(board, _SEQUENCE, start_us, loops=0)
        passed_us = board.clock.soon_us(bytes(2000)) - start_us
        latch_us = start_us + -(-passed_us // play.period_us) * play.period_us
        # A board that is left alone for the whole of a long period may mute.
        board.wire.idle(latch_us - board.clock.device_us() - play.period_us // 2)
        board.clock.device_us()
        stop, _ = board.link.request_wire(m.Stop())
        wires = stop + board.link.stream_wire(board.flat_phases())
        latching.send_to_arrive_at(board, latch_us + off_us, wires)
        board.clock.wait_latched()

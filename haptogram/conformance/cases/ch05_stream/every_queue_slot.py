"""HG-3.5, HG-5.2, HG-5.7, HG-5.9: the queue at every format: slots, times ahead, IMMEDIATE."""

from __future__ import annotations

import itertools
import zlib
from typing import Final

from haptogram_protocol import messages as m

from ...case import Depth, case
from ...client import latching, playback
from ...client.board_client import BoardClient
from ...client.drive_paths import registers_asked_for
from ...client.stream_kinds import StreamKind, stream_kinds
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, require
from .every_drop import fill_queue

_WAITING: Final = 3
_STEP_US: Final = 200
_BATCH_US: Final = 300_000  # of the line, for frames that are sent at once
_OVER_US: Final = 15_000  # beyond a power of two
_LOOK_US: Final = 20_000
_AHEAD_US: Final = 400_000
_SEQUENCE: Final = 6
_FRAMES: Final = 3
_PAST_US: Final = 1000
_FAR_US: Final = 5_000_000
_NONE: Final = dict.fromkeys(
    ("accepted", "latched", "late", "flushed", "dropped_order", "dropped_late"), 0
)
_BOTH_LATCHED: Final = _NONE | {"accepted": 2, "latched": 2}
_FIRST_LATCHED: Final = _NONE | {"accepted": 1, "latched": 1}


@case("HG-5.9/1-types", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_format_is_streamed_at_once(board: BoardClient) -> None:
    """IMMEDIATE frames of every message and format flush the queue, whatever their time_us"""
    good = board.flat_phases()
    for kind in stream_kinds(board):
        board.hello()
        board.arm()
        t_us = board.clock.soon_us(bytes(4000), ahead_us=1_000_000)
        for number in range(_WAITING):
            board.link.stream(good, t_us + 1000 * number)
        for past_us in (0, 1, 2**30, -(2**30)):
            waiting = board.status().queued
            with board.counting(flushed=waiting, latched=1, late=0):
                board.link.stream(kind.make(), t_us - past_us, flags=m.Flag.IMMEDIATE)
                board.clock.wait_latched()
        board.check_status(f"{kind.name}, IMMEDIATE", queued=0)


@case("HG-5.9/1-full", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_format_flushes_a_full_queue(board: BoardClient) -> None:
    """IMMEDIATE frames of every message and format flush a full queue, and are latched"""
    depth = board.depth_to_fill()
    board.arm()
    for kind in stream_kinds(board):
        fill_queue(board, depth)
        found = board.status()
        board.clock.end_exchange()
        check_fields(found, f"{depth} frames wait: STATUS_REPLY", queued=depth)
        with board.counting(flushed=depth, latched=1):
            index = latching.latch_now(board, kind.make())
        board.check_status(kind.name, queued=0, last_seq=index)


def _arrival_of_frame_us(board: BoardClient) -> int:
    """Return the device time in µs at which a PHASES frame sent now arrives, by the line's rate."""
    size = len(board.link.stream_wire(board.flat_phases(), 0, seq=0))
    board.clock.device_us()
    return board.clock.device_estimate_us() + board.wire.period_us(size)


# --- Slots and times ---------------------------------------------------------------------------


def _queued_codes_in_turn(kinds: list[StreamKind]) -> list[StreamKind]:
    """Return each PHASES kind of *kinds*, after the DRIVES kinds, which set other amplitudes."""
    graded = [kind for kind in kinds if kind.name == "DRIVES"]
    full = [kind for kind in kinds if kind.name.startswith("PHASES")]
    return [kind for each in full for kind in (*graded, each)]


@case("HG-5.2/6-slots", needs=m.Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_queue_slot_is_written_whole(board: BoardClient) -> None:
    """through every slot of the queue DRIVES, then PHASES of every format: each as it was sent"""
    depth = board.depth_to_fill()
    mode = latching.ask_for_board_latches(board)
    room = board.identity.trace_ring if mode is m.TraceMode.RING else depth
    board.arm()
    for kind in _queued_codes_in_turn(stream_kinds(board)):
        sent: dict[int, int] = {}
        seen: dict[int, int] = {}
        while len(sent) < depth:
            since = board.link.mark()
            _queue_some_stream_frames(board, kind, min(room, depth - len(sent)), sent)
            latches = latching.latches_received_from_board(board, since, mode)
            seen |= {latch.index: latch.crc for latch in latches}
        lost = sent.keys() - seen.keys()
        check(not lost, f"{kind.name}: {len(lost)} of {len(sent)} queued frames are not latched")
        wrong = sum(seen[index] != crc for index, crc in sent.items())
        check_equal(wrong, 0, f"{kind.name}: {wrong} of {len(sent)} drives are not those sent")


def _queue_some_stream_frames(
    board: BoardClient, kind: StreamKind, most: int, sent: dict[int, int]
) -> None:
    """Queue frames of *kind*, wait until they are latched; put the CRC-32 of each into *sent*.

    *sent* is by stream number.  There are *most*, or what the line brings in 0.3 s and the horizon
    holds, one at least.
    """
    messages: list[m.Message] = []
    for _ in range(most):
        messages.append(kind.make())
        if not board.wire.carries(len(messages) * len(messages[0].serialize()), _BATCH_US):
            break
    start_us, step_us = latching.time_for_frames(board, messages), board.clock.on_carrier(_STEP_US)
    wires = []
    within = (board.clock.device_us() + board.identity.max_horizon_us - start_us) // step_us
    messages = messages[: max(1, within)]
    for place, message in enumerate(messages):
        registers = registers_asked_for(board, message)
        assert registers is not None  # codes
        sent[board.link.stream_next] = zlib.crc32(b"".join(registers))
        wires.append(board.link.stream_wire(message, start_us + place * step_us))
    board.link.send(*wires)
    board.clock.wait_until(start_us + len(messages) * step_us)


@case("HG-5.7/4-border", evidence=SELF_REPORTED)
def the_horizon_of_the_queue_is_sharp(board: BoardClient) -> None:
    """frames at the very border of the horizon wait or are dropped, by their margin"""
    horizon_us, judged = board.identity.max_horizon_us, 0
    is_beyond = board.clock.beyond_us(4) is not None
    require(is_beyond, f"a t_apply beyond the horizon of {horizon_us} µs has passed")
    is_within = board.clock.can_be_in_time()
    require(is_within, f"no frame for within the horizon of {horizon_us} µs is ready in time")
    for off_us in range(-3, 4):
        board.arm_anew()
        before = board.status().counters
        t_us = _arrival_of_frame_us(board) + horizon_us + off_us
        board.link.stream(board.flat_phases(), t_us)
        found = board.status()
        if board.config.status_period_ms and not found.margins:
            continue  # a STATUS in between took the margin
        judged += 1
        ahead_us = board.clock.ready_us(found.margin_min_us)  # the margin is of the ready frame
        within, text = ahead_us <= horizon_us, f"a frame {ahead_us} of {horizon_us} µs ahead"
        check_fields(found, f"{text}: STATUS_REPLY", queued=int(within))
        board.check_counted(before, text, {"dropped_future": int(not within)})
    require(judged > 0, "STATUS took every margin")


@case("HG-5.7/4-lengths", evidence=SELF_REPORTED)
def far_frames_wait_in_the_queue(board: BoardClient) -> None:
    """frames due just above every power of two of microseconds wait, up to the horizon"""
    board.arm()
    most_us = board.identity.max_horizon_us - _AHEAD_US
    lengths = [(1 << bits) + _OVER_US for bits in range(16, 31)]
    least_us = board.clock.ready_us(_LOOK_US)
    ahead_us = [us for us in lengths if least_us < us < most_us][: board.identity.queue_depth]
    text = f"max_horizon_us is {board.identity.max_horizon_us}: no wait of 2^16 µs fits"
    require(bool(ahead_us), text)
    size = len(board.link.stream_wire(board.flat_phases(), 0, seq=0))
    first_us = board.clock.ahead_us(ahead_us[0] + board.wire.period_us(len(ahead_us) * size))
    times_us = [first_us - ahead_us[0] + us for us in ahead_us]
    with board.counting(latched=0, flushed=len(ahead_us)):
        board.link.send(*(board.link.stream_wire(board.flat_phases(), t_us) for t_us in times_us))
        board.clock.end_exchange()
        board.wire.idle(_LOOK_US)
        found = board.status()
        board.mute()
        board.clock.require_before(first_us, "a look at frames that wait")
    check_fields(found, "frames wait: STATUS_REPLY", queued=len(ahead_us))


# --- The time in a frame with IMMEDIATE ----------------------------------------------------------


def _times_of_immediate_frames(board: BoardClient) -> dict[str, int]:
    """Return device times in µs that an IMMEDIATE frame carries and the board ignores, by name."""
    now_us = board.clock.device_us()
    return {
        "5 s ahead": now_us + _FAR_US,
        "5 s ago": now_us - _FAR_US,
        "half a turn away": now_us + (1 << 31),
        "0": 0,
        "0xFFFFFFFF": 0xFFFFFFFF,
    }


@case("HG-5.9/1-behind", needs=m.Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def the_time_of_an_immediate_frame_orders_nothing(board: BoardClient) -> None:
    """frames behind one with IMMEDIATE, whatever its time: for the past dropped, for later
    latched
    """
    mode = latching.ask_for_board_latches(board)
    board.arm()
    kinds = stream_kinds(board)
    names = list(_times_of_immediate_frames(board))
    pairs = list(itertools.product(kinds, names))
    if not board.wire.is_virtual:  # each kind and each time once: a host's lead takes its time
        some = zip(itertools.cycle(kinds), itertools.cycle(names), strict=False)
        pairs = list(itertools.islice(some, max(len(kinds), len(names))))
    for number, ((kind, name), is_past) in enumerate(itertools.product(pairs, (False, True))):
        other = kinds[(number // 2 + number) % len(kinds)]
        board.wire.idle(1 + 7 * number % board.clock.carrier_us)  # another part of the period
        since, index = board.link.mark(), board.link.stream_next
        before = board.status().counters
        frames = kind.make(), other.make()
        due_us, rx_us = _send_behind_immediate(board, *frames, name, is_past=is_past)
        seen = {x.index: x.t_us for x in latching.latches_received_from_board(board, since, mode)}
        text = f"{kind.name} with IMMEDIATE and the time {name}, and {other.name} for "
        text += f"{_PAST_US} µs ago" if is_past else f"{due_us} µs"
        latch_us, got_us = seen.get(index), seen.get(index + 1)
        check(latch_us is not None, f"{text}: the first is not latched")
        if not is_past:
            board.check_counted(before, text, _BOTH_LATCHED)
            check_equal(got_us, due_us, f"{text}: the second is latched at {got_us} µs")
            continue
        allowed = [_FIRST_LATCHED | {"dropped_order": 1}]
        # In virtual time a frame that came before the latch of the first met it in the queue.
        if not board.wire.is_virtual or rx_us >= (latch_us or 0):
            allowed.append(_FIRST_LATCHED | {"dropped_late": 1})
        board.check_counted(before, text, *allowed)


def _send_behind_immediate(
    board: BoardClient, first: m.Message, second: m.Message, name: str, *, is_past: bool
) -> tuple[int, int]:
    """Send *first*, IMMEDIATE with the time called *name*, and behind it *second*.

    If *is_past*, *second* was due 1 ms ago.

    Returns
    -------
    due_us, rx_us : int
        Device times: when *second* is due, unless *is_past*; and when both had come.
    """
    later_us = 10 * board.clock.carrier_us
    others = board.flat_phases(), board.flat_phases()  # what is asked meanwhile takes less
    due_us = latching.time_for_frames(board, (first, second, *others), ahead_us=later_us)
    time_us = _times_of_immediate_frames(board)[name]
    at_us = board.clock.device_us() - _PAST_US if is_past else due_us
    board.link.send(
        board.link.stream_wire(first, time_us, flags=m.Flag.IMMEDIATE),
        board.link.stream_wire(second, at_us),
    )
    rx_us = board.clock.unwrap(board.link.ping(0).t_rx_us)
    board.clock.wait_until(due_us + board.clock.lead_us)
    if not board.config.status_period_ms:  # else STATUS may take the margins
        board.check_status("a frame with IMMEDIATE and one without", margins=1)
    return due_us, rx_us


@case("HG-3.5/2-play", needs=m.Feature.CONFIG | m.Feature.SEQUENCE_PHASES, evidence=SELF_REPORTED)
def the_time_of_an_immediate_playback_starts_nothing(board: BoardClient) -> None:
    """PLAY with IMMEDIATE, whatever its time, begins at once, and its frames keep to that start"""
    mode = latching.ask_for_board_latches(board)
    playback.send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
    board.arm()
    period_us = board.clock.on_carrier(playback.period_to_play(board))
    playback.require_time_to_play(board, _FRAMES * period_us)
    play = playback.play_request(board, _SEQUENCE, loops=1, period_us=period_us)
    for number, name in enumerate(_times_of_immediate_frames(board)):
        board.wire.idle(1 + 7 * number % board.clock.carrier_us)
        since, start_us = board.link.mark(), board.clock.device_us()
        time_us = _times_of_immediate_frames(board)[name]
        board.link.call(play, m.PlayReply, flags=m.Flag.IMMEDIATE, time_us=time_us)
        most_us = board.clock.on_carrier(board.clock.ready_us(board.clock.device_us()))
        ended = playback.await_playback_end(board, since, _FRAMES * period_us)
        check_fields(ended, f"PLAY with the time {name}", frames=_FRAMES)
        times = [x.t_us for x in latching.latches_received_from_board(board, since, mode)][
            -_FRAMES:
        ]
        least_us = board.clock.on_carrier(board.clock.ready_us(start_us))
        text = f"PLAY with IMMEDIATE and the time {name}, first due from {least_us} to {most_us} µs"
        check(least_us <= times[0] <= most_us, f"{text}: latches at {times} µs")
        due = [times[0] + period_us * place for place in range(_FRAMES)]
        check_equal(times, due, f"{text}: latches, {period_us} µs apart")
        board.stop()

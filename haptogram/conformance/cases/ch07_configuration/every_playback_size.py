"""HG-7.6, HG-7.8, HG-8.4: playback of every kind and size."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Final

from haptogram_protocol.messages import (
    Feature,
    Flag,
    LatchKey,
    ReadTrace,
    Stop,
    StopReply,
    TraceMode,
    TraceReply,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now, latches_received_from_board
from ...client.playback import (
    await_playback_end,
    play_now,
    play_out,
    send_phases_to_store,
    shortest_period_to_play_us,
)
from ...client.stream_kinds import random_points_to_send
from ...client.uploads import UploadForm, frames_with_room, upload_forms
from ...judge.events import judge_division, played_keys
from ...outcome import SELF_REPORTED, check, check_equal, named, require
from .playback import judge_playback

_TRACED_DRIVES: Final = Feature.TRACE_DRIVE | Feature.SEQUENCE_PHASES | Feature.CONFIG
_RINGS: Final = Feature.TRACE_RING | Feature.CONFIG
_SEQUENCE: Final = 0x0201
#: Frames of the sequence, loops, and period in us (0: the shortest): each wide in one of them.
_SHAPES: Final = (
    (1, 1, 1003),
    (1, 258, 0),
    (3, 100, 0),
    (300, 1, 0),
    (2, 3, 1507),
    (2, 1, 0),
    (2, 1, 70_000),
)
_MOST: Final = 65_537  # frames of a sequence: more than 16 bits
_MANY: Final = 66_000  # frames in a playback: more than 16 bits
_OVER_16_BITS: Final = 66_000  # bytes of a sequence
_SHAPES_MIXED: Final = 5  # different frames of it
_TELLING: Final = 4  # transducers: the codes of fewer may be the same for different points
_BEHIND: Final = 0x0101  # stored behind the other one
_DIVIDER: Final = 260
_MANY_DIVIDER: Final = 40_000  # no divisor of 2^16, and of 16 bits itself
_WINDOW_US: Final = 100_000


def _played_forms(board: BoardClient) -> list[UploadForm]:
    """Return the forms of sequences that the board plays."""
    board.need_any(Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS)
    return [form for form in upload_forms(board, _SEQUENCE) if form.target]


def _random_frame(board: BoardClient, form: UploadForm) -> bytes:
    if form.points:
        return random_points_to_send(board).serialize()
    return board.random.randbytes(form.frame_bytes)


def _shortest_playback_us(board: BoardClient) -> int:
    return shortest_period_to_play_us(board, max(200, board.identity.point_time_us))


@case("HG-7.6/4-sizes", needs=_RINGS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_playback_size_is_played(board: BoardClient) -> None:
    """258 loops, 300 frames, a period of 70 ms, of phases and points: each frame at its time,
    once
    """
    ring = board.identity.trace_ring
    for form, (frames, loops, period_us) in itertools.product(_played_forms(board), _SHAPES):
        if frames * loops > ring or frames > board.identity.max_sequence_frames:
            continue
        board.hello()
        board.configure(trace_mode=TraceMode.RING)
        form.upload(board, b"".join(_random_frame(board, form) for _ in range(frames)))
        period = max(period_us or _shortest_playback_us(board), board.identity.point_time_us)
        name = f"{form.kind.name}, {frames} frames, {loops} loops, {period} µs"
        with named(name):
            judge_playback(board, TraceMode.RING, _SEQUENCE, frames, loops, period)


@case("HG-7.6/4-offsets", needs=_RINGS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def frames_of_long_playback_are_those_stored(board: BoardClient) -> None:
    """two sequences of more than 64 KiB, of phases and points: each frame latched is the one
    stored
    """
    for form in _played_forms(board):
        wanted = _OVER_16_BITS // form.frame_bytes + 2
        for sequence in (_SEQUENCE, _BEHIND):
            stored = _store_mixed_frames(board, replace(form, target=sequence), wanted)
            name = f"{form.kind.name}, {len(stored)} frames of {len(stored[0])} bytes"
            _judge_frames_of_long_playback(board, sequence, stored, name)


@case("HG-7.6/4-most", needs=_RINGS, evidence=SELF_REPORTED, wall_depth=Depth.FULL)
def playback_of_most_frames_begins(board: BoardClient) -> None:
    """a sequence of as many frames as the board takes, 65537 at most, is stored, and its first
    play
    """
    form, stored = _store_most_frames(board)
    since = _begin_traced_playback(board)
    period_us, seen_us = _shortest_playback_us(board), 20_000
    text = f"the last of {len(stored)} frames at most is played within {seen_us} µs"
    require((len(stored) - 1) * period_us > seen_us, text)
    play_now(board, _SEQUENCE, loops=1, period_us=period_us)
    board.wire.idle(seen_us)
    board.link.call(Stop(), StopReply)
    ended = await_playback_end(board, since, 0)
    name = f"{form.kind.name}, {len(stored)} frames"
    check_equal(ended.loops, 0, f"{name}: PLAYBACK_ENDED says {ended.loops} loops within 20 ms")
    seen = latches_received_from_board(board, since, TraceMode.RING)
    got = [(latch.loop, latch.index) for latch in seen]
    due = [(0, index) for index in range(ended.frames)]
    check_equal(got, due[-board.identity.trace_ring :], f"{name}: (loop, index) are {got[:3]}...")
    form.upload(board, stored[0])  # makes room


@case("HG-7.6/4-longest", needs=_RINGS, evidence=SELF_REPORTED, depth=Depth.FULL)
def playback_of_most_frames_is_what_was_stored(board: BoardClient) -> None:
    """a sequence of as many frames as the board takes, 65537 at most, is played to its last
    frame
    """
    form, stored = _store_most_frames(board)
    _judge_frames_of_long_playback(
        board, _SEQUENCE, stored, f"{form.kind.name}, {len(stored)} frames"
    )
    form.upload(board, stored[0])  # makes room


def _store_most_frames(board: BoardClient) -> tuple[UploadForm, list[bytes]]:
    """Store a sequence of the form whose frames are the shortest; return both."""
    form = min(_played_forms(board), key=lambda form: form.frame_bytes)
    return form, _store_mixed_frames(board, form, _MOST)


def _begin_traced_playback(board: BoardClient) -> int:
    board.hello()
    return board.arm(trace_mode=TraceMode.RING)


def _store_mixed_frames(board: BoardClient, form: UploadForm, wanted: int) -> list[bytes]:
    """Store a sequence of *wanted* frames, or as many as find room, of a few shapes; return it."""
    wanted = min(wanted, form.most_frames(board))
    frames = frames_with_room(board, form.kind, form.target, wanted, form.frame_bytes)
    shapes = [_random_frame(board, form) for _ in range(_SHAPES_MIXED)]
    stored = [board.random.choice(shapes) for _ in range(frames)]
    form.upload(board, b"".join(stored))
    return stored


def _judge_frames_of_long_playback(
    board: BoardClient, sequence: int, stored: list[bytes], name: str
) -> None:
    """FAILED unless stored frames that are alike, and only these, are latched alike."""
    since = _begin_traced_playback(board)
    ended = play_out(board, sequence, len(stored), period_us=_shortest_playback_us(board))
    told = (ended.loops, ended.frames)
    check_equal(told, (1, len(stored)), f"{name}: PLAYBACK_ENDED says {told}")
    seen = latches_received_from_board(board, since, TraceMode.RING)
    due_latches = min(len(stored), board.identity.trace_ring)
    check(len(seen) >= due_latches, f"{name}: the ring tells of {len(seen)}, due {due_latches}")
    crcs: dict[bytes, int] = {}
    for latch in seen:
        due = crcs.setdefault(stored[latch.index], latch.crc)
        check_equal(latch.crc, due, f"{name}: frame {latch.index} is latched as another one")
    different = len(set(crcs.values())) == len(crcs)
    text = f"{name}: frames that differ are latched as one"
    check(different or board.identity.transducers < _TELLING, text)


@case("HG-7.8/1-many", needs=Feature.SEQUENCE_PHASES, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def many_playback_frames_are_counted(board: BoardClient) -> None:
    """66000 frames are played and counted: more than 16 bits hold"""
    send_phases_to_store(board, _SEQUENCE, frames=1)
    rings = board.has(Feature.TRACE_RING | Feature.CONFIG)
    if rings:
        board.configure(trace_mode=TraceMode.RING, late_window_us=_WINDOW_US)
    board.arm()
    with board.counting(latched=_MANY):
        event = play_out(
            board, _SEQUENCE, 1, loops=_MANY, period_us=shortest_period_to_play_us(board)
        )
    told = (event.loops, event.frames)
    check_equal(told, (_MANY, _MANY), f"{_MANY} passes of one frame: PLAYBACK_ENDED says {told}")
    if rings:
        _check_playback_in_the_ring(board)


def _check_playback_in_the_ring(board: BoardClient) -> None:
    """FAILED unless the ring numbers the last latches, and one late frame, beyond 16 bits."""
    last = board.link.stream_next
    board.link.stream(board.flat_phases(), board.late_time_us(5000))
    board.clock.wait_latched()
    reply = board.link.call(ReadTrace(_MANY - 2, 9), TraceReply)
    due = [(n, _SEQUENCE, n, 0, 0) for n in (_MANY - 2, _MANY - 1)]
    due.append((_MANY, 0, 0, last, int(Flag.LATE)))
    got = [(r.number, r.key.sequence, r.key.loop, r.key.index, r.flags) for r in reply.records]
    text = "(number, sequence, loop, index, flags) of the last latches"
    check(got == due, f"{text}: {got}, due are {due}")
    check_equal(reply.next, _MANY + 1, f"TRACE_REPLY: next is {reply.next} behind {_MANY} latches")


@case("HG-8.4/1-divider", needs=_TRACED_DRIVES, evidence=SELF_REPORTED)
def wide_dividers_divide_playback(board: BoardClient) -> None:
    """of 600 latches a divider of 260 traces those of 0, 260 and 520, of stream and playback"""
    send_phases_to_store(board, _SEQUENCE, frames=3)
    since = board.arm(trace_mode=TraceMode.DRIVE, trace_divider=_DIVIDER)
    keys = [LatchKey(0, 0, latch_now(board)), *played_keys(_SEQUENCE, 3, 200)]
    play_out(board, _SEQUENCE, 3, loops=200, period_us=_shortest_playback_us(board))
    judge_division(board, since, keys, _DIVIDER)


@case("HG-8.4/1-many", needs=_TRACED_DRIVES, evidence=SELF_REPORTED, wall_depth=Depth.FULL)
def a_divider_divides_many_playback_latches(board: BoardClient) -> None:
    """of 66000 latches since SET_CONFIG those 0 and 40000 are traced by a divider of 40000"""
    send_phases_to_store(board, _SEQUENCE, frames=1)
    since = board.arm(trace_mode=TraceMode.DRIVE, trace_divider=_MANY_DIVIDER)
    play_out(board, _SEQUENCE, 1, loops=_MANY, period_us=shortest_period_to_play_us(board))
    judge_division(board, since, played_keys(_SEQUENCE, 1, _MANY), _MANY_DIVIDER)


@case("HG-8.4/1-kinds", needs=_TRACED_DRIVES, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_playback_latch_counts_in_the_division(board: BoardClient) -> None:
    """latches at once, in time, late and played count alike in a division by 2, 3 and 4"""
    send_phases_to_store(board, _SEQUENCE, frames=1)
    board.clock.require_horizon(board.clock.ready_us(_WINDOW_US // 2))
    for divider in (2, 3, 4):
        board.arm(trace_mode=TraceMode.DRIVE, trace_divider=divider, late_window_us=_WINDOW_US)
        since, before = board.link.mark(), board.status().counters
        keys: list[LatchKey] = []
        for _ in range(3):
            for lateness_us in (None, _WINDOW_US // 20, -_WINDOW_US // 2):
                keys.append(LatchKey(0, 0, board.link.stream_next))
                at_us = None if lateness_us is None else board.late_time_us(lateness_us)
                board.link.stream(board.flat_phases(), at_us)
                board.wire.idle(max(0, -(lateness_us or 0)))
                board.clock.wait_latched()
            keys += played_keys(_SEQUENCE, 1, 1)
            play_out(board, _SEQUENCE, 1)
        counted = board.counted_since(before)["latched"]
        check_equal(counted, len(keys), f"of {len(keys)} frames {counted} are latched")
        judge_division(board, since, keys, divider)

"""HG-3.5, HG-5.9: the time in a frame with IMMEDIATE touches nothing, the frame behind neither."""

from __future__ import annotations

import itertools
from typing import Final

from haptogram_protocol.messages import Feature, Flag, Message, Ping, PlayReply, Pong, Stop

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import ask_for_board_latches, latches_received_from_board
from ...client.playback import (
    await_playback_end,
    period_to_play,
    play_request,
    require_time_to_play,
    send_phases_to_store,
)
from ...client.stream_kinds import points_of_stream_kind, stream_kinds
from ...outcome import SELF_REPORTED, check, check_equal, fail

_SEQUENCE: Final = 6
_FRAMES: Final = 3
_PAST_US: Final = 1000
_COUNTERS: Final = ("accepted", "latched", "late", "flushed", "dropped_order", "dropped_late")
_FAR_US: Final = 5_000_000


def _times_of_immediate_frames(board: BoardClient) -> dict[str, int]:
    """Return times that no board looks at, by their names."""
    now_us = board.clock.device_us()
    return {
        "5 s ahead": now_us + _FAR_US,
        "5 s ago": now_us - _FAR_US,
        "half a turn away": now_us + (1 << 31),
        "0": 0,
        "0xFFFFFFFF": 0xFFFFFFFF,
    }


@case("HG-5.9/1-behind", needs=Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def the_time_of_an_immediate_frame_orders_nothing(board: BoardClient) -> None:
    """frames behind one with IMMEDIATE, whatever its time: for the past dropped, for later
    latched
    """
    mode = ask_for_board_latches(board)
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
        due_us, rx_us, counted = _send_behind_immediate(
            board, kind.make(), other.make(), name, is_past=is_past
        )
        seen = {x.index: x.t_us for x in latches_received_from_board(board, since, mode)}
        text = f"{kind.name} with IMMEDIATE and the time {name}, and {other.name}"
        latch_us = seen.get(index)
        if latch_us is None:
            fail(f"{text}: the first is not latched")
        if not is_past:
            got_us = seen.get(index + 1)
            check_equal(counted, [2, 2, 0, 0, 0, 0], f"{text} for later: {_COUNTERS} {counted}")
            check_equal(got_us, due_us, f"{text} for {due_us} µs: latched at {got_us} µs")
            continue
        allowed = [[1, 1, 0, 0, 1, 0]]
        # In virtual time a frame that came before the latch of the first met it in the queue.
        if not board.wire.is_virtual or rx_us >= latch_us:
            allowed.append([1, 1, 0, 0, 0, 1])
        text += f" for {_PAST_US} µs ago: {_COUNTERS} count {counted}"
        check(counted in allowed, f"{text}, due is {' or '.join(map(str, allowed))}")


def _send_behind_immediate(
    board: BoardClient, first: Message, second: Message, name: str, *, is_past: bool
) -> tuple[int, int, list[int]]:
    """Send a frame with IMMEDIATE and one behind it.

    Returns
    -------
    due_us, rx_us : int
        When the second is due, and a time at which both had come.
    counted : list of int
        What both of them count.
    """
    size = sum(len(one.serialize()) for one in (first, second)) + 80
    points = sum(map(points_of_stream_kind, (first, second)))
    before = board.status().counters
    later_us = 10 * board.clock.carrier_us
    due_us = board.clock.soon_us(bytes(size), points=points, ahead_us=later_us)
    time_us = _times_of_immediate_frames(board)[name]
    at_us = board.clock.device_us() - _PAST_US if is_past else due_us
    board.link.send(
        board.link.stream_wire(first, time_us, flags=Flag.IMMEDIATE),
        board.link.stream_wire(second, at_us),
    )
    rx_us = board.clock.unwrap(board.link.call(Ping(0), Pong).t_rx_us)
    board.clock.wait_until(due_us + board.clock.lead_us)
    after = board.status()
    check_equal(
        after.margins, 1, f"a frame with IMMEDIATE and one without: margins is {after.margins}"
    )
    counted = [(getattr(after.counters, n) - getattr(before, n)) & 0xFFFFFFFF for n in _COUNTERS]
    return due_us, rx_us, counted


@case("HG-3.5/2-play", needs=Feature.CONFIG | Feature.SEQUENCE_PHASES, evidence=SELF_REPORTED)
def the_time_of_an_immediate_playback_starts_nothing(board: BoardClient) -> None:
    """PLAY with IMMEDIATE, whatever its time, begins at once, and its frames keep to that start"""
    mode = ask_for_board_latches(board)
    send_phases_to_store(board, _SEQUENCE, frames=_FRAMES)
    board.arm()
    period_us = board.clock.on_carrier(period_to_play(board))
    require_time_to_play(board, _FRAMES * period_us)
    play = play_request(board, _SEQUENCE, loops=1, period_us=period_us)
    for number, name in enumerate(_times_of_immediate_frames(board)):
        board.wire.idle(1 + 7 * number % board.clock.carrier_us)
        since, start_us = board.link.mark(), board.clock.device_us()
        time_us = _times_of_immediate_frames(board)[name]
        board.link.call(play, PlayReply, flags=Flag.IMMEDIATE, time_us=time_us)
        most_us = board.clock.on_carrier(board.clock.ready_us(board.clock.device_us()))
        ended = await_playback_end(board, since, _FRAMES * period_us)
        check_equal(ended.frames, _FRAMES, f"PLAY with the time {name}: {ended.frames} frames")
        times = [x.t_us for x in latches_received_from_board(board, since, mode)][-_FRAMES:]
        least_us = board.clock.on_carrier(board.clock.ready_us(start_us))
        text = f"PLAY with IMMEDIATE and the time {name}: latches at {times} µs"
        check(
            least_us <= times[0] <= most_us,
            f"{text}; the first is due from {least_us} to {most_us} µs",
        )
        apart = {b - a for a, b in itertools.pairwise(times)}
        check_equal(apart, {period_us}, f"{text}; the period is {period_us} µs")
        board.link.ask(Stop())

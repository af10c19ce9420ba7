"""HG-5.5, HG-5.6, HG-5.7, HG-5.8: numbers of stream frames; which wait, replace and are dropped."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.state import OutputState

from ...case import Depth, case
from ...client import latching, playback
from ...client.board_client import BoardClient
from ...client.stream_kinds import StreamKind, points_of_stream_kind, stream_kinds
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, require
from .every_drop import judge_first_drop

_MAX_LATE_US: Final = 100_000  # HG-7.1
_SEQUENCE: Final = 5
_STEP_US: Final = 1000  # between two carrier periods that frames are sent for
_STALE: Final = 0x0F0F
_UNKNOWN_FLAG: Final = 0x40
_TURNS_AT_WALL: Final = 2
_LONGEST: Final = 4096
_ONE_LATCHED: Final = {"accepted": 1, "flushed": 0, "dropped_order": 0, "latched": 1}


@case("HG-5.5/1", evidence=SELF_REPORTED)
def drops_duplicates_of_the_stream(board: BoardClient) -> None:
    """frames 1 to 32 before the expected one are counted in duplicate and not latched"""
    judge_first_drop(board, "HG-5.5/1")


@case("HG-5.5/2", evidence=SELF_REPORTED)
def counts_stream_gaps(board: BoardClient) -> None:
    """frames ahead by 1 to 65 503, as behind a cut of the line, add to gap and are latched at
    once
    """
    judge_gaps(board, (1, 15, 16, 255, 256, 300, 32_767, 32_768, 40_000, 65_503))


def judge_gaps(board: BoardClient, gaps: Iterable[int]) -> None:
    """FAILED unless the frame behind each gap is latched at once, and both are told as they are."""
    board.arm()
    board.check_status("before the first latch", last_seq=0)
    for gap in gaps:
        board.link.stream_next += gap
        with board.counting(gap=gap, latched=1):
            index = latching.latch_now(board)
        board.check_status(f"a frame behind a gap of {gap}", last_seq=index)


@case("HG-5.6/1", evidence=SELF_REPORTED)
def stream_numbers_are_used_up(board: BoardClient) -> None:
    """frames dropped for type, flags, length, state and time use up their numbers"""
    good = board.flat_phases()
    board.link.stream(good)  # not armed: dropped_state
    board.arm()
    past_us = board.clock.device_us() - 1_000_000
    beyond_us = board.clock.beyond_us(10_000_000)
    dropped = {
        "unknown_type": board.link.stream_raw(0x3B, b""),
        "unsupported": board.link.stream_wire(good, flags=0x40),
        "bad_length": board.link.stream_raw(m.Phases.TYPE, good.serialize() + b"\x00"),
        "dropped_late": board.link.stream_wire(good, past_us),
    }
    if beyond_us is not None:
        at_us = board.clock.device_us() + beyond_us
        dropped["dropped_future"] = board.link.stream_wire(good, at_us)
    with board.counting(latched=1, **dict.fromkeys(dropped, 1)):
        board.link.send(*dropped.values())
        latching.latch_now(board, good)
    used = range(board.link.stream_next - 1 - len(dropped), board.link.stream_next)
    with board.counting(duplicate=len(used)):
        for seq in used:
            board.link.stream(good, seq=seq)


# --- The queue ------------------------------------------------------------------------------------


@case("HG-5.7/1", evidence=SELF_REPORTED)
def drops_stream_frames_unless_armed(board: BoardClient) -> None:
    """frames while DISARMED and MUTED are counted in dropped_state"""
    judge_first_drop(board, "HG-5.7/1")
    with board.counting(dropped_state=1, latched=0):
        latching.latch_now(board)  # MUTED


@case("HG-5.7/2", evidence=SELF_REPORTED)
def queue_keeps_its_order(board: BoardClient) -> None:
    """frames not after the last queued one are counted in dropped_order"""
    board.arm()
    t_us = board.clock.soon_us(board.bytes_of_frames(5), ahead_us=10_000)
    good = board.flat_phases()
    with board.counting(dropped_order=3, latched=2):
        board.link.stream(good, t_us)
        for early_us in (0, 1, 10_000):
            board.link.stream(good, t_us - early_us)
        board.link.stream(good, t_us + 1000)
        board.clock.wait_until(t_us + 2000)


@case("HG-5.7/2-empty", needs=m.Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def an_empty_queue_has_no_order(board: BoardClient) -> None:
    """behind a frame that is latched or flushed the queue is empty: no earlier time is out of
    order
    """
    is_soon = board.clock.ready_us(0) <= _MAX_LATE_US // 2
    require(is_soon, "a frame for a time before the last latch is ready behind the late window")
    board.configure(late_window_us=_MAX_LATE_US)
    flushes = _queue_flushes(board)
    for name in ("a latch", *flushes):
        board.arm()
        t_us = board.clock.soon_us(bytes(4000), ahead_us=10_000)
        board.link.stream(board.flat_phases(), t_us)
        if name in flushes:
            _flush_queue(board, flushes[name], name)
        else:
            board.clock.wait_until(t_us + board.clock.carrier_us)
        earlier_us = min(t_us - 50, board.late_time_us(50))
        before = board.status().counters
        board.link.stream(board.flat_phases(), earlier_us)
        last_us = earlier_us + _MAX_LATE_US - board.clock.ready_us(0)
        board.clock.require_before(last_us, "a late frame", board.clock.device_us())
        board.clock.wait_latched()
        text = f"a frame, {name}, and one for an earlier time"
        due = {"late": 1, "latched": 1, "dropped_order": 0, "dropped_late": 0}
        board.check_counted(before, text, due)


@case("HG-5.7/3", evidence=SELF_REPORTED)
def queue_holds_its_depth(board: BoardClient) -> None:
    """queue_depth frames are queued and latched; one more is dropped_full"""
    depth = board.depth_to_fill()
    board.arm()
    good = board.shortest_stream()
    times = board.times_in_queue(depth + 1)
    with board.counting(dropped_full=1, latched=depth):
        board.link.send(*(board.link.stream_wire(good, t_us) for t_us in times))
        found = board.status()
        board.clock.require_before(times[0], "a look at frames that wait")
        check_fields(found, f"{depth} frames wait: STATUS_REPLY", queued=depth)
        board.clock.wait_until(times[-1])


@case("HG-5.7/4", evidence=SELF_REPORTED)
def queue_has_its_horizon(board: BoardClient) -> None:
    """a frame beyond max_horizon_us is dropped_future, one 1% nearer is queued"""
    horizon_us = board.identity.max_horizon_us
    if board.clock.can_be_in_time():
        board.arm()
        near_us = board.clock.device_us() + horizon_us - horizon_us // 100
        with board.counting(flushed=1):
            board.link.stream(board.flat_phases(), near_us)
            board.link.barrier()
            board.disarm()
    judge_first_drop(board, "HG-5.7/4")


@case("HG-5.7/5", evidence=SELF_REPORTED)
def drops_late_stream_frames(board: BoardClient) -> None:
    """frames 1 µs to 1 s later than late_window_us are dropped_late, none is latched"""
    judge_first_drop(board, "HG-5.7/5")


@case("HG-5.7/7")
def queue_horizon_is_below_half_the_clock(board: BoardClient) -> None:
    """max_horizon_us is less than 2^31"""
    horizon_us = board.identity.max_horizon_us
    check(0 < horizon_us < 2**31, f"max_horizon_us is {horizon_us}")


# --- Several frames for one carrier period -------------------------------------------------------


@dataclass(frozen=True, slots=True)
class PeriodOrder:
    """The order of the times of frames that are sent for one carrier period.

    Attributes
    ----------
    ranks : tuple of int
        Rank of the time of each frame, from 0; equal ranks are equal times.
    """

    ranks: tuple[int, ...]

    @property
    def taken(self) -> list[int]:
        """Places of the frames that are taken: each is for a later time than the one before."""
        newest, found = -1, []
        for place, rank in enumerate(self.ranks):
            if rank > newest:
                newest = rank
                found.append(place)
        return found

    def times_us(self, boundary_us: int, carrier_us: int) -> list[int]:
        """Return the times, the latest on the boundary at which one frame is latched."""
        apart_us = max(1, carrier_us // 4)
        last = max(self.ranks)
        return [boundary_us - apart_us * (last - rank) for rank in self.ranks]


def orders_in_a_period(frames: int) -> list[PeriodOrder]:
    """Return every order of the times of so many frames, equal times among them.

    Examples
    --------
    >>> [order.ranks for order in orders_in_a_period(2)]
    [(0, 0), (0, 1), (1, 0)]
    >>> len(orders_in_a_period(3))
    13
    """
    ranks = itertools.product(range(frames), repeat=frames)
    return [PeriodOrder(some) for some in ranks if set(some) == set(range(max(some) + 1))]


@case("HG-5.7/2-period", evidence=SELF_REPORTED)
def every_order_of_times_in_a_period(board: BoardClient) -> None:
    """two and three frames for one carrier period, in every order of times: the last in order
    is on
    """
    board.clock.require_times_in_carrier()
    mode = latching.ask_for_board_latches_if_supported(board)
    orders = [*orders_in_a_period(2), *orders_in_a_period(3)]
    room = board.identity.queue_depth - 1  # a frame that meets a full queue replaces none
    turns = len(stream_kinds(board)) if board.thorough else 1
    for turn in board.sample(range(turns), _TURNS_AT_WALL):
        for first in range(0, len(orders), room):
            _judge_orders(board, orders[first : first + room], turn, mode)


def _judge_orders(
    board: BoardClient, orders: list[PeriodOrder], turn: int, mode: m.TraceMode
) -> None:
    """FAILED unless, of several frames for one carrier period, the last accepted one is latched.

    Each of *orders* ranks the times of the frames for one period; kinds of frames take turns, from
    the *turn*-th.  If not all fit in the board's horizon, each half is judged alone.
    """
    kinds = itertools.islice(itertools.cycle(stream_kinds(board)), turn, None)
    messages = [[next(kinds).make() for _ in order.ranks] for order in orders]
    every = [message for some in messages for message in some]
    board.arm_anew()
    since, before, due = board.link.mark(), board.status().counters, {}
    start_us, step_us = latching.time_for_frames(board, every), board.clock.on_carrier(_STEP_US)
    last_us = start_us + step_us * len(orders)
    if last_us > board.clock.device_estimate_us() + board.identity.max_horizon_us:
        _judge_shorter_burst(board, orders, turn, mode)
        return
    for place, (order, some) in enumerate(zip(orders, messages, strict=True)):
        times = order.times_us(start_us + step_us * place, board.clock.carrier_us)
        due[board.link.stream_next + order.taken[-1]] = order
        for message, t_us in zip(some, times, strict=True):
            board.link.stream(message, t_us)
    board.clock.wait_until(last_us)
    taken, number = sum(len(order.taken) for order in orders), len(orders)
    rest = {"flushed": taken - number, "dropped_order": len(every) - taken, "latched": number}
    if mode is not m.TraceMode.OFF:
        seen = {latch.index for latch in latching.latches_received_from_board(board, since, mode)}
        lost = [order for index, order in due.items() if index not in seen]
        text = f"frames for one carrier period, their times in the order {lost and lost[0].ranks}"
        check(not lost, f"{text}: the last one in order is not latched")
    text = f"{number} times two or three frames for one period"
    board.check_counted(before, text, {"accepted": taken} | rest)


def _judge_shorter_burst(
    board: BoardClient, orders: list[PeriodOrder], turn: int, mode: m.TraceMode
) -> None:
    """Judge each half of *orders* as :func:`_judge_orders` does, as all do not fit in the horizon.

    NOT-OBSERVED if there is only one.
    """
    require(len(orders) != 1, "no three frames reach this board within its horizon")
    half = len(orders) // 2
    _judge_orders(board, orders[:half], turn, mode)
    _judge_orders(board, orders[half:], turn, mode)


# --- Frames that replace nothing ---------------------------------------------------------------


def _frames_that_replace_nothing(
    board: BoardClient, message: m.Message, t_us: int
) -> Iterator[tuple[str, bytes]]:
    """Yield frames for *t_us* that are dropped for a defect other than their time: name, bytes."""
    payload, kind = message.serialize(), message.TYPE
    yield "a byte too much", board.link.stream_raw(kind, payload + b"\x00", t_us)
    yield "a byte too little", board.link.stream_raw(kind, payload[:-1], t_us)
    if isinstance(message, m.Points) and board.identity.max_points < 250:
        many = message.points[:1] * (board.identity.max_points + 1)
        yield "too many points", board.link.stream_wire(m.Points(many), t_us)
    yield "an unknown flag", board.link.stream_wire(message, t_us, flags=_UNKNOWN_FLAG)
    other, newest = board.link.session ^ _STALE, board.link.stream_next - 1
    seq = board.link.stream_next
    yield "another session", board.link.stream_wire(message, t_us, session=other, seq=seq)
    yield "the newest number", board.link.stream_wire(message, t_us, seq=newest)


@case("HG-5.8/3-defects", evidence=SELF_REPORTED)
def every_defect_replaces_no_frame(board: BoardClient) -> None:
    """frames of every format and defect for the carrier period of a queued one: that one is
    latched
    """
    board.clock.require_times_in_carrier()
    mode = latching.ask_for_board_latches_if_supported(board)
    kinds = stream_kinds(board)
    for kind in kinds if board.thorough else kinds[:1]:
        board.arm_anew()
        since, before, index = board.link.mark(), board.status().counters, board.link.stream_next
        queued, others = kind.make(), [one.make() for one in kinds]
        size = sum(8 * len(message.serialize()) + 200 for message in (queued, *others))
        points = sum(map(points_of_stream_kind, (queued, *others)))
        t_us = board.clock.soon_us(bytes(size), points=points) - 1
        board.link.stream(queued, t_us)
        wrong = 0
        for message in others:
            for _, wire in _frames_that_replace_nothing(board, message, t_us + 1):
                board.link.send(wire)
                wrong += 1
        board.clock.wait_until(t_us + _STEP_US)
        text = f"{kind.name} queued, and {wrong} frames with a defect for its carrier period"
        board.check_counted(before, text, _ONE_LATCHED)
        if mode is not m.TraceMode.OFF:  # its codes are judged by the rules of every frame
            seen = [
                latch.index for latch in latching.latches_received_from_board(board, since, mode)
            ]
            check_equal(seen[-1:], [index], f"{text}: latched")


# --- What a replaced frame leaves behind -------------------------------------------------------


def _play_and_stop(board: BoardClient) -> None:
    """Play the stored sequence without end, and send STOP at once."""
    playback.play_now(board, _SEQUENCE, loops=0)
    board.stop()


def _queue_flushes(board: BoardClient) -> dict[str, Callable[[BoardClient], object]]:
    """Return the actions that flush the queue, by name; a sequence is stored if supported."""
    flushes: dict[str, Callable[[BoardClient], object]] = {
        "MUTE": BoardClient.mute,
        "DISARM": BoardClient.disarm,
        "a new session": BoardClient.hello,
        "IMMEDIATE": latching.latch_now,
    }
    if board.has(m.Feature.SEQUENCE_PHASES):
        playback.send_phases_that_fit(board, _SEQUENCE, frames=2)
        flushes["PLAY and STOP"] = _play_and_stop
    return flushes


def _flush_queue(board: BoardClient, flush: Callable[[BoardClient], object], name: str) -> None:
    """Flush the queue, then arm the board; FAILED if a frame is still queued."""
    board.link.barrier()  # or MUTE may overtake them
    flush(board)
    if board.check_status(f"behind {name}", queued=0).state is not OutputState.ARMED:
        board.arm()


@case("HG-5.7/2-flushed", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_flush_leaves_no_order(board: BoardClient) -> None:
    """frames for one carrier period, flushed by all that flushes: one for before them is in
    order
    """
    flushes = _queue_flushes(board)
    board.arm()
    apart_us = max(1, board.clock.carrier_us // 4)
    for name, flush in flushes.items():
        ahead_us = board.clock.ready_us(2 * playback.PERIOD_US)  # of a frame that flushes
        t_us = board.clock.soon_us(board.bytes_of_frames(5), ahead_us=ahead_us)
        board.require_hold(t_us + _STEP_US - board.clock.device_us(), "a slow line")
        for later_us in (0, apart_us, 2 * apart_us):
            board.link.stream(board.flat_phases(), t_us + later_us - apart_us)
        _flush_queue(board, flush, name)
        before = board.status().counters
        board.link.stream(board.flat_phases(), t_us - 2 * apart_us)
        board.clock.wait_until(t_us + _STEP_US)
        text = f"frames for one carrier period, {name}, and one for before them"
        board.check_counted(before, text, _ONE_LATCHED)


# --- Late frames -------------------------------------------------------------------------------


@case("HG-5.7/6-replaced", needs=m.Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_late_frame_is_replaced_with_its_mark(board: BoardClient) -> None:
    """late frames of every kind, replaced by one in time or late: marked is what is latched"""
    board.clock.require_frames_in_carrier(_LONGEST, 4)
    mode = latching.ask_for_board_latches(board)
    board.arm(trace_mode=mode, late_window_us=_MAX_LATE_US)
    for first, second in itertools.product(stream_kinds(board), repeat=2):
        for is_late in (False, True):
            _judge_late_pair(board, (first, second), mode, is_late=is_late)


def _judge_late_pair(
    board: BoardClient, kinds: tuple[StreamKind, StreamKind], mode: m.TraceMode, *, is_late: bool
) -> None:
    """Send a frame half a carrier period late and one 1/8 of it late or, not *is_late*, early.

    FAILED unless counters and the trace of *mode* show both so; late counts from when it is ready.
    """
    carrier_us = board.clock.carrier_us
    messages = [kind.make() for kind in kinds]
    came_us = board.clock.soon_us(bytes(_LONGEST)) + carrier_us // 5
    points = [points_of_stream_kind(message) for message in messages]
    ready_us = [
        board.clock.ready_us(came_us, points[0]),
        board.clock.ready_us(came_us, sum(points)),
    ]
    times = (
        ready_us[0] - carrier_us // 2,
        ready_us[1] + (-carrier_us if is_late else carrier_us) // 8,
    )
    pairs = zip(times, ready_us, strict=True)
    latches = [board.clock.on_carrier(max(t_us, at_us)) for t_us, at_us in pairs]
    number = board.link.stream_next
    wires = [board.link.stream_wire(*pair) for pair in zip(messages, times, strict=True)]
    since, before = board.link.mark(), board.status().counters
    latching.send_to_arrive_at(board, came_us, b"".join(wires))
    board.clock.wait_until(latches[1] + carrier_us)
    replaced = latches[0] == latches[1]
    due = {"accepted": 2, "flushed": int(replaced), "latched": 2 - replaced}
    due["late"] = (not replaced) + is_late
    text = f"{kinds[0].name}, late, then {kinds[1].name}, {'late' if is_late else 'in time'}"
    board.check_counted(before, text, due)
    seen = latching.latches_received_from_board(board, since, mode)
    marks = [latch.late for latch in seen if latch.index >= number]
    check_equal(marks, [is_late] if replaced else [True, is_late], f"{text}: LATE of the latches")

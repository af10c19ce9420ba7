"""HG-6.11, HG-7.6, HG-9.1, HG-12.1, HG-12.2, HG-12.3: timers of every length.

A length just above 2^b units is judged in some ten milliseconds: a timer that kept b bits of it
ends at once.  In virtual time each of these lengths passes as a whole too; at a wall clock only the
greatest ones do, in a run with ``--full``.
"""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import Feature, Mute, StateChanged, Status
from haptogram_protocol.rules import CONFIG_BOUNDS

from ...case import Case, Depth, case
from ...client.board_client import BoardClient
from ...judge.timers import (
    EXACT_US,
    HOLD,
    LEASE,
    RAMP,
    UNATTENDED,
    TimerKind,
    timer_kinds,
)
from ...outcome import check, check_equal

_MS: Final = 1000
_BITS: Final = (16, 15, 12, 10, 8)
_UNITS_US: Final = (1, 10, 100, 1000)
_OVER_MS: Final = 15  # beyond 2^b units: what is left of a length that wrapped
_LOOK_MS: Final = 60  # how long the board is watched for a timer that wrapped


def wrapping_timer_lengths(least_ms: int, most_ms: int, *, thorough: bool = True) -> list[int]:
    """Return lengths in ms just above every power of two in every unit, within the bounds.

    If not *thorough*: just above 2^16 units.

    Examples
    --------
    >>> wrapping_timer_lengths(20, 500)
    [48, 81, 271, 343, 425]
    """
    edges = {
        -(-(unit_us << bits) // _MS)
        for unit_us in _UNITS_US
        for bits in _BITS[: None if thorough else 1]
    }
    lengths = {edge + _OVER_MS for edge in edges if edge >= 2 * _OVER_MS}
    return sorted(ms for ms in lengths if max(least_ms, 2 * _OVER_MS) <= ms <= most_ms)


def _wrapping_case(
    clause: str, timer: TimerKind, text: str, least_ms: int, depth: Depth = Depth.QUICK
) -> Case:
    title = text.format("just above every power of two of 1 µs to 1 ms do not")

    @case(f"{clause}-lengths", title, needs=timer.needs, depth=depth)
    def body(board: BoardClient) -> None:
        most_ms = timer.most_ms(board)
        for length_ms in wrapping_timer_lengths(least_ms, most_ms, thorough=board.thorough):
            _timer_stays(board, timer, length_ms)

    return body


TIMERS_DO_NOT_WRAP: Final = (
    _wrapping_case("HG-12.2/1", LEASE, "leases {} run out at once", 20),
    _wrapping_case("HG-12.3/1", HOLD, "holds {} run out at once", 1),
    _wrapping_case("HG-7.6/5", UNATTENDED, "unattended times {} run out at once", 1, Depth.DEFAULT),
    _wrapping_case("HG-6.11/2", RAMP, "ramps {} end at once", 60),
)


def _timer_stays(board: BoardClient, timer: TimerKind, length_ms: int) -> None:
    """FAILED if a timer ends within the first tens of milliseconds."""
    since = board.link.mark()
    start_us = timer.start(board, length_ms)
    look_ms = min(_LOOK_MS, length_ms - 2 * _OVER_MS)
    found = board.link.await_event(StateChanged, since, look_ms * _MS)
    if found is not None:
        # By the board's own clock: a host that was held up may have let the whole length pass.
        took_us = board.clock.unwrap(found[0].time_us) - start_us
        reason = found[1].reason.name
        text = f"{timer.name} = {length_ms}: {reason} within {took_us / _MS:.1f} ms"
        check(took_us >= length_ms * _MS - EXACT_US, text)
    board.link.ask(Mute())


@case("HG-9.1/1-lengths", needs=Feature.CONFIG)
def status_timers_of_every_length_do_not_wrap(board: BoardClient) -> None:
    """status periods just above every power of two of 1 µs to 1 ms bring no STATUS at once"""
    for length_ms in wrapping_timer_lengths(board.quick_status_ms, 65_535, thorough=board.thorough):
        set_us = board.clock.device_us()
        board.configure(status_period_ms=length_ms)
        since = board.link.mark()
        look_us = min(_LOOK_MS, length_ms - 2 * _OVER_MS) * _MS
        board.wire.idle(look_us)  # a host that is held up sees what came in its time, too
        times = [board.clock.unwrap(h.time_us) for h, _ in board.link.events(Status, since)]
        got = sum(t_us - set_us < look_us for t_us in times)
        check_equal(
            got, 0, f"status_period_ms = {length_ms}: {got} STATUS within {look_us // _MS} ms"
        )


@case("HG-6.11/5-timers", needs=Feature.CONFIG | Feature.AMPLITUDE, depth=Depth.DEFAULT)
def every_timer_ends_in_a_ramp(board: BoardClient) -> None:
    """hold, lease and unattended time each mute after their ramp, with their reason, counted
    once
    """
    ramp_ms = 270  # of other lengths: HG-6.11/5-pairs
    length_ms = board.clock.timer_ms(60, 2 * board.identity.transducers + 200)
    for timer in timer_kinds(board):
        if timer is RAMP:
            continue
        since = board.link.mark()
        with board.counting(timeouts=1):
            start_us = timer.start(board, length_ms, ramp_ms=ramp_ms)
            name = f"{timer.reason.name}, ramp"
            timer.judge(board, since, start_us, length_ms + ramp_ms, name)


# --- Whole lengths -----------------------------------------------------------------------------


@case("HG-12.1/1-whole", needs=Feature.CONFIG, depth=Depth.DEFAULT, wall_depth=Depth.FULL)
def timers_pass_their_whole_lengths(board: BoardClient) -> None:
    """lease, hold, ramp and unattended time of lengths up to the greatest end within 1 ms"""
    for timer in timer_kinds(board):
        lengths = [most_ms := timer.most_ms(board)]
        if board.wire.is_virtual:
            least_ms = board.clock.timer_ms(CONFIG_BOUNDS.get(timer.name, (1, most_ms))[0])
            lengths = [*wrapping_timer_lengths(least_ms, most_ms), most_ms]
        for length_ms in lengths:
            since = board.link.mark()
            start_us = timer.start(board, length_ms)
            name = f"{timer.name} = {length_ms}"
            timer.judge(board, since, start_us, length_ms, name)


@case("HG-9.1/1-whole", needs=Feature.CONFIG, depth=Depth.DEFAULT, wall_depth=Depth.FULL)
def status_timers_pass_their_whole_lengths(board: BoardClient) -> None:
    """status periods of every length up to the greatest pass as a whole"""
    lengths = [65_535]
    if board.wire.is_virtual:
        lengths = [*wrapping_timer_lengths(board.quick_status_ms, lengths[0]), *lengths]
    for length_ms in lengths:
        before_us = board.clock.device_us()
        board.configure(status_period_ms=length_ms)
        since, start_us = board.link.mark(), board.clock.device_us()
        name = f"status_period_ms = {length_ms}"
        header, _ = board.due_event(Status, since, (length_ms + 1000) * _MS, name)
        took_us = board.clock.unwrap(header.time_us) - start_us
        late_us = took_us - length_ms * _MS
        text = f"status_period_ms = {length_ms}: STATUS after {took_us / _MS:.1f} ms"
        check(before_us - start_us - EXACT_US <= late_us <= EXACT_US, text)

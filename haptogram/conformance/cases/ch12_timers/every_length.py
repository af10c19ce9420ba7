"""HG-6.11, HG-7.6, HG-9.1, HG-12.1, HG-12.2, HG-12.3: timers of every length.

A length just above 2^b units is judged in some ten milliseconds: a timer that kept b bits of it
ends at once.  In virtual time each of these lengths passes as a whole too; at a wall clock only the
greatest ones do, in a run with ``--full``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from haptogram_protocol.messages import Feature, Mute, StateChanged, Status
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...client.playback import play_now, send_phases_that_fit
from ...judge.timers import EXACT_US, judge_mute_time, judged_mute_by_timer
from ...outcome import check, check_equal

_MS: Final = 1000
_BITS: Final = (16, 15, 12, 10, 8)
_UNITS_US: Final = (1, 10, 100, 1000)
_OVER_MS: Final = 15  # beyond 2^b units: what is left of a length that wrapped
_LOOK_MS: Final = 60  # how long the board is watched for a timer that wrapped
_LONGEST_WALL_MS: Final = 70_000  # of a timer that is awaited at a wall clock
_PERIOD_US: Final = 4_000_000  # of a playback that is left alone
_SEQUENCE: Final = 2


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


def _timer_stays(
    board: BoardClient, name: str, start: Callable[[], object], length_ms: int
) -> None:
    """FAILED if the timer that *start* starts ends within the first tens of milliseconds."""
    since, start_us = board.link.mark(), board.clock.device_us()
    start()
    look_ms = min(_LOOK_MS, length_ms - 2 * _OVER_MS)
    found = board.link.await_event(StateChanged, since, look_ms * _MS)
    if found is not None:
        # By the board's own clock: a host that was held up may have let the whole length pass.
        took_us = board.clock.unwrap(found[0].time_us) - start_us
        reason = found[1].reason.name
        text = f"{name} = {length_ms}: {reason} within {took_us / _MS:.1f} ms"
        check(took_us >= length_ms * _MS - EXACT_US, text)
    board.link.ask(Mute())


@case("HG-12.2/1-lengths", needs=Feature.CONFIG)
def leases_of_every_length_do_not_wrap(board: BoardClient) -> None:
    """leases just above every power of two of 1 µs to 1 ms do not run out at once"""
    for length_ms in wrapping_timer_lengths(20, 10_000, thorough=board.thorough):
        board.configure(host_timeout_ms=length_ms)
        _timer_stays(board, "host_timeout_ms", board.arm, length_ms)


@case("HG-12.3/1-lengths", needs=Feature.CONFIG)
def holds_of_every_length_do_not_wrap(board: BoardClient) -> None:
    """holds just above every power of two of 1 µs to 1 ms do not run out at once"""
    for length_ms in wrapping_timer_lengths(1, 10_000, thorough=board.thorough):
        board.arm(hold_ms=length_ms)
        _timer_stays(board, "hold_ms", lambda: latch_now(board), length_ms)


@case("HG-7.6/5-lengths", needs=Feature.CONFIG | Feature.SEQUENCE_PHASES, depth=Depth.DEFAULT)
def unattended_times_of_every_length_do_not_wrap(board: BoardClient) -> None:
    """unattended times just above every power of two of 1 µs to 1 ms do not run out at once"""
    send_phases_that_fit(board, _SEQUENCE, frames=2)
    for length_ms in wrapping_timer_lengths(
        1, board.identity.max_unattended_ms, thorough=board.thorough
    ):

        def play(length_ms: int = length_ms) -> None:
            board.arm()
            play_now(board, _SEQUENCE, loops=0, unattended_ms=length_ms)

        _timer_stays(board, "unattended_ms", play, length_ms)


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


@case("HG-6.11/2-lengths", needs=Feature.CONFIG | Feature.AMPLITUDE)
def timer_ramps_of_every_length_do_not_wrap(board: BoardClient) -> None:
    """ramps just above every power of two of 1 µs to 1 ms do not end at once"""
    for length_ms in wrapping_timer_lengths(60, 2000, thorough=board.thorough):
        board.arm(ramp_ms=length_ms, hold_ms=5)
        _timer_stays(board, "ramp_ms", lambda: latch_now(board), length_ms - 10)


@case("HG-6.11/5-timers", needs=Feature.CONFIG | Feature.AMPLITUDE, depth=Depth.DEFAULT)
def every_timer_ends_in_a_ramp(board: BoardClient) -> None:
    """hold, lease and unattended time each mute after their ramp, with their reason, counted
    once
    """
    ramp_ms = 270  # of other lengths: HG-6.11/5-pairs
    length_ms = board.clock.timer_ms(60, 2 * board.identity.transducers + 200)
    for reason, changes in (
        (MuteReason.HOLD_EXPIRED, {"hold_ms": length_ms}),
        (MuteReason.HOST_SILENT, {"host_timeout_ms": length_ms}),
        (MuteReason.UNATTENDED, {"host_timeout_ms": 40}),
    ):
        plays = reason is MuteReason.UNATTENDED
        if plays and not board.has(Feature.SEQUENCE_PHASES):
            continue
        if plays:
            send_phases_that_fit(board, _SEQUENCE, frames=2)
        board.arm(ramp_ms=ramp_ms, **changes)
        with board.counting(timeouts=1):
            since = board.link.mark()
            if plays:
                play_now(board, _SEQUENCE, loops=0, unattended_ms=length_ms)
            else:
                latch_now(board)
            start_us = board.clock.device_us()
            if reason is MuteReason.HOLD_EXPIRED:
                start_us = board.last_latch_us()
            header, _ = judged_mute_by_timer(
                board, since, (400 + length_ms + ramp_ms) * _MS, reason
            )
            judge_mute_time(board, start_us, header, length_ms + ramp_ms, f"{reason.name}, ramp")


# --- Whole lengths -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class TimerKind:
    """A timer that mutes.

    Attributes
    ----------
    name : str
        Name of its length.
    reason : MuteReason
        Reason of the mute at its end.
    least_ms : int
        Least length.
    most_ms : callable
        Returns the greatest length on a board.
    start : callable
        Starts it on a DISARMED board, with a length in ms; returns the device time of its start.
    needs : Feature
        Capabilities that it needs.
    """

    name: str
    reason: MuteReason
    least_ms: int
    most_ms: Callable[[BoardClient], int]
    start: Callable[[BoardClient, int], int]
    needs: Feature = Feature.CONFIG


def _start_lease(board: BoardClient, length_ms: int) -> int:
    board.arm(host_timeout_ms=length_ms)
    return board.clock.device_us()


def _start_hold(board: BoardClient, length_ms: int) -> int:
    board.arm(hold_ms=length_ms)
    latch_now(board)  # before it the hold does not run (HG-12.2/2)
    return board.last_latch_us()


def _start_unattended(board: BoardClient, length_ms: int) -> int:
    board.configure(host_timeout_ms=50, hold_ms=10_000)
    send_phases_that_fit(board, _SEQUENCE, frames=2)
    board.arm()
    play_now(board, _SEQUENCE, loops=0, unattended_ms=length_ms, period_us=_PERIOD_US)
    return board.clock.device_us()


def _start_ramp_of_lease(board: BoardClient, length_ms: int) -> int:
    board.arm(ramp_ms=length_ms, hold_ms=5)
    latch_now(board)
    return board.last_latch_us() + 5 * _MS


def _longest_unattended_time(board: BoardClient) -> int:
    most_ms = board.identity.max_unattended_ms
    return min(most_ms, 1 << 21 if board.wire.is_virtual else _LONGEST_WALL_MS)


_TIMERS: Final = (
    TimerKind("host_timeout_ms", MuteReason.HOST_SILENT, 20, lambda _: 10_000, _start_lease),
    TimerKind("hold_ms", MuteReason.HOLD_EXPIRED, 1, lambda _: 10_000, _start_hold),
    TimerKind(
        "ramp_ms",
        MuteReason.HOLD_EXPIRED,
        1,
        lambda _: 2000,
        _start_ramp_of_lease,
        Feature.CONFIG | Feature.AMPLITUDE,
    ),
    TimerKind(
        "unattended_ms",
        MuteReason.UNATTENDED,
        1,
        _longest_unattended_time,
        _start_unattended,
        Feature.CONFIG | Feature.SEQUENCE_PHASES,
    ),
)


@case("HG-12.1/1-whole", needs=Feature.CONFIG, depth=Depth.DEFAULT, wall_depth=Depth.FULL)
def timers_pass_their_whole_lengths(board: BoardClient) -> None:
    """lease, hold, ramp and unattended time of lengths up to the greatest end within 1 ms"""
    for timer in _TIMERS:
        if not board.has(timer.needs):
            continue
        most_ms = timer.most_ms(board)
        lengths = [most_ms]
        if board.wire.is_virtual:
            least_ms = board.clock.timer_ms(timer.least_ms)
            lengths = [*wrapping_timer_lengths(least_ms, most_ms), most_ms]
        for length_ms in lengths:
            since = board.link.mark()
            start_us = timer.start(board, length_ms)
            header, _ = judged_mute_by_timer(board, since, (length_ms + 1000) * _MS, timer.reason)
            judge_mute_time(board, start_us, header, length_ms, f"{timer.name} = {length_ms}")


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
        check(
            before_us - start_us - EXACT_US <= late_us <= EXACT_US,
            f"status_period_ms = {length_ms}: STATUS after {took_us / _MS:.1f} ms",
        )

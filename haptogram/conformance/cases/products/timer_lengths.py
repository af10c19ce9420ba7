"""HG-6.7, HG-6.10, HG-6.11, HG-7.6, HG-9.1, HG-12.1, HG-12.2, HG-12.3: timers.

A length just above 2^b units is judged in some ten milliseconds: a timer that kept b bits of it
ends at once.  Whole lengths are the business of a run with ``--full``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

from haptogram_protocol.messages import Feature, Mute, PlaybackEnded, StateChanged, Status
from haptogram_protocol.state import MuteReason, OutputState

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...client.playback import play_now, store_phases
from ...client.stream_kinds import stream_kinds, valid_requests
from ...judge.timers import check_mute_time, muted_by_timer
from ...outcome import check, fail, inconclusive, not_observed
from .stream_types import DROPS, Drop, fill_queue

_MS: Final = 1000
_BITS: Final = (16, 15, 12, 10, 8)
_UNITS_US: Final = (1, 10, 100, 1000)
_OVER_MS: Final = 15  # beyond 2^b units: what is left of a length that wrapped
_LOOK_MS: Final = 60  # how long the board is watched for a timer that wrapped
_LEASE_MS: Final = 240
_STEP_MS: Final = 170  # between frames that each have to renew that lease
_TRIES: Final = 3
_SEQUENCE: Final = 2


def wrapping_lengths(least_ms: int, most_ms: int, *, thorough: bool = True) -> list[int]:
    """Return lengths in ms just above every power of two in every unit, within the bounds.

    If not *thorough*: just above 2^16 units.

    Examples
    --------
    >>> wrapping_lengths(20, 500)
    [48, 81, 271, 343, 425]
    """
    edges = {
        -(-(unit_us << bits) // _MS)
        for unit_us in _UNITS_US
        for bits in _BITS[: None if thorough else 1]
    }
    lengths = {edge + _OVER_MS for edge in edges if edge >= 2 * _OVER_MS}
    return sorted(ms for ms in lengths if max(least_ms, 2 * _OVER_MS) <= ms <= most_ms)


def _stays(board: BoardClient, name: str, start: Callable[[], object], length_ms: int) -> None:
    """FAILED if the timer that *start* starts ends within the first tens of milliseconds."""
    since = board.link.mark()
    start()
    look_ms = min(_LOOK_MS, length_ms - 2 * _OVER_MS)
    found = board.link.await_event(StateChanged, since, look_ms * _MS)
    if found is not None:
        fail(f"{name} = {length_ms}: {found[1].reason.name} within {look_ms} ms")
    board.link.ask(Mute())


@case(
    "HG-12.2/1",
    "leases just above every power of two of 1 us to 1 ms do not run out at once",
    variant="lengths",
    needs=Feature.CONFIG,
)
def leases_do_not_wrap(board: BoardClient) -> None:
    for length_ms in wrapping_lengths(20, 10_000, thorough=board.thorough):
        board.configure(host_timeout_ms=length_ms)
        _stays(board, "host_timeout_ms", board.arm, length_ms)


@case(
    "HG-12.3/1",
    "holds just above every power of two of 1 us to 1 ms do not run out at once",
    variant="lengths",
    needs=Feature.CONFIG,
)
def holds_do_not_wrap(board: BoardClient) -> None:
    for length_ms in wrapping_lengths(1, 10_000, thorough=board.thorough):
        board.configure(hold_ms=length_ms)
        board.arm()
        _stays(board, "hold_ms", lambda: latch_now(board, board.flat_phases()), length_ms)


@case(
    "HG-7.6/5",
    "unattended times just above every power of two of 1 us to 1 ms do not run out at once",
    variant="lengths",
    needs=Feature.CONFIG | Feature.SEQUENCE_PHASES,
)
def unattended_does_not_wrap(board: BoardClient) -> None:
    store_phases(board, _SEQUENCE, frames=2)
    for length_ms in wrapping_lengths(1, board.identity.max_unattended_ms, thorough=board.thorough):

        def play(length_ms: int = length_ms) -> None:
            board.arm()
            play_now(board, _SEQUENCE, loops=0, unattended_ms=length_ms)

        _stays(board, "unattended_ms", play, length_ms)


@case(
    "HG-9.1/1",
    "status periods just above every power of two of 1 us to 1 ms bring no STATUS at once",
    variant="lengths",
    needs=Feature.CONFIG,
)
def status_periods_do_not_wrap(board: BoardClient) -> None:
    for length_ms in wrapping_lengths(board.quick_status_ms, 65_535, thorough=board.thorough):
        board.configure(status_period_ms=length_ms)
        since = board.link.mark()
        board.wire.idle(min(_LOOK_MS, length_ms - 2 * _OVER_MS) * _MS)
        got = len(board.link.events(Status, since))
        check(got == 0, f"status_period_ms = {length_ms}: {got} STATUS within {_LOOK_MS} ms")


@case(
    "HG-6.11/2",
    "ramps just above every power of two of 1 us to 1 ms do not end at once",
    variant="lengths",
    needs=Feature.CONFIG | Feature.AMPLITUDE,
)
def ramps_do_not_wrap(board: BoardClient) -> None:
    for length_ms in wrapping_lengths(60, 2000, thorough=board.thorough):
        board.configure(ramp_ms=length_ms, hold_ms=5)
        board.arm()
        _stays(board, "ramp_ms", lambda: latch_now(board, board.flat_phases()), length_ms - 10)


@case(
    "HG-6.11/5",
    "hold, lease and unattended time each mute after their ramp, with their reason, counted once",
    variant="timers",
    needs=Feature.CONFIG | Feature.AMPLITUDE,
    depth=Depth.DEFAULT,
)
def every_timer_ramps(board: BoardClient) -> None:
    for reason, changes in (
        (MuteReason.HOLD_EXPIRED, {"hold_ms": 90}),
        (MuteReason.HOST_SILENT, {"host_timeout_ms": 90}),
        (MuteReason.UNATTENDED, {"host_timeout_ms": 40}),
    ):
        plays = reason is MuteReason.UNATTENDED
        if plays and not board.has(Feature.SEQUENCE_PHASES):
            continue
        if plays:
            store_phases(board, _SEQUENCE, frames=2)
        for ramp_ms in (40, 270):
            board.configure(ramp_ms=ramp_ms, **changes)
            board.arm()
            with board.counting(timeouts=1):
                since = board.link.mark()
                if plays:
                    play_now(board, _SEQUENCE, loops=0, unattended_ms=90)
                else:
                    latch_now(board, board.flat_phases())
                start_us = board.clock.device_us()
                if reason is MuteReason.HOLD_EXPIRED:
                    start_us = board.clock.unwrap(board.status().last_latch_us)
                header, _ = muted_by_timer(board, since, (400 + ramp_ms) * _MS, reason)
                check_mute_time(board, start_us, header, 90 + ramp_ms, f"{reason.name}, ramp")


# --- What starts a timer anew, and what does not -----------------------------------------------


@case(
    "HG-6.10/1",
    "dropped frames of every kind and every request leave the hold as it runs; only latches do not",
    variant="types",
    needs=Feature.CONFIG,
)
def nothing_else_restarts_the_hold(board: BoardClient) -> None:
    drops = [drop for drop in DROPS if drop.armed and drop.queued >= 0]
    groups: list[Drop | None] = [None, *sorted(drops, key=lambda drop: drop.queued)]
    hold_ms = _hold_ms(board)
    took_us = _hold_after(board, groups, hold_ms)
    if abs(took_us - hold_ms * _MS) <= _MS:
        return
    for group in groups:  # which one was it?
        took_us = _hold_after(board, [group], hold_ms)
        name = "requests" if group is None else f"frames {group.summary}"
        check(
            abs(took_us - hold_ms * _MS) <= _MS,
            f"{name}: muted {took_us / _MS:.1f} ms after the latch, hold_ms is {hold_ms}",
        )
    fail(f"muted {took_us / _MS:.1f} ms after the latch, hold_ms is {hold_ms}")


def _hold_ms(board: BoardClient) -> int:
    """Return a hold that is longer than everything that is sent within it takes on the line."""
    sizes = sum(len(kind.make().serialize()) + 20 for kind in stream_kinds(board))
    return min(7000, 700 + board.wire.line_us(8 * len(DROPS) * sizes) // _MS)


def _hold_after(board: BoardClient, groups: list[Drop | None], hold_ms: int) -> int:
    """Return the time from a latch to the mute by the hold, with *groups* sent in between."""
    board.hello()
    board.configure(hold_ms=hold_ms)
    board.arm()
    since = board.link.mark()
    latch_now(board, board.flat_phases())
    start_us = board.clock.unwrap(board.status().last_latch_us)
    board.wire.idle(30 * _MS)
    for group in groups:
        if group is None:
            _ask_all(board)
        else:
            _send_all(board, group, (hold_ms + 1000) * _MS)
    if board.clock.device_us() - start_us > (hold_ms - 20) * _MS:
        inconclusive("the line or the host is too slow to send everything within the hold")
    header, _ = muted_by_timer(board, since, 3 * hold_ms * _MS, MuteReason.HOLD_EXPIRED)
    return board.clock.unwrap(header.time_us) - start_us


def _send_all(board: BoardClient, drop: Drop, ahead_us: int) -> None:
    last_us = fill_queue(board, 1, ahead_us) if drop.queued else 0
    for kind in stream_kinds(board):
        board.link.send(*drop.frames(board, kind, last_us))


def _ask_all(board: BoardClient) -> None:
    for message in valid_requests(board, _SEQUENCE):
        if message.TYPE.name not in ("DISARM", "PLAY", "SET_CONFIG"):
            board.link.ask(message)


@case(
    "HG-12.3/1",
    "during a playback longer than the hold each latch restarts it; after it the hold runs out",
    variant="playback",
    needs=Feature.CONFIG | Feature.SEQUENCE_PHASES,
    depth=Depth.DEFAULT,
)
def playback_restarts_the_hold(board: BoardClient) -> None:
    board.configure(hold_ms=100)
    store_phases(board, _SEQUENCE, frames=2)
    board.arm()
    since = board.link.mark()
    play_now(board, _SEQUENCE, loops=50, period_us=4 * _MS)
    timeout_us = 600 * _MS + board.wire.limits.slack_us
    ended = board.link.await_event(PlaybackEnded, since, timeout_us)
    check(ended is not None, "a playback of 400 ms with a hold of 100 ms did not end")
    start_us = board.clock.unwrap(board.status().last_latch_us)
    header, _ = muted_by_timer(board, since, 300 * _MS, MuteReason.HOLD_EXPIRED)
    check_mute_time(board, start_us, header, 100, "after the last frame of a playback")


@case(
    "HG-6.7/1",
    "frames of every type, good and bad, each renew the lease: a chain of them keeps the board on",
    variant="types",
    needs=Feature.CONFIG,
    depth=Depth.DEFAULT,
)
def every_type_renews(board: BoardClient) -> None:
    for _ in range(_TRIES):
        late = _renewed_by_all(board)
        if not late:
            return
    inconclusive(f"the host was late {_TRIES} times in sending a frame every {_STEP_MS} ms")


def _renewals(board: BoardClient) -> Iterator[tuple[str, bytes]]:
    """Yield frames of the session that renew the lease, with their names."""
    for kind in stream_kinds(board):
        yield kind.name, board.link.stream_wire(kind.make())
    kind = stream_kinds(board)[0]
    for drop in DROPS:
        if drop.armed and not drop.queued and drop.counter != "stale_session":
            yield f"a frame {drop.summary}", next(iter(drop.frames(board, kind, 0)))
    for message in valid_requests(board, _SEQUENCE):
        if message.TYPE.name not in ("DISARM", "PLAY"):
            yield message.TYPE.name, board.link.request_wire(message)[0]
            wire, _ = board.link.request_wire(message, flags=0x40)
            yield f"{message.TYPE.name} with an unknown flag", wire


def _renewed_by_all(board: BoardClient) -> bool:
    """Send a frame of each kind, each in time; FAILED at the first that does not renew the lease.

    Returns whether the host was late with one.
    """
    if board.has(Feature.SEQUENCE_PHASES):
        store_phases(board, _SEQUENCE, frames=2)
    board.configure(host_timeout_ms=_LEASE_MS, hold_ms=10_000)
    board.arm()
    names: list[str] = []
    since, sent_us = board.link.mark(), board.wire.now_us()
    for name, wire in _renewals(board):
        board.wire.idle(max(0, sent_us + _STEP_MS * _MS - board.wire.now_us()))
        events = board.link.events(StateChanged, since)
        if events:
            fail(f"{names[-1] if names else 'ARM'} did not renew the lease")
        if board.wire.now_us() - sent_us > (_LEASE_MS - 20) * _MS:
            return True
        sent_us = board.wire.now_us()
        board.link.send(wire)
        names.append(name)
    board.wire.idle((_STEP_MS - 20) * _MS)
    if board.status().state is not OutputState.ARMED:
        fail(f"{names[-1]} did not renew the lease")
    return False


# --- Whole lengths -----------------------------------------------------------------------------


@case(
    "HG-12.1/1",
    "lease, hold, ramp and unattended time at their greatest lengths end within 1 ms",
    variant="whole",
    needs=Feature.CONFIG,
    depth=Depth.FULL,
)
def greatest_lengths(board: BoardClient) -> None:
    ramp_ms = 2000 if board.has(Feature.AMPLITUDE) else 0
    _whole(board, MuteReason.HOST_SILENT, 10_000, ramp_ms, host_timeout_ms=10_000, hold_ms=10_000)
    _whole(board, MuteReason.HOLD_EXPIRED, 9_990, 0, host_timeout_ms=10_000, hold_ms=9_990)
    if board.has(Feature.SEQUENCE_PHASES):
        store_phases(board, _SEQUENCE, frames=2)
        alone_ms = min(70_000, board.identity.max_unattended_ms)
        _whole(board, MuteReason.UNATTENDED, alone_ms, 0, host_timeout_ms=50)


def _whole(
    board: BoardClient, reason: MuteReason, due_ms: int, ramp_ms: int, **changes: Any
) -> None:
    board.configure(ramp_ms=ramp_ms, **changes)
    board.arm()
    since = board.link.mark()
    if reason is MuteReason.UNATTENDED:
        play_now(board, _SEQUENCE, loops=0, unattended_ms=due_ms, period_us=10 * _MS)
    elif reason is MuteReason.HOLD_EXPIRED:
        latch_now(board, board.flat_phases())  # before it the hold does not run (HG-12.2/2)
    start_us = board.clock.device_us()
    if reason is MuteReason.HOLD_EXPIRED:
        start_us = board.clock.unwrap(board.status().last_latch_us)
    if 1.5 * due_ms * _MS + ramp_ms * _MS > board.wire.limits.case_us:
        not_observed(f"a case ends before {due_ms} ms have passed")
    header, _ = muted_by_timer(board, since, (due_ms + ramp_ms + 1000) * _MS, reason)
    check_mute_time(board, start_us, header, due_ms + ramp_ms, f"{reason.name} after {due_ms} ms")

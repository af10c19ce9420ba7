"""HG-7.1: a configuration set while a timer runs, each field and each timer."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, Final

from haptogram_protocol.messages import Feature, SetConfig, SetConfigReply, Status
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import trace_modes
from ...client.latching import latch_now, latch_timed
from ...client.playback import (
    PERIOD_US,
    play_now,
    send_phases_that_fit,
    send_phases_to_store_if_supported,
)
from ...judge.timers import (
    EXACT_US,
    HOLD,
    LEASE,
    UNATTENDED,
    judge_status_period,
    judged_mute_by_timer,
)
from ...outcome import check, require

_MS: Final = 1000
_SEQUENCE: Final = 3
_BEFORE_MS: Final = 30  # from the start of a timer to the new configuration
_LENGTH_MS: Final = 130
_NEVER_MS: Final = 10_000
_RAMP_MS: Final = 30


def every_other_setting(board: BoardClient) -> list[dict[str, Any]]:
    """Return changes of one field each, to both ends, but for ceiling and lengths of timers."""
    values: dict[str, tuple[int, ...]] = {
        "status_period_ms": (board.quick_status_ms + 100, 65_535),
        "late_window_us": (50_000, 0, 100_000),
        "sound_speed_mm_s": (300_000, 380_000),
        "trace_divider": (7, 65_535),
        "trace_mode": tuple(trace_modes(board)),
    }
    return [{name: value} for name, some in values.items() for value in some]


def _other_settings(board: BoardClient) -> list[dict[str, Any]]:
    """Return changes of each field that is no length of a mute; at a wall clock all in one."""
    found = every_other_setting(board)
    if board.has(Feature.AMPLITUDE):
        found.append({"amplitude_ceiling": 50})
    if not board.wire.is_virtual:
        found = [{name: value for change in reversed(found) for name, value in change.items()}]
    return found


def _set_configuration_alone(board: BoardClient, **changes: Any) -> int:
    """Set the configuration and return the time of the reply; no frame follows that may help."""
    wanted = dataclasses.replace(board.base_config, **changes)
    answer = board.link.ask(SetConfig(wanted))
    board.config = board.link.reply_in(answer, SetConfigReply, SetConfig.TYPE).config
    assert answer.header is not None  # reply_in
    return board.clock.unwrap(answer.header.time_us)


def _start_played_hold(board: BoardClient) -> int:
    play_now(board, _SEQUENCE, loops=1, period_us=PERIOD_US)
    board.wire.idle(5 * PERIOD_US)
    return board.last_latch_us()


def _hold_with_configuration(
    board: BoardClient,
    start: Callable[[BoardClient], int],
    length_ms: int,
    changes: Mapping[str, Any],
) -> None:
    """Change the configuration while a hold runs; FAILED unless it ends at its new time."""
    ramps = board.has(Feature.AMPLITUDE)
    before = {"hold_ms": length_ms, "ramp_ms": _RAMP_MS if ramps else 0}
    after = before | dict(changes)
    since = board.arm(**before)
    start_us = start(board)
    board.clock.idle_until(start_us + _BEFORE_MS * _MS)
    early_us = board.clock.device_us()
    late_us = _set_configuration_alone(board, **after)
    board.clock.require_before(start_us + length_ms * _MS, "SET_CONFIG in a hold", late_us)
    longest_ms = 2 * max(length_ms, after["hold_ms"]) + after["ramp_ms"]
    header, _ = judged_mute_by_timer(board, since, longest_ms * _MS, MuteReason.HOLD_EXPIRED)
    muted_us = board.clock.unwrap(header.time_us)
    due_us = start_us + after["hold_ms"] * _MS
    # A hold that is over by its new length ends when SET_CONFIG comes.
    least_us = max(due_us, early_us) + after["ramp_ms"] * _MS
    most_us = max(due_us, late_us) + after["ramp_ms"] * _MS
    check(
        least_us - EXACT_US <= muted_us <= most_us + EXACT_US,
        f"hold {before}, after {_BEFORE_MS} ms {dict(changes)}: muted "
        f"{(muted_us - start_us) / _MS:.1f} ms after the latch, due is "
        f"{(least_us - start_us) / _MS:.1f} to {(most_us - start_us) / _MS:.1f} ms",
    )


@case("HG-7.1/3-hold", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def configuration_changes_a_running_hold(board: BoardClient) -> None:
    """a hold that runs, of stream and playback, gets a new length and ramp; other fields leave
    it
    """
    ramps: list[dict[str, Any]] = [{"ramp_ms": 0}]
    if board.has(Feature.AMPLITUDE):
        ramps += [{"ramp_ms": 90}, {"ramp_ms": 90, "hold_ms": _LENGTH_MS - 50}]
    starts: list[Callable[[BoardClient], int]] = [latch_timed]
    if board.has(Feature.SEQUENCE_PHASES):
        send_phases_that_fit(board, _SEQUENCE, frames=2)
        starts.append(_start_played_hold)
    lengths: list[tuple[int, dict[str, Any]]] = [
        (_LENGTH_MS, {"hold_ms": _LENGTH_MS - 50}),
        (_LENGTH_MS, {"hold_ms": 1}),
        (_LENGTH_MS, {"hold_ms": _BEFORE_MS // 2}),
        (_LENGTH_MS, {"hold_ms": _LENGTH_MS + 60}),
        (_NEVER_MS, {"hold_ms": _LENGTH_MS}),
        *((_LENGTH_MS, changes) for changes in [*ramps, *_other_settings(board)]),
    ]
    for start in starts:
        most = 2 if start is _start_played_hold else len(lengths)
        for length_ms, changes in board.sample(lengths, most):
            _hold_with_configuration(board, start, length_ms, changes)


@case("HG-7.1/3-lease", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def configuration_changes_a_running_lease(board: BoardClient) -> None:
    """a lease, and an unattended time, that run get new lengths with SET_CONFIG, and the new
    ramp
    """
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    lengths: list[dict[str, Any]] = [
        {"host_timeout_ms": 60},
        {"host_timeout_ms": _LENGTH_MS + 100},
        {"hold_ms": 1000},
    ]
    lengths += [{"ramp_ms": 90}] if board.has(Feature.AMPLITUDE) else []
    for plays in (False, True) if board.has(Feature.SEQUENCE_PHASES) else (False,):
        for changes in [*lengths, *_other_settings(board)]:
            _lease_with_configuration(board, changes, plays=plays)


def _lease_with_configuration(
    board: BoardClient, changes: Mapping[str, Any], *, plays: bool
) -> None:
    before = {"host_timeout_ms": _LENGTH_MS, "hold_ms": 5000, "ramp_ms": 0}
    after = before | dict(changes)
    since = board.arm(**before)
    if plays:
        play_now(board, _SEQUENCE, loops=0, period_us=50 * _MS, unattended_ms=_LENGTH_MS)
    else:
        latch_now(board)
    begun_us = board.clock.device_us()
    board.wire.idle(_BEFORE_MS * _MS)
    asked_us = board.clock.device_estimate_us()
    start_us = _set_configuration_alone(board, **after)
    board.clock.require_before(begun_us + _LENGTH_MS * _MS, "SET_CONFIG in a lease", start_us)
    due_ms = (_LENGTH_MS if plays else after["host_timeout_ms"]) + after["ramp_ms"]
    timer = UNATTENDED if plays else LEASE
    name = f"{timer.name}, {dict(changes)} meanwhile"
    timer.judge(board, since, start_us, due_ms, name, asked_us=asked_us)


@case("HG-7.1/3-fields", needs=Feature.CONFIG | Feature.AMPLITUDE, depth=Depth.DEFAULT)
def configuration_leaves_a_running_ramp(board: BoardClient) -> None:
    """a ramp that has begun goes on as it began, whichever field is set meanwhile"""
    hold_ms, ramp_ms = 30, 150
    lengths: list[dict[str, Any]] = [
        {"hold_ms": 1},
        {"hold_ms": _NEVER_MS},
        {"ramp_ms": 0},
        {"ramp_ms": 2000},
        {"host_timeout_ms": 200},
    ]
    if not board.wire.is_virtual:
        lengths = [{"hold_ms": _NEVER_MS, "ramp_ms": 2000}, {"hold_ms": 1, "ramp_ms": 0}]
    for changes in [*lengths, *_other_settings(board)]:
        since = board.arm(hold_ms=hold_ms, ramp_ms=ramp_ms)
        start_us = latch_timed(board)
        board.clock.idle_until(start_us + (hold_ms + ramp_ms // 3) * _MS)
        board.clock.require_before(start_us + (hold_ms + ramp_ms) * _MS, "the middle of a ramp")
        board.configure(**{"hold_ms": hold_ms, "ramp_ms": ramp_ms} | changes)
        name = f"a ramp of {hold_ms} + {ramp_ms} ms, {changes} meanwhile"
        HOLD.judge(board, since, start_us, hold_ms + ramp_ms, name)


@case("HG-7.1/3-status", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def configuration_changes_a_running_status_period(board: BoardClient) -> None:
    """a status period that runs is replaced: the first STATUS comes within the new period"""
    least_ms = board.quick_status_ms
    require(least_ms <= 1000, "a status period takes too long on this line")
    for before_ms, after_ms in ((65_535, least_ms), (least_ms, 3 * least_ms), (0, least_ms)):
        board.configure(status_period_ms=before_ms)
        board.wire.idle(least_ms * _MS // 2)
        since = board.link.mark()
        start_us = _set_configuration_alone(board, status_period_ms=after_ms)
        board.wire.idle_beyond(7 * after_ms * _MS // 2)
        board.link.barrier()
        first = board.link.events(Status, since)[:1]
        late_us = [board.clock.unwrap(header.time_us) - start_us for header, _ in first]
        text = f"status_period_ms {before_ms}, then {after_ms}: the first one after {late_us} µs"
        check(not late_us or late_us[0] <= after_ms * _MS + EXACT_US, text)
        judge_status_period(board, since, after_ms, 3, f"{before_ms} before, 3.5 periods")

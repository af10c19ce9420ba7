"""HG-7.1, HG-8.4: every field of the configuration, set at any moment, while any timer runs."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.state import OutputState

from ...case import Depth, case
from ...client import latching, playback, uploads
from ...client.board_client import BoardClient
from ...client.capabilities import PLAYS, SHOWN_RAMPS, trace_modes
from ...client.recording import counter_steps
from ...client.stream_kinds import random_points_to_send, valid_requests_to_send
from ...judge.events import judge_division
from ...judge.refused_requests import requests_refused_by_link
from ...judge.timers import (
    EXACT_US,
    HOLD,
    LEASE,
    UNATTENDED,
    TimerKind,
    judge_in_time,
    judge_ramp_with_configuration,
    judge_status_period,
    timer_kinds,
)
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, require
from ..ch05_stream.drives import judge_points_read_back

_MS: Final = 1000
_SHOWN: Final = m.Feature.CONFIG | m.Feature.READ_LATCHED
_DIVIDES: Final = m.Feature.CONFIG | m.Feature.TRACE_DRIVE
_SEQUENCE: Final = 4
_CEILINGS: Final = (60, 255, 0, 1, 254)
_SPEEDS_MM_S: Final = (300_000, 380_000, 331_300)
_DIVIDER: Final = 3
_QUEUED_US: Final = 40_000
_BEFORE_MS: Final = 30  # from the start of a timer to the new configuration
_LENGTH_MS: Final = 100
_NEVER_MS: Final = 10_000
_RAMP_MS: Final = 30


@case("HG-7.1/3-ceiling", needs=SHOWN_RAMPS, evidence=SELF_REPORTED)
def configured_ceiling_is_in_force_at_once(board: BoardClient) -> None:
    """a ceiling set while a drive sounds, of stream and playback, is in force without a new
    latch
    """
    board.arm(amplitude_ceiling=255)
    latching.latch_now(board)
    _judge_ceilings(board)
    if board.has(m.Feature.SEQUENCE_PHASES):
        board.configure()
        playback.send_phases_to_store(board, _SEQUENCE, frames=1)
        playback.play_now(board, _SEQUENCE, loops=1)
        playback.let_play(board, 2)
        board.wire.idle_beyond(0)
        _judge_ceilings(board)


def _judge_ceilings(board: BoardClient) -> None:
    """FAILED unless the loudest radiated amplitude code equals each ceiling that is set."""
    for ceiling in _CEILINGS:
        board.configure(amplitude_ceiling=ceiling)
        check_fields(latching.read_back_radiated(board), "a ceiling set meanwhile", loudest=ceiling)


@case("HG-7.1/3-speed", needs=_SHOWN | m.Feature.SEQUENCE_POINTS, evidence=SELF_REPORTED)
def stored_points_take_the_configured_speed(board: BoardClient) -> None:
    """points stored before a new speed of sound are played with the new one"""
    frame = random_points_to_send(board)
    uploads.upload_to_board(board, m.UploadKind.POINTS, _SEQUENCE, frame.serialize(), 1)
    for speed in _SPEEDS_MM_S:
        board.arm(sound_speed_mm_s=speed)
        playback.play_out(board, _SEQUENCE, 1, period_us=playback.period_to_play(board, 1))
        judge_points_read_back(board, frame, f"{speed / 1000:g} m/s")


@case("HG-7.1/3-traces", needs=PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def configured_trace_modes_are_in_force_at_once(board: BoardClient) -> None:
    """trace modes set one after the other while a sequence plays are each in force at once"""
    events = {m.TraceMode.CRC: m.TracePlayback, m.TraceMode.DRIVE: m.TraceDrive}
    modes = [m.TraceMode.OFF, *trace_modes(board)]
    playback.send_phases_that_fit(board, _SEQUENCE, frames=2)
    board.arm()
    playback.play_now(board, _SEQUENCE, loops=0, period_us=10 * _MS)
    for mode in [*modes, *reversed(modes)]:
        board.configure(trace_mode=mode)
        since = board.link.mark()
        board.wire.idle(35 * _MS)
        board.link.barrier()
        kinds = (m.Trace, *events.values())
        got = [kind.__name__ for kind in kinds if board.link.events(kind, since)]
        due = [events[mode].__name__] if mode in events else []
        check_equal(got, due, f"mode {mode.name}, set while a sequence plays: traces")


# --- What goes on as it began -----------------------------------------------------------------


def _settings_beside_timers(board: BoardClient) -> list[dict[str, Any]]:
    """Return changes of one field each, for every field; hold and lease become 2 s and 10 s."""
    lengths = [{name: ms} for name in ("hold_ms", "host_timeout_ms") for ms in (2000, 10_000)]
    found = [*every_other_setting(board), *lengths]
    if board.has(m.Feature.AMPLITUDE):
        found += [{"ramp_ms": 2000}, *({"amplitude_ceiling": code} for code in (0, 1, 254))]
    return found


@case("HG-7.1/3-queue", needs=_SHOWN, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def configuration_leaves_the_queue(board: BoardClient) -> None:
    """frames in the queue are latched when they are due, as they came, whatever is set meanwhile"""
    from ...judge.array_model import judged_model_of_board
    from ...judge.focusing import judge_drive_of_points

    settings = _settings_beside_timers(board)
    if not board.wire.is_virtual:  # all fields at once, at one end and at the other
        settings = [_all_of(settings), _all_of(reversed(settings))]
    before = {"sound_speed_mm_s": board.identity.sound_speed_mm_s}
    board.configure(**before)
    model = judged_model_of_board(board)
    for changes in settings:
        board.arm()
        codes = board.random_registers()
        frames: list[m.Message] = [board.phases(codes)]
        frames += [random_points_to_send(board)] if board.has(m.Feature.POINTS) else []
        for frame in frames:
            name = f"{frame.TYPE.name} in the queue, {changes} meanwhile"
            wire_bytes = bytes(2 * len(frame.serialize()) + 400)
            at_us = board.clock.soon_us(wire_bytes, points=1, ahead_us=_QUEUED_US)
            with board.counting(accepted=1, latched=1):
                board.link.stream(frame, at_us)
                board.configure(**before | changes)
                board.clock.wait_until(at_us + 2 * board.clock.carrier_us)
                shown = latching.read_back(board)
            late_us = board.clock.unwrap(shown.reply.t_latch_us) - at_us
            in_time = 0 <= late_us <= board.clock.carrier_us
            judge_in_time(board, in_time, f"{name}: latched {late_us} µs behind its time")
            if isinstance(frame, m.Points):
                judge_drive_of_points(board, model, tuple(frame.points), shown, name)
            else:
                check_equal(shown.phases, codes, f"{name}: other phases are latched")
            board.configure(**before)


@case("HG-7.1/3-playback", needs=PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def configuration_leaves_a_playback(board: BoardClient) -> None:
    """a playback keeps its period, and an upload its bytes, whatever is set meanwhile"""
    count = board.identity.transducers
    playback.send_phases_that_fit(board, _SEQUENCE, frames=2)
    other = board.random_registers()
    uploads.begin_upload(board, m.UploadKind.PHASES, _SEQUENCE + 1, other)
    period_us = board.clock.on_carrier(board.wire.period_us(4 * (2 * count + 200), 20 * _MS))
    board.arm()
    since, before = board.link.mark(), board.status().counters
    playback.play_now(board, _SEQUENCE, loops=0, period_us=period_us, unattended_ms=10_000)
    board.clock.wait_latched(0)
    begun = board.status()  # of the second frame or a later one, if the host was held up
    latched = counter_steps(before, begun.counters)["latched"]
    first_us = board.clock.unwrap(begun.last_latch_us) - (latched - 1) * period_us
    # The last one would mute: but unattended_ms stands for it (HG-7.6/5).
    for changes in [*_settings_beside_timers(board), {"host_timeout_ms": 20}]:
        board.configure(**changes)
        board.wire.idle(period_us)
        status = board.status()
        late_us = (board.clock.unwrap(status.last_latch_us) - first_us) % period_us
        name = f"{changes} while a sequence plays"
        judge_in_time(board, late_us == 0, f"{name}: a latch is {late_us} µs behind its time")
        check_fields(status, f"{name}: STATUS_REPLY", state=OutputState.ARMED)
    asked_us = board.clock.device_us() - board.clock.carrier_us
    board.stop()
    ended = playback.await_playback_end(board, since, 0)
    header, _ = board.link.events(m.PlaybackEnded, since)[0]
    least, most = (
        (t_us - first_us) // period_us + 1
        for t_us in (asked_us, board.clock.unwrap(header.time_us))
    )
    text = f"{ended.frames} frames were played, {least} to {most} were due up to STOP"
    check(least <= ended.frames <= most, text)
    uploads.send_upload_chunks(board, other)
    board.link.call(m.UploadCommit(_SEQUENCE + 1), m.UploadCommitReply)


@case("HG-8.4/1-requests", needs=_DIVIDES, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def requests_leave_the_configured_division(board: BoardClient) -> None:
    """requests between latches, carried out and refused, leave the division as it runs"""
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    since = board.arm(trace_mode=m.TraceMode.DRIVE, trace_divider=_DIVIDER)
    latches = []
    for message in (*valid_requests_to_send(board, _SEQUENCE), m.Mute(), m.Arm()):
        if isinstance(message, m.SetConfig | m.Play | m.UploadBegin):
            continue
        latches.append(latching.latch_now(board))
        board.link.ask(message)
        if isinstance(message, m.Disarm | m.Stop | m.Mute):
            board.arm()
    for refusal in requests_refused_by_link(board):
        latches.append(latching.latch_now(board))
        board.link.ask_raw(refusal.kind, refusal.payload, **{"session": 0} | dict(refusal.header))
    for _ in range(_DIVIDER):
        board.hello(board.link.session)
        latches.append(latching.latch_now(board))
    judge_division(board, since, [m.LatchKey(0, 0, index) for index in latches], _DIVIDER)


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
    """Return changes of one field each, not of timers or ramp; at a wall clock merged into one."""
    found = every_other_setting(board)
    if board.has(m.Feature.AMPLITUDE):
        found.append({"amplitude_ceiling": 50})
    return found if board.wire.is_virtual else [_all_of(reversed(found))]


def _all_of(settings: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Return all changes merged into one; the last one of a field counts."""
    return {name: value for changes in settings for name, value in changes.items()}


def _set_configuration_alone(board: BoardClient, **changes: Any) -> int:
    """Set the base configuration with *changes* by one request, with no frame after it.

    Returns the device time of the reply in µs.
    """
    wanted = dataclasses.replace(board.base_config, **changes)
    answer = board.link.ask(m.SetConfig(wanted))
    board.config = board.link.reply_in(answer, m.SetConfigReply, m.SetConfig.TYPE).config
    assert answer.header is not None  # reply_in
    return board.clock.unwrap(answer.header.time_us)


def _start_played_hold(board: BoardClient) -> int:
    """Play a sequence to its end; return the time of its last latch, when the hold starts.

    It is device time in µs.
    """
    playback.play_now(board, _SEQUENCE, loops=1, period_us=playback.PERIOD_US)
    board.wire.idle(5 * playback.PERIOD_US)
    return board.last_latch_us()


def _hold_with_configuration(
    board: BoardClient,
    start: Callable[[BoardClient], int],
    length_ms: int,
    changes: Mapping[str, Any],
) -> None:
    """Change the configuration 30 ms into a hold; FAILED unless the hold ends when it is now due.

    *start* latches and returns the time, from which the new length counts; one that is over already
    ends at once.
    """
    ramps = board.has(m.Feature.AMPLITUDE)
    before = {"hold_ms": length_ms, "ramp_ms": _RAMP_MS if ramps else 0}
    after = before | dict(changes)
    since = board.arm(**before)
    start_us = start(board)
    board.clock.idle_until(start_us + _BEFORE_MS * _MS)
    early_us = board.clock.device_us()
    late_us = _set_configuration_alone(board, **after)
    board.clock.require_before(start_us + length_ms * _MS, "SET_CONFIG in a hold", late_us)
    # A hold that is over by its new length ends when SET_CONFIG comes.
    due_us = start_us + after["hold_ms"] * _MS
    least_us, most_us = max(due_us, early_us), max(due_us, late_us)
    name = f"hold {before}, after {_BEFORE_MS} ms {dict(changes)}, behind its end"
    HOLD.judge(board, since, most_us, after["ramp_ms"], name, asked_us=least_us)


@case("HG-7.1/3-hold", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def configuration_changes_a_running_hold(board: BoardClient) -> None:
    """a hold that runs, of stream and playback, gets a new length and ramp; other fields leave
    it
    """
    ramps: list[dict[str, Any]] = [{"ramp_ms": 0}]
    if board.has(m.Feature.AMPLITUDE):
        ramps += [{"ramp_ms": 90}, {"ramp_ms": 90, "hold_ms": _LENGTH_MS - 50}]
    starts: list[Callable[[BoardClient], int]] = [latching.latch_timed]
    if board.has(m.Feature.SEQUENCE_PHASES):
        playback.send_phases_that_fit(board, _SEQUENCE, frames=2)
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


@case("HG-7.1/3-lease", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
def configuration_changes_a_running_lease(board: BoardClient) -> None:
    """a lease, and an unattended time, that run get new lengths with SET_CONFIG, and the new
    ramp
    """
    lengths: list[dict[str, Any]] = [
        {"host_timeout_ms": 60},
        {"host_timeout_ms": _LENGTH_MS + 100},
        {"hold_ms": 1000},
    ]
    lengths += [{"ramp_ms": 90}] if board.has(m.Feature.AMPLITUDE) else []
    for timer in timer_kinds(board, LEASE, UNATTENDED):
        for changes in [*lengths, *_other_settings(board)]:
            _lease_with_configuration(board, timer, changes)


def _lease_with_configuration(
    board: BoardClient, timer: TimerKind, changes: Mapping[str, Any]
) -> None:
    """Change the configuration 30 ms into a timer; FAILED unless it mutes when it is now due.

    SET_CONFIG starts the lease or unattended time anew; a new length of the lease counts.
    """
    length_ms = board.clock.timer_ms(_LENGTH_MS, len(board.bytes_of_frames(1)))
    before = {"host_timeout_ms": length_ms, "hold_ms": 5000, "ramp_ms": 0}
    after = before | dict(changes)
    since = board.link.mark()
    begun_us = timer.start(board, length_ms, **before)
    if timer is LEASE:
        latching.latch_now(board)
    board.wire.idle(_BEFORE_MS * _MS)
    asked_us = board.clock.device_estimate_us()
    start_us = _set_configuration_alone(board, **after)
    board.clock.require_before(begun_us + length_ms * _MS, "SET_CONFIG in a lease", start_us)
    due_ms = after["host_timeout_ms"] if timer is LEASE else length_ms
    name = f"{timer.name}, {dict(changes)} meanwhile"
    due_ms += after["ramp_ms"]
    timer.judge(board, since, start_us, due_ms, name, asked_us=asked_us)


@case("HG-7.1/3-fields", needs=m.Feature.CONFIG | m.Feature.AMPLITUDE, depth=Depth.DEFAULT)
def configuration_leaves_a_running_ramp(board: BoardClient) -> None:
    """a ramp that has begun goes on as it began, whichever field is set meanwhile"""
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
        judge_ramp_with_configuration(board, 30, 150, changes)


@case("HG-7.1/3-status", needs=m.Feature.CONFIG, depth=Depth.DEFAULT)
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
        first = board.link.events(m.Status, since)[:1]
        late_us = [board.clock.unwrap(header.time_us) - start_us for header, _ in first]
        text = f"status_period_ms {before_ms}, then {after_ms}: the first one after {late_us} µs"
        check(not late_us or late_us[0] <= after_ms * _MS + EXACT_US, text)
        judge_status_period(board, since, after_ms, 3, f"{before_ms} before, 3.5 periods")

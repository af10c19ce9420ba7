"""HG-7.1, HG-8.4: every field of the configuration, set at any moment."""

from __future__ import annotations

from typing import Any, Final

from haptogram_protocol.messages import (
    Arm,
    Disarm,
    Feature,
    Message,
    Mute,
    Play,
    PlaybackEnded,
    Points,
    SetConfig,
    Stop,
    StopReply,
    Trace,
    TraceDrive,
    TraceMode,
    TracePlayback,
    UploadBegin,
    UploadCommit,
    UploadCommitReply,
    UploadKind,
)
from haptogram_protocol.state import OutputState

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import PLAYS, SHOWN_RAMPS, trace_modes
from ...client.latching import latch_now, read_back, read_back_radiated
from ...client.playback import (
    await_playback_end,
    let_play,
    period_to_play,
    play_now,
    play_out,
    send_phases_that_fit,
    send_phases_to_store,
    send_phases_to_store_if_supported,
)
from ...client.recording import counter_steps
from ...client.stream_kinds import random_points_to_send, valid_requests_to_send
from ...client.uploads import begin_upload, send_upload_chunks, upload_to_board
from ...judge.refused_requests import requests_refused_by_link
from ...judge.timers import judge_in_time
from ...outcome import SELF_REPORTED, check, check_equal
from .every_running_timer import every_other_setting

_MS: Final = 1000
_SEQUENCE: Final = 4
_CEILINGS: Final = (60, 255, 0, 1, 254)
_SPEEDS_MM_S: Final = (300_000, 380_000, 331_300)
_DIVIDER: Final = 3
_QUEUED_US: Final = 40_000


@case("HG-7.1/3-ceiling", needs=SHOWN_RAMPS, evidence=SELF_REPORTED)
def configured_ceiling_is_in_force_at_once(board: BoardClient) -> None:
    """a ceiling set while a drive sounds, of stream and playback, is in force without a new
    latch
    """
    for played in (False, True) if board.has(Feature.SEQUENCE_PHASES) else (False,):
        board.configure()
        board.arm()
        if played:
            send_phases_to_store(board, _SEQUENCE, frames=1)
            play_now(board, _SEQUENCE, loops=1)
            let_play(board, 2)
            board.wire.idle_beyond(0)
        else:
            latch_now(board)
        for ceiling in _CEILINGS:
            board.configure(amplitude_ceiling=ceiling)
            loudest = read_back_radiated(board).loudest
            text = f"ceiling {ceiling}, set meanwhile: {loudest} is radiated"
            check_equal(loudest, ceiling, text)


@case(
    "HG-7.1/3-speed",
    needs=Feature.CONFIG | Feature.SEQUENCE_POINTS | Feature.READ_LATCHED,
    evidence=SELF_REPORTED,
)
def stored_points_take_the_configured_speed(board: BoardClient) -> None:
    """points stored before a new speed of sound are played with the new one"""
    from ...judge.array_model import judged_model_of_board
    from ...judge.focusing import judge_drive_of_points

    frame = random_points_to_send(board)
    upload_to_board(board, UploadKind.POINTS, _SEQUENCE, frame.serialize(), 1)
    for speed in _SPEEDS_MM_S:
        board.arm(sound_speed_mm_s=speed)
        play_out(board, _SEQUENCE, 1, period_us=period_to_play(board, 1))
        name = f"{speed / 1000:g} m/s"
        model, points = judged_model_of_board(board), tuple(frame.points)
        judge_drive_of_points(board, model, points, read_back(board), name)


@case("HG-7.1/3-traces", needs=PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def configured_trace_modes_are_in_force_at_once(board: BoardClient) -> None:
    """trace modes set one after the other while a sequence plays are each in force at once"""
    events = {TraceMode.CRC: TracePlayback, TraceMode.DRIVE: TraceDrive}
    modes = [TraceMode.OFF, *trace_modes(board)]
    send_phases_that_fit(board, _SEQUENCE, frames=2)
    board.arm()
    play_now(board, _SEQUENCE, loops=0, period_us=10 * _MS)
    for mode in [*modes, *reversed(modes)]:
        board.configure(trace_mode=mode)
        since = board.link.mark()
        board.wire.idle(35 * _MS)
        board.link.barrier()
        for kind in (Trace, TracePlayback, TraceDrive):
            got = len(board.link.events(kind, since))
            due = kind is events.get(mode)
            name = f"{kind.__name__} in mode {mode.name}, set while a sequence plays"
            check_equal(bool(got), due, f"{got} {name}")


# --- What goes on as it began -----------------------------------------------------------------


def _settings_beside_timers(board: BoardClient) -> list[dict[str, Any]]:
    """Return changes of every field, with timers that nothing here runs into."""
    found = every_other_setting(board)
    lengths = {"hold_ms": (2000, 10_000), "host_timeout_ms": (2000, 10_000)}
    found += [{name: value} for name, some in lengths.items() for value in some]
    if board.has(Feature.AMPLITUDE):
        found += [{"ramp_ms": 2000}, *({"amplitude_ceiling": code} for code in (0, 1, 254))]
    return found


@case(
    "HG-7.1/3-queue",
    needs=Feature.CONFIG | Feature.READ_LATCHED,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def configuration_leaves_the_queue(board: BoardClient) -> None:
    """frames in the queue are latched when they are due, as they came, whatever is set meanwhile"""
    from ...judge.array_model import judged_model_of_board
    from ...judge.focusing import judge_drive_of_points

    settings = _settings_beside_timers(board)
    if not board.wire.is_virtual:  # all fields at once, at one end and at the other
        both = (settings, settings[::-1])
        settings = [{name: v for one in some for name, v in one.items()} for some in both]
    before = {"sound_speed_mm_s": board.identity.sound_speed_mm_s}
    board.configure(**before)
    model = judged_model_of_board(board)
    for changes in settings:
        board.arm()
        codes = board.random_registers()
        frames: list[Message] = [board.phases(codes)]
        frames += [random_points_to_send(board)] if board.has(Feature.POINTS) else []
        for frame in frames:
            name = f"{frame.TYPE.name} in the queue, {changes} meanwhile"
            wire_bytes = bytes(2 * len(frame.serialize()) + 400)
            at_us = board.clock.soon_us(wire_bytes, points=1, ahead_us=_QUEUED_US)
            with board.counting(accepted=1, latched=1):
                board.link.stream(frame, at_us)
                board.configure(**before | changes)
                board.clock.wait_until(at_us + 2 * board.clock.carrier_us)
                shown = read_back(board)
            late_us = board.clock.unwrap(shown.reply.t_latch_us) - at_us
            in_time = 0 <= late_us <= board.clock.carrier_us
            judge_in_time(board, in_time, f"{name}: latched {late_us} µs behind its time")
            if isinstance(frame, Points):
                judge_drive_of_points(board, model, tuple(frame.points), shown, name)
            else:
                check_equal(shown.phases, codes, f"{name}: other phases are latched")
            board.configure(**before)


@case("HG-7.1/3-playback", needs=PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def configuration_leaves_a_playback(board: BoardClient) -> None:
    """a playback keeps its period, and an upload its bytes, whatever is set meanwhile"""
    count = board.identity.transducers
    send_phases_that_fit(board, _SEQUENCE, frames=2)
    other = board.random_registers()
    begin_upload(board, UploadKind.PHASES, _SEQUENCE + 1, other)
    period_us = board.clock.on_carrier(board.wire.period_us(4 * (2 * count + 200), 20 * _MS))
    board.arm()
    since, before = board.link.mark(), board.status().counters
    play_now(board, _SEQUENCE, loops=0, period_us=period_us, unattended_ms=10_000)
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
        check_equal(status.state, OutputState.ARMED, f"{name}: {status.state.name}")
    asked_us = board.clock.device_us() - board.clock.carrier_us
    board.link.call(Stop(), StopReply)
    ended = await_playback_end(board, since, 0)
    header, _ = board.link.events(PlaybackEnded, since)[0]
    least, most = (
        (t_us - first_us) // period_us + 1
        for t_us in (asked_us, board.clock.unwrap(header.time_us))
    )
    text = f"{ended.frames} frames were played, {least} to {most} were due up to STOP"
    check(least <= ended.frames <= most, text)
    send_upload_chunks(board, other)
    board.link.call(UploadCommit(_SEQUENCE + 1), UploadCommitReply)


@case(
    "HG-8.4/1-requests",
    needs=Feature.CONFIG | Feature.TRACE_DRIVE,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def requests_leave_the_configured_division(board: BoardClient) -> None:
    """requests between latches, carried out and refused, leave the division as it runs"""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    board.arm(trace_mode=TraceMode.DRIVE, trace_divider=_DIVIDER)
    since, first = board.link.mark(), board.link.stream_next
    count = 0
    for message in (*valid_requests_to_send(board, _SEQUENCE), Mute(), Arm()):
        if isinstance(message, SetConfig | Play | UploadBegin):
            continue
        latch_now(board)
        board.link.ask(message)
        if isinstance(message, Disarm | Stop | Mute):
            board.arm()
        count += 1
    for refusal in requests_refused_by_link(board):
        latch_now(board)
        board.link.ask_raw(refusal.kind, refusal.payload, **{"session": 0} | dict(refusal.header))
        count += 1
    for _ in range(_DIVIDER):
        board.hello(board.link.session)
        latch_now(board)
    board.link.barrier()
    got = [event.key.index - first for _, event in board.link.events(TraceDrive, since)]
    due = list(range(0, count + _DIVIDER, _DIVIDER))
    wrong = [pair for pair in zip(got, due, strict=False) if pair[0] != pair[1]]
    text = f"of {count + _DIVIDER} latches {len(got)} are traced, seen and due {wrong[:1]}"
    check(got == due, text)

"""HG-7.1, HG-8.4: every field of the configuration, set at any moment."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Disarm,
    Feature,
    Message,
    Mute,
    Play,
    Points,
    SetConfig,
    Stop,
    Trace,
    TraceDrive,
    TraceMode,
    TracePlayback,
    UploadBegin,
    UploadKind,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now, read_back, read_back_radiated
from ...client.playback import (
    period_to_play,
    play_now,
    play_out,
    send_phases_to_store,
    send_phases_to_store_if_supported,
)
from ...client.stream_kinds import random_point_to_send, valid_requests_to_send
from ...client.uploads import upload_to_board
from ...judge.refused_requests import requests_refused_by_link
from ...outcome import SELF_REPORTED, check

_MS: Final = 1000
_SEQUENCE: Final = 4
_CEILINGS: Final = (60, 255, 0, 1, 254)
_SPEEDS_MM_S: Final = (300_000, 380_000, 331_300)
_WORST_STEPS: Final = 1.5 + 1e-6  # one step beyond the rounding, which is half of one
_DIVIDER: Final = 3


@case(
    "HG-7.1/3",
    "a ceiling set while a drive sounds, of stream and playback, is in force without a new latch",
    variant="ceiling",
    needs=Feature.CONFIG | Feature.AMPLITUDE | Feature.READ_RADIATED,
    evidence=SELF_REPORTED,
)
def configured_ceiling_is_in_force_at_once(board: BoardClient) -> None:
    plays = [False, True] if board.has(Feature.SEQUENCE_PHASES) else [False]
    for played in plays:
        board.configure()
        board.arm()
        if played:
            send_phases_to_store(board, _SEQUENCE, frames=1)
            play_now(board, _SEQUENCE, loops=1)
            board.wire.idle(5 * _MS + board.wire.limits.slack_us)
        else:
            latch_now(board, board.flat_phases())
        for ceiling in _CEILINGS:
            board.configure(amplitude_ceiling=ceiling)
            loudest = read_back_radiated(board).loudest
            check(loudest == ceiling, f"ceiling {ceiling}, set meanwhile: {loudest} is radiated")


@case(
    "HG-7.1/3",
    "points stored before a new speed of sound are played with the new one",
    variant="speed",
    needs=Feature.CONFIG | Feature.SEQUENCE_POINTS | Feature.READ_LATCHED,
    evidence=SELF_REPORTED,
)
def stored_points_take_the_configured_speed(board: BoardClient) -> None:
    from ...judge.array_model import judged_model_of_board
    from ...judge.focusing import judged_phase_errors

    frame = Points(tuple(random_point_to_send(board, 1) for _ in range(1)))
    upload_to_board(board, UploadKind.POINTS, _SEQUENCE, frame.serialize(), 1)
    for speed in _SPEEDS_MM_S:
        board.configure(sound_speed_mm_s=speed)
        board.arm()
        play_out(board, _SEQUENCE, 1, period_us=period_to_play(board, 1))
        errors = judged_phase_errors(
            judged_model_of_board(board), [(tuple(frame.points), read_back(board))]
        )
        worst = float(abs(errors).max(initial=0.0))
        check(worst <= _WORST_STEPS, f"{speed / 1000:g} m/s: a phase is off by {worst:.1f} steps")


@case(
    "HG-7.1/3",
    "trace modes set one after the other while a sequence plays are each in force at once",
    variant="traces",
    needs=Feature.CONFIG | Feature.SEQUENCE_PHASES,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def configured_trace_modes_are_in_force_at_once(board: BoardClient) -> None:
    events = {
        TraceMode.OFF: (Feature(0), None),
        TraceMode.CRC: (Feature.TRACE, TracePlayback),
        TraceMode.DRIVE: (Feature.TRACE_DRIVE, TraceDrive),
        TraceMode.RING: (Feature.TRACE_RING, None),
    }
    modes = [mode for mode, (feature, _) in events.items() if board.has(feature)]
    send_phases_to_store(board, _SEQUENCE, frames=2)
    board.arm()
    play_now(board, _SEQUENCE, loops=0, period_us=10 * _MS)
    for mode in [*modes, *reversed(modes)]:
        board.configure(trace_mode=mode)
        since = board.link.mark()
        board.wire.idle(35 * _MS)
        board.link.barrier()
        for kind in (Trace, TracePlayback, TraceDrive):
            got = len(board.link.events(kind, since))
            due = kind is events[mode][1]
            name = f"{kind.__name__} in mode {mode.name}, set while a sequence plays"
            check(bool(got) == due, f"{got} {name}")


@case(
    "HG-8.4/1",
    "requests between latches, carried out and refused, leave the division as it runs",
    variant="requests",
    needs=Feature.CONFIG | Feature.TRACE_DRIVE,
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def requests_leave_the_configured_division(board: BoardClient) -> None:
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=1)
    board.configure(trace_mode=TraceMode.DRIVE, trace_divider=_DIVIDER)
    board.arm()
    since, first = board.link.mark(), board.link.stream_next
    count = 0
    messages: list[Message] = [*valid_requests_to_send(board, _SEQUENCE), Mute(), Arm()]
    for message in messages:
        if isinstance(message, SetConfig | Play | UploadBegin):
            continue
        latch_now(board, board.flat_phases())
        board.link.ask(message)
        if isinstance(message, Disarm | Stop | Mute):
            board.arm()
        count += 1
    for refusal in requests_refused_by_link(board):
        latch_now(board, board.flat_phases())
        board.link.ask_raw(refusal.kind, refusal.payload, **{"session": 0} | dict(refusal.header))
        count += 1
    for _ in range(_DIVIDER):
        board.hello(board.link.session)
        latch_now(board, board.flat_phases())
    board.link.barrier()
    got = [event.key.index - first for _, event in board.link.events(TraceDrive, since)]
    due = list(range(0, count + _DIVIDER, _DIVIDER))
    wrong = [pair for pair in zip(got, due, strict=False) if pair[0] != pair[1]]
    check(
        got == due, f"of {count + _DIVIDER} latches {len(got)} are traced, seen and due {wrong[:1]}"
    )

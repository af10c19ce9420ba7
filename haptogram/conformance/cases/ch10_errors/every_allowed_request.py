"""HG-3.6, HG-7.1, HG-10.2: requests that a state allows are carried out, and change one thing."""

from __future__ import annotations

import dataclasses
from typing import Any, Final

from haptogram_protocol.messages import (
    Arm,
    Disarm,
    Error,
    Feature,
    Message,
    Play,
    SetConfig,
    SetConfigReply,
    Stop,
    TraceMode,
    UploadBegin,
    UploadChunk,
    UploadCommit,
)

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import TRACED_PLAYS
from ...client.playback import (
    play_out,
    send_phases_that_fit,
    send_phases_to_store_if_supported,
    shortest_period_to_play_us,
)
from ...client.stream_kinds import valid_requests_to_send
from ...judge.events import judge_event_numbers
from ...judge.held_state import held_state_changes
from ...judge.refused_requests import STORED, other_config_than_judged
from ...outcome import SELF_REPORTED, check, check_equal, fail
from .every_refusal import brought_to_refusal, held_after_refusals, refusal_situations

_ABSENT: Final = 51
_EVENTS: Final = 2200  # more than 11 bits of event numbers
_CHANGING: Final = (Arm, Disarm, Stop, Play, SetConfig, UploadBegin, UploadChunk, UploadCommit)
#: What a configuration itself changes, of what a board holds.
_BY_CONFIG: Final = ("config_crc", "the configuration", "the radiated drive")


def _allowed_readings(board: BoardClient) -> list[Message]:
    """Return every request that only asks."""
    return [m for m in valid_requests_to_send(board, _ABSENT) if not isinstance(m, _CHANGING)]


@case("HG-10.2/1-moments", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def allowed_readings_are_always_answered(board: BoardClient) -> None:
    """requests that only ask are answered while streaming, playing, waiting, DISARMED and MUTED"""
    send_phases_to_store_if_supported(board, STORED, frames=1)
    for situation in refusal_situations(board):
        last_us, before = brought_to_refusal(board, situation)
        for message in _allowed_readings(board):
            answer = board.link.ask(message)
            name = f"{situation.name}, {message.TYPE.name}"
            if isinstance(answer.message, Error) or answer.message is None:
                fail(f"{name} is answered by {board.link.answer_text(answer)}")
        text = held_state_changes(before, held_after_refusals(board, last_us))
        check(not text, f"{situation.name}, requests that only ask: {text}")


@case("HG-7.1/3-alone", needs=Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def an_allowed_setting_changes_only_itself(board: BoardClient) -> None:
    """a field set while frames wait, a sequence plays or an upload is under way changes only
    itself
    """
    send_phases_to_store_if_supported(board, STORED, frames=1)
    for situation in refusal_situations(board):
        last_us, before = brought_to_refusal(board, situation)
        other = other_config_than_judged(board)
        changed: dict[str, Any] = {
            "ramp_ms": other.ramp_ms if board.has(Feature.AMPLITUDE) else 0,
            "late_window_us": other.late_window_us,
            "sound_speed_mm_s": other.sound_speed_mm_s,
            "amplitude_ceiling": other.amplitude_ceiling,
            "trace_divider": other.trace_divider,
            "host_timeout_ms": board.config.host_timeout_ms - 1,
            "hold_ms": board.config.hold_ms - 1,
        }
        usual = board.config
        for name, value in changed.items():
            wanted = SetConfig(dataclasses.replace(usual, **{name: value}))
            board.link.call(wanted, SetConfigReply)
            after = held_after_refusals(board, last_us)
            held = {key: value for key, value in before.items() if key not in _BY_CONFIG}
            text = held_state_changes(before, {key: after[key] for key in held})
            check(not text, f"{situation.name}, {name} is set: {text}")
        board.config = usual


@case("HG-7.1/3-hello", needs=Feature.CONFIG)
def an_allowed_speed_is_told_by_hello(board: BoardClient) -> None:
    """HELLO_REPLY tells the speed of sound that is set"""
    for speed in (300_000, 343_210, 380_000):
        board.configure(sound_speed_mm_s=speed)
        told = board.hello().sound_speed_mm_s
        check_equal(told, speed, f"sound_speed_mm_s {speed} is set, HELLO_REPLY says {told}")


@case("HG-3.6/2-events", needs=TRACED_PLAYS, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def events_of_many_allowed_requests_are_numbered(board: BoardClient) -> None:
    """2200 events of one session count up by 1: more than 11 bits of their numbers are kept"""
    send_phases_that_fit(board, STORED, frames=2)
    board.configure(trace_mode=TraceMode.CRC)
    board.hello()
    since, period_us = board.arm(), shortest_period_to_play_us(board, 500)
    play_out(board, STORED, 2, loops=_EVENTS // 2, period_us=period_us)
    judge_event_numbers(board, board.wire.received[since:])
    board.disarm()

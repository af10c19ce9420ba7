"""HG-4.6, HG-6.4, HG-6.5, HG-7.7: what ends the output or a playback, at every moment."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from haptogram_protocol.messages import Disarm, Feature, Mute, PlaybackEnded, StateChanged, Stop
from haptogram_protocol.state import OUTPUT_TRANSITIONS, OutputInput, OutputState

from ...case import Case, Depth
from ...client.board_client import BoardClient
from ...client.latching import is_board_silent, latch_now
from ...client.playback import (
    PERIOD_US,
    let_play,
    period_to_play,
    phases_that_fit,
    play_later,
    play_now,
    send_phases_to_store_if_supported,
)
from ...outcome import SELF_REPORTED, CaseEndedError, check, check_equal, named
from ...verdict import Behaviour
from ..ch05_stream.every_drop import fill_queue

_MS: Final = 1000
_SEQUENCE: Final = 7
_STORED: Final = 2  # frames of it, if one upload takes them
_QUEUED: Final = 2
_AFTER_MS: Final = 20  # how long the board is watched afterwards, behind its hold if that is short
_HOLD_MS: Final = 200
_RAMP_MS: Final = 900
_RAMPS: Final[dict[str, Any]] = {"ramp_ms": _RAMP_MS}
_TRIES: Final = 3
_FOREIGN: Final = 0x0660


@dataclass(frozen=True, slots=True)
class Moment:
    """A state of a board with an output that can be ended.

    Attributes
    ----------
    name : str
        For reports.
    config : dict
        Settings that differ from the usual ones.
    bring : callable
        Brings the ARMED board into this state.
    queued : int
        Frames that wait in it.
    frames : int or None
        Frames that were played in it, at 1 kHz at least; None: nothing plays.
    needs : Feature
        Capabilities that it needs.
    lasts_ms : int
        How long the board stays in it, from the beginning of *bring*.
    """

    name: str
    config: dict[str, Any]
    bring: Callable[[BoardClient], None]
    queued: int = 0
    frames: int | None = None
    needs: Feature = Feature.CONFIG
    lasts_ms: int = 3000


class _TooLateError(CaseEndedError):
    """A moment was over before its end was answered: host, line or emulator were held up."""


def _output_of_nothing(_: BoardClient) -> None:
    """Leave the board ARMED and silent."""


def _output_of_sound(board: BoardClient) -> None:
    latch_now(board)


def _output_with_queue(board: BoardClient) -> None:
    _output_of_sound(board)
    fill_queue(board, _QUEUED, 3_000_000)
    board.link.barrier()  # or MUTE may overtake them (HG-3.8/2)


def _output_in_ramp(board: BoardClient) -> None:
    """Queue frames, and be silent until the ramp of hold or lease has begun."""
    _output_with_queue(board)
    board.wire.idle(120 * _MS)


def _output_before_playback(board: BoardClient) -> None:
    _output_of_sound(board)
    play_later(board, _SEQUENCE, 3_000_000, unattended_ms=5000)


def _output_of_playback(board: BoardClient) -> None:
    play_now(board, _SEQUENCE, loops=0, unattended_ms=9_999)
    let_play(board, 5)


def _output_of_slow_playback(board: BoardClient) -> None:
    play_now(board, _SEQUENCE, loops=2, period_us=9_000_000)
    board.clock.wait_latched()


def _output_of_playback_in_ramp(board: BoardClient) -> None:
    play_now(board, _SEQUENCE, loops=0, unattended_ms=40)
    board.wire.idle(100 * _MS)


_PLAYS: Final = Feature.CONFIG | Feature.SEQUENCE_PHASES
_FADES: Final = Feature.CONFIG | Feature.AMPLITUDE


def _ramp_moment(
    name: str,
    config: dict[str, Any],
    bring: Callable[[BoardClient], None],
    queued: int = 0,
    frames: int | None = None,
) -> Moment:
    needs = _FADES if frames is None else _PLAYS | _FADES
    return Moment(name, _RAMPS | config, bring, queued, frames, needs, _RAMP_MS)


_MOMENTS: Final = (
    Moment("ARMED, silent", {}, _output_of_nothing),
    Moment("sounding", {"hold_ms": _HOLD_MS}, _output_of_sound, lasts_ms=_HOLD_MS),
    Moment("with frames queued", {}, _output_with_queue, _QUEUED),
    _ramp_moment("in the hold's ramp", {"hold_ms": 30}, _output_in_ramp, _QUEUED),
    _ramp_moment("in a ramp of the lease", {"host_timeout_ms": 40}, _output_in_ramp, _QUEUED),
    Moment("while a playback waits", {}, _output_before_playback, 0, 0, _PLAYS),
    Moment("while a sequence plays", {}, _output_of_playback, 0, 3, _PLAYS, 8000),
    Moment("within a long period", {}, _output_of_slow_playback, 0, 1, _PLAYS),
    _ramp_moment("in a ramp of a playback", {}, _output_of_playback_in_ramp, frames=20),
)


# --- Ends --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class End:
    """A frame that ends the output, or only a playback.

    Attributes
    ----------
    clause, variant : str
        Of the case.
    name : str
        Description.
    event : OutputInput
        Input of the table of HG-6.2.
    send : callable
        Sends it and waits for its answer.
    """

    clause: str
    variant: str
    name: str
    event: OutputInput
    send: Callable[[BoardClient], object]


def _mute_output_as_another(board: BoardClient) -> None:
    board.link.ask(Mute(), session=board.link.session ^ _FOREIGN)


_ENDS: Final = (
    End("HG-4.6/3", "moments", "a new session", OutputInput.NEW_SESSION, lambda b: b.hello()),
    End("HG-6.4/2", "moments", "MUTE", OutputInput.MUTE, lambda b: b.link.ask(Mute())),
    End("HG-6.4/2", "others", "MUTE of another session", OutputInput.MUTE, _mute_output_as_another),
    End("HG-6.5/1", "moments", "DISARM", OutputInput.DISARM, lambda b: b.link.ask(Disarm())),
    End("HG-7.7/1", "moments", "STOP", OutputInput.STOP, lambda b: b.link.ask(Stop())),
)


def _judge_end_of_output(board: BoardClient, end: End, moment: Moment) -> None:
    """FAILED unless the end leads to its state, flushes, ends the playback and counts no timer."""
    board.hello()
    board.configure(**{"hold_ms": 5000} | moment.config)
    is_over = end.event is not OutputInput.STOP
    board.arm()
    with board.counting(flushed=moment.queued if is_over else 0):
        since, begin_us = board.link.mark(), board.wire.now_us()
        moment.bring(board)
        end.send(board)
        took_ms, lasts_ms = (board.wire.now_us() - begin_us) // _MS, moment.lasts_ms
        if took_ms >= lasts_ms:
            text = f"answered after {took_ms} ms; the board leaves this state after {lasts_ms} ms"
            raise _TooLateError(Behaviour.INCONCLUSIVE, text)
        found = board.status()
    due = OUTPUT_TRANSITIONS[OutputState.ARMED, end.event]
    check(found.state is due, f"the state is {found.state.name}, due is {due.name}")
    queued = 0 if is_over else moment.queued
    check(found.queued == queued, f"{found.queued} frames are queued, due are {queued}")
    if is_over and board.has(Feature.READ_RADIATED):
        check(is_board_silent(board), "transducers are driven")
    _check_end_of_played_output(board, moment, since)
    if is_over:
        _check_output_stays_off(board, since, moment.config.get("hold_ms", 0) + _AFTER_MS)


def _judge_end_of_output_in_time(board: BoardClient, end: End, moment: Moment) -> None:
    """Judge; once more, twice at most, if the moment was over too soon."""
    for _ in range(_TRIES - 1):
        with contextlib.suppress(_TooLateError):
            _judge_end_of_output(board, end, moment)
            return
    _judge_end_of_output(board, end, moment)


def _check_end_of_played_output(board: BoardClient, moment: Moment, since: int) -> None:
    board.link.barrier()
    told = [event for _, event in board.link.events(PlaybackEnded, since)]
    due, stored = int(moment.frames is not None), phases_that_fit(board, _STORED)
    check(len(told) == due, f"{len(told)} PLAYBACK_ENDED, due are {due}")
    for event in told:
        least = moment.frames or 0
        if least > 1:
            least = max(1, least * PERIOD_US // period_to_play(board))
        least_most = least if moment.frames in (0, 1) else event.frames
        check_equal(event.sequence, _SEQUENCE, f"PLAYBACK_ENDED of sequence {event.sequence}")
        check(
            least <= event.frames <= least_most and event.loops == event.frames // stored,
            f"PLAYBACK_ENDED says {event.frames} frames, {event.loops} passes of {stored}",
        )


def _check_output_stays_off(board: BoardClient, since: int, watch_ms: int) -> None:
    """FAILED if something that was under way goes on: a timer, a ramp, the queue, a playback."""
    before = len(board.link.events(StateChanged, since))
    board.arm()
    with board.counting(latched=0):
        board.wire.idle(watch_ms * _MS)
        if board.has(Feature.READ_RADIATED):
            check(is_board_silent(board), "ARM sounds what was latched before")
    late = board.link.events(StateChanged, since)[before:]
    check(not late, f"ARMED again, {late[0][1].reason.name if late else ''} mutes the board")


def _case_of_output_end(end: End) -> Case:
    def body(board: BoardClient) -> None:
        send_phases_to_store_if_supported(board, _SEQUENCE, frames=_STORED)
        for moment in _MOMENTS:
            if not board.has(moment.needs):
                continue
            with named(f"{end.name} {moment.name}"):
                _judge_end_of_output_in_time(board, end, moment)

    summary = f"{end.name} while sounding, queued, fading, waiting and playing ends what it has to"
    needs = _PLAYS if end.event is OutputInput.STOP else Feature.CONFIG
    return Case(
        end.clause, summary, body, end.variant, needs, evidence=SELF_REPORTED, depth=Depth.DEFAULT
    )


PRODUCT: Final = tuple(_case_of_output_end(end) for end in _ENDS)

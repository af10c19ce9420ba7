"""HG-3.9, HG-4.6, HG-5.7, HG-6.3, HG-6.4, HG-6.5, HG-6.6, HG-6.11, HG-7.1, HG-7.4, HG-7.6,
HG-7.7: events.

Each event changes what SPEC.md says of it, and leaves all else that a host can read.  A table of
events, and for each of them the values that are due; whatever a board holds beside these has to be
there as before: in every state, with frames queued, a playback and an upload under way.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from haptogram_protocol import messages as m
from haptogram_protocol.state import OUTPUT_TRANSITIONS, MuteReason, OutputInput, OutputState

from ...case import NOTHING, Case, Depth, case
from ...client import latching, playback, uploads
from ...client.board_client import BoardClient
from ...client.stream_kinds import stream_kinds
from ...judge import effects, events
from ...judge.held_state import ANYTHING, Held, held_state_changes, judged_held_state
from ...judge.refused_requests import PENDING, STORED
from ...judge.timers import judge_in_time
from ...outcome import SELF_REPORTED, HeldUpError, check, check_equal, check_fields, named
from ..ch05_stream.every_drop import (
    BEFORE_STATE,
    DROPS,
    OUTPUT_STATES,
    PLAYING,
    PLAYING_SLOWLY,
    QUEUED_FRAMES,
    QUEUES,
    SILENT,
    WAITS,
)
from ..ch10_errors.refusals import (
    Situation,
    brought_to_refusal,
    is_situation_old,
    pending_before_refusal,
    refusal_situations,
)
from .states import fail_hardware, recover_from_hardware_fault

_OTHER: Final = 7  # sequence of an upload that is begun and not committed
_FOREIGN: Final = 0x0550
_UPLOADS: Final = m.Feature.SEQUENCE_PHASES
_UNKNOWN_FLAG: Final = 0x40
_ON: Final = (QUEUES, PLAYING_SLOWLY, WAITS)
_PLAYS: Final = m.Feature.CONFIG | m.Feature.SEQUENCE_PHASES
_MS: Final = 1000
_STORED: Final = 2  # frames of it, if one upload takes them
_AFTER_MS: Final = 20  # how long the board is watched afterwards, behind its hold if that is short
_HOLD_MS: Final = 200
_RAMP_MS: Final = 900
_TRIES: Final = 3
_RAMPS: Final[dict[str, Any]] = {"ramp_ms": _RAMP_MS}
_FADES: Final = m.Feature.CONFIG | m.Feature.AMPLITUDE


@dataclass(frozen=True, slots=True)
class Effect:
    """An event, and what it changes.

    Attributes
    ----------
    clause : str
        Of the case that judges it.
    name : str
        For reports.
    happen : callable
        Brings it about, and waits for what it leads to.
    due : callable
        Returns the values that are due after it, where they are not those before.
    needs : Feature
        Capabilities that it needs.
    where : tuple of str
        Names of the situations in which it can come about; empty: in all.
    variant : str
        Of the case that judges it.
    """

    clause: str
    name: str
    happen: events.Event
    due: effects.Due
    needs: m.Feature = NOTHING
    where: tuple[str, ...] = ()
    variant: str = "alone"


# --- What happens ------------------------------------------------------------------------------


def _greet_again(board: BoardClient) -> None:
    """Send HELLO with the same nonce."""
    board.hello(board.link.session)


def _configure_again(board: BoardClient) -> None:
    """Send SET_CONFIG with the same values."""
    board.link.ask(m.SetConfig(board.config))


def _stop(board: BoardClient) -> None:
    """Send STOP."""
    board.stop()


def _begin_upload_for_effect(board: BoardClient) -> None:
    """Begin another upload of one frame."""
    board.link.ask(m.UploadBegin(m.UploadKind.PHASES, 0, _OTHER, board.identity.transducers, 0))


def _add_chunk_for_effect(board: BoardClient) -> None:
    """Send the next two bytes of the pending upload."""
    board.link.ask(m.UploadChunk(1, pending_before_refusal(board)[1:3]))


def _complete_upload_for_effect(board: BoardClient) -> None:
    """Send the pending upload and commit it."""
    uploads.send_upload_chunks(board, pending_before_refusal(board))
    board.link.ask(m.UploadCommit(PENDING))


def _drop_for_effect(counter: str) -> events.Event:
    """Return a function that sends frames which the board drops and counts in *counter*."""

    def send(board: BoardClient) -> None:
        frames = (
            drop.frames(board, kind, 0)
            for drop in DROPS
            for kind in (stream_kinds(board) if drop.counter == counter else ())
        )
        board.link.send(*board.within_timers(itertools.chain.from_iterable(frames)))

    return send


# --- Table -------------------------------------------------------------------------------------


def _input(clause: str, name: str, message: m.Message, **header: int) -> Effect:
    """Return an event that sends *message* with the given header fields, to judge *clause*.

    *name* is for findings; the effect due is that of the table of HG-6.2.
    """
    due = effects.effect_of_input(OutputInput[message.TYPE.name])
    return Effect(clause, name, lambda board: board.link.ask(message, **header), due)


def _foreign_mute(board: BoardClient) -> None:
    """Send MUTE from another session."""
    board.mute(session=board.link.session ^ _FOREIGN)


def _timer(reason: MuteReason, happen: events.Event, needs: m.Feature, *where: str) -> Effect:
    """Return a mute by a timer as an event, with the effect that is due after it.

    *happen* lets the timer expire; *where* names the output states to try it in, none: all.
    """
    due = effects.effect_of_timer(reason)
    return Effect("HG-6.11/5", f"a mute, {reason.name}", happen, due, needs, where)


def _upload(name: str, happen: events.Event, due: effects.Due) -> Effect:
    """Return an event of an upload: *happen* causes it, *due* returns the effect due after it."""
    return Effect("HG-7.4/1", name, happen, due, _UPLOADS)


def _every_event() -> Iterator[Effect]:
    """Yield every event of line, host, timers and hardware, with the effect that is due."""
    once, of_mute = effects.effect_counted_once, effects.effect_of_input(OutputInput.MUTE)
    for name in ("crc", "cobs", "short", "oversize", "unknown_type"):
        yield Effect("HG-3.9/1", f"a frame for {name}", events.event_of_damage(name), once(name))
    for name in BEFORE_STATE:
        due = effects.effect_of_copies if name == "duplicate" else effects.no_effect
        yield Effect("HG-3.9/1", f"stream frames for {name}", _drop_for_effect(name), due)
    again, same = "HELLO with the open nonce", "SET_CONFIG as it is"
    yield Effect("HG-4.6/1", again, _greet_again, once("repeated"), variant="moments")
    yield Effect(
        "HG-7.1/3", same, _configure_again, effects.no_effect, m.Feature.CONFIG, variant="same"
    )
    yield _input("HG-6.3/2", "ARM", m.Arm())
    yield _input("HG-6.4/2", "MUTE", m.Mute())
    yield Effect("HG-6.4/2", "MUTE of another session", _foreign_mute, of_mute)
    yield _input("HG-6.4/2", "MUTE without a session", m.Mute(), session=0)
    yield _input("HG-6.5/1", "DISARM", m.Disarm())
    yield Effect("HG-7.7/2", "STOP", _stop, effects.effect_of_end, _UPLOADS)
    yield Effect("HG-4.6/5", "a new session", BoardClient.hello, effects.effect_of_new_session)
    yield _upload("UPLOAD_CHUNK", _add_chunk_for_effect, effects.effect_of_received(3))
    yield _upload("UPLOAD_BEGIN", _begin_upload_for_effect, effects.effect_of_received(0))
    yield _upload("UPLOAD_COMMIT", _complete_upload_for_effect, effects.effect_of_commit)
    corrected, plays = effects.effect_of_correction, effects.effect_of_play
    correct, play = events.event_of_correction, events.event_of_waiting_playback
    yield Effect("HG-7.4/1", "a new correction", correct, corrected, m.Feature.CORRECTION)
    yield Effect("HG-7.6/3", "PLAY", play, plays, _UPLOADS, (QUEUES,))
    yield _timer(MuteReason.HOLD_EXPIRED, events.event_of_hold, m.Feature.CONFIG, *_ON)
    yield _timer(MuteReason.HOST_SILENT, events.event_of_lease, m.Feature.CONFIG, QUEUES)
    alone = events.event_of_unattended_time
    yield _timer(MuteReason.UNATTENDED, alone, _PLAYS, QUEUES, WAITS)
    yield Effect("HG-6.6/1", "a fault", fail_hardware, effects.effect_of_fault)


_EVENTS: Final = tuple(_every_event())
_ARM: Final = next(event for event in _EVENTS if event.name == "ARM")


# --- Cases -------------------------------------------------------------------------------------


def _held_after_effect(board: BoardClient, last_us: int, effect: Effect) -> Held:
    """Cause *effect*, return the held state of the board; FAILED if it takes a used request number.

    Unless *last_us* is 0, a frame for that time, of the last queued one, is sent before: it is
    dropped.
    """
    since = board.link.mark()
    if last_us:  # dropped for its order: the margins tell of it
        board.link.stream(board.shortest_stream(), last_us)
        board.link.barrier()  # or MUTE may overtake it (HG-3.8/2)
    effect.happen(board)
    old = (board.link.seq - 1) & 0xFFFF
    board.link.refused(
        m.Ping(board.random.getrandbits(64)), m.ErrorCode.SEQUENCE_REUSED, old, seq=old
    )
    # A frame that uses its number and nothing else: gap and duplicate tell which one was due.
    board.link.stream(board.shortest_stream(), flags=_UNKNOWN_FLAG)
    return judged_held_state(board, since)


def _judge_effects(board: BoardClient, some: Sequence[Effect], situation: Situation) -> None:
    """Bring the board to *situation*, cause *some* events; FAILED if one changes more than is due.

    Due are the changes of its effect; events of other situations are left out.
    """
    before: Held | None = None
    last_us = brought_us = 0
    config = board.config
    for effect in some:
        if effect.where and situation.name not in effect.where:
            continue
        if before is None or is_situation_old(board, brought_us):
            brought_us = board.wire.now_us()
            last_us, before = brought_to_refusal(board, situation)
            config = board.config
        held = _held_after_effect(board, last_us, effect)
        muted = effects.state_before_effect(held) == (OutputState.MUTED, MuteReason.HOLD_EXPIRED)
        lasted_us = board.wire.now_us() - brought_us
        if muted and not board.has(m.Feature.CONFIG) and lasted_us >= 1000 * board.config.hold_ms:
            before = None  # this line takes longer than the hold, which nothing extends
            continue
        due = effect.due(board, before)
        text = held_state_changes(before, held, due)
        judge_in_time(board, not text, f"{effect.name}: {text}")
        leaves = all(name.startswith("the counter") for name in due)
        before = held if leaves else None
        if effects.state_before_effect(held)[0] is OutputState.FAULT:
            recover_from_hardware_fault(board)
        elif not leaves:
            _judge_arm_behind_effect(board, effect, held, config)


def _judge_arm_behind_effect(
    board: BoardClient, effect: Effect, before: Held, config: m.Config
) -> None:
    """FAILED if ARM after *effect* changes anything of the held state but the output state.

    *before* is the held state behind *effect*.  If that changed the configuration, *config* is set
    again first: short timers would expire during the readings on a slow line.
    """
    if board.config != config:
        board.config = config
        board.link.ask(m.SetConfig(config))
        before = judged_held_state(board, board.link.mark())
    due = _ARM.due(board, before) | {"events": ANYTHING, "the arrival margins": ANYTHING}
    text = held_state_changes(before, _held_after_effect(board, 0, _ARM), due)
    judge_in_time(board, not text, f"{effect.name}, then ARM: {text}")


def _effect_case(clause: str, variant: str) -> Case:
    """Return the case *variant* of a clause: its events, in every state of output and playback.

    FAILED if an event changes more of the held state than is due.
    """
    asked = [e for e in _EVENTS if (e.clause, e.variant) == (clause, variant)]

    def body(board: BoardClient) -> None:
        some = [effect for effect in asked if board.has(effect.needs)]
        if not some:
            board.need(asked[0].needs)
        playback.send_phases_to_store_if_supported(board, STORED, frames=1)
        for situation in (*refusal_situations(board), Situation(SILENT)):
            with named(situation.name):
                _judge_effects(board, some, situation)

    first = asked[0].name + (" and others" if len(asked) > 1 else "")
    summary = f"{first}, in every state of output and playback: all else is as before"
    return Case(clause, summary, body, variant, evidence=SELF_REPORTED, depth=Depth.DEFAULT)


_IDS: Final = dict.fromkeys((event.clause, event.variant) for event in _EVENTS)
PRODUCT: Final = tuple(_effect_case(*names) for names in _IDS)


@case("HG-5.7/1-fault", evidence=SELF_REPORTED)
def a_hardware_fault_drops_stream_frames(board: BoardClient) -> None:
    """in FAULT frames of every message and format are counted in dropped_state, none is latched"""
    fail_hardware(board)
    kinds = stream_kinds(board)
    with board.counting(dropped_state=len(kinds), latched=0):
        for kind in kinds:
            board.link.stream(kind.make())
    recover_from_hardware_fault(board)


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
    bring: Callable[[BoardClient], Any]
    queued: int = 0
    frames: int | None = None
    needs: m.Feature = m.Feature.CONFIG
    lasts_ms: int = 3000


def _output_with_queue(board: BoardClient) -> None:
    """Latch a frame, then queue three for later."""
    latching.latch_now(board)
    OUTPUT_STATES[QUEUES](board)
    board.link.barrier()  # or MUTE may overtake them (HG-3.8/2)


def _output_in_ramp(board: BoardClient) -> None:
    """Latch a frame, queue three and wait 70 ms: the hold or lease set before begins its ramp."""
    _output_with_queue(board)
    board.wire.idle(70 * _MS)


def _output_of_playback(board: BoardClient) -> None:
    """Play a stored sequence in a loop, and wait for five of its frames."""
    OUTPUT_STATES[PLAYING](board)
    playback.let_play(board, 5)


def _output_of_playback_in_ramp(board: BoardClient) -> None:
    """Start a playback whose unattended time is 40 ms, and wait 70 ms: its ramp has begun."""
    playback.play_now(board, STORED, loops=0, unattended_ms=40)
    board.wire.idle(70 * _MS)


def _ramp_moment(
    name: str,
    config: dict[str, Any],
    bring: Callable[[BoardClient], Any],
    queued: int = 0,
    frames: int | None = None,
) -> Moment:
    """Return the board's state during an amplitude ramp, reached by *bring* with settings *config*.

    *queued* frames wait in it; *frames* is how many were played, None: nothing plays.
    """
    needs = _FADES if frames is None else _PLAYS | _FADES
    return Moment(name, _RAMPS | config, bring, queued, frames, needs, _RAMP_MS)


_MOMENTS: Final = (
    Moment(SILENT, {}, OUTPUT_STATES[SILENT]),
    Moment("sounding", {"hold_ms": _HOLD_MS}, latching.latch_now, lasts_ms=_HOLD_MS),
    Moment(QUEUES, {}, _output_with_queue, QUEUED_FRAMES),
    _ramp_moment("in the hold's ramp", {"hold_ms": 30}, _output_in_ramp, QUEUED_FRAMES),
    _ramp_moment("in a ramp of the lease", {"host_timeout_ms": 40}, _output_in_ramp, QUEUED_FRAMES),
    Moment(WAITS, {}, OUTPUT_STATES[WAITS], 0, 0, _PLAYS),
    Moment(PLAYING, {}, _output_of_playback, 0, 3, _PLAYS, 8000),
    Moment(PLAYING_SLOWLY, {}, OUTPUT_STATES[PLAYING_SLOWLY], 0, 1, _PLAYS),
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


_ENDS: Final = (
    End("HG-4.6/3", "moments", "a new session", OutputInput.NEW_SESSION, lambda b: b.hello()),
    End("HG-6.4/2", "moments", "MUTE", OutputInput.MUTE, lambda b: b.mute()),
    End("HG-6.4/2", "others", "MUTE of another session", OutputInput.MUTE, _foreign_mute),
    End("HG-6.5/1", "moments", "DISARM", OutputInput.DISARM, lambda b: b.link.ask(m.Disarm())),
    End("HG-7.7/1", "moments", "STOP", OutputInput.STOP, lambda b: b.stop()),
)


def _judge_end_of_output(board: BoardClient, end: End, moment: Moment) -> None:
    """FAILED unless *end*, sent in state *moment*, leads to the output state that is due.

    Unless *end* is STOP, the output is silent then, and neither queue nor playback goes on.
    """
    board.hello()
    board.configure(**{"hold_ms": 5000} | moment.config)
    is_over = end.event is not OutputInput.STOP
    board.arm()
    with board.counting(flushed=moment.queued if is_over else 0):
        since, begin_us = board.link.mark(), board.wire.now_us()
        moment.bring(board)
        end.send(board)
        board.wire.check_not_after(
            begin_us + moment.lasts_ms * _MS, "a state that has ended by itself"
        )
        due = OUTPUT_TRANSITIONS[OutputState.ARMED, end.event]
        board.check_status("behind it", state=due, queued=0 if is_over else moment.queued)
    if is_over:
        latching.check_silent(board, "behind it")
    _check_end_of_played_output(board, moment, since)
    if is_over:
        _check_output_stays_off(board, since, moment.config.get("hold_ms", 0) + _AFTER_MS)


def _judge_end_of_output_in_time(board: BoardClient, end: End, moment: Moment) -> None:
    """Judge *end* in the state *moment*, with up to two retries if the host was late."""
    for _ in range(_TRIES - 1):
        with contextlib.suppress(HeldUpError):
            _judge_end_of_output(board, end, moment)
            return
    _judge_end_of_output(board, end, moment)


def _check_end_of_played_output(board: BoardClient, moment: Moment, since: int) -> None:
    """FAILED unless PLAYBACK_ENDED came once if a playback ran in *moment*, else never.

    It has to name the frames played; received frames from number *since* on count.
    """
    board.link.barrier()
    told = [event for _, event in board.link.events(m.PlaybackEnded, since)]
    stored = playback.phases_that_fit(board, _STORED)
    check_equal(len(told), int(moment.frames is not None), f"{len(told)} PLAYBACK_ENDED")
    for event in told:
        least = moment.frames or 0
        if least > 1:
            least = max(1, least * playback.PERIOD_US // playback.period_to_play(board))
        least_most = least if moment.frames in (0, 1) else event.frames
        passes = event.frames // stored
        check_fields(event, "PLAYBACK_ENDED", sequence=STORED, loops=passes)
        check(least <= event.frames <= least_most, f"PLAYBACK_ENDED says {event.frames} frames")


def _check_output_stays_off(board: BoardClient, since: int, watch_ms: int) -> None:
    """Arm, watch for *watch_ms*; FAILED if a timer, ramp, queue or playback from before goes on.

    Received frames from number *since* on count.
    """
    before = len(board.link.events(m.StateChanged, since))
    board.arm()
    with board.counting(latched=0):
        board.wire.idle(watch_ms * _MS)
        latching.check_silent(board, "behind it and ARM")
    late = [event.reason.name for _, event in board.link.events(m.StateChanged, since)[before:]]
    check(not late, f"ARMED again, {', '.join(late)} mutes the board")


def _case_of_output_end(end: End) -> Case:
    """Return the case that sends *end* in every state of the output: queued, in a ramp, others."""

    def body(board: BoardClient) -> None:
        playback.send_phases_to_store_if_supported(board, STORED, frames=_STORED)
        for moment in _MOMENTS:
            if not board.has(moment.needs):
                continue
            with named(f"{end.name} {moment.name}"):
                _judge_end_of_output_in_time(board, end, moment)

    summary = f"{end.name} while sounding, queued, fading, waiting and playing ends what it has to"
    needs = _PLAYS if end.event is OutputInput.STOP else m.Feature.CONFIG
    return Case(
        end.clause, summary, body, end.variant, needs, evidence=SELF_REPORTED, depth=Depth.DEFAULT
    )


ENDS: Final = tuple(_case_of_output_end(end) for end in _ENDS)

"""HG-3.9, HG-4.6, HG-5.7, HG-6.3, HG-6.4, HG-6.5, HG-6.6, HG-6.11, HG-7.1, HG-7.4, HG-7.6,
HG-7.7: events.

Each event changes what SPEC.md says of it, and leaves all else that a host can read.  A table of
events, and for each of them the values that are due; whatever a board holds beside these has to be
there as before: in every state, with frames queued, a playback and an upload under way.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Config,
    Disarm,
    ErrorCode,
    Feature,
    Message,
    Mute,
    Ping,
    SetConfig,
    Stop,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    UploadKind,
)
from haptogram_protocol.state import MuteReason, OutputInput, OutputState

from ...case import NOTHING, Case, Depth, case
from ...client.board_client import BoardClient
from ...client.playback import send_phases_to_store_if_supported
from ...client.stream_kinds import stream_kinds
from ...client.uploads import send_upload_chunks
from ...judge.effects import (
    Due,
    effect_counted_once,
    effect_of_commit,
    effect_of_copies,
    effect_of_correction,
    effect_of_end,
    effect_of_fault,
    effect_of_input,
    effect_of_new_session,
    effect_of_play,
    effect_of_received,
    effect_of_timer,
    no_effect,
    state_before_effect,
)
from ...judge.events import (
    Event,
    event_of_correction,
    event_of_damage,
    event_of_hold,
    event_of_lease,
    event_of_unattended_time,
    event_of_waiting_playback,
)
from ...judge.held_state import ANYTHING, Held, held_state_changes, judged_held_state
from ...judge.refused_requests import PENDING, STORED
from ...judge.timers import judge_in_time
from ...outcome import SELF_REPORTED, named
from ..ch05_stream.every_drop import DROPS
from ..ch05_stream.every_state import BEFORE_STATE
from ..ch10_errors.every_refusal import (
    PLAYING,
    QUEUED,
    SILENT,
    WAITING,
    Situation,
    brought_to_refusal,
    is_situation_old,
    pending_before_refusal,
    refusal_situations,
)
from .faults import fail_hardware, recover_from_hardware_fault

_OTHER: Final = 7  # sequence of an upload that is begun and not committed
_FOREIGN: Final = 0x0550
_UPLOADS: Final = Feature.SEQUENCE_PHASES
_REUSED: Final = ErrorCode.SEQUENCE_REUSED
_UNKNOWN_FLAG: Final = 0x40


@dataclass(frozen=True, slots=True)
class Effect:
    """An event, and what it changes.

    Attributes
    ----------
    clause, variant : str
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
    """

    clause: str
    variant: str
    name: str
    happen: Event
    due: Due
    needs: Feature = NOTHING
    where: tuple[str, ...] = ()


# --- What happens ------------------------------------------------------------------------------


def _asked(message: Message) -> Event:
    """Return the event of a request that is answered."""
    return lambda board: board.link.ask(message)


def _begin_upload_for_effect(board: BoardClient) -> None:
    board.link.ask(UploadBegin(UploadKind.PHASES, 0, _OTHER, board.identity.transducers, 0))


def _add_chunk_for_effect(board: BoardClient) -> None:
    board.link.ask(UploadChunk(1, pending_before_refusal(board)[1:3]))


def _complete_upload_for_effect(board: BoardClient) -> None:
    send_upload_chunks(board, pending_before_refusal(board))
    board.link.ask(UploadCommit(PENDING))


def _drop_for_effect(counter: str) -> Event:
    """Return the event of frames of every format that *counter*, of steps 6 to 10, counts."""

    def send(board: BoardClient) -> None:
        frames = (
            drop.frames(board, kind, 0)
            for drop in DROPS
            for kind in (stream_kinds(board) if drop.counter == counter else ())
        )
        board.link.send(*board.within_timers(itertools.chain.from_iterable(frames)))

    return send


# --- Table -------------------------------------------------------------------------------------

_ON: Final = (QUEUED, PLAYING, WAITING)
_SHORTENS: Final = Feature.CONFIG
_PLAYS: Final = Feature.CONFIG | Feature.SEQUENCE_PHASES


def _every_event() -> Iterator[Effect]:
    for name in ("crc", "cobs", "short", "oversize", "unknown_type"):
        yield Effect(
            "HG-3.9/1",
            "alone",
            f"a frame for {name}",
            event_of_damage(name),
            effect_counted_once(name),
        )
    for name in BEFORE_STATE:
        due: Due = effect_of_copies if name == "duplicate" else no_effect
        yield Effect("HG-3.9/1", "alone", f"stream frames for {name}", _drop_for_effect(name), due)
    repeated = effect_counted_once("repeated")
    yield Effect(
        "HG-4.6/1",
        "moments",
        "HELLO with the open nonce",
        lambda b: b.hello(b.link.session),
        repeated,
    )
    yield Effect(
        "HG-7.1/3",
        "same",
        "SET_CONFIG as it is",
        lambda b: b.link.ask(SetConfig(b.config)),
        no_effect,
        Feature.CONFIG,
    )
    yield Effect("HG-6.3/2", "alone", "ARM", _asked(Arm()), effect_of_input(OutputInput.ARM))
    mutes: dict[str, Event] = {
        "MUTE": _asked(Mute()),
        "MUTE of another session": lambda b: b.link.ask(Mute(), session=b.link.session ^ _FOREIGN),
        "MUTE without a session": lambda b: b.link.ask(Mute(), session=0),
    }
    for name, mute in mutes.items():
        yield Effect("HG-6.4/2", "alone", name, mute, effect_of_input(OutputInput.MUTE))
    yield Effect(
        "HG-6.5/1", "alone", "DISARM", _asked(Disarm()), effect_of_input(OutputInput.DISARM)
    )
    yield Effect("HG-7.7/2", "alone", "STOP", _asked(Stop()), effect_of_end, _UPLOADS)
    yield Effect("HG-4.6/5", "alone", "a new session", BoardClient.hello, effect_of_new_session)
    yield Effect(
        "HG-7.4/1", "alone", "UPLOAD_CHUNK", _add_chunk_for_effect, effect_of_received(3), _UPLOADS
    )
    yield Effect(
        "HG-7.4/1",
        "alone",
        "UPLOAD_BEGIN",
        _begin_upload_for_effect,
        effect_of_received(0),
        _UPLOADS,
    )
    yield Effect(
        "HG-7.4/1",
        "alone",
        "UPLOAD_COMMIT",
        _complete_upload_for_effect,
        effect_of_commit,
        _UPLOADS,
    )
    correction = Feature.CORRECTION
    yield Effect(
        "HG-7.4/1",
        "alone",
        "a new correction",
        event_of_correction,
        effect_of_correction,
        correction,
    )
    queue = (QUEUED,)
    yield Effect(
        "HG-7.6/3", "alone", "PLAY", event_of_waiting_playback, effect_of_play, _UPLOADS, queue
    )
    for reason, happen, needs, where in (
        (MuteReason.HOLD_EXPIRED, event_of_hold, _SHORTENS, _ON),
        (MuteReason.HOST_SILENT, event_of_lease, _SHORTENS, queue),
        (MuteReason.UNATTENDED, event_of_unattended_time, _PLAYS, (QUEUED, WAITING)),
    ):
        due = effect_of_timer(reason)
        yield Effect("HG-6.11/5", "alone", f"a mute, {reason.name}", happen, due, needs, where)
    yield Effect("HG-6.6/1", "alone", "a fault", fail_hardware, effect_of_fault)


_EVENTS: Final = tuple(_every_event())
_ARM: Final = next(event for event in _EVENTS if event.name == "ARM")


# --- Cases -------------------------------------------------------------------------------------


def _held_after_effect(board: BoardClient, last_us: int, effect: Effect) -> Held:
    """Return what a board holds after an event; FAILED if an old number is taken again."""
    since = board.link.mark()
    if last_us:  # dropped for its order: the margins tell of it
        board.link.stream(board.shortest_stream(), last_us)
        board.link.barrier()  # or MUTE may overtake it (HG-3.8/2)
    effect.happen(board)
    old = (board.link.seq - 1) & 0xFFFF
    board.link.refused(Ping(board.random.getrandbits(64)), _REUSED, old, seq=old)
    # A frame that uses its number and nothing else: gap and duplicate tell which one was due.
    board.link.stream(board.shortest_stream(), flags=_UNKNOWN_FLAG)
    return judged_held_state(board, since)


def _judge_effects(board: BoardClient, effects: tuple[Effect, ...], situation: Situation) -> None:
    """FAILED with the name of the first event that changes what it must leave."""
    before: Held | None = None
    last_us = brought_us = 0
    config = board.config
    for effect in effects:
        if effect.where and situation.name not in effect.where:
            continue
        if before is None or is_situation_old(board, brought_us):
            brought_us = board.wire.now_us()
            last_us, before = brought_to_refusal(board, situation)
            config = board.config
        held = _held_after_effect(board, last_us, effect)
        muted = state_before_effect(held) == (OutputState.MUTED, MuteReason.HOLD_EXPIRED)
        lasted_us = board.wire.now_us() - brought_us
        if muted and not board.has(Feature.CONFIG) and lasted_us >= 1000 * board.config.hold_ms:
            before = None  # this line takes longer than the hold, which nothing extends
            continue
        due = effect.due(board, before)
        text = held_state_changes(before, held, due)
        judge_in_time(board, not text, f"{effect.name}: {text}")
        leaves = all(name.startswith("the counter") for name in due)
        before = held if leaves else None
        if state_before_effect(held)[0] is OutputState.FAULT:
            recover_from_hardware_fault(board)
        elif not leaves:
            _judge_arm_behind_effect(board, effect, held, config)


def _judge_arm_behind_effect(
    board: BoardClient, effect: Effect, before: Held, config: Config
) -> None:
    """FAILED if ARM behind an event changes anything but the state: nothing sounds again.

    Timers that the event has shortened are as in *config* again: on a slow line the readings take
    longer than they last.
    """
    if board.config != config:
        board.config = config
        board.link.ask(SetConfig(config))
        before = judged_held_state(board, board.link.mark())
    due = _ARM.due(board, before) | {"events": ANYTHING, "the arrival margins": ANYTHING}
    text = held_state_changes(before, _held_after_effect(board, 0, _ARM), due)
    judge_in_time(board, not text, f"{effect.name}, then ARM: {text}")


def _effect_case(clause: str, variant: str, effects: tuple[Effect, ...]) -> Case:
    def body(board: BoardClient) -> None:
        some = tuple(effect for effect in effects if board.has(effect.needs))
        if not some:
            board.need(effects[0].needs)
        send_phases_to_store_if_supported(board, STORED, frames=1)
        for situation in (*refusal_situations(board), Situation(SILENT)):
            with named(situation.name):
                _judge_effects(board, some, situation)

    first = effects[0].name + (" and others" if len(effects) > 1 else "")
    summary = f"{first}, in every state of output and playback: all else is as before"
    return Case(clause, summary, body, variant, evidence=SELF_REPORTED, depth=Depth.DEFAULT)


def _effect_cases() -> Iterator[Case]:
    for clause, variant in dict.fromkeys((event.clause, event.variant) for event in _EVENTS):
        same = (e for e in _EVENTS if (e.clause, e.variant) == (clause, variant))
        yield _effect_case(clause, variant, tuple(same))


PRODUCT: Final = tuple(_effect_cases())


@case("HG-5.7/1-fault", evidence=SELF_REPORTED)
def a_hardware_fault_drops_stream_frames(board: BoardClient) -> None:
    """in FAULT frames of every message and format are counted in dropped_state, none is latched"""
    fail_hardware(board)
    kinds = stream_kinds(board)
    with board.counting(dropped_state=len(kinds), latched=0):
        for kind in kinds:
            board.link.stream(kind.make())
    recover_from_hardware_fault(board)

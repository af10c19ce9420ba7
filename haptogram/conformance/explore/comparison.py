"""Comparison of two boards, frame by frame, within the freedom that SPEC.md leaves."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, Self

from haptogram_protocol.messages import (
    EVENT_RANGE,
    Counters,
    DriveReply,
    Error,
    ErrorCode,
    GeometryReply,
    Header,
    HelloReply,
    Message,
    Play,
    PlaybackEnded,
    Pong,
    StateChanged,
    Status,
    StatusReply,
    Trace,
    TraceDrive,
    TracePlayback,
    TraceReply,
    UploadBeginReply,
    UploadChunk,
    UploadCommit,
    signed_difference,
)
from haptogram_protocol.state import MuteReason

_SAME_IN_HELLO: Final = frozenset(
    {"major", "minor", "nonce", "state", "sound_speed_mm_s", "config_crc"}
)
#: Fields in which boards of one protocol may differ.
_OWN: Final[dict[type[Message], frozenset[str]]] = {
    HelloReply: frozenset(HelloReply.WIRE) - _SAME_IN_HELLO,
    UploadBeginReply: frozenset(UploadBeginReply.WIRE),
    Status: frozenset({"free_bytes"}),
    StatusReply: frozenset({"free_bytes"}),
    GeometryReply: frozenset({"elements"}),
    # CRC-32 of a computed drive may differ by rounding; other cases compare the drives.
    Trace: frozenset({"crc"}),
    TracePlayback: frozenset({"crc"}),
    TraceDrive: frozenset({"data"}),
    TraceReply: frozenset({"records"}),
}
#: Fields that are times or time differences, by the last letters of their names.
_TIMES: Final = "_us"
_CODES_APART: Final = 1  # steps between two computations of one drive


@dataclass(frozen=True, slots=True)
class DialogueBase:
    """Counters and number of stored sequences of a board before slot 0."""

    counters: Counters
    stored: int = 0


@dataclass(slots=True)
class DialogueEventNumbers:
    """Numbers of a board's events: each is the one before and 1, from 0 in every session."""

    session: int
    due: int = 0

    def first_wrong(self, frames: Iterable[tuple[Header, Message]]) -> str:
        """Return the first event of *frames* that is not numbered so (HG-4.6); else empty."""
        for header, message in frames:
            if isinstance(message, HelloReply) and message.nonce != self.session:
                self.session, self.due = message.nonce, 0
            if header.type not in EVENT_RANGE:
                continue
            if header.seq != self.due:
                name = _named_in_dialogue(message)
                return f"{name}: its number is {header.seq}, due is {self.due}"
            self.due = (self.due + 1) & 0xFFFF
        return ""


@dataclass(frozen=True, slots=True)
class DialogueAnswers:
    """Responses and events of one board in one slot, and what it said before the dialogue."""

    responses: list[tuple[Header, Message]]
    events: list[tuple[Header, Message]]
    base: DialogueBase

    @classmethod
    def of(cls, frames: Iterable[tuple[Header, Message]], base: DialogueBase) -> Self:
        """Sort *frames*; a STATE_CHANGED of a MUTE is optional (HG-6.8/2) and left out."""
        kept = [pair for pair in frames if not _is_optional_in_dialogue(pair[1])]
        events = [pair for pair in kept if pair[0].type in EVENT_RANGE]
        return cls([pair for pair in kept if pair[0].type not in EVENT_RANGE], events, base)


def _is_optional_in_dialogue(message: Message) -> bool:
    return isinstance(message, StateChanged) and message.reason is MuteReason.MUTE


def dialogue_difference(ours: DialogueAnswers, theirs: DialogueAnswers, tolerance_us: int) -> str:
    """Return the first difference between a board and the model; empty if there is none."""
    for kind in ("responses", "events"):
        one, other = getattr(ours, kind), getattr(theirs, kind)
        for place, (mine, due) in enumerate(zip(one, other, strict=False)):
            if text := _dialogue_frame_difference(mine, due, ours, theirs, tolerance_us):
                return f"{kind[:-1]} {place}: {text}"
        if len(one) != len(other):
            rest = one[len(other) :] or other[len(one) :]
            who = "the board sends" if len(one) > len(other) else "due is"
            return f"{who} {_named_in_dialogue(rest[0][1])} as well"
    return ""


def _dialogue_frame_difference(
    mine: tuple[Header, Message],
    due: tuple[Header, Message],
    ours: DialogueAnswers,
    theirs: DialogueAnswers,
    tolerance_us: int,
) -> str:
    header, message = mine
    due_header, due_message = due
    if type(message) is not type(due_message):
        return f"{_named_in_dialogue(message)}, due is {_named_in_dialogue(due_message)}"
    for name in ("session", "flags") if header.type in EVENT_RANGE else ("session", "flags", "seq"):
        if getattr(header, name) != getattr(due_header, name):
            return (
                f"{_named_in_dialogue(message)}: {name} is {getattr(header, name):#x}, "
                f"due is {getattr(due_header, name):#x}"
            )
    if not _is_near_in_dialogue(header.time_us, due_header.time_us, tolerance_us):
        name = _named_in_dialogue(message)
        return f"{name}: time_us is {header.time_us}, due is {due_header.time_us}"
    return _dialogue_message_difference(message, due_message, ours, theirs, tolerance_us)


def _dialogue_message_difference(
    message: Message,
    due: Message,
    ours: DialogueAnswers,
    theirs: DialogueAnswers,
    tolerance_us: int,
) -> str:
    own = _OWN.get(type(message), frozenset())
    names = [*message.WIRE, *([message.TAIL.name] if message.TAIL else [])]
    if isinstance(message, Error) and isinstance(due, Error):
        own = frozenset({"detail"}) if _is_own_detail_in_dialogue(due) else own
    for name in names:
        if name in own:
            continue
        got, wanted = getattr(message, name), getattr(due, name)
        if name == "detail" and _is_absent_sequence_in_dialogue(due):
            wanted += ours.base.stored - theirs.base.stored
        if name == "counters":
            before = ours.base.counters, theirs.base.counters
            if text := _dialogue_counter_difference(got, wanted, *before):
                return f"{_named_in_dialogue(message)}: {text}"
        elif isinstance(message, DriveReply) and name == "data":
            if not _are_near_codes_in_dialogue(got, wanted):
                return f"{_named_in_dialogue(message)}: another drive"
        elif name.endswith(_TIMES):
            if not _is_near_in_dialogue(got, wanted, tolerance_us):
                return f"{_named_in_dialogue(message)}: {name} is {got}, due is {wanted}"
        elif got != wanted:
            return f"{_named_in_dialogue(message)}: {name} is {got}, due is {wanted}"
    return ""


def _is_own_detail_in_dialogue(due: Error) -> bool:
    """Return True if the detail of a refusal depends on the board's limits."""
    uploads = due.request in (UploadChunk.TYPE, UploadCommit.TYPE)
    return (uploads and due.code == ErrorCode.BAD_STATE) or due.code == ErrorCode.TOO_LARGE


def _is_absent_sequence_in_dialogue(due: Message) -> bool:
    """Return True if the detail of a refusal is the number of stored sequences (HG-7.6/1)."""
    is_absent = isinstance(due, Error) and due.code == ErrorCode.NOT_FOUND
    return is_absent and getattr(due, "request", 0) == Play.TYPE


def _dialogue_counter_difference(
    got: Counters, due: Counters, ours: Counters, theirs: Counters
) -> str:
    for name in Counters.WIRE:
        mine = (getattr(got, name) - getattr(ours, name)) & 0xFFFFFFFF
        wanted = (getattr(due, name) - getattr(theirs, name)) & 0xFFFFFFFF
        if mine != wanted and name != "trace_dropped":
            return f"counter {name} grew by {mine}, due is {wanted}"
    return ""


def _is_near_in_dialogue(got: int, due: int, tolerance_us: int) -> bool:
    return abs(signed_difference(got & 0xFFFFFFFF, due & 0xFFFFFFFF, 32)) <= tolerance_us


def _are_near_codes_in_dialogue(got: bytes, due: bytes) -> bool:
    if len(got) != len(due):
        return False
    apart = ((a - b + 128) % 256 - 128 for a, b in zip(got, due, strict=True))
    return all(abs(step) <= _CODES_APART for step in apart)


def _named_in_dialogue(message: Message) -> str:
    text = message.TYPE.name
    if isinstance(message, Error):
        code = message.code
        known = ErrorCode._value2member_map_.get(code)
        return f"{text}({getattr(known, 'name', code)}) to type {message.request:#04x}"
    if isinstance(message, StateChanged | PlaybackEnded | Trace | Pong):
        shown: dict[str, Any] = {name: getattr(message, name) for name in message.WIRE}
        return f"{text} {shown}"
    return text

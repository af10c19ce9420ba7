"""Comparison of two boards, frame by frame, within the freedom that SPEC.md leaves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Self

from haptogram_protocol import messages as m
from haptogram_protocol.annotation.frames import annotated_type_name
from haptogram_protocol.state import MuteReason

from ..outcome import record_differences
from .broken_clauses import (
    COUNTER_CLAUSES,
    clause_of_due_message,
    clause_of_header_field,
    clause_of_message_field,
)
from .host import DialogueHost

_SAME_IN_HELLO: Final = frozenset(
    {"major", "minor", "nonce", "state", "sound_speed_mm_s", "config_crc"}
)
#: Fields in which boards of one protocol may differ.
_OWN: Final[dict[type[m.Message], frozenset[str]]] = {
    m.HelloReply: frozenset(m.HelloReply.WIRE) - _SAME_IN_HELLO,
    m.UploadBeginReply: frozenset(m.UploadBeginReply.WIRE),
    m.Status: frozenset({"free_bytes"}),
    m.StatusReply: frozenset({"free_bytes"}),
}
#: Fields that are times or time differences, by the last letters of their names.
_TIMES: Final = "_us"
_CODES_APART: Final = 1  # steps between two computations of one drive
_WEAK: Final = 17  # amplitude code of |w| = 1/16: below it a phase is free (HG-5.4/3)
_TIMER_US: Final = 2000  # two timers within 1 ms of their lengths


@dataclass(frozen=True, slots=True)
class FrameInDialogue:
    """One frame of a board: its header, message and body."""

    header: m.Header
    message: m.Message
    body: bytes = b""


@dataclass(frozen=True, slots=True)
class DialogueBase:
    """Counters and number of stored sequences of a board before slot 0."""

    counters: m.Counters
    stored: int = 0


class DialogueMemory:
    """Replies of a board, which are the same when it sends them again (HG-4.9/1)."""

    def __init__(self) -> None:
        self._sent: dict[bytes, bytes] = {}

    def first_altered(
        self, ours: Sequence[FrameInDialogue], theirs: Sequence[FrameInDialogue]
    ) -> str:
        """Return the first reply that is sent again, and with other bytes; empty without any.

        The model's bytes are those of an earlier slot only if its reply came from memory.
        """
        sent = {}
        for mine, due in zip(ours, theirs, strict=False):
            if self._sent.get(due.body, mine.body) != mine.body:
                name = _message_text(mine.message)
                return f"HG-4.9/1: {name}: not the bytes of its first sending"
            sent[due.body] = mine.body
        self._sent |= sent
        return ""


@dataclass(frozen=True, slots=True)
class DialogueAnswers:
    """Responses and events of one board in one slot, and what it said before the dialogue.

    Attributes
    ----------
    responses, events : list of FrameInDialogue
        Both in their order.
    base : DialogueBase
        State and counters of the board before the dialogue.
    answered : tuple of int
        Number of responses before each event.
    """

    responses: list[FrameInDialogue]
    events: list[FrameInDialogue]
    base: DialogueBase
    answered: tuple[int, ...] = ()

    @classmethod
    def of(cls, frames: Iterable[FrameInDialogue], base: DialogueBase) -> Self:
        """Sort *frames*; a STATE_CHANGED of a MUTE is optional (HG-6.8/2) and left out."""
        kept = [frame for frame in frames if not is_optional_in_dialogue(frame.message)]
        responses: list[FrameInDialogue] = []
        events: list[FrameInDialogue] = []
        answered: list[int] = []
        for frame in kept:
            if frame.header.type in m.EVENT_RANGE:
                events.append(frame)
                answered.append(len(responses))
            else:
                responses.append(frame)
        return cls(responses, events, base, tuple(answered))


def superfluous_in_dialogue(frames: Sequence[FrameInDialogue]) -> str:
    """Return a sentence about the first of *frames*, which were never due; empty without any."""
    if not frames:
        return ""
    message = frames[0].message
    name = _message_text(message)
    return f"{clause_of_due_message(message)}: {name} comes, and nothing is due"


def is_optional_in_dialogue(message: m.Message) -> bool:
    """Return True for a STATE_CHANGED of a MUTE, which a board SHOULD send (HG-6.8/2)."""
    return isinstance(message, m.StateChanged) and message.reason is MuteReason.MUTE


@dataclass(frozen=True, slots=True)
class DialogueComparison:
    """Compares what two boards say in a slot.

    Attributes
    ----------
    ours, theirs : DialogueAnswers
        Of the board under test and of the model.
    host : DialogueHost
        The host whose frames were sent to both.
    near_us : int
        How far apart frames may have arrived.
    """

    ours: DialogueAnswers
    theirs: DialogueAnswers
    host: DialogueHost
    near_us: int

    def difference(self) -> str:
        """Return the first difference between board and model; empty if there is none.

        Frames beyond those that are due may be those of the next slot: see :meth:`early`.
        """
        for kind in ("responses", "events"):
            one, other = getattr(self.ours, kind), getattr(self.theirs, kind)
            for place, (mine, due) in enumerate(zip(one, other, strict=False)):
                if text := self._unexpected_event(mine, other[place:]) or self._frame(mine, due):
                    return text
            if len(one) < len(other):
                message = other[len(one)].message
                return f"{clause_of_due_message(message)}: no {_message_text(message)} comes"
        return self._order() if self.near_us < _TIMER_US else ""

    def _unexpected_event(self, mine: FrameInDialogue, left: Sequence[FrameInDialogue]) -> str:
        """Return a text if the board's event *mine* is not due where it arrives, else ''.

        *left* are the virtual board's frames that are due from here on. It is '' too if an event of
        the same kind and about the same time is among them, or if *mine* is later than the next one
        due: then that one is missing, not this one wrong.
        """
        due, name = left[0], _message_text(mine.message)
        if mine.header.type not in m.EVENT_RANGE or _frame_kind(mine) == _frame_kind(due):
            return ""
        apart_us = self.near_us + _TIMER_US
        of_kind = [one for one in left if _frame_kind(one) == _frame_kind(mine)]
        times_us = [m.signed_difference(f.header.time_us, mine.header.time_us, 32) for f in of_kind]
        is_behind = m.signed_difference(mine.header.time_us, due.header.time_us, 32) > apart_us
        if is_behind or any(abs(t_us) <= apart_us for t_us in times_us):
            return ""  # the one that is due is missing
        return (
            f"{clause_of_due_message(mine.message)}: {name} for t {mine.header.time_us} comes and "
            f"is not due; next is {_message_text(due.message)} for t {due.header.time_us}"
        )

    def _order(self) -> str:
        """Return a text if an event left before the response to the request behind it, else ''.

        Only STATE_CHANGED and PLAYBACK_ENDED count: they must not leave before the response to the
        request that caused them (HG-4.11/5).
        """
        paired = zip(self.ours.events, self.ours.answered, self.theirs.answered, strict=False)
        for event, ours, theirs in paired:
            if ours < theirs and isinstance(event.message, m.StateChanged | m.PlaybackEnded):
                name = _message_text(event.message)
                return f"HG-4.11/5: {name} leaves before the response to the request that led to it"
        return ""

    def early(self) -> list[FrameInDialogue]:
        """Return the frames of the board that were not due yet."""
        answers, events = len(self.theirs.responses), len(self.theirs.events)
        return self.ours.responses[answers:] + self.ours.events[events:]

    def _frame(self, mine: FrameInDialogue, due: FrameInDialogue) -> str:
        """Return as text how *mine* differs first from *due* of the virtual board, or ''."""
        header, message, due_header = mine.header, mine.message, due.header
        if type(message) is not type(due.message):
            wanted, got = _message_text(due.message), _message_text(message)
            return f"{clause_of_due_message(due.message)}: due is {wanted}, there comes {got}"
        names = (
            ("session", "flags") if header.type in m.EVENT_RANGE else ("session", "flags", "seq")
        )
        for name in names:
            if getattr(header, name) != getattr(due_header, name):
                return (
                    f"{clause_of_header_field(due.message, name)}: {_message_text(message)}: "
                    f"{name} of the header is {getattr(header, name):#x}, "
                    f"due is {getattr(due_header, name):#x}"
                )
        apart_us = self.near_us
        if isinstance(message, m.Trace | m.TracePlayback | m.TraceDrive):
            apart_us = self._apart_us(_message_key(due.message))
        elif header.type in m.EVENT_RANGE:
            apart_us += _TIMER_US
        if not _is_within(header.time_us, due_header.time_us, apart_us):
            clause = clause_of_header_field(due.message, "time_us")
            late_us = m.signed_difference(header.time_us, due_header.time_us, 32)
            times = f"time_us of the header is {header.time_us}, {late_us:+d} µs from what is due"
            return f"{clause}: {_message_text(message)}: {times}"
        return self._message(message, due.message)

    def _apart_us(self, key: m.LatchKey | None) -> int:
        """Return by how many µs the board's time of a latch may differ from the virtual board's.

        0 if the latched frame *key* had an exact time; else, and if *key* is None, what the board's
        clock is uncertain by.
        """
        return 0 if key is not None and self.host.is_exact(key) else self.near_us

    def _message(self, message: Any, due: Any) -> str:
        """Return as text the first field in which *message* differs from *due*, or ''.

        *due* is that of the virtual board, which is given the same bytes.
        """
        own = _OWN.get(type(message), frozenset())
        if isinstance(due, m.Error) and due.code == m.ErrorCode.TOO_LARGE:
            own = frozenset({"detail"})  # a limit
        names = [*message.WIRE, *([message.TAIL.name] if message.TAIL else [])]
        key = _message_key(due)
        for name in names:
            if name in own:
                continue
            got, wanted = getattr(message, name), getattr(due, name)
            if name == "detail" and _is_absent_sequence(due):
                wanted += self.ours.base.stored - self.theirs.base.stored
            if text := self._field(name, got, wanted, key, due):
                return f"{self._clause(due, name, text)}: {_message_text(message)}: {text}"
        return ""

    def _clause(self, due: m.Message, name: str, text: str) -> str:
        """Return the clause that a wrong value of the field *name* breaks, such as HG-7.9/1.

        *due* is the message with the right value; *text* says how the value differs, and its first
        word tells which counter, or which half of a drive.
        """
        word = text.split()[0]  # a counter, or one of the two halves of a drive
        if name == "counters":
            return COUNTER_CLAUSES[word]
        if name != "data":
            return clause_of_message_field(due, name)
        if not isinstance(due, m.DriveReply) or due.kind is not m.DriveKind.RADIATED:
            return clause_of_message_field(due, word)
        if word == "phase":
            return "HG-7.9/1"
        if text.endswith("due is 0"):
            return "HG-6.6/2"
        return "HG-6.11/2" if self.host.least_ramp_us else "HG-7.9/2"

    def _field(
        self, name: str, got: Any, wanted: Any, key: m.LatchKey | None, due: m.Message
    ) -> str:
        """Return as text how *got* differs from *wanted* in the field *name*; '' if it may.

        It may within the tolerance of times. *due* is the message with the right value; *key* is
        the latch that it is about, None if none.
        """
        if name == "counters":
            before = self.ours.base.counters, self.theirs.base.counters
            return _dialogue_counter_difference(got, wanted, *before)
        if name == "records":
            return self._records(got, wanted)
        if name == "elements":
            return _dialogue_element_difference(got, wanted)
        if name == "crc" and key is not None and self.host.is_computed(key):
            return ""  # rounding is free; the drive itself is compared elsewhere
        if isinstance(due, m.DriveReply | m.TraceDrive) and name == "data":
            return self._drive(got, wanted, due)
        apart_us = self.near_us
        if name == "t_latch_us":
            apart_us = self._apart_us(key)
        elif not name.endswith(_TIMES):
            apart_us = -1
        same = got == wanted if apart_us < 0 else _is_within(got, wanted, apart_us)
        return "" if same else f"{name} is {got}, due is {wanted}"

    def _records(self, got: Sequence[m.TraceRecord], wanted: Sequence[m.TraceRecord]) -> str:
        """Return as text how records of the trace ring differ first from those due, or ''."""
        if len(got) != len(wanted):
            return f"{len(got)} records, due are {len(wanted)}"
        for mine, due in zip(got, wanted, strict=True):
            for name in ("number", "key", "t_latch_us", "crc", "flags"):
                values = getattr(mine, name), getattr(due, name)
                if text := self._field(name, *values, due.key, m.TraceReply(0, 0, ())):
                    return f"record {due.number}: {text}"
        return ""

    def _drive(self, got: bytes, wanted: bytes, due: m.DriveReply | m.TraceDrive) -> str:
        """Return as text how *got* differs first from *wanted*, the drive in *due*, or ''.

        Both are N phase codes, then N amplitude codes. Codes that the board computed from points
        may be off by one; radiated amplitudes by as much as a ramp falls in the tolerance of times.
        """
        if len(got) != len(wanted):
            return f"{len(got)} codes, due are {len(wanted)}"
        if got == wanted:
            return ""
        count = len(got) // 2
        computed = self.host.is_computed(due.key)
        phase_apart = _CODES_APART if computed else 0
        amplitude_apart = phase_apart
        if isinstance(due, m.DriveReply) and due.kind is m.DriveKind.RADIATED:
            amplitude_apart += self.host.ramp_codes(self.near_us + _TIMER_US)
        for n in range(count):
            apart = abs((got[n] - wanted[n] + 128) % 256 - 128)
            is_free = computed and wanted[count + n] < _WEAK
            if apart > phase_apart and not is_free:
                return f"phase {n} is {got[n]}, due is {wanted[n]}"
            if abs(got[count + n] - wanted[count + n]) > amplitude_apart:
                return f"amplitude {n} is {got[count + n]}, due is {wanted[count + n]}"
        return ""


def _message_key(message: m.Message) -> m.LatchKey | None:
    """Return sequence, loop and index of the latch that a message is about; None: of none."""
    if isinstance(message, m.Trace):
        return m.LatchKey(0, 0, message.index)
    if isinstance(message, m.TracePlayback | m.TraceDrive | m.DriveReply):
        return message.key
    return None


def _frame_kind(frame: FrameInDialogue) -> tuple[type[m.Message], m.LatchKey | None]:
    """Return the type of a frame's message, and the latch that it is about (None: about none).

    Frames with equal ones can be compared with each other.
    """
    return type(frame.message), _message_key(frame.message)


def _is_absent_sequence(due: m.Message) -> bool:
    """Return True for NOT_FOUND to a PLAY, whose detail is the number of stored sequences."""
    is_absent = isinstance(due, m.Error) and due.code == m.ErrorCode.NOT_FOUND
    return is_absent and getattr(due, "request", 0) == m.Play.TYPE


def _dialogue_counter_difference(
    got: m.Counters, due: m.Counters, ours: m.Counters, theirs: m.Counters
) -> str:
    """Return as text the counters of which *got* has grown otherwise than *due*, or ''.

    Growth counts from the begin of the dialogue: *ours* of the board, *theirs* of the virtual
    board.
    """
    found = []
    for name in COUNTER_CLAUSES:
        mine = (getattr(got, name) - getattr(ours, name)) & 0xFFFFFFFF
        wanted = (getattr(due, name) - getattr(theirs, name)) & 0xFFFFFFFF
        if mine != wanted:
            found.append(f"{name} has grown by {mine}, due is {wanted}")
    return "; ".join(found)


def _dialogue_element_difference(got: Sequence[m.Element], due: Sequence[m.Element]) -> str:
    """Return as text the first transducer that differs, in x or y by more than 1 µm, or ''."""
    if len(got) != len(due):
        return f"{len(got)} transducers, due are {len(due)}"
    for mine, wanted in zip(got, due, strict=True):
        apart_um = max(abs(mine.x_um - wanted.x_um), abs(mine.y_um - wanted.y_um))
        rest = ("z_um", "nx", "ny", "nz")
        if apart_um > 1 or any(getattr(mine, name) != getattr(wanted, name) for name in rest):
            return record_differences(mine, wanted)
    return ""


def _is_within(got: int, due: int, tolerance_us: int) -> bool:
    """Return True if two device times, of 32 bits, differ by at most the tolerance."""
    return abs(m.signed_difference(got & 0xFFFFFFFF, due & 0xFFFFFFFF, 32)) <= tolerance_us


def _message_text(message: m.Message) -> str:
    """Return the type of a message as text; of ERROR the code, of some others the fields."""
    text = message.TYPE.name
    if isinstance(message, m.Error):
        code = message.code
        known = m.ErrorCode._value2member_map_.get(code)
        return f"{text}({getattr(known, 'name', code)}) to {annotated_type_name(message.request)}"
    if isinstance(message, m.StateChanged | m.PlaybackEnded | m.Trace | m.Pong):
        shown: dict[str, Any] = {name: getattr(message, name) for name in message.WIRE}
        return f"{text} {shown}"
    return text

"""Two accounts of one run, joined by their keys; every difference has a name.

An account is a sequence of frames, latches and changes of the output.  Entries meet as they come,
so that memory holds only those whose other half has not come yet.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

from haptogram.records.latch import Codes, LatchRecord
from haptogram_protocol.annotation.frames import Annotated
from haptogram_protocol.connection import INITIAL_RTO_US
from haptogram_protocol.messages import EVENT_RANGE, MessageType, signed_difference

Fields: TypeAlias = Mapping[str, Any]
_Key: TypeAlias = tuple[Hashable, ...]
RECORDED: Final = "recorded"
REPLAYED: Final = "replayed"
_OTHER: Final = {RECORDED: REPLAYED, REPLAYED: RECORDED}
_REPLY: Final = "reply"
_MOST_KEPT: Final = 1000  # differences that are kept in words; all are counted
#: Fields that hold a count or a state of the moment at which a frame came.
_OF_THE_MOMENT: Final = frozenset(
    {"queued", "free_bytes", "margins", "last_seq", "counters", "number", "oldest", "next"}
    | {"config_crc", "boot_id", "last_latch_us", "margin_min_us", "margin_mean_us"}
)
#: Fields by which a board introduces itself.
_IDENTITY: Final = frozenset({"major", "nonce", "transducers", "carrier_hz"})


@dataclass(frozen=True, slots=True)
class Difference:
    """One thing that the two accounts do not agree on.

    Attributes
    ----------
    what : str
        The frame, latch or change of the output, by its key.
    t_us : int or None
        Device time in the recording; None: it is not in the recording.
    detail : str
        How the accounts differ.
    """

    what: str
    t_us: int | None
    detail: str

    def __str__(self) -> str:
        """Return it in a line."""
        when = "" if self.t_us is None else f" at {self.t_us} µs"
        return f"{self.what}{when}: {self.detail}"


@dataclass(slots=True)
class _Entry:
    what: str
    t_us: int
    fields: Fields


@dataclass(slots=True)
class ReplayComparison:
    """Joins what was recorded with what was replayed.

    Parameters
    ----------
    exact : bool
        Whether both ran on one clock: then every field is compared, else those that do not depend
        on the moment at which a byte came.
    has_backdoor : bool
        Whether the recorded board told its latches beside the line. Those of a board at a port are
        compared only if the recording has any of them.

    Attributes
    ----------
    same : Counter
        Entries that agree, by kind.
    differing : Counter
        Entries that do not, by kind.
    differences : list of Difference
        The first of them.
    """

    exact: bool
    has_backdoor: bool = True
    same: Counter[str] = field(default_factory=Counter)
    differing: Counter[str] = field(default_factory=Counter)
    differences: list[Difference] = field(default_factory=list)
    _waiting: dict[str, dict[_Key, deque[_Entry]]] = field(
        default_factory=lambda: {RECORDED: {}, REPLAYED: {}}
    )
    _read_us: int | None = None  # device time of the last frame in the recording
    _first_bytes: Difference | None = None

    def add_frame(self, side: str, piece: Annotated) -> None:
        """Take a frame of the board, or what was left of one."""
        if piece.header is None:
            entry = _Entry(f"damaged frame of {piece.size} bytes", 0, {"fault": piece.fault})
            self._add(side, "frames", ("damaged",), entry)
            return
        header = piece.header
        if side == RECORDED:
            self._read_us = header.time_us
        fields = {"type": piece.name, "fault": piece.fault, **piece.fields}
        what = f"{piece.name} seq {header.seq} of session {header.session:#06x}"
        entry = _Entry(what, header.time_us, fields)
        if self.exact:
            entry.fields = fields | {"t_us": header.time_us, "flags": header.flags}
            key = (header.session, header.seq, header.type in EVENT_RANGE)
            self._add(side, "frames", key, entry)
        elif header.type != MessageType.STATUS:
            entry.fields = _comparable_fields(fields, piece.name)
            self._add(side, "frames", _compared_replay_key(piece), entry)

    def add_latch(self, side: str, latch: LatchRecord, *, timed: bool = True) -> None:
        """Take a latch; one that was not *timed* latched as soon as its frame was complete."""
        what = f"latch {latch.index} of session {latch.session:#06x}"
        if latch.sequence:
            what = f"latch {latch.index} in pass {latch.loop} of sequence {latch.sequence}"
        fields: dict[str, Any] = {"late": latch.late, "commanded_bits": latch.commanded_bits}
        fields |= {"latched": latch.latched, "radiated": latch.radiated or latch.latched}
        if self.exact or timed:
            fields["t_us"] = latch.t_latch_us % (1 << 32)
        if self.exact:
            fields |= {"number": latch.number, "t_received_us": latch.t_received_us}
            fields |= {"ramping": latch.ramping}
        entry = _Entry(what, latch.t_latch_us, fields)
        self._add(side, "latches", ("latch", *latch.key), entry)

    def add_record(self, side: str, kind: str, record: Fields) -> None:
        """Take another record of the back door: a change of the output, or pulses."""
        t_us = record.get("t_us", record.get("t_latch_us", 0))
        what = f"output {record['event']}" if "event" in record else "pulses"
        left_out = {"kind", "reconstruction"} | (set() if self.exact else {"t_us", "t_latch_us"})
        fields = {name: value for name, value in record.items() if name not in left_out}
        key = (kind, record.get("event"))
        self._add(side, kind, key, _Entry(what, t_us, fields))

    @property
    def awaited(self) -> int:
        """Number of keys in the recording whose other half has not come."""
        return len(self._waiting[RECORDED])

    def note_bytes(self, t_us: int, recorded: bytes, replayed: bytes) -> None:
        """Take the bytes of one read of each account; an exact replay has the same ones."""
        if self.exact and recorded != replayed and self._first_bytes is None:
            detail = f"a read of {len(recorded)} bytes gives {len(replayed)}, or other ones"
            self._first_bytes = Difference("bytes of the board", t_us, detail)

    def forget_replayed(self, *, frames: bool) -> None:
        """Leave out the frames that the recorded host did not come to read, or all but frames.

        An answer is not left out that left so long before the last frame in the recording that the
        host would have asked again.
        """
        waiting = self._waiting[REPLAYED]
        for key in [key for key in waiting if (key[0] == "frames") is frames]:
            waiting[key] = deque(one for one in waiting[key] if self._is_extra_reply(key, one))

    def _is_extra_reply(self, key: _Key, entry: _Entry) -> bool:
        """Return True for a replayed reply that left over 250 ms before the recording's last frame.

        If the recorded host had lacked it for so long, it would have asked again. *entry* is the
        reply; both times are those of the device.
        """
        if key[-1] != _REPLY or self._read_us is None:
            return False
        return signed_difference(self._read_us, entry.t_us, 32) > INITIAL_RTO_US

    def close(self, end_us: int) -> None:
        """Count the entries that only one account has.

        Behind *end_us*, the time of the last byte, a board may have ended: what a replay has there
        may be unwritten in the recording, and the output of the recorded one went off by its end.
        """
        if not self.has_backdoor:
            self.forget_replayed(frames=False)
        for side, why in ((RECORDED, "missing in the replay"), (REPLAYED, "not in the recording")):
            for key, entries in self._waiting[side].items():
                kind = str(key[0])
                is_ours = side == RECORDED and kind != "output"
                for entry in entries:
                    if is_ours or entry.t_us < end_us:
                        self._differ(kind, entry, why, recorded=side == RECORDED)
            self._waiting[side].clear()
        if self._first_bytes is not None and not self.differing["frames"]:
            self.differing["bytes"] += 1  # the same frames: in another order, or with noise between
            self.differences.append(self._first_bytes)

    def _add(self, side: str, kind: str, key: _Key, entry: _Entry) -> None:
        """Compare *entry* with the oldest waiting one of the other side that has an equal *key*.

        Without one it waits itself. *side* is recorded or replayed; *kind* is that of the count.
        """
        if side == RECORDED and kind != "frames":
            self.has_backdoor = True
        place, others = (kind, *key), self._waiting[_OTHER[side]]
        if not others.get(place):
            self._waiting[side].setdefault(place, deque()).append(entry)
            return
        other = others[place].popleft()  # of those with one key the first meets the first
        if not others[place]:
            del others[place]
        recorded, replayed = (entry, other) if side == RECORDED else (other, entry)
        details = "; ".join(_compared_replay_details(recorded.fields, replayed.fields))
        if details:
            self._differ(kind, recorded, details, recorded=True)
        else:
            self.same[kind] += 1

    def _differ(self, kind: str, entry: _Entry, detail: str, *, recorded: bool) -> None:
        """Count a difference of *kind*; describe the first 1000 with name, time and *detail*.

        *recorded* tells if *entry* is that of the recording: only its time is given, else None.
        """
        self.differing[kind] += 1
        if len(self.differences) < _MOST_KEPT:
            t_us = entry.t_us if recorded else None
            self.differences.append(Difference(entry.what, t_us, detail))


def _compared_replay_key(piece: Annotated) -> _Key:
    """Return what identifies a frame on both sides: session, with the number of a reply.

    For an event it is the session, the event's name, and the latch of which it tells, if any.
    """
    header, fields = piece.header, piece.fields
    assert header is not None  # of an undamaged frame
    if header.type not in EVENT_RANGE:
        return (header.session, header.seq, _REPLY)
    of_latch = fields.get("index", str(fields.get("key", "")))
    return (header.session, piece.name, of_latch)


def _comparable_fields(fields: Fields, name: str) -> Fields:
    """Return the fields of a frame *name* that must be equal in a replay: none of the moment.

    Of HELLO_REPLY only the fields count that tell the kind of board.
    """
    if name == MessageType.HELLO_REPLY.name:
        return {key: value for key, value in fields.items() if key in _IDENTITY}
    return {
        key: _comparable_value(value)
        for key, value in fields.items()
        if not (key.startswith("t_") or key in _OF_THE_MOMENT)
    }


def _comparable_value(value: Any) -> Any:
    """Return a JSON value without those fields, at any depth, that may differ in a replay."""
    if isinstance(value, Mapping):
        return _comparable_fields(value, "")
    if isinstance(value, list):
        return [_comparable_value(item) for item in value]
    return value


def _compared_replay_details(recorded: Fields, replayed: Fields) -> Iterator[str]:
    """Yield the differences of two sets of fields in words; nothing if they are equal."""
    for name in {**recorded, **replayed}:
        before, after = recorded.get(name), replayed.get(name)
        if before == after:
            continue
        if isinstance(before, Codes) and isinstance(after, Codes):
            yield f"{name} drive differs in {_compared_replay_codes(before, after)}"
        else:
            yield f"{name} {_shortened_text(before)} recorded, {_shortened_text(after)} replayed"


def _compared_replay_codes(before: Codes, after: Codes) -> str:
    """Return how many phases and amplitudes of two drives differ, as text."""
    count = len(before.phases)
    if count != len(after.phases):
        return f"size: {count} elements recorded, {len(after.phases)} replayed"
    phases = sum(a != b for a, b in zip(before.phases, after.phases, strict=True))
    amplitudes = sum(a != b for a, b in zip(before.amplitudes, after.amplitudes, strict=True))
    parts = [f"{phases} phases"] * (phases > 0) + [f"{amplitudes} amplitudes"] * (amplitudes > 0)
    return f"{' and '.join(parts) or 'the bits of its phases'} of {count} elements"


def _shortened_text(value: Any) -> str:
    """Return a value as text of at most 60 characters."""
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 60 else f"{text[:60]}..."

"""One direction of the line: its time, its faults, and what must be found at its far end.

The bytes between two delimiters are a *run*.  A run that is, byte by byte, the encoding of a frame
that was sent must be taken for it, whatever was around it (HG-2.1/3); every other one is damage and
must be counted once (HG-2.2, HG-2.4 to HG-2.6).  That rule, and no decoder, says what to expect.

The names of faults are those of :mod:`haptogram.settings.faults`, and two more: ``lose`` takes a
whole frame away, ``junk`` puts a run before it that is longer than a frame can be.  A fault is
drawn for a whole frame, not for a byte, so that the account knows the fault of every frame.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

from haptogram.driver.line.budget import line_transmission_ns
from haptogram.settings.faults.kinds import FAULT_KINDS
from haptogram_protocol import messages as m
from haptogram_protocol.framing import DELIMITER, MAX_ENCODED_BYTES

from .tally import DAMAGE, UNEXPLAINED, SoakHit, SoakTally

BAUD: Final = 6_000_000  # half of it is free, so that the line catches up after what held it up
_MOST_BEHIND_NS: Final = 60_000_000  # most that delays may make the line fall behind
_MOST_FLIPS: Final = 3
_BURST_BYTES: Final = round(FAULT_KINDS["line.burst"]["bytes"].default)
_MOST_INSERTED: Final = 4
_JUNK_BYTES: Final = MAX_ENCODED_BYTES + 100
_LEAST_DELAY_NS: Final = 100_000
_MOST_DELAY_NS: Final = 60_000_000  # beyond the lead of the stream: some frames come too late

#: Pieces of a frame, each with how long the line waits before it.
Pieces: TypeAlias = list[tuple[int, bytes]]


def _flip_damage(wire: bytes, source: random.Random) -> Pieces:
    """Flip 1 to 3 random bits of a frame."""
    flipped = bytearray(wire)
    for place in source.sample(range(8 * len(wire)), source.randint(1, _MOST_FLIPS)):
        flipped[place // 8] ^= 1 << place % 8
    return [(0, bytes(flipped))]


def _replaced(wire: bytes, source: random.Random, gone: int, new: int) -> Pieces:
    """Return *wire* with *gone* bytes at a random place replaced by *new* random ones.

    It is one piece, without a delay.
    """
    place = source.randrange(len(wire) - gone + 1)
    return [(0, wire[:place] + source.randbytes(new) + wire[place + gone :])]


def _delay_damage(wire: bytes, source: random.Random) -> Pieces:
    """Delay a whole frame by 0.1 to 60 ms, short delays as likely as long ones."""
    return [(round(_LEAST_DELAY_NS * (_MOST_DELAY_NS / _LEAST_DELAY_NS) ** source.random()), wire)]


def _slice_damage(wire: bytes, source: random.Random) -> Pieces:
    """Cut a frame in two at a random place, with up to 0.1 ms between the parts."""
    place = source.randrange(1, len(wire))
    return [(0, wire[:place]), (source.randrange(_LEAST_DELAY_NS), wire[place:])]


FAULTS: Final[dict[str, Callable[[bytes, random.Random], Pieces]]] = {
    "flip": _flip_damage,
    "burst": lambda wire, source: _replaced(wire, source, _BURST_BYTES, _BURST_BYTES),
    "drop": lambda wire, source: _replaced(wire, source, 1, 0),
    "insert": lambda wire, source: _replaced(wire, source, 0, source.randint(1, _MOST_INSERTED)),
    "truncate": lambda wire, source: [(0, wire[: source.randrange(len(wire))])],
    "break": lambda _, __: [(0, b"\x00")],  # what a receiver makes of a line held low
    "lose": lambda _, __: [],
    "duplicate": lambda wire, _: [(0, wire), (0, wire)],
    "junk": lambda wire, source: [
        (0, source.randbytes(_JUNK_BYTES).replace(b"\x00", b"\x01")),
        (0, wire),
    ],
    "delay": _delay_damage,
    "slice": _slice_damage,
}
KINDS: Final = tuple(FAULTS)


@dataclass(slots=True, eq=False)
class Sent:
    """A frame that was put on the line.

    Attributes
    ----------
    wire : bytes
        Between two delimiters.
    session : int
        To which it belongs.
    is_numbered : bool
        True if the next one tells that this one is missing: a stream frame or an event.
    index, due_us : int
        Of a stream frame: its number, and its t_apply in device time, both unwrapped.
    drive : message or None
        What a stream frame carries; None: it is no stream frame.
    hit, cause : SoakHit or None
        The fault that hit it, and the one that made it late.
    """

    wire: bytes
    session: int
    is_numbered: bool = False
    index: int = 0
    due_us: int = 0
    drive: m.Phases | m.Drives | None = None
    hit: SoakHit | None = None
    cause: SoakHit | None = None

    @property
    def type(self) -> int:
        """Message type: none is 0, so that it stands after a delimiter and a code byte."""
        return self.wire[2]


class SoakLine:
    """Carries frames of one direction, and harms some.

    Parameters
    ----------
    name, end : str
        ``down`` or ``up``: begins the names of its faults; who is at the far end.
    share : float
        Of the frames that are hit.
    source : random.Random
        Of all chance.
    tally : SoakTally
        Where faults are taken down.

    Attributes
    ----------
    arriving : deque of (int, bytes)
        When which bytes have come.
    calm : bool
        Whether no frame is hit for now.
    cut : bool
        Whether no frame comes through.
    free_ns : int
        When it has carried everything.
    """

    def __init__(
        self, name: str, end: str, share: float, source: random.Random, tally: SoakTally
    ) -> None:
        self.arriving: deque[tuple[int, bytes]] = deque()
        self.calm = True
        self.cut = False
        self.free_ns = 0
        self._name, self._end, self._share = name, end, share
        self._source, self._tally = source, tally
        self._runs: deque[tuple[Sent | None, SoakHit | None]] = deque()  # None: damage, by a fault
        self._numbered: deque[Sent] = deque()  # numbered frames that nobody has found yet
        self._partial = b""
        self._under_way: list[Sent] = []  # with whose bytes that begins
        self._cause: SoakHit | None = None

    def begin_session(self) -> None:
        """Forget the numbers of the session before: nobody misses its frames any more."""
        for sent in self._numbered:
            if sent.hit is not None:
                self._tally.find(sent.hit, "given up")
        self._numbered.clear()

    def send(self, sent: Sent, t_ns: int, *, spared: bool = False) -> None:
        """Put a frame on the line at *t_ns*; nothing happens to one that is *spared*."""
        if self.free_ns <= t_ns:
            self._cause = None
        if sent.is_numbered and not spared:
            self._numbered.append(sent)
        usual_ns = max(self.free_ns, t_ns) + line_transmission_ns(len(sent.wire), BAUD)
        for wait_ns, piece in [(0, sent.wire)] if spared else self._harm(sent):
            self._carry(piece, t_ns, wait_ns)
            self._expect(piece, sent)
        if self.free_ns > usual_ns:
            self._cause = sent.hit  # what comes after it is late because of it
        sent.cause = self._cause
        hit = sent.hit or sent.cause
        if hit is not None and not sent.is_numbered:
            hit.delivered = True  # or asked for again: the host waits for it
            self._tally.request_hits.append(hit)

    def _harm(self, sent: Sent) -> Pieces:
        """Return a frame's pieces, each with its delay in ns, after a random fault or none.

        An outage leaves no piece.
        """
        if self.cut:
            kind, pieces = "outage", []
        elif self.calm or self._source.random() >= self._share:
            return [(0, sent.wire)]
        else:
            kind = self._source.choice(KINDS)
            pieces = FAULTS[kind](sent.wire, self._source)
        sent.hit = self._tally.inject(f"{self._name}.{kind}")
        return pieces

    def _carry(self, data: bytes, t_ns: int, wait_ns: int) -> None:
        """Schedule the arrival of *data*, sent at *t_ns*, behind earlier bytes at the line rate.

        They start *wait_ns* after the line is free; the wait ends 60 ms after *t_ns* at the latest.
        """
        if not data:
            return
        start_ns = max(self.free_ns, t_ns)
        start_ns += max(0, min(wait_ns, t_ns + _MOST_BEHIND_NS - start_ns))
        self.free_ns = start_ns + line_transmission_ns(len(data), BAUD)
        # The board counts in microseconds.
        self.arriving.append((-(-self.free_ns // 1000) * 1000, data))

    def _expect(self, data: bytes, sent: Sent) -> None:
        """Note what the end of the line is to find in *data*: frame and fault of each run.

        Delimiters end a run of bytes. The frame is None if the run is damaged, the fault None if
        none hit it. *data* is what the faults left of *sent*, or a piece of it.
        """
        if data is sent.wire and not self._partial:  # as nearly all of them
            self._runs.append((sent, sent.hit))
            return
        *ended, rest = (self._partial + data).split(DELIMITER)
        self._under_way.append(sent)
        for run in ended:
            if run:
                whole = next((one for one in self._under_way if one.wire[1:-1] == run), None)
                hits = (one.hit for one in self._under_way if one.hit is not None)
                self._runs.append((whole, whole.hit if whole else next(hits, None)))
            self._under_way = [sent]
        if not rest:
            self._under_way = []
        self._partial = rest

    @property
    def is_idle(self) -> bool:
        """True if every frame that was sent has arrived and was matched, or is known as lost."""
        return not (self.arriving or self._runs or self._partial or self._numbered)

    def next_sent(self, verdict: int | str) -> Sent | None:
        """Return the whole frame whose last byte led to *verdict*; None: damage, or nothing."""
        if not self._runs:
            self._tally.violate(UNEXPLAINED, f"{self._end} found {verdict} where nothing came")
            return None
        sent, hit = self._runs.popleft()
        if sent is None:
            self._explain_damage(hit, verdict)
        elif hit is not None:
            hit.delivered = True
        return sent

    def _explain_damage(self, hit: SoakHit | None, verdict: int | str) -> None:
        """Count damaged bytes at the end of the line for the fault *hit*, which explains them.

        Reports a violation if *hit* is None, or if the bytes were taken. *verdict*: the reason why
        the end of the line dropped them; any other if it took them.
        """
        if hit is None:
            self._tally.violate(UNEXPLAINED, f"damage at {self._end} without a fault: {verdict}")
        elif verdict not in DAMAGE:
            text = f"{self._end} took what {hit.kind} left for {verdict!r}"
            self._tally.violate("damaged frame taken", text)
        else:
            self._tally.find(hit, str(verdict))
            self._tally.count(f"{self._end}: {verdict}", column="damaged")

    def explain_gap(self, sent: Sent) -> int:
        """Count the numbered frames before *sent* that did not arrive; return their number."""
        missing = 0
        while sent in self._numbered and (lost := self._numbered.popleft()) is not sent:
            missing += 1
            if lost.hit is None:
                self._tally.violate(UNEXPLAINED, f"{self._end} missed a frame that came whole")
            else:
                self._tally.find(lost.hit, "gap")
        return missing

"""One direction of the line: its time, its faults, and what must be found at its far end.

What stands between two delimiters is a *run*.  A run that is, byte by byte, the encoding of a frame
that was sent must be taken for it, whatever was around it (HG-2.1/3); every other one is damage and
must be counted once (HG-2.2, HG-2.4 to HG-2.6).  That rule, and no decoder, says what to expect.
"""

from __future__ import annotations

import random
from collections import deque
from typing import Final

from haptogram_protocol.framing import DELIMITER

from .account.tally import DAMAGE, UNEXPLAINED, SoakHit, SoakTally
from .line_damage import FAULTS, KINDS

_NS_PER_S: Final = 1_000_000_000
_BITS_PER_BYTE: Final = 10
_MOST_BEHIND_NS: Final = 60_000_000  # no delay makes the line fall further behind


class Sent:
    """A frame that was put on the line."""

    __slots__ = ("about", "cause", "encoded", "hit", "kind", "session")

    def __init__(self, kind: str, wire: bytes, session: int, about: int = 0) -> None:
        self.kind = kind  # stream, request, event, reply
        self.encoded = wire[1:-1]
        self.session = session
        self.about = about  # t_apply of a stream frame, device microseconds
        self.hit: SoakHit | None = None
        self.cause: SoakHit | None = None  # of its being late


class DamagedFrame:
    """A run that is no frame that was sent."""

    __slots__ = ("hit",)

    def __init__(self, hit: SoakHit | None) -> None:
        self.hit = hit

    def explain(self, verdict: int | str, who: str, tally: SoakTally) -> None:
        """Take down the *verdict* on this run, by *who* was to find damage in it."""
        if self.hit is None:
            tally.violate(UNEXPLAINED, f"damage at {who} that nothing did: {verdict}")
        elif verdict not in DAMAGE:
            tally.violate(
                "damaged frame taken", f"{who} took what {self.hit.kind} left for {verdict!r}"
            )
        else:
            tally.find(self.hit, str(verdict))
            tally.totals[f"{who}: {verdict}"] += 1


def sent_soak_message_type(encoded: bytes) -> int:
    """Return the message type of an undamaged frame: no type is 0, so that it stands there."""
    return encoded[1]


class SoakLine:
    """Carries frames of one direction, and harms some.

    Parameters
    ----------
    name : str
        ``down`` or ``up``: begins the names of its faults.
    baud : int
        Bits per second.
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
    expected : deque of Sent or Damaged
        What is to be found in them, in order.
    calm : bool
        Whether no frame is hit for now.
    cut : bool
        Whether no frame comes through.
    hits : list of Hit
        Faults that are not closed.
    lost : deque of Hit
        Numbered frames that will not be found, so that a gap must be.
    """

    def __init__(
        self, name: str, baud: int, share: float, source: random.Random, tally: SoakTally
    ) -> None:
        self.arriving: deque[tuple[int, bytes]] = deque()
        self.expected: deque[Sent | DamagedFrame] = deque()
        self.calm = True
        self.cut = False
        self.hits: list[SoakHit] = []
        self.lost: deque[SoakHit] = deque()
        self.free_ns = 0
        self._name, self._baud, self._share = name, baud, share
        self._source, self._tally = source, tally
        self._partial = b""
        self._open: Sent | None = None  # with whose bytes that begins
        self._pending: Sent | None = None  # whole but for the delimiter, so far
        self._cause: SoakHit | None = None

    def send(self, sent: Sent, wire: bytes, t_ns: int, *, spared: bool = False) -> None:
        """Put a frame on the line at *t_ns*; nothing happens to one that is *spared*."""
        if self.free_ns <= t_ns:
            self._cause = None
        sent.cause = self._cause
        if self.cut:
            self._strike(sent, "outage")
            self._note_loss(sent, found=False)
        elif spared or self.calm or self._source.random() >= self._share:
            self._carry(wire, t_ns)
            if self._partial:
                self._split(wire, sent)
            else:
                self.expected.append(sent)
        else:
            self._harm(sent, wire, t_ns)

    def _harm(self, sent: Sent, wire: bytes, t_ns: int) -> None:
        kind = KINDS[int(self._source.random() * len(KINDS))]
        hit = self._strike(sent, kind)
        usual_ns = max(self.free_ns, t_ns) + self._ns(len(wire))
        found = 0
        for wait_ns, piece in FAULTS[kind](wire, self._source):
            self._carry(piece, t_ns, wait_ns)
            found += self._split(piece, sent)
        self._note_loss(sent, found=found > 0)
        if self.free_ns > usual_ns:
            self._cause = hit  # what comes behind it is late because of it
            sent.cause = hit

    def _strike(self, sent: Sent, kind: str) -> SoakHit:
        sent.hit = hit = self._tally.inject(f"{self._name}.{kind}")
        self.hits.append(hit)
        return hit

    def _note_loss(self, sent: Sent, *, found: bool) -> None:
        if not found and self._partial and self._partial == sent.encoded:
            self._pending = sent  # the next delimiter will end it
        elif not found:
            self._lose(sent)

    def _lose(self, sent: Sent) -> None:
        if sent.kind in ("stream", "event"):
            assert sent.hit is not None  # only what was hit is lost
            self.lost.append(sent.hit)

    def _carry(self, data: bytes, t_ns: int, wait_ns: int = 0) -> None:
        if not data:
            return
        start_ns = max(self.free_ns, t_ns)
        start_ns += max(0, min(wait_ns, t_ns + _MOST_BEHIND_NS - start_ns))
        self.free_ns = start_ns + self._ns(len(data))
        # The board counts in microseconds.
        self.arriving.append((-(-self.free_ns // 1000) * 1000, data))

    def _ns(self, count: int) -> int:
        return count * _BITS_PER_BYTE * _NS_PER_S // self._baud

    def _split(self, data: bytes, sent: Sent) -> int:
        """Expect what the runs that end in *data* are; return how often *sent* is among them."""
        found = 0
        *ended, rest = data.split(DELIMITER)
        for piece in ended:
            run, before, pending = self._partial + piece, self._open, self._pending
            self._partial, self._open, self._pending = b"", None, None
            if not run:
                continue
            if run == sent.encoded:
                self.expected.append(sent)
                found += 1
            elif pending is not None and run == pending.encoded:
                self.expected.append(pending)
            else:
                self.expected.append(DamagedFrame((before or sent).hit or sent.hit))
                if pending is not None:
                    self._lose(pending)
        if rest and self._open is None:
            self._open = sent
        self._partial += rest
        return found

    @property
    def is_idle(self) -> bool:
        """True if every frame that was sent has arrived and was matched."""
        return not self.arriving and not self.expected and not self._partial

    def next_sent(self, verdict: int | str, who: str) -> Sent | None:
        """Return the whole frame of which *who* found *verdict*; None: damage, or nothing came."""
        if not self.expected:
            self._tally.violate(UNEXPLAINED, f"{who} found {verdict} where nothing came")
            return None
        sent = self.expected.popleft()
        if isinstance(sent, DamagedFrame):
            sent.explain(verdict, who, self._tally)
            return None
        return sent

    def close(self) -> None:
        """Close the account of every fault up to now."""
        for hit in self.hits:
            self._tally.close(hit)
        self.hits.clear()

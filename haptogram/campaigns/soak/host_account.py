"""The account at the host: each event of the connection against the bytes that came to it."""

from __future__ import annotations

from haptogram_protocol.connection import EventReceived, FrameDropped, HostEvent
from haptogram_protocol.messages import Status

from .account.tally import UNEXPLAINED, SoakTally
from .line import Sent, SoakLine


class SoakHostAccount:
    """Compares the events of a host's connection with the line to it.

    Parameters
    ----------
    line : SoakLine
        To the host.
    tally : SoakTally
        The account.
    """

    def __init__(self, line: SoakLine, tally: SoakTally) -> None:
        self._line, self._tally = line, tally
        self._status: Status | None = None

    def begin_session(self) -> None:
        """Forget the last STATUS: it was of another session."""
        self._status = None

    def judge(self, event: HostEvent, session: int) -> bool:
        """Compare *event* with the bytes that came; return whether an undamaged frame made it."""
        verdict = event.reason if isinstance(event, FrameDropped) else type(event).__name__
        sent = self._line.next_sent(verdict, "the host")
        if sent is None:
            return False
        if sent.hit is not None:
            sent.hit.delivered = True
        if isinstance(event, EventReceived):
            self._take_event(event)
        elif isinstance(event, FrameDropped):
            self._explain_drop(sent, event.reason, session)
        return True

    def _explain_drop(self, sent: Sent, reason: str, session: int) -> None:
        """Explain a copy by its fault, or by the host having asked twice; see HG-3.7/3."""
        self._tally.totals[f"the host: {reason}"] += 1
        if reason == "duplicate" and sent.hit is not None:
            self._tally.find(sent.hit, reason)
        elif reason == "duplicate" and sent.kind == "reply":
            self._tally.totals["answers of copies"] += 1
        elif reason != "stale_session" or sent.session == session:
            self._tally.violate("undamaged frame dropped", f"{sent.kind} at the host, as {reason}")

    def _take_event(self, event: EventReceived) -> None:
        for _ in range(event.gap):
            if not self._line.lost:
                self._tally.violate(UNEXPLAINED, "an event never came, and none was lost")
                break
            self._tally.find(self._line.lost.popleft(), "gap")
        if isinstance(event.message, Status):
            if self._status and event.message.free_bytes < self._status.free_bytes:
                self._tally.violate("memory leak", "the board has fewer free bytes than before")
            self._status = event.message

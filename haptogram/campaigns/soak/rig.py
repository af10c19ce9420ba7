"""Host, line and board in virtual time; every frame's end is compared with what it must be."""

from __future__ import annotations

import random
from typing import Final

from haptogram.driver.line.link import NS_PER_S, Link, open_line_session
from haptogram.driver.timing.clock import ClockEstimate
from haptogram.driver.timing.pings import Pinger
from haptogram_protocol import HostConnection
from haptogram_protocol import messages as m
from haptogram_protocol.cobs import fastest_cobs
from haptogram_protocol.connection import events

from .comparison import BoardUnderSoak, Hopeless, SoakComparison
from .excerpts import SoakExcerpts
from .line import BAUD, Sent, SoakLine
from .setup import SoakSetup
from .tally import UNEXPLAINED, SoakTally

_NEVER_NS: Final = 1 << 62
NS_PER_MS: Final = 1_000_000
_TIMEOUT_S: Final = 60.0  # the connection gives up long before
_MOST_VIOLATIONS: Final = 50  # violations after which a segment is stopped
_DRIVES: Final = 61  # prime, so that it meets every phase of what repeats
_AMPLITUDES_EVERY: Final = 8


class SoakHost(HostConnection):
    """A host's end whose every event is accounted for.

    Parameters
    ----------
    nonce : int
        The session.
    line : SoakLine
        To the host.
    tally : SoakTally
        The account.
    """

    def __init__(self, nonce: int, line: SoakLine, tally: SoakTally) -> None:
        super().__init__(nonce=nonce, cobs=fastest_cobs())
        self._line, self._tally = line, tally
        self._free_bytes = 0

    def next_event(self) -> events.HostEvent | events.NeedData:
        """Return the next event, after it was compared."""
        event = super().next_event()
        if event is not events.NEED_DATA and not isinstance(event, events.RequestTimedOut):
            dropped = event if isinstance(event, events.FrameDropped) else None
            sent = self._line.next_sent(dropped.reason if dropped else type(event).__name__)
            if sent is not None and isinstance(event, events.EventReceived):
                self._compare_event(event, sent)
            elif sent is not None and dropped:
                self._explain_drop(sent, dropped.reason)
        return event

    def _explain_drop(self, sent: Sent, reason: str) -> None:
        """Explain by a fault, a retry or an old session why the host drops a frame of the board.

        Else a violation is reported. *reason*: "duplicate" for a second copy, which a fault or a
        repeated request makes; "stale_session" for a frame of a session before (HG-3.7/3).
        """
        self._tally.totals[f"the host: {reason}"] += 1
        if reason == "duplicate" and sent.hit is not None:
            self._tally.find(sent.hit, reason)
        elif reason == "duplicate" and not sent.is_numbered:
            self._tally.totals["answers of copies"] += 1
        elif reason != "stale_session" or sent.session == self.session:
            text = f"type {sent.type:#04x} at the host, as {reason}"
            self._tally.violate("undamaged frame dropped", text)

    def _compare_event(self, event: events.EventReceived, sent: Sent) -> None:
        """Report a violation if the host misses other events than the line lost, or memory leaks.

        Memory leaks if the board has fewer free bytes than at the last STATUS.
        """
        lost = self._line.explain_gap(sent)
        if event.gap != lost:
            text = f"the host misses {event.gap} events, and {lost} were lost"
            self._tally.violate(UNEXPLAINED, text)
        if isinstance(event.message, m.Status):
            if event.message.free_bytes < self._free_bytes:
                self._tally.violate("memory leak", "the board has fewer free bytes than before")
            self._free_bytes = event.message.free_bytes


class SoakRig:
    """One host and one board; the rig itself is the port between them.

    Parameters
    ----------
    board : BoardUnderSoak
        Just powered up.
    setup : SoakSetup
        Faults of the line.
    source : random.Random
        Of all chance.
    tally : SoakTally
        The account.
    recorded : bool, keyword-only
        Whether it keeps what happens around violations, for a recording.

    Attributes
    ----------
    down, up : SoakLine
    excerpts : SoakExcerpts
        Bytes and latches around violations.
    clock : ClockEstimate
        The host's estimate of the board's clock.
    comparison : SoakComparison
        The board beside its model.
    link, pinger : Link, Pinger
        Of the session.
    source : random.Random
        Of all chance.
    """

    url: Final = "the line of the soak"

    def __init__(
        self,
        board: BoardUnderSoak,
        setup: SoakSetup,
        source: random.Random,
        tally: SoakTally,
        *,
        recorded: bool = False,
    ) -> None:
        self.down = SoakLine("down", "the board", setup.fault_rate, source, tally)
        self.up = SoakLine("up", "the host", setup.fault_rate, source, tally)
        self.clock = ClockEstimate()
        self.excerpts = SoakExcerpts(tally, kept=recorded)
        self.comparison = SoakComparison(board, self.down, tally, self.excerpts)
        self.link: Link
        self.pinger: Pinger
        self._now_ns = self._session = 0
        self._board, self.source, self.tally = board, source, tally
        self._interval_ns, self._first_interval = setup.interval_s * NS_PER_S, tally.interval
        self._drives = _soak_drives(board.transducers)
        self._last_request = b""
        self._frame = Sent(b"", 0)  # the stream frame that goes out now

    # --- the host ------------------------------------------------------------------------------

    def new_session(self) -> None:
        """Open another session: the host forgets everything but the clock."""
        while (nonce := self.source.randint(1, 0xFFFF)) == self._board.session:
            pass
        host = SoakHost(nonce, self.up, self.tally)
        self.link = Link(self, host, baudrate=BAUD, timeout_s=_TIMEOUT_S, keep=0)
        self.pinger = Pinger(self.link, self.clock)
        # As the pinger's own method, it and its link would keep each other.
        self.link.handler = lambda event: self.pinger.take(event)
        self.down.begin_session()
        self.up.begin_session()
        open_line_session(self.link)
        self.tally.totals["sessions"] += 1

    def arm(self) -> None:
        """Let the board sound."""
        self.link.request(m.Arm(), m.ArmReply)

    def silence(self) -> None:
        """Mute the board."""
        self.link.mute(m.MuteReply, self.link.timeout_ns)

    def stream_frame(self, due_us: int) -> None:
        """Send the next frame now; it is due at *due_us* of the board's clock."""
        self.pinger.keep()
        self.tally.count("frames", column="frames")
        drive = self._drives[self.tally.totals["frames"] % _DRIVES]
        index, wire = self.link.connection.stream_frame(drive, t_apply_us=due_us)
        self._frame = Sent(wire, self.link.connection.session, True, index, due_us, drive)
        self.link.write_frame(wire)

    def run_until(self, t_ns: int) -> None:
        """Let everything happen up to *t_ns*."""
        if self.link.connection.outstanding or self._carry(t_ns):
            self.link.run_until(t_ns)

    def idle_until(self, t_ns: int) -> None:
        """Let time pass while nothing is streamed, and listen whether the board is silent."""
        while self._now_ns < t_ns:
            self.run_until(min(t_ns, self._now_ns + NS_PER_MS))
            self.listen()

    def listen(self) -> None:
        """Compare what the board does by itself, and radiates, with what it must."""
        self.comparison.compare(self._now_ns)
        self._take_from_board()
        if sum(self.tally.violations.values()) > _MOST_VIOLATIONS:
            raise Hopeless("too much is wrong to go on")

    # --- the port ------------------------------------------------------------------------------

    def now_ns(self) -> int:
        """Return the time since the board was powered up."""
        return self._now_ns

    def read_available(self, deadline_ns: int) -> bytes:
        """Let everything happen on both lines until bytes have come to the host."""
        if not self._carry(deadline_ns):
            return b""
        data = self.up.arriving.popleft()[1]
        self.excerpts.add(self._now_ns, False, data)
        return data

    def _carry(self, deadline_ns: int) -> bool:
        """Carry bytes both ways until some reach the host; return False if none do in time."""
        down, up = self.down.arriving, self.up.arriving
        while True:
            down_ns = down[0][0] if down else _NEVER_NS
            up_ns = up[0][0] if up else _NEVER_NS
            next_ns = min(down_ns, up_ns, deadline_ns)
            self._now_ns = max(self._now_ns, next_ns)
            self.tally.interval = self._first_interval + self._now_ns / self._interval_ns
            if down_ns > next_ns:
                return up_ns <= deadline_ns
            self.comparison.receive(down.popleft()[1], self._now_ns, self.up.free_ns)
            self._take_from_board()

    def write_some(self, data: bytes) -> int:
        """Put a frame on the line."""
        sent = self._frame
        if data is not sent.wire:
            sent = Sent(data, self.link.connection.session)
            self._note_request(data)
        self.down.send(sent, self._now_ns)
        return len(data)

    def close(self) -> None:
        """Do nothing: the board stays."""

    def _note_request(self, wire: bytes) -> None:
        """Note a request that is sent; count a repetition for the fault that lost the first.

        Reports a violation for a repetition if no fault hit the request or its reply.
        """
        hits = self.tally.request_hits
        if wire != self._last_request:
            hits.clear()
        else:
            self.tally.totals["asked again"] += 1
            if hits:
                self.tally.find(hits.pop(0), "asked again")
            else:
                self.tally.violate(UNEXPLAINED, "the host asked again, and nothing was lost")
        self._last_request = wire

    def _take_from_board(self) -> None:
        """Send the frames of the board up the line, each with its session."""
        for wire in self.comparison.take_frames(self._now_ns):
            if wire[2] == m.HelloReply.TYPE:  # an event just before it is of the session before
                self._session = self._board.session
            sent = Sent(wire, self._session, wire[2] in m.EVENT_RANGE)
            # Events of the session before have no number that could show their loss.
            self.up.send(sent, self._now_ns, spared=sent.session != self.link.connection.session)


def _soak_drives(count: int) -> list[m.Phases | m.Drives]:
    """Return 61 frames of random codes for *count* transducers, every eighth with amplitudes."""
    source = random.Random(_DRIVES)
    return [
        m.Phases(source.randbytes(count))
        if number % _AMPLITUDES_EVERY
        else m.Drives(source.randbytes(2 * count))
        for number in range(_DRIVES)
    ]

"""Host, line and board in virtual time; every frame's end is compared with what it must be."""

from __future__ import annotations

import random
from typing import Final, TypeVar

from haptogram.driver.line.budget import frame_bytes_on_line, line_transmission_ns
from haptogram.driver.timing.clock import ClockEstimate
from haptogram_protocol import NEED_DATA, HostConnection
from haptogram_protocol.connection import (
    HostEvent,
    ReplyReceived,
    RequestRefused,
    RequestTimedOut,
)
from haptogram_protocol.framing import fastest_cobs
from haptogram_protocol.messages import EVENT_RANGE, FIRST_STREAM_SEQ, Message, Ping, Pong

from .account.course import CourseTaker
from .account.tally import UNEXPLAINED, SoakHit, SoakTally
from .board import BoardUnderSoak, Hopeless
from .board_account import SoakBoardAccount
from .drives import SoakDrives
from .excerpts import SoakExcerpts
from .host_account import SoakHostAccount
from .line import Sent, SoakLine, sent_soak_message_type
from .oracle import SoakOracle

BAUD: Final = 6_000_000  # half of it is free, so that the line catches up after what held it up
_NEVER_NS: Final = 1 << 62
_PING_NS: Final = 980_000_000  # no whole fraction of the stream's period
_DOUBTFUL_NS: Final = 100_000_000
_MOST_VIOLATIONS: Final = 50  # of a segment: then there is no sense in going on
_PONG_NS: Final = line_transmission_ns(frame_bytes_on_line(Pong.LAYOUT.size), BAUD)

_M = TypeVar("_M", bound=Message)


class SoakRig:
    """One host and one board.

    Parameters
    ----------
    board : BoardUnderSoak
        Just powered up.
    share : float
        Of the frames that are hit.
    source : random.Random
        Of all chance.
    tally : SoakTally
        The account.
    excerpts : SoakExcerpts or None
        Keeps what happens around violations, for a recording.
    course : CourseTaker or None
        Divides the counts among intervals of time.

    Attributes
    ----------
    now_ns : int
        Time since the board was powered up.
    down, up : SoakLine
    oracle : SoakOracle
    clock : ClockEstimate
        What the host makes of the board's clock.
    """

    def __init__(
        self,
        board: BoardUnderSoak,
        share: float,
        source: random.Random,
        tally: SoakTally,
        excerpts: SoakExcerpts | None = None,
        course: CourseTaker | None = None,
    ) -> None:
        self.now_ns = 0
        self._course = course
        self._excerpts = excerpts
        self.tally = tally
        self.down = SoakLine("down", BAUD, share, source, tally)
        self.up = SoakLine("up", BAUD, share, source, tally)
        self.show = SoakDrives(board.transducers)
        self.oracle = SoakOracle(self.show, board.carrier_us, tally)
        self.clock = ClockEstimate()
        self.board = board
        self._at_board = SoakBoardAccount(board, self.down, self.oracle, tally)
        self._at_host = SoakHostAccount(self.up, tally)
        self.host: HostConnection
        self._source = source
        self._answers: dict[int, HostEvent] = {}
        self._deadline_ns = _NEVER_NS
        self._ping_due_ns = self._ping_left_ns = self._pings = 0
        self._last_request = b""
        self._request_hits: list[SoakHit] = []
        self._next_index = FIRST_STREAM_SEQ

    # --- sessions and requests -----------------------------------------------------------------

    def new_session(self) -> None:
        """Open another session: the host forgets everything but the clock."""
        nonce = self._source.randint(1, 0xFFFF)
        while nonce == self.board.session:
            nonce = self._source.randint(1, 0xFFFF)
        self.host = HostConnection(nonce=nonce, cobs=fastest_cobs())
        self._answers = {}
        self._next_index = FIRST_STREAM_SEQ  # HG-3.6/5
        self._at_board.begin_session()
        self._at_host.begin_session()
        self.wait_for(self.host.send_hello(self.now_ns // 1000))
        self.tally.totals["sessions"] += 1

    def request(self, message: Message, reply: type[_M]) -> _M:
        """Send a request and return its reply."""
        while self.host.outstanding:
            self.run_until(self.now_ns + 1_000_000)
        answer = self.wait_for(self.host.send_request(message, self.now_ns // 1000))
        assert isinstance(answer.message, reply)  # the connection pairs them
        return answer.message

    def wait_for(self, seq: int) -> ReplyReceived:
        """Let time pass until request *seq* is answered.

        Raises
        ------
        Hopeless
            If it is refused, or not answered however often it is sent.
        """
        self._push()
        while (answer := self._answers.pop(seq, None)) is None:
            self.run_until(self.now_ns + 1_000_000)
        if not isinstance(answer, ReplyReceived):
            self.tally.violate("no answer", f"{answer}")
            raise Hopeless(f"{answer}")
        return answer

    def keep_clock(self) -> None:
        """Ask for the board's time now and then."""
        if self.now_ns >= self._ping_due_ns and not self.host.outstanding:
            self.ping()

    def ping(self) -> int:
        """Ask for the board's time and return the number of the request."""
        self._pings += 1
        soon = self.clock.ready and self.clock.doubtful
        self._ping_due_ns = self.now_ns + (_DOUBTFUL_NS if soon else _PING_NS)
        seq = self.host.send_request(Ping(self._pings), self.now_ns // 1000)
        self._push()
        self._ping_left_ns = self.down.free_ns
        return seq

    def _push(self) -> None:
        """Put on the line what the connection wants to send."""
        wire = self.host.data_to_send()
        if wire:
            sent = Sent("request", wire, self.host.session)
            if wire == self._last_request:
                self._explain_repetition()
            else:
                self._request_hits.clear()
            self._last_request = wire
            self.down.send(sent, wire, self.now_ns)
            self._note_request_hit(sent)
        due_us = self.host.next_deadline_us()
        self._deadline_ns = _NEVER_NS if due_us is None else due_us * 1000

    def _note_request_hit(self, sent: Sent) -> None:
        hit = sent.hit or sent.cause
        if hit is not None:
            self._request_hits.append(hit)
            hit.delivered = True  # or asked for again: the host waits for it

    def _explain_repetition(self) -> None:
        """Take down why the host had to ask again."""
        self.tally.totals["asked again"] += 1
        if self._request_hits:
            self.tally.find(self._request_hits.pop(0), "asked again")
        else:
            self.tally.violate(UNEXPLAINED, "the host asked again, and nothing was lost")

    # --- stream --------------------------------------------------------------------------------

    def stream_frame(self, due_us: int) -> None:
        """Put the next frame on the line now; it is due at *due_us* of the board's clock."""
        host = self.host
        message = self.show.message(self._next_index)
        index, wire = host.stream_frame(message, t_apply_us=due_us)
        self._next_index = index + 1
        self.tally.totals["frames"] += 1
        self.down.send(Sent("stream", wire, host.session, due_us), wire, self.now_ns)

    # --- time ----------------------------------------------------------------------------------

    def run_until(self, t_ns: int) -> None:
        """Let everything happen up to *t_ns*, on both lines."""
        down, up = self.down.arriving, self.up.arriving
        while True:
            down_ns = down[0][0] if down else _NEVER_NS
            up_ns = up[0][0] if up else _NEVER_NS
            first_ns = min(down_ns, up_ns, self._deadline_ns)
            if first_ns > t_ns:
                break
            self.now_ns = max(self.now_ns, first_ns)
            if first_ns == down_ns:
                self._to_board(*down.popleft())
            elif first_ns == up_ns:
                self._to_host(*up.popleft())
            else:
                self.host.advance_to(first_ns // 1000)
                self._collect()
                self._push()
        self.now_ns = t_ns
        if self._course is not None:
            self._course.advance_to(t_ns)

    def idle_until(self, t_ns: int, step_ns: int = 1_000_000) -> None:
        """Let time pass while nothing is streamed, and listen whether the board is silent."""
        while self.now_ns < t_ns:
            self.run_until(min(t_ns, self.now_ns + step_ns))
            self.listen()

    def listen(self) -> None:
        """Compare what the board radiates now with what it must."""
        self.board.advance_to(self.now_ns)
        self._take_from_board(self.now_ns)
        now_us = self.board.device_us(self.now_ns)
        self.oracle.check_overdue(now_us)
        self.oracle.check_output(now_us, silent=self.board.is_silent)
        if sum(self.tally.violations.values()) > _MOST_VIOLATIONS:
            raise Hopeless("too much is wrong to go on")

    # --- at the board --------------------------------------------------------------------------

    def _to_board(self, t_ns: int, data: bytes) -> None:
        if self._excerpts is not None:
            self._excerpts.to_board(t_ns, data)
        self.board.receive(data, t_ns, self.up.free_ns)
        went_off = False
        for verdict in self.board.take_verdicts():
            went_off |= self._at_board.judge(verdict, t_ns)
        self._take_from_board(t_ns)
        if went_off:
            self.oracle.flush(self.board.device_us(t_ns))
            self.board.advance_to(t_ns + self.board.carrier_us * 1000)  # HG-6.6/1
            self.oracle.check_output(self.board.device_us(t_ns), silent=self.board.is_silent)

    def _take_from_board(self, t_ns: int) -> None:
        latches = self.board.take_latches()
        if self._excerpts is not None:
            self._excerpts.latches(t_ns, latches)
        for latch in latches:
            self.oracle.latched(latch)
        self.tally.totals["timeouts"] += self.board.take_timeouts()
        output = self.board.take_output()
        for encoded in output.split(b"\x00") if output else ():
            if encoded:
                self._send_up(b"\x00" + encoded + b"\x00", t_ns)

    # --- at the host ---------------------------------------------------------------------------

    def _send_up(self, wire: bytes, t_ns: int) -> None:
        kind = "event" if sent_soak_message_type(wire[1:-1]) in EVENT_RANGE else "reply"
        sent = Sent(kind, wire, self.board.session)
        # What belongs to the session before has no number that its loss could be told by.
        self.up.send(sent, wire, t_ns, spared=sent.session != self.host.session)
        if kind == "reply":
            self._note_request_hit(sent)

    def _to_host(self, t_ns: int, data: bytes) -> None:
        if self._excerpts is not None:
            self._excerpts.to_host(t_ns, data)
        self.host.receive_data(data, t_ns // 1000)
        self.host.advance_to(t_ns // 1000)
        self._collect()
        self._push()

    def _collect(self) -> None:
        while (event := self.host.next_event()) is not NEED_DATA:
            assert not isinstance(event, type(NEED_DATA))
            if isinstance(event, RequestTimedOut):
                self._answers[event.seq] = event
            elif self._at_host.judge(event, self.host.session) and isinstance(
                event, ReplyReceived | RequestRefused
            ):
                self._take_answer(event)

    def _take_answer(self, event: ReplyReceived | RequestRefused) -> None:
        if isinstance(event, ReplyReceived) and isinstance(event.message, Pong):
            self._take_pong(event, event.message)
        self._answers.clear()  # of requests that nobody waits for
        self._answers[event.seq] = event

    def _take_pong(self, event: ReplyReceived, pong: Pong) -> None:
        if event.rtt_us is None:
            return
        came_ns = event.t_rx_us * 1000 - _PONG_NS
        self.clock.add(self._ping_left_ns, pong.t_rx_us, pong.t_tx_us, came_ns)
        if self.clock.doubtful:
            self._ping_due_ns = min(self._ping_due_ns, self.now_ns + _DOUBTFUL_NS)

    # --- the account ---------------------------------------------------------------------------

    @property
    def is_idle(self) -> bool:
        """True if no frame, request or latch is outstanding."""
        lines = self.down.is_idle and self.up.is_idle
        return lines and not (self.down.lost or self.up.lost or self.host.outstanding)

    def close(self) -> None:
        """Close the account of every fault so far."""
        self.down.close()
        self.up.close()

"""Host, line and board in virtual time; every frame's end is compared with what it must be."""

from __future__ import annotations

import random
from typing import Any, Final, Protocol, TypeVar

from haptogram.driver.line.budget import frame_bytes, transmission_ns
from haptogram.driver.timing.clock import ClockEstimate
from haptogram.errors import HaptogramError
from haptogram_protocol import NEED_DATA, HostConnection
from haptogram_protocol.connection import (
    EventReceived,
    FrameDropped,
    HostEvent,
    ReplyReceived,
    RequestRefused,
    RequestTimedOut,
)
from haptogram_protocol.export.tables import description_hash
from haptogram_protocol.framing import fastest_cobs
from haptogram_protocol.messages import EVENT_RANGE, FIRST_STREAM_SEQ, Message, Ping, Pong, Status

from .drives import Show
from .line import DAMAGE, Damaged, Line, Sent
from .oracle import Oracle
from .tally import UNEXPLAINED, Hit, Tally

BAUD: Final = 6_000_000  # half of it is free, so that the line catches up after what held it up
_NEVER_NS: Final = 1 << 62
_PING_NS: Final = 980_000_000  # no whole fraction of the stream's period
_DOUBTFUL_NS: Final = 100_000_000
_MOST_VIOLATIONS: Final = 50  # of a segment: then there is no sense in going on
_PONG_NS: Final = transmission_ns(frame_bytes(Pong.LAYOUT.size), BAUD)

_M = TypeVar("_M", bound=Message)


class Hopeless(HaptogramError):
    """The board is so wrong that the account cannot go on."""


class Board(Protocol):
    """A board without its line; times are nanoseconds since power-up."""

    transducers: int
    carrier_us: int

    @property
    def session(self) -> int: ...  # noqa: D102  see sim_device.soak_board.SoakBoard
    @property
    def counters(self) -> dict[str, int]: ...  # noqa: D102
    @property
    def is_silent(self) -> bool: ...  # noqa: D102
    def device_us(self, t_ns: int) -> int: ...  # noqa: D102
    def receive(self, data: bytes, t_ns: int, up_free_ns: int) -> None: ...  # noqa: D102
    def advance_to(self, t_ns: int) -> None: ...  # noqa: D102
    def take_output(self) -> bytes: ...  # noqa: D102
    def take_verdicts(self) -> list[Any]: ...  # noqa: D102
    def take_latches(self) -> list[Any]: ...  # noqa: D102
    def take_timeouts(self) -> int: ...  # noqa: D102


class Rig:
    """One host and one board.

    Parameters
    ----------
    board : Board
        Just powered up.
    share : float
        Of the frames that are hit.
    source : random.Random
        Of all chance.
    tally : Tally
        The account.

    Attributes
    ----------
    now_ns : int
        Time since the board was powered up.
    down, up : Line
    oracle : Oracle
    clock : ClockEstimate
        What the host makes of the board's clock.
    status : Status or None
        The newest one.
    """

    def __init__(self, board: Board, share: float, source: random.Random, tally: Tally) -> None:
        self.now_ns = 0
        self.tally = tally
        self.down = Line("down", BAUD, share, source, tally)
        self.up = Line("up", BAUD, share, source, tally)
        self.show = Show(board.transducers)
        self.oracle = Oracle(self.show, board.carrier_us, tally)
        self.clock = ClockEstimate()
        self.status: Status | None = None
        self.board = board
        self.host: HostConnection
        self._source = source
        self._answers: dict[int, HostEvent] = {}
        self._deadline_ns = _NEVER_NS
        self._ping_due_ns = self._ping_left_ns = self._pings = 0
        self._last_request = b""  # as the host sent it; and as the board took it
        self._last_taken = b""
        self._request_hits: list[Hit] = []
        self._next_index = self._expected_index = FIRST_STREAM_SEQ

    # --- sessions and requests -----------------------------------------------------------------

    def new_session(self) -> None:
        """Open another session: the host forgets everything but the clock."""
        nonce = self._source.randint(1, 0xFFFF)
        while nonce == self.board.session:
            nonce = self._source.randint(1, 0xFFFF)
        self.host = HostConnection(
            nonce=nonce, description_hash=description_hash(), cobs=fastest_cobs()
        )
        self.status, self._answers = None, {}
        self._next_index = self._expected_index = FIRST_STREAM_SEQ  # HG-3.6/5
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
        self.board.receive(data, t_ns, self.up.free_ns)
        went_off = False
        for verdict in self.board.take_verdicts():
            went_off |= self._judge_down(verdict, t_ns)
        self._take_from_board(t_ns)
        if went_off:
            self.oracle.flush(self.board.device_us(t_ns))
            self.board.advance_to(t_ns + self.board.carrier_us * 1000)  # HG-6.6/1
            self.oracle.check_output(self.board.device_us(t_ns), silent=self.board.is_silent)

    def _take_from_board(self, t_ns: int) -> None:
        for latch in self.board.take_latches():
            self.oracle.latched(latch)
        self.tally.totals["timeouts"] += self.board.take_timeouts()
        output = self.board.take_output()
        for encoded in output.split(b"\x00") if output else ():
            if encoded:
                self._send_up(b"\x00" + encoded + b"\x00", t_ns)

    def _judge_down(self, verdict: int | str, t_ns: int) -> bool:
        """Compare a verdict of the board with what came; tell whether it switches the output off.

        A frame that came whole is taken; a copy of it is known; everything else is damage.
        """
        if not self.down.expected:
            self.tally.violate(UNEXPLAINED, f"the board found {verdict!r} where nothing came")
            return False
        sent = self.down.expected.popleft()
        if isinstance(sent, Damaged):
            self._judge_damage(sent, verdict, "the board")
            return False
        self.tally.totals["board frames"] += 1
        if sent.session == self.board.session:
            self.oracle.heard(self.board.device_us(t_ns))
        if sent.hit is not None:
            sent.hit.delivered = True
        if sent.kind == "stream":
            self._judge_stream(sent, verdict, t_ns)
            return False
        return self._judge_request(sent, verdict)

    def _judge_damage(self, damaged: Damaged, verdict: int | str, who: str) -> None:
        if damaged.hit is None:
            self.tally.violate(UNEXPLAINED, f"damage at {who} that nothing did: {verdict}")
        elif verdict not in DAMAGE:
            self.tally.violate(
                "damaged frame taken", f"{who} took what {damaged.hit.kind} left for {verdict!r}"
            )
        else:
            self.tally.find(damaged.hit, str(verdict))
            self.tally.totals[f"{who}: {verdict}"] += 1

    def _judge_stream(self, sent: Sent, verdict: int | str, t_ns: int) -> None:
        if isinstance(verdict, int) and verdict < self._expected_index:
            self.tally.violate("copy taken", f"frame {verdict} once more")
        elif isinstance(verdict, int):
            missing = verdict - self._expected_index
            self._explain_gap(missing)
            self._expected_index = verdict + 1
            rx_us = self.board.device_us(t_ns)
            self.oracle.came(sent.session, verdict, sent.about, rx_us, sent.cause)
        elif verdict == "duplicate" and sent.hit is not None:
            self.tally.find(sent.hit, verdict)
            self.tally.totals["duplicate"] += 1
        else:
            self.tally.violate("undamaged frame dropped", f"a stream frame, as {verdict}")

    def _explain_gap(self, missing: int) -> None:
        self.tally.totals["gap"] += missing
        if missing > len(self.down.lost):
            lost = len(self.down.lost)
            self.tally.violate(UNEXPLAINED, f"{missing} frames never came, {lost} were lost")
            self.down.lost.clear()
        for _ in range(min(missing, len(self.down.lost))):
            self.tally.find(self.down.lost.popleft(), "gap")

    def _judge_request(self, sent: Sent, verdict: int | str) -> bool:
        copy = sent.encoded == self._last_taken
        mute_or_hello = _type_of(sent.encoded) in _SILENCING
        is_mute = _type_of(sent.encoded) == _MUTE
        wanted = "repeated" if copy and not is_mute else "request"
        self._last_taken = sent.encoded
        if verdict != wanted:
            self.tally.violate("undamaged frame dropped", f"{wanted}, as {verdict}")
        self.tally.totals[str(verdict)] += 1
        if copy and sent.hit is not None and sent.hit.kind.endswith("duplicate"):
            self.tally.find(sent.hit, str(wanted))
        return mute_or_hello and not copy

    # --- at the host ---------------------------------------------------------------------------

    def _send_up(self, wire: bytes, t_ns: int) -> None:
        kind = "event" if _type_of(wire[1:]) in EVENT_RANGE else "reply"
        sent = Sent(kind, wire, self.board.session)
        # What belongs to the session before has no number that its loss could be told by.
        self.up.send(sent, wire, t_ns, spared=sent.session != self.host.session)
        if kind == "reply":
            self._note_request_hit(sent)

    def _to_host(self, t_ns: int, data: bytes) -> None:
        self.host.receive_data(data, t_ns // 1000)
        self.host.advance_to(t_ns // 1000)
        self._collect()
        self._push()

    def _collect(self) -> None:
        while (event := self.host.next_event()) is not NEED_DATA:
            assert not isinstance(event, type(NEED_DATA))
            if isinstance(event, RequestTimedOut):
                self._answers[event.seq] = event
            else:
                self._judge_up(event)

    def _judge_up(self, event: HostEvent) -> None:
        verdict = event.reason if isinstance(event, FrameDropped) else type(event).__name__
        if not self.up.expected:
            self.tally.violate(UNEXPLAINED, f"the host found {verdict} where nothing came")
            return
        sent = self.up.expected.popleft()
        if isinstance(sent, Damaged):
            self._judge_damage(sent, verdict, "the host")
            return
        if sent.hit is not None:
            sent.hit.delivered = True
        if isinstance(event, EventReceived):
            self._take_event(event)
        elif isinstance(event, ReplyReceived | RequestRefused):
            self._take_answer(event)
        elif isinstance(event, FrameDropped):
            self._explain_drop(sent, event.reason)

    def _explain_drop(self, sent: Sent, reason: str) -> None:
        """Explain a copy by its fault, or by the host having asked twice; see HG-3.7/3."""
        self.tally.totals[f"the host: {reason}"] += 1
        if reason == "duplicate" and sent.hit is not None:
            self.tally.find(sent.hit, reason)
        elif reason == "duplicate" and sent.kind == "reply":
            self.tally.totals["answers of copies"] += 1
        elif reason != "stale_session" or sent.session == self.host.session:
            self.tally.violate("undamaged frame dropped", f"{sent.kind} at the host, as {reason}")

    def _take_event(self, event: EventReceived) -> None:
        for _ in range(event.gap):
            if not self.up.lost:
                self.tally.violate(UNEXPLAINED, "an event never came, and none was lost")
                break
            self.tally.find(self.up.lost.popleft(), "gap")
        if isinstance(event.message, Status):
            if self.status and event.message.free_bytes < self.status.free_bytes:
                self.tally.violate("memory leak", "the board has fewer free bytes than before")
            self.status = event.message

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
    def is_settled(self) -> bool:
        """Whether nothing is under way whose end is not known."""
        lines = self.down.is_idle and self.up.is_idle
        return lines and not (self.down.lost or self.up.lost or self.host.outstanding)

    def close(self) -> None:
        """Close the account of every fault so far."""
        self.down.close()
        self.up.close()


_HELLO: Final = 0x40
_MUTE: Final = 0x42
_SILENCING: Final = (_HELLO, _MUTE)


def _type_of(encoded: bytes) -> int:
    """Return the message type of an undamaged frame: no type is 0, so that it stands there."""
    return encoded[1]

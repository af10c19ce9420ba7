"""Raw frames out and in through a transport; every wait has an end.

Times are those of the transport's clock.  Nothing here knows a session or a sequence number.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final, NoReturn, Protocol, runtime_checkable

from haptogram.driver.line.port import Transport
from haptogram.errors import LinkLostError
from haptogram.machine.process import TerminalProcesses
from haptogram_protocol import messages as m
from haptogram_protocol.cobs import cobs_decode, fastest_cobs
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import DELIMITER, MAX_ENCODED_BYTES, decode_frame, encode_frame

from ..outcome import CaseEndedError, HeldUpError, check, fail, inconclusive, require
from .recording import DialogueRecording, TransferDirection

_LOOK_NS: Final = 5_000_000  # longest wait at a wall clock before the host looks at it again
_RETRY_NS: Final = 1_000_000  # how soon a port that took nothing is asked again
_HOUR_US: Final = 3_600_000_000
_FLOOD_BYTES: Final = 2 << 20  # limit for one case: a board that sends more cannot be judged
_FLOOD_FRAMES: Final = 50_000
_PARTIAL_BYTES: Final = 16 * MAX_ENCODED_BYTES
_TRIPS_IN_LEAD: Final = 4  # a case may ask the board so often before a t_apply
_STATUS: Final = (m.Status, m.StatusReply)
CLIENT_COBS: Final = fastest_cobs()
encoded_frame: Final = partial(encode_frame, stuff=CLIENT_COBS.encode)
#: Time from sending a frame to its t_apply, at a wall clock.
WALL_LEAD_US: Final = 20_000
DELAYED_LEAD_FACTOR: Final = 3  # of that time, once host or board was delayed; a retry has more
HELD_UP_US: Final = 5000  # without the processor: too long to judge a timer of the board


@runtime_checkable
class UnreadClientTime(Protocol):
    """A transport in virtual time that lets time pass without a reader."""

    def skip_ns(self, duration_ns: int) -> None:
        """Let so much time pass; what the board sends meanwhile waits at the board."""


@runtime_checkable
class FoundMute(Protocol):
    """A transport that decides whether an interrupt of the board finds MUTE ahead of other frames.

    Attributes
    ----------
    finds_mutes : bool or None
        Whether it does; None: sometimes.
    """

    finds_mutes: bool | None


@dataclass(frozen=True, slots=True)
class ClientWaitLimits:
    """Limits of waits, on the clock of the transport.

    Attributes
    ----------
    answer_us : int
        Longest wait for an answer.
    case_us : int
        Longest duration of a case.
    slack_us : int
        Delay that the host's scheduling may add to a wait; 0 in virtual time.
    lead_us : int
        Time between sending a frame and its t_apply.
    """

    answer_us: int
    case_us: int
    slack_us: int
    lead_us: int

    @classmethod
    def of(cls, timeout_s: float, *, virtual: bool) -> ClientWaitLimits:
        """Return the limits for a transport in virtual time, or in wall time."""
        answer_us = round(timeout_s * 1e6)
        if virtual:
            return cls(answer_us, 12 * _HOUR_US, slack_us=0, lead_us=3_000)
        return cls(answer_us, 120_000_000, slack_us=30_000, lead_us=WALL_LEAD_US)


@dataclass(slots=True, eq=False)  # frozen would take four times as long to make
class ReceivedByClient:
    """The bytes between two delimiters: a piece, which may be a frame.

    Attributes
    ----------
    t_us : int
        Time of reading, on the clock of the transport.
    piece : bytes
        The bytes on the line, without delimiters.
    shared : bool
        Whether only one delimiter separates the piece from the one before.
    header : Header or None
        None: the piece is no frame.
    message : Message or None
        None: the piece is no frame, or its payload cannot be read.
    body : bytes
        Header and payload; empty if the piece is no frame.
    fault : str
        Description of the defect; empty if there is none.
    reason : str
        ``cobs``, ``crc``, ``short``, ``bad_length``, ...; empty if there is no defect.
    """

    t_us: int
    piece: bytes
    shared: bool
    header: m.Header | None = None
    message: m.Message | None = None
    body: bytes = b""
    fault: str = ""
    reason: str = ""

    @property
    def frame_header(self) -> m.Header:
        """The header of a piece that is a frame."""
        assert self.header is not None
        return self.header

    @property
    def is_response(self) -> bool:
        """True for a response."""
        return self.header is not None and self.header.type in m.RESPONSE_RANGE

    @property
    def is_event(self) -> bool:
        """True for an event."""
        return self.header is not None and self.header.type in m.EVENT_RANGE

    @property
    def unstuffed(self) -> bytes:
        """The piece without its byte stuffing; empty if the piece is not COBS."""
        try:
            return cobs_decode(self.piece)
        except RemoteProtocolError:
            return b""


class RawFrameClient:
    """An open port, and every piece that came from it since the case began.

    Attributes
    ----------
    limits : ClientWaitLimits
        Limits of every wait.
    baudrate : int
        Rate of the line, bits per second.
    received : list of Received
        Pieces since :meth:`begin_case`.
    heard : int
        Bytes since :meth:`begin_case`.
    counters : Counters or None
        Counters of the board, by the last STATUS or STATUS_REPLY.
    on_piece : callable or None
        Is given each piece as it comes.
    on_sent : callable or None
        Is given the bytes that are sent, and when the line is free for them.
    ask_time : callable or None
        Returns the device time in an answer to a question after all that was sent; None: no
        answer can show it.
    trip_us : int
        The longest time to an answer since :meth:`begin_case`.
    sent_for_us : int
        Time that the line needs for the bytes that were sent last.
    held_up_us : int
        The longest time since :meth:`begin_case` in which the host neither sent nor listened, and
        did not compute either, as others had the processor; or in which the process of a board on
        a pseudo-terminal of this machine waited for one.
    """

    def __init__(self, transport: Transport, limits: ClientWaitLimits, *, baudrate: int) -> None:
        self.limits = limits
        self.baudrate = baudrate
        self.received: list[ReceivedByClient] = []
        self.on_piece: Callable[[ReceivedByClient], None] | None = None
        self.on_sent: Callable[[bytes, int], None] | None = None
        self.ask_time: Callable[[], int | None] | None = None
        self.recording = DialogueRecording()
        self.heard = self.held_up_us = self.trip_us = self._board_waited_us = 0
        self.counters: m.Counters | None = None
        self._transport = transport
        self._board = TerminalProcesses(transport.url if limits.slack_us else "")
        self._begin_delays()
        self._partial = b""
        self.ended_whole = True
        self._zeros = 2  # delimiters since the last piece
        self._deadline_us = self.now_us() + limits.case_us
        self._busy_until_us = self.sent_for_us = 0

    def close(self) -> None:
        """Close the port."""
        self._board.close()
        self._transport.close()

    def begin_case(self) -> None:
        """Forget the pieces received so far, and start the time of the next case."""
        self.forget_received()
        self._begin_delays()
        self._deadline_us = self.now_us() + self.limits.case_us

    def forget_received(self) -> None:
        """Forget the pieces received so far: more may come than one case may have."""
        self.received, self.heard = [], 0
        self.recording = DialogueRecording()

    def now_us(self) -> int:
        """Return the time of the transport."""
        return self._transport.now_ns() // 1000

    def line_us(self, size: int) -> int:
        """Return the transmission time of *size* bytes, rounded up."""
        return -(-size * 10_000_000 // self.baudrate)

    @property
    def is_virtual(self) -> bool:
        """True if time is virtual, so that bytes arrive to the microsecond."""
        return not self.limits.slack_us

    def require_exact_times(self) -> None:
        """End the case as NOT-OBSERVED unless the host knows when a byte is on the line."""
        require(self.is_virtual, "when a byte is on a real line is not known to 10 µs here")

    def carries(self, size: int, within_us: int) -> bool:
        """Return True if the line carries *size* bytes within that time."""
        return self.line_us(size) <= within_us

    def require_carried(self, size: int, within_us: int) -> None:
        """End the case as NOT-OBSERVED unless the line carries *size* bytes within that time."""
        took_us = self.line_us(size)
        require(took_us <= within_us, f"{size} bytes take {took_us} µs on this line, too long")

    def period_us(self, size: int, least_us: int = 1) -> int:
        """Return *least_us*, or a longer period within which the line carries *size* bytes."""
        return max(least_us, self.line_us(size))

    def begun_us(self, piece: ReceivedByClient) -> int:
        """Return when the first byte of a piece that came was on the line, at the latest."""
        return piece.t_us - self.line_us(len(piece.piece) + 2)

    def check_not_after(self, t_us: int, what: str) -> None:
        """End the case, not judged, unless *what* was over by that time of the transport."""
        if self.now_us() > t_us:
            raise HeldUpError(f"{what}, {self.now_us() - t_us} µs behind")

    def check_in_time(self, holds: bool, text: str) -> None:
        """FAILED unless *holds*; not judged if the host was held up, and perhaps an emulator."""
        if not holds and self.held_up_us > HELD_UP_US:
            raise HeldUpError(f"for {self.held_up_us / 1000:.0f} ms, and then: {text}")
        check(holds, text)

    @property
    def backlog_us(self) -> int:
        """Time that the line still needs for the bytes that were sent."""
        return max(0, self._busy_until_us - self.now_us())

    # --- out -----------------------------------------------------------------------------------

    def send(self, data: bytes, *, paced: bool = False) -> None:
        """Send all of *data*; read meanwhile if the port takes *data* in pieces.

        With *paced* a port without a rate of its own (TCP) gets it no faster than the line has it.

        Raises
        ------
        LinkLostError
            If the port is gone, or takes no byte during the longest wait for an answer.
        """
        self._note_idle_time()
        now_us = self.now_us()
        free_us = max(now_us, self._busy_until_us)
        self.ended_whole = data.endswith(DELIMITER)
        self.recording.add(now_us, TransferDirection.HOST, data)
        if self.on_sent is not None:
            self.on_sent(data, free_us)
        self.sent_for_us = self.line_us(len(data))
        self._busy_until_us = free_us + self.sent_for_us
        patience_us = self.limits.answer_us + self._busy_until_us - now_us
        stuck_us = now_us + patience_us
        rest = memoryview(data)
        end_us = now_us + self.sent_for_us
        while rest:
            written = self._transport.write_some(bytes(rest[:MAX_ENCODED_BYTES]))
            rest = rest[written:]
            if written:
                stuck_us = self.now_us() + patience_us
            elif self.now_us() > stuck_us:
                raise LinkLostError(f"the port took no byte for {patience_us / 1e6:g} s")
            if rest:
                self._read(self._transport.now_ns() + (_RETRY_NS if not written else 0))
            if paced and self.limits.slack_us:
                self.idle(end_us - self.line_us(len(rest)) - self.now_us())
        self._leave()

    # --- in ------------------------------------------------------------------------------------

    def wait(self, until: Callable[[], bool], timeout_us: int) -> bool:
        """Read until *until* returns True or the time is over; return True in the first case."""
        end_us = self.now_us() + timeout_us
        while not until():
            if self.now_us() >= end_us:
                return False
            self._read(end_us * 1000)
        return True

    def wait_for(
        self, wanted: Callable[[ReceivedByClient], bool], since: int, timeout_us: int
    ) -> ReceivedByClient | None:
        """Return the first *wanted* piece from number *since* on, None if none comes in time."""
        looked_at = since
        found: ReceivedByClient | None = None

        def there() -> bool:
            nonlocal looked_at, found
            while found is None and looked_at < len(self.received):
                piece = self.received[looked_at]
                looked_at += 1
                found = piece if wanted(piece) else None
            return found is not None

        self.wait(there, timeout_us)
        return found

    def idle(self, duration_us: int) -> None:
        """Read for *duration_us*."""
        self.wait(lambda: False, duration_us)

    def idle_beyond(self, duration_us: int) -> None:
        """Read for *duration_us*, and all that the board has sent by then.

        A later answer shows that nothing more comes. Without one there may be more, as the host's
        scheduling delays it.
        """
        self.idle(duration_us)
        if self.is_virtual or self.ask_time is None or self.ask_time() is None:
            self.idle(self.limits.slack_us)

    def idle_while_sending(self) -> None:
        """Read until the line has carried what was sent."""
        self.idle(self.backlog_us)

    def look_away(self, duration_us: int) -> None:
        """Let time pass without reading, so that what the board sends has to wait.

        Where only reading lets virtual time pass, the virtual line is as slow as its rate.
        """
        if isinstance(self._transport, UnreadClientTime):
            self._transport.skip_ns(duration_us * 1000)
            self._leave()  # meant to be away: the host was not held up
            return
        if not self.limits.slack_us:
            self.idle(duration_us)
            return
        time.sleep(duration_us / 1e6)
        self._leave()

    def ways_of_mute(self) -> Iterator[str]:
        """Yield a name for each way in which MUTE can reach the board, and let MUTE go that way.

        Only in virtual time can the suite choose; else there is one way, without a name.
        """
        if not isinstance(self._transport, FoundMute):
            yield ""
            return
        try:
            for name, found in (("in its place", False), ("found ahead", True)):
                self._transport.finds_mutes = found
                yield name
        finally:
            self._transport.finds_mutes = None

    def _read(self, deadline_ns: int) -> None:
        """Read once, at *deadline_ns* at the latest; inconclusive when the case's time is over."""
        if self.now_us() > self._deadline_us:
            inconclusive(f"the case was not over after {self.limits.case_us / 1e6:g} s")
        self._note_idle_time()
        if self.limits.slack_us:  # short waits: each one shows whether it lasted too long
            deadline_ns = min(deadline_ns, self._transport.now_ns() + _LOOK_NS)
        data = self._transport.read_available(deadline_ns)
        self._leave(deadline_ns // 1000)  # held up if that is long ago
        if data:
            self._take(data)

    @property
    def delay_us(self) -> int:
        """The longest time in which something was held up that is usually on time.

        An answer that has taken a whole trip of those that the lead has room for was.
        """
        late_us = self.trip_us if self.trip_us > self.limits.lead_us // _TRIPS_IN_LEAD else 0
        return max(self.held_up_us, late_us)

    def was_held_up_beyond_reckoning(self) -> bool:
        """Return True if host or emulator lacked a processor for longer than cases reckon with.

        The board answers once more before: one that still waits for a processor has not told so.
        """
        if not self.is_virtual and self.ask_time is not None:
            with contextlib.suppress(LinkLostError, CaseEndedError):
                self.ask_time()
        return self.held_up_us > self.limits.slack_us

    def note_late(self) -> None:
        """Note that what follows may come after its t_apply."""
        self.trip_us = max(self.trip_us, self.limits.lead_us // _TRIPS_IN_LEAD + 1)

    def note_held_up(self, duration_us: int) -> None:
        """Note that something between host and board was held up for *duration_us*."""
        self.held_up_us = max(self.held_up_us, duration_us)

    def _begin_delays(self) -> None:
        """Reset the measured delays of the host."""
        self.held_up_us = self.trip_us = 0
        self._board_waited_us = self._board.waited_us()
        self._leave()

    def _note_idle_time(self) -> None:
        """Record how long host and board had no processor since the host's last wait.

        Nothing in virtual time, which does not pass meanwhile.
        """
        if not self.limits.slack_us:  # no virtual time passes while the host computes
            return
        computed_us = (time.process_time_ns() - self._left_cpu_ns) // 1000
        self.note_held_up(self.now_us() - self._left_us - computed_us)
        before_us, self._board_waited_us = self._board_waited_us, self._board.waited_us()
        self.note_held_up(self._board_waited_us - before_us)

    def _leave(self, latest_us: int = 1 << 62) -> None:
        """Record when the host last listened or sent: now, or *latest_us* if that is earlier."""
        if self.limits.slack_us:
            self._left_us = min(latest_us, self.now_us())
            self._left_cpu_ns = time.process_time_ns()

    def _take(self, data: bytes) -> None:
        """Split received bytes at zeros, decode each piece, and judge it by the standing rules.

        More than 2 MiB or 50 000 pieces in one case end it.
        """
        now_us = self.now_us()
        self.recording.add(now_us, TransferDirection.BOARD, data)
        self.heard += len(data)
        *ended, rest = (self._partial + data).split(DELIMITER)
        rules = self.on_piece
        for piece in ended:
            if piece:
                self.received.append(_received_by_client(now_us, piece, shared=self._zeros == 1))
                self._zeros = 0
                if isinstance(message := self.received[-1].message, _STATUS):
                    self.counters = message.counters
                if rules is not None:
                    rules(self.received[-1])
            self._zeros += 1
        self._partial = rest[:_PARTIAL_BYTES]
        if self.heard > _FLOOD_BYTES or len(self.received) > _FLOOD_FRAMES:
            self._flooded()

    def _flooded(self) -> NoReturn:
        """End the case: too many bytes. FAILED if a frame is among them, else inconclusive."""
        text = f"the line is flooded: {self.heard} bytes in one case"
        if any(piece.header is not None for piece in self.received):
            fail(text)
        inconclusive(f"{text}, and no frame among them: not a board")


def decoded_frame(piece: bytes) -> bytes:
    """Return the body of a frame, as :func:`decode_frame` does."""
    try:
        return decode_frame(piece, CLIENT_COBS.decode)
    except CLIENT_COBS.refusal:
        return decode_frame(piece)  # its error names the code byte


def _received_by_client(t_us: int, piece: bytes, *, shared: bool) -> ReceivedByClient:
    """Return the piece between two delimiters with header and message, or with what is wrong.

    *shared*: one delimiter alone is between it and the piece before.
    """
    try:
        body = decoded_frame(piece)
    except RemoteProtocolError as error:
        return ReceivedByClient(t_us, piece, shared, fault=str(error), reason=error.reason)
    header = m.Header.of_body(body)
    try:
        message = m.parse_payload(header, body)
    except RemoteProtocolError as error:
        return ReceivedByClient(
            t_us, piece, shared, header, None, body, fault=str(error), reason=error.reason
        )
    return ReceivedByClient(t_us, piece, shared, header, message, body)

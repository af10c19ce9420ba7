"""Connection + transport: the pump that everything between host and board goes through.

All waiting of the driver happens in :meth:`Link.turn`, with a deadline; so nothing can hang, and
the same code runs on the wall clock and in virtual time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final, NoReturn, TypeAlias, TypeVar

from haptogram import errors
from haptogram.driver.line.budget import LineBudget, line_transmission_ns
from haptogram.driver.line.port import ClosedTransport, Transport
from haptogram.records.kept import MOST_KEPT
from haptogram_protocol import NEED_DATA, VERSION_MAJOR, HostConnection, messages
from haptogram_protocol.connection import (
    EventReceived,
    FrameDropped,
    HostEvent,
    ReplyReceived,
    RequestRefused,
    RequestTimedOut,
)
from haptogram_protocol.messages import ErrorCode, HelloReply, Message, UploadChunk

NS_PER_S: Final = 1_000_000_000
_SILENCE_NS: Final = 20_000_000  # the shortest lease of a board
BURST_NS: Final = 1_800_000  # line time that may be unsent: two frames of 276 B at 3 Mbaud
_STALL_RETRY_NS: Final = 1_000_000  # how soon a port that took nothing is asked again

#: Why a request was refused, by code and whether there is a detail: HG-4.9, HG-4.12.
_REASONS: Final[dict[tuple[int, bool], str]] = {
    (ErrorCode.STALE_SESSION, True): "; another host has opened a session",
    (ErrorCode.STALE_SESSION, False): "; the board has been started anew, and has no session",
    (
        ErrorCode.SEQUENCE_REUSED,
        True,
    ): "; the last session had this nonce: take another one, or seed",
}

_UNASKED: Final = (EventReceived, FrameDropped)
_FAILED: Final = (RequestRefused, RequestTimedOut)
_Outcome: TypeAlias = ReplyReceived | RequestRefused | RequestTimedOut
Handler: TypeAlias = Callable[[EventReceived | ReplyReceived | FrameDropped], None]
_M = TypeVar("_M", bound=Message)
_Part = TypeVar("_Part", messages.GeometryReply, messages.DriveReply)


class Link:
    """An open port and the protocol on it.

    Parameters
    ----------
    transport : Transport
        Open port; the link closes it.
    connection : HostConnection
        The protocol's state.
    baudrate : int
        Rate of the line, bits per second.
    timeout_s : float
        How long the port may refuse to take a byte, and the board to answer.
    keep : int or None
        Number of silences to keep; None: all.

    Attributes
    ----------
    handler : callable
        Is given events of the board, damaged frames, and replies that nobody waits for.
    stalls : int
        How often the port did not take all bytes that it was offered.
    idle_since_ns : int
        When it last had nothing to do but wait for bytes.
    silences_ns : deque of (int, int)
        Begin and end of the newest times in which nothing was sent for 20 ms or longer.
    now_ns : callable
        Returns the time on the port's clock.
    """

    def __init__(
        self,
        transport: Transport,
        connection: HostConnection,
        *,
        baudrate: int,
        timeout_s: float,
        keep: int | None = MOST_KEPT,
    ) -> None:
        self.connection = connection
        self.line = LineBudget(baudrate)
        self._burst_bytes = self.line.bytes_in(BURST_NS)
        self.handler: Handler = _ignore_link_event
        self.stalls = 0
        self.idle_since_ns = 0
        self.silences_ns: deque[tuple[int, int]] = deque(maxlen=keep)
        self.now_ns = transport.now_ns  # the very method: it is called a dozen times a frame
        self._transport = transport
        self._wrote_ns = transport.now_ns()
        self._timeout_ns = int(timeout_s * NS_PER_S)
        self._unwritten = b""
        self._refusing_since_ns: int | None = None
        self._awaited: dict[int, _Outcome | None] = {}
        self._untold: deque[HostEvent] = deque()  # for the handler
        self._telling = False

    @property
    def url(self) -> str:
        """URL by which the port was opened."""
        return self._transport.url

    @property
    def timeout_ns(self) -> int:
        """Longest time until the board answers, in nanoseconds."""
        return self._timeout_ns

    def now_us(self) -> int:
        """Return the same time in microseconds: the clock of the connection."""
        return self.now_ns() // 1000

    # --- the pump ------------------------------------------------------------------------------

    def run_until(self, deadline_ns: int) -> None:
        """Serve the line until *deadline_ns*, at least once."""
        self.turn(deadline_ns)
        while self.now_ns() < deadline_ns:
            self.turn(deadline_ns)

    def turn(self, deadline_ns: int) -> None:
        """Send frames that are due, wait for bytes until *deadline_ns*, and act on the bytes.

        Raises
        ------
        LinkLostError
            If the port is gone, or took no byte for the timeout.
        """
        self._push()
        self.idle_since_ns = self.now_ns()
        data = self._transport.read_available(self._wake_ns(deadline_ns))
        if not (data or self._unwritten or self._untold or self.connection.outstanding):
            return  # most turns of a stream
        now_us = self.now_us()
        if data:
            self.connection.receive_data(data, now_us)
        self.connection.advance_to(now_us)
        self._dispatch()
        self._push()

    def _wake_ns(self, deadline_ns: int) -> int:
        """Return the host time to wake: at the deadline, or before it to retry or to write."""
        due_us = self.connection.next_deadline_us()
        if due_us is not None:
            deadline_ns = min(deadline_ns, due_us * 1000)
        if self._unwritten:
            deadline_ns = min(deadline_ns, self.now_ns() + _STALL_RETRY_NS)
        return deadline_ns

    def _push(self) -> None:
        """Write pending bytes: the rest of a frame first, then requests."""
        data = self._unwritten + self.connection.data_to_send()
        if data:
            self._write_some(data, self.now_ns())

    def _write_some(self, data: bytes, now_ns: int) -> None:
        """Write as many bytes as the transport takes, keep the rest; raise if it takes none.

        It raises LinkLostError after the timeout. If nothing was written for 20 ms or more before,
        start and end of that silence go into `silences_ns`.
        """
        written = self._transport.write_some(data)
        self._unwritten = data[written:]
        self.line.add(written, now_ns)
        if now_ns - self._wrote_ns >= _SILENCE_NS:
            self.silences_ns.append((self._wrote_ns, now_ns))
        self._wrote_ns = now_ns
        if not self._unwritten:
            self._refusing_since_ns = None
            return
        self.stalls += 1
        if written or self._refusing_since_ns is None:
            self._refusing_since_ns = now_ns
        if now_ns - self._refusing_since_ns > self._timeout_ns:
            raise errors.LinkLostError(
                f"{self.url}: the port has taken no byte for {self._timeout_ns / NS_PER_S:g} s"
            )

    def _dispatch(self) -> None:
        """Keep replies that a caller awaits; pass all else to the handler, one after the other.

        The handler may use the link: what comes meanwhile is passed to it afterwards.
        """
        while (event := self.connection.next_event()) is not NEED_DATA:
            if not isinstance(event, _UNASKED) and event.seq in self._awaited:
                self._awaited[event.seq] = event
            else:
                self._untold.append(event)
        while self._untold and not self._telling:
            self._telling = True
            try:
                self._tell(self._untold.popleft())
            finally:
                self._telling = False

    def _tell(self, event: HostEvent) -> None:
        """Pass an event to the handler; raise if a request failed that no caller awaits.

        It raises DeviceError for a refused request, else NoAnswerError.
        """
        if isinstance(event, _FAILED):
            self._message(event, Message)  # raises: nobody else would tell
        else:
            self.handler(event)

    # --- stream --------------------------------------------------------------------------------

    def write_frame(self, wire: bytes) -> int:
        """Send a stream frame, once there is room for it, and return when there was.

        There is room when *wire* would be no more than the second frame unsent, or 1.8 ms of the
        line.  What lies in the port cannot be overtaken: with more in it, a MUTE would come too
        late.  With less, a host that catches up would sleep once a frame, and oversleep as often.
        """
        unsent = max(len(wire), self._burst_bytes - len(wire))
        now_ns = self.now_ns()
        while self._unwritten or self.line.unsent_bytes(now_ns) > unsent:
            wait_ns = _STALL_RETRY_NS if self._unwritten else 1
            self.turn(max(self.line.room_at_ns(unsent), now_ns + wait_ns))
            now_ns = self.now_ns()
        self._write_some(wire, now_ns)
        return now_ns

    def transmission_ns(self, wire: bytes) -> int:
        """Return the transmission time of *wire* in nanoseconds."""
        return line_transmission_ns(len(wire), self.line.baudrate)

    # --- requests ------------------------------------------------------------------------------

    def request(
        self, message: Message, reply: type[_M], *, t_apply_us: int = 0, immediate: bool = False
    ) -> _M:
        """Send a request and return its reply, which is of the type *reply*.

        Raises
        ------
        DeviceError
            The board refused it.
        NoAnswerError
            It was not answered in time.
        LinkLostError
            The port is gone.
        """
        deadline_ns = self.now_ns() + self._timeout_ns
        self.wait_idle(deadline_ns)
        seq = self.send(message, t_apply_us=t_apply_us, immediate=immediate)
        return self.wait_for(seq, reply, deadline_ns)

    def send(self, message: Message, *, t_apply_us: int = 0, immediate: bool = False) -> int:
        """Send a request without waiting: the handler gets its reply, unless somebody waits."""
        self._check_open()
        seq = self.connection.send_request(
            message, self.now_us(), t_apply_us=t_apply_us, immediate=immediate
        )
        self._push()
        return seq

    def mute(self, reply: type[_M], timeout_ns: int) -> _M:
        """Mute the board before anything else that waits, and return its reply."""
        # The rest of a frame that was cut off here ends at the MUTE's first delimiter, damaged.
        self._check_open()
        self._unwritten = b""
        self._awaited.clear()
        self.connection.data_to_send()
        seq = self.connection.send_mute(self.now_us())
        outcome = self._wait_for_outcome(seq, self.now_ns() + timeout_ns)
        return self.mute(reply, timeout_ns) if outcome is None else self._message(outcome, reply)

    def wait_idle(self, deadline_ns: int) -> None:
        """Wait until no request waits for its answer."""
        while self.connection.outstanding:
            self._check_time(deadline_ns, "a request")
            self.turn(deadline_ns)

    def send_chunk(self, chunk: UploadChunk) -> int:
        """Send a part of an upload and return its number; a full window is the caller's affair."""
        self._check_open()
        seq = self.connection.send_chunk(chunk, self.now_us())
        self._awaited[seq] = None
        self._push()
        return seq

    def answered(self, seq: int) -> bool:
        """Return True if an awaited request has its answer, or none any more: after a MUTE."""
        return seq not in self._awaited or self._awaited[seq] is not None

    def answer_of(self, seq: int, reply: type[_M]) -> _M:
        """Return the reply to an awaited request that was answered; see :meth:`request`."""
        return self._message(self._awaited.pop(seq, None), reply)

    def wait_for(self, seq: int, reply: type[_M], deadline_ns: int) -> _M:
        """Return the reply to the request *seq*; see :meth:`request`."""
        return self._message(self._wait_for_outcome(seq, deadline_ns), reply)

    def _wait_for_outcome(self, seq: int, deadline_ns: int) -> _Outcome | None:
        """Return reply, refusal or timeout of request *seq*; None if a MUTE made it void.

        Raises NoAnswerError if none comes before the deadline.
        """
        self._awaited[seq] = None
        try:
            while not self.answered(seq):
                self._check_time(deadline_ns, "the last request")
                self.turn(deadline_ns)
            return self._awaited.get(seq)
        finally:
            self._awaited.pop(seq, None)

    def _check_time(self, deadline_ns: int, what: str) -> None:
        """Raise NoAnswerError once the deadline has passed while waiting for *what*."""
        if self.now_ns() >= deadline_ns:
            raise errors.NoAnswerError(
                f"{self.url}: {what} was not answered within {self._timeout_ns / NS_PER_S:g} s"
            )

    def _message(self, outcome: _Outcome | None, reply: type[_M]) -> _M:
        """Return the message of a reply; raise DeviceError for a refusal, else NoAnswerError.

        *outcome*: reply, refusal or timeout of a request; None if a MUTE made it void.
        """
        if outcome is None:
            raise errors.NoAnswerError(f"{self.url}: a request was given up for a MUTE")
        if isinstance(outcome, RequestTimedOut):
            raise errors.NoAnswerError(
                f"{self.url}: {outcome.request.name} was sent {outcome.attempts} times and not "
                "answered"
            )
        if isinstance(outcome, RequestRefused):
            error = outcome.error
            why = _REASONS.get((error.code, error.detail != 0), "")
            raise errors.DeviceError(
                f"{outcome.request.name} was refused: {_link_error_name(error.code)}, "
                f"detail {error.detail}{why}",
                code=error.code,
                detail=error.detail,
            )
        assert isinstance(outcome.message, reply)  # the connection pairs requests and replies
        return outcome.message

    def close(self) -> None:
        """Close the port, and forget what waits for it; never raises."""
        self._transport.close()
        self._transport = ClosedTransport(self._transport)
        self.connection.port_closed()

    def _check_open(self) -> None:
        """Raise LinkLostError if the transport is closed."""
        if isinstance(self._transport, ClosedTransport):
            raise self._transport.error()


def _link_error_name(code: int) -> str:
    """Return the name of an error code, its number if this version does not know it."""
    return ErrorCode(code).name if code in ErrorCode._value2member_map_ else f"error {code}"


def _ignore_link_event(_: EventReceived | ReplyReceived | FrameDropped) -> None:
    """Ignore an event without a handler."""


def request_parts(
    link: Link,
    transducers: int,
    ask: Callable[[int, int], Message],
    reply: type[_Part],
    size: Callable[[_Part], int],
) -> list[_Part]:
    """Return the replies that together speak of all *transducers*, each of *size* of them.

    Raises
    ------
    WrongProtocolError
        A reply speaks of none, or of others than those that were asked for.
    """
    parts, first = list[_Part](), 0
    while first < transducers:
        request = ask(first, transducers - first)
        part = link.request(request, reply)
        if part.first != first or not size(part):
            raise errors.WrongProtocolError(
                f"{link.url}: {request.TYPE.name} from {first} gave {size(part)} transducers from "
                f"{part.first}"
            )
        parts.append(part)
        first += size(part)
    return parts


def open_line_session(link: Link) -> HelloReply:
    """Say HELLO and return the board's answer.

    Raises
    ------
    NoAnswerError
        The port is silent.
    WrongProtocolError
        Something answers, but no board.
    VersionMismatchError
        A board of another major version.
    LinkLostError
        The port closed.
    """
    deadline_ns = link.now_ns() + link.timeout_ns
    seq = link.connection.send_hello(link.now_us())
    try:
        return link.wait_for(seq, HelloReply, deadline_ns)
    except errors.NoAnswerError as error:
        _explain_line_silence(link, error)
    except errors.DeviceError as error:
        if error.code == ErrorCode.VERSION:
            raise errors.VersionMismatchError(
                f"{link.url}: the board speaks version {error.detail} of the protocol, "
                f"this host version {VERSION_MAJOR}"
            ) from error
        raise


def _explain_line_silence(link: Link, error: errors.NoAnswerError) -> NoReturn:
    """Raise the likely cause of silence: no bytes, no frames, an echo, or no answer."""
    connection = link.connection
    seconds = f"{link.timeout_ns / 1e9:g} s"
    if not connection.bytes_received:
        raise errors.NoAnswerError(f"{link.url}: nothing came back within {seconds}") from error
    if not connection.frames_received:
        raise errors.WrongProtocolError(
            f"{link.url}: {connection.bytes_received} bytes came within {seconds}, but no "
            f"Haptogram frame: another device, or another rate than {link.line.baudrate} baud"
        ) from error
    if connection.counters["unknown_type"] == connection.frames_received:
        raise errors.WrongProtocolError(
            f"{link.url}: the port sends back what is written to it; no board answers"
        ) from error
    raise errors.NoAnswerError(
        f"{link.url}: frames came within {seconds}, but no answer to HELLO"
    ) from error

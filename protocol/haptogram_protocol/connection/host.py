"""The host's end: sends requests and stream frames, takes replies and events of the board.

Control is stop-and-wait (HG-4.8): one request at a time, sent again until it is answered or given
up. Upload chunks have a window, and MUTE waits for no other request. A stream frame is never sent
again, so the caller gets its bytes.
"""

from __future__ import annotations

from collections import deque

from .. import messages as m
from ..cobs import PURE_PYTHON, Cobs
from ..errors import LocalProtocolError, RemoteProtocolError
from ..framing import encode_frame
from ..state import LinkInput, LinkState, next_link_state
from . import events
from .counters import HOST_COUNTERS
from .inbox import ConnectionInbox
from .pending import PendingRequest, PendingRequests


class HostConnection(ConnectionInbox):
    """Sans-I/O end of the link at the host.

    Parameters
    ----------
    nonce : int, keyword-only
        Session to ask for, 1 to 65535, chosen at random.
    cobs : Cobs, keyword-only
        COBS; :func:`~haptogram_protocol.cobs.fastest_cobs` gives a compiled one.

    Attributes
    ----------
    session : int
        Nonce of the session that is open or asked for.
    link_state : LinkState
        State of the link.
    identity : HelloReply or None
        Identity and limits of the board, once the session is open.
    warnings : list of str
        Differences between the two ends that do not keep them from working together.
    stream_index : int
        Number of the next stream frame; may be set back over frames that were not sent.
    counters : dict of str to int
        Number of received frames by :data:`HOST_COUNTERS`.

    Raises
    ------
    LocalProtocolError
        If *nonce* is not 1 to 65535.
    """

    def __init__(self, *, nonce: int, cobs: Cobs = PURE_PYTHON) -> None:
        if not 1 <= nonce <= 0xFFFF:
            raise LocalProtocolError(f"session nonce {nonce}; it is 1 to 65535")
        super().__init__(cobs)
        self.session = nonce
        self.link_state = LinkState.CLOSED
        self.identity: m.HelloReply | None = None
        self.warnings: list[str] = []
        self.counters = dict.fromkeys(HOST_COUNTERS, 0)
        self._stuff = cobs.encode
        self._output = bytearray()
        self._events: deque[events.HostEvent] = deque()
        self._pending = PendingRequests()
        self._window = 1  # upload chunks that may be unanswered
        self._control_seq = 0
        self.stream_index = m.FIRST_STREAM_SEQ
        self._event_expected = 0

    # --- Out -----------------------------------------------------------------------------------

    def send_hello(self, now_us: int) -> int:
        """Ask for the session and return the request's seq; allowed in every link state.

        The board does not start a session anew for the same nonce (HG-4.6): after a reset of the
        board, or of the line, make a new connection.
        """
        self.link_state = next_link_state(self.link_state, LinkInput.HELLO_SENT)
        self._pending.forget_all()
        hello = m.Hello(m.VERSION_MAJOR, m.VERSION_MINOR, self.session)
        return self._send(hello, now_us, session=0)

    def send_request(
        self, message: m.Message, now_us: int, *, t_apply_us: int = 0, immediate: bool = False
    ) -> int:
        """Send a request and return its seq; it is sent again until it is answered.

        Parameters
        ----------
        t_apply_us : int
            PLAY: start on the device clock; taken modulo 2^32.
        immediate : bool
            PLAY: start at once.

        Raises
        ------
        LocalProtocolError
            If another request waits for its answer, if the link is not open, or if *message* is no
            request or has its own method.
        """
        if message.TYPE not in m.REQUEST_RANGE or isinstance(
            message, m.Hello | m.Mute | m.UploadChunk
        ):
            raise LocalProtocolError(
                f"send_request does not send {message.TYPE.name}; use send_hello, send_mute, "
                "send_chunk or stream_frame"
            )
        if (t_apply_us or immediate) and message.TYPE is not m.MessageType.PLAY:
            raise LocalProtocolError(f"{message.TYPE.name} takes no time; only PLAY does")
        if self._pending:
            raise LocalProtocolError(f"{message.TYPE.name} while {self._pending.names} waits")
        self.link_state = next_link_state(self.link_state, LinkInput.REQUEST_SENT)
        flags = m.Flag.IMMEDIATE if immediate else 0
        time_us = 0 if immediate else t_apply_us
        return self._send(message, now_us, session=self.session, flags=flags, time_us=time_us)

    def send_chunk(self, chunk: m.UploadChunk, now_us: int) -> int:
        """Send a part of an upload and return its seq; several may wait for their answer.

        Raises
        ------
        LocalProtocolError
            If the window is full (see :attr:`chunks_free`) or another request waits.
        """
        if not self.chunks_free:
            raise LocalProtocolError(
                f"UPLOAD_CHUNK while {self._pending.names} waits; the window is {self._window}"
            )
        self.link_state = next_link_state(self.link_state, LinkInput.REQUEST_SENT)
        return self._send(chunk, now_us, session=self.session)

    def send_mute(self, now_us: int) -> int:
        """Mute the board, in any link state, and return the request's seq.

        A request that waits, other than HELLO, is abandoned without an event.
        """
        self._pending.forget_all(but=m.MessageType.HELLO)
        return self._send(m.Mute(), now_us, session=self.session if self.identity else 0)

    def stream_frame(
        self, message: m.Phases | m.Drives | m.Points, *, t_apply_us: int | None
    ) -> tuple[int, bytes]:
        """Return the unwrapped sequence number and the bytes of the next stream frame.

        Parameters
        ----------
        t_apply_us : int or None
            On the device clock, taken modulo 2^32; None: as soon as the frame is complete.

        Raises
        ------
        LocalProtocolError
            If the link is not open or the message does not fit.
        """
        self.link_state = next_link_state(self.link_state, LinkInput.STREAM_SENT)
        body = m.build_body(
            message,
            flags=m.Flag.IMMEDIATE if t_apply_us is None else 0,
            seq=self.stream_index,
            time_us=t_apply_us or 0,
            session=self.session,
        )
        wire = encode_frame(body, self._stuff)
        index = self.stream_index
        self.stream_index += 1
        return index, wire

    def data_to_send(self) -> bytes:
        """Return the bytes of the requests that are due, without stream frames."""
        if not self._output:
            return b""
        taken = bytes(self._output)
        self._output.clear()
        return taken

    @property
    def outstanding(self) -> int:
        """Number of requests that wait for their answer."""
        return len(self._pending)

    @property
    def chunks_free(self) -> int:
        """Number of upload chunks that may be sent now."""
        if any(w.request is not m.MessageType.UPLOAD_CHUNK for w in self._pending):
            return 0
        return max(0, self._window - len(self._pending))

    def port_closed(self) -> None:
        """Forget every request and byte that waits: the port is closed."""
        self.link_state = next_link_state(self.link_state, LinkInput.PORT_CLOSED)
        self._pending.forget_all()
        self._output.clear()
        self._forget_received()

    def _send(
        self, message: m.Message, now_us: int, *, session: int, flags: int = 0, time_us: int = 0
    ) -> int:
        """Queue a request, to be sent again until answered; return its sequence number.

        *session*, *flags* and *time_us* are for its header.
        """
        seq = self._control_seq
        body = m.build_body(message, flags=flags, seq=seq, time_us=time_us, session=session)
        wire = encode_frame(body, self._stuff)
        self._control_seq = (seq + 1) & 0xFFFF
        self._output += wire
        self._pending.add(message.TYPE, seq, wire, now_us)
        return seq

    # --- Time ----------------------------------------------------------------------------------

    def next_deadline_us(self) -> int | None:
        """Return the time at which to call :meth:`advance_to`; None if no request waits."""
        return self._pending.next_deadline_us

    def advance_to(self, now_us: int) -> None:
        """Send unanswered requests again, or give them up.  HG-12.6."""
        for waiting in self._pending.due(now_us):
            if waiting.is_exhausted:
                self._give_up(waiting)
            else:
                self._output += self._pending.resend(waiting, now_us)

    def _give_up(self, waiting: PendingRequest) -> None:
        """Report that a request was never answered; the link times out, if open or opening."""
        self._pending.forget(waiting)
        if self.link_state is LinkState.OPEN or waiting.request is m.MessageType.HELLO:
            self.link_state = next_link_state(self.link_state, LinkInput.TIMED_OUT)
        self._events.append(events.RequestTimedOut(waiting.request, waiting.seq, waiting.attempts))

    # --- In ------------------------------------------------------------------------------------

    @property
    def frames_received(self) -> int:
        """Number of frames whose CRC was right; 0 after many bytes means another protocol."""
        return self.counters["frames"]

    def next_event(self) -> events.HostEvent | events.NeedData:
        """Return the next event, or :data:`NEED_DATA`."""
        if self._events:
            return self._events.popleft()
        found = self._next_frame()
        if found is None:
            return events.NEED_DATA
        body, t_rx_us = found
        if isinstance(body, RemoteProtocolError):
            return self._drop(body.reason, t_rx_us)
        return self._judge(body, t_rx_us)

    def _drop(self, reason: str, t_rx_us: int) -> events.FrameDropped:
        """Count a dropped frame in the counter *reason* and return its event."""
        self.counters[reason] += 1
        return events.FrameDropped(reason, t_rx_us)

    def _judge(self, body: bytes, t_rx_us: int) -> events.HostEvent:
        """Parse a decoded frame and return its event: response, event or drop."""
        self.counters["frames"] += 1
        try:
            header, message = m.parse_body(body)
        except RemoteProtocolError as error:
            return self._drop(error.reason, t_rx_us)
        if header.flags & m.MUST_UNDERSTAND:
            return self._drop("unsupported", t_rx_us)
        if header.type in m.RESPONSE_RANGE:
            return self._judge_response(header, message, t_rx_us)
        if header.type in m.EVENT_RANGE:
            return self._judge_event(header, message, t_rx_us)
        return self._drop("unknown_type", t_rx_us)

    def _judge_event(self, header: m.Header, message: m.Message, t_rx_us: int) -> events.HostEvent:
        """Return an event, with how many before it were lost.

        Drop a copy, and one of another session.
        """
        if header.session != self.session:
            return self._drop("stale_session", t_rx_us)
        ahead = m.signed_difference(header.seq, self._event_expected, 16)
        if ahead < 0:
            return self._drop("duplicate", t_rx_us)
        self.counters["gap"] += ahead
        self._event_expected += ahead + 1
        return events.EventReceived(message, header, t_rx_us, ahead)

    def _judge_response(
        self, header: m.Header, message: m.Message, t_rx_us: int
    ) -> events.HostEvent:
        """Return a response as reply or refusal of its request.

        Drop a copy, one that no request waits for, and one of another session.
        """
        waiting = self._pending.get(header.seq)
        if waiting is None or not _is_answer_to(message, waiting.request):
            return self._drop("duplicate", t_rx_us)
        if not self._is_of_session(header, message, waiting):
            return self._drop("stale_session", t_rx_us)
        rtt_us = self._pending.answered(waiting, t_rx_us)
        if isinstance(message, m.HelloReply):
            message = self._greeted(message)
        if isinstance(message, m.Error):
            if waiting.request is m.MessageType.HELLO or self.link_state is LinkState.OPEN:
                self.link_state = next_link_state(self.link_state, LinkInput.REFUSED)
            return events.RequestRefused(message, header.seq, waiting.request, t_rx_us)
        if isinstance(message, m.UploadBeginReply):
            self._window = max(1, message.window)
        return events.ReplyReceived(
            message, header.seq, waiting.request, rtt_us, t_rx_us, header.time_us
        )

    def _is_of_session(self, header: m.Header, message: m.Message, waiting: PendingRequest) -> bool:
        """Return True if a response is of this session, or need not be (to MUTE). HG-3.7.

        *waiting* is the request that it answers.
        """
        if isinstance(message, m.HelloReply):
            return message.nonce == self.session
        anywhere = waiting.request in (m.MessageType.MUTE, m.MessageType.HELLO)
        stale = isinstance(message, m.Error) and header.session == 0
        return anywhere or stale or header.session == self.session

    def _greeted(self, reply: m.HelloReply) -> m.HelloReply | m.Error:
        """Open the link and return the reply; ERROR for a board of another major version."""
        if reply.major != m.VERSION_MAJOR:
            return m.Error(m.MessageType.HELLO, m.ErrorCode.VERSION, reply.major)
        self.link_state = next_link_state(self.link_state, LinkInput.HELLO_ANSWERED)
        self.identity = reply
        self.warnings = _identity_differences(reply)
        return reply


def _is_answer_to(message: m.Message, request: m.MessageType) -> bool:
    """Return True if a message is the response, or the ERROR, to a request of this type."""
    if isinstance(message, m.Error):
        return message.request == request
    return request + m.RESPONSE_OFFSET == message.TYPE


def _identity_differences(reply: m.HelloReply) -> list[str]:
    """Return a note if the board's minor version is not the host's, else []. HG-11.3.

    It says which version both use.
    """
    found = []
    if reply.minor != m.VERSION_MINOR:
        found.append(
            f"board speaks version {reply.major}.{reply.minor}, host {m.VERSION_MAJOR}."
            f"{m.VERSION_MINOR}: both use {m.VERSION_MAJOR}.{min(reply.minor, m.VERSION_MINOR)}"
        )
    return found

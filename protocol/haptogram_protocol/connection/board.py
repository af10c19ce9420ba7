"""The board's end: takes frames of the host, gives events to the board and replies to the line.

The connection makes every check that needs no board, in the order of SPEC.md HG-3.8: damage, type,
session, sequence, flags, length and value. It answers a request that fails one. The board itself
checks output state, time and configuration.
"""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass
from typing import Any, Final

from .. import messages as m
from ..cobs import PURE_PYTHON, Cobs
from ..errors import LocalProtocolError, RemoteProtocolError
from ..framing import HEADER_BYTES, FrameDecoder, encode_frame
from .counters import LINK_COUNTERS
from .events import NEED_DATA, BoardEvent, FrameDropped, NeedData, RequestReceived, StreamReceived
from .inbox import ConnectionInbox

OUTPUT_LIMIT: Final = 65_536  # bytes that may wait for the line


# HG-3.5: IMMEDIATE has a meaning in these only.  MUTE is carried out whatever its flags (HG-6.4).
_TAKES_IMMEDIATE: Final = frozenset({*m.STREAM_RANGE, int(m.MessageType.PLAY)})
_HELLO: Final = int(m.MessageType.HELLO)
IMMEDIATE: Final = int(m.Flag.IMMEDIATE)  # as a number: an operation on a Flag costs microseconds


@dataclass(slots=True)  # frozen would take four times as long to make
class ReceivedFrame:
    """A frame whose CRC was right.

    Attributes
    ----------
    header : Header
        Its header.
    payload : bytes
        Bytes behind the header.
    crc : int
        CRC-32 of header and payload, by which a repeated request is known.
    t_rx_us : int
        Device time, unwrapped, at which its last byte came.
    in_session : bool
        True if the frame, no HELLO, is of the open session; it renews the lease then (HG-6.7).
    """

    header: m.Header
    payload: bytes
    crc: int
    t_rx_us: int
    in_session: bool


def unknown_received_flags(header: m.Header) -> int:
    """Return the must-understand flags that have no meaning in such a frame.  HG-3.4."""
    known = IMMEDIATE if header.type in _TAKES_IMMEDIATE else 0
    return header.flags & m.MUST_UNDERSTAND & ~known


#: How far ahead of the expected one a stream number is at which the frame is a copy.  HG-5.5/1.
COPY_AHEAD: Final = 0x10000 - 32
# HG-4.10: never compared with the last request, because a repetition does no harm.
_IDEMPOTENT: Final = frozenset({m.MessageType.MUTE, m.MessageType.UPLOAD_CHUNK})


@dataclass(frozen=True, slots=True)
class _Answered:
    """The last request and its reply, for a host that missed the reply.  HG-4.9."""

    seq: int
    crc: int
    wire: bytes


class BoardConnection(ConnectionInbox):
    """Sans-I/O end of the link at the board.

    Parameters
    ----------
    output_limit : int, keyword-only
        Bytes that may wait for the line; droppable events get half of it.
    cobs : Cobs, keyword-only
        COBS; :func:`~haptogram_protocol.cobs.fastest_cobs` gives a compiled one.
    decoder : FrameDecoder or None, keyword-only
        Decoder of the received bytes; None: a new one with *cobs*.
    unsupported : container of int, keyword-only
        Types whose capability the board does not advertise: it does not know them (HG-1.2).

    Attributes
    ----------
    session : int
        The open session, 0 if there is none.
    counters : dict of str to int
        :data:`LINK_COUNTERS`, modulo 2^32.
    output_bytes : int
        Bytes that wait for the line.
    departure_us : callable
        Returns when the first byte of an answer leaves that the connection itself gives to a frame
        of which it is told the arrival. Whoever knows the line sets it; without, it leaves at once.
    """

    def __init__(
        self,
        *,
        output_limit: int = OUTPUT_LIMIT,
        cobs: Cobs = PURE_PYTHON,
        decoder: FrameDecoder | None = None,
        unsupported: Container[int] = (),
    ) -> None:
        super().__init__(cobs, decoder)
        self.session = 0
        self.counters = dict.fromkeys(LINK_COUNTERS, 0)
        self.departure_us: Callable[[int], int] = _at_once
        self._output_limit = output_limit
        self._types = frozenset(kind for kind in m.MESSAGES if kind not in unsupported)
        self._stuff = cobs.encode
        self._frames: deque[bytes] = deque()  # that wait for the line
        self.output_bytes = 0
        self._greeting: m.HelloReply | None = None
        self._start_sequences(0)

    def _start_sequences(self, control_seq: int) -> None:
        """Reset sequence numbers for a new session; requests count on from *control_seq*.

        Stream frames begin at FIRST_STREAM_SEQ, events at 0; the remembered reply is forgotten.
        """
        self._stream_expected = m.FIRST_STREAM_SEQ  # unwrapped
        self._control_newest = control_seq
        self._event_seq = 0
        self._answered: _Answered | None = None

    # --- In ------------------------------------------------------------------------------------

    def next_event(self) -> BoardEvent | NeedData:
        """Return the next event, or :data:`NEED_DATA`.

        Requests must be answered before the next event is asked for.
        """
        found = self._next_frame()
        if found is None:
            return NEED_DATA
        body, t_rx_us = found
        if isinstance(body, RemoteProtocolError):
            self.count(body.reason)
            return FrameDropped(body.reason, t_rx_us)
        return self._judge(body, t_rx_us)

    def count(self, reason: str, number: int = 1) -> None:
        """Add *number* to a counter: the connection or the board dropped frames.

        Raises
        ------
        LocalProtocolError
            If *reason* is not one of :data:`LINK_COUNTERS`.
        """
        if reason not in self.counters:
            raise LocalProtocolError(f"no link counter {reason!r}; there are {LINK_COUNTERS}")
        self.counters[reason] = (self.counters[reason] + number) & 0xFFFFFFFF

    def _judge(self, body: bytes, t_rx_us: int) -> BoardEvent:
        """Return what a decoded frame is to the board: stream, request or drop."""
        self.count("frames")
        header = m.Header.of_body(body)
        bears_session = self.session != 0 and header.session == self.session
        in_session = bears_session and header.type != _HELLO  # which belongs to none: HG-6.7
        frame = ReceivedFrame(header, body[HEADER_BYTES:], zlib.crc32(body), t_rx_us, in_session)
        if header.type in m.STREAM_RANGE:
            return self._judge_stream(frame)
        if header.type in m.REQUEST_RANGE:
            return self._judge_request(frame)
        return self._drop(frame, "unknown_type")

    def _drop(self, frame: ReceivedFrame, reason: str) -> FrameDropped:
        """Count a dropped frame in the counter *reason* and return its event."""
        self.count(reason)
        return FrameDropped(reason, frame.t_rx_us, frame.in_session)

    # --- Stream (HG-5) -------------------------------------------------------------------------

    @property
    def next_stream_index(self) -> int:
        """Unwrapped number of the next stream frame, if none is lost."""
        return self._stream_expected

    def skip_stream(self, count: int) -> None:
        """Count *count* stream frames that came whole, one after the other, without their bytes."""
        self.count("frames", count)
        self._stream_expected += count

    def _judge_stream(self, frame: ReceivedFrame) -> BoardEvent:
        """Return a stream frame for the board, or its drop; either way its number is used up."""
        header = frame.header
        # HG-5.6: whatever else is wrong with the frame, its number has been used.
        index = self._take_index(header.seq) if frame.in_session else None
        if header.type not in self._types:
            return self._drop(frame, "unknown_type")
        if not frame.in_session:
            return self._drop(frame, "stale_session")
        if index is None:
            return self._drop(frame, "duplicate")
        if header.flags and unknown_received_flags(header):
            return self._drop(frame, "unsupported")
        try:
            message: Any = m.MESSAGES[header.type].deserialize(frame.payload)
        except RemoteProtocolError as error:
            return self._drop(frame, error.reason)
        return StreamReceived(
            message,  # Phases, Drives or Points: the only types below 0x40
            index,
            None if header.flags & IMMEDIATE else header.time_us,
            header.session,
            frame.t_rx_us,
        )

    def _take_index(self, seq: int) -> int | None:
        """Return *seq* unwrapped, and count a gap before it; None if it was used.  HG-5.5."""
        ahead = (seq - self._stream_expected) & 0xFFFF
        if ahead >= COPY_AHEAD:
            return None
        if ahead:
            self.count("gap", ahead)
        index = self._stream_expected + ahead
        self._stream_expected = index + 1
        return index

    # --- Requests (HG-4) -----------------------------------------------------------------------

    def _judge_request(self, frame: ReceivedFrame) -> BoardEvent:
        """Return a request for the board, or its refusal by type, session, flags or payload.

        MUTE is refused for none of these.
        """
        header = frame.header
        if header.type == m.MessageType.MUTE:
            return self._request(frame, m.Mute())  # HG-6.4: no flag, length or session refuses it
        if header.type not in self._types:
            return self._refuse(frame, m.ErrorCode.UNSUPPORTED, header.type)
        if header.type != _HELLO and not frame.in_session:
            return self._refuse(frame, m.ErrorCode.STALE_SESSION, self.session)
        if flags := unknown_received_flags(header):
            return self._refuse(frame, m.ErrorCode.UNSUPPORTED, flags)
        return self._judge_payload(frame, m.MESSAGES[header.type])

    def _judge_payload(self, frame: ReceivedFrame, kind: type[m.Message]) -> BoardEvent:
        """Parse the payload of a request and return the request, or its refusal.

        Refused are a wrong length (BAD_LENGTH), a wrong value (BAD_VALUE), and a used number.
        """
        try:
            message = kind.deserialize(frame.payload)
        except RemoteProtocolError as error:
            if error.reason == "bad_length":
                length = 0 if kind.TAIL else kind.LAYOUT.size
                return self._refuse(frame, m.ErrorCode.BAD_LENGTH, length)
            return self._judge_control_seq(frame) or self._refuse_value(frame, error)
        if isinstance(message, m.Hello):
            return self._judge_hello(frame, message)
        return self._judge_control_seq(frame) or self._request(frame, message)

    def _refuse_value(self, frame: ReceivedFrame, error: RemoteProtocolError) -> BoardEvent:
        """Refuse a request for a value that no table has; the refusal is remembered.  HG-4.9/4."""
        self._take_control_seq(frame)
        return self._refuse(frame, m.ErrorCode.BAD_VALUE, error.offset, is_remembered=True)

    def _judge_hello(self, frame: ReceivedFrame, hello: m.Hello) -> BoardEvent:
        """Refuse a wrong HELLO, repeat the greeting of the open session, or open a new one."""
        if hello.major != m.VERSION_MAJOR:  # HG-4.4
            own = m.VERSION_MAJOR
            return self._refuse(frame, m.ErrorCode.VERSION, own)
        if hello.nonce == 0:
            offset = m.Hello.WIRE["nonce"].offset
            return self._refuse(frame, m.ErrorCode.BAD_VALUE, offset)
        if hello.nonce == self.session and self._greeting is not None:  # HG-4.6
            leaves_us = self.departure_us(frame.t_rx_us)
            wire = self._response(self._greeting, frame.header.seq, leaves_us)
            self._queue(wire, self._output_limit)
            return self._drop(frame, "repeated")
        return self._request(frame, hello, new_session=True)

    def _judge_control_seq(self, frame: ReceivedFrame) -> FrameDropped | None:
        """Answer a repetition from memory, refuse a used number; return the drop in both cases.

        None for a new request.
        """
        seq = frame.header.seq
        if frame.header.type in _IDEMPOTENT:
            return None
        if self._answered and (self._answered.seq, self._answered.crc) == (seq, frame.crc):
            self._queue(self._answered.wire, self._output_limit)
            return self._drop(frame, "repeated")
        if m.signed_difference(seq, self._control_newest, 16) <= 0:
            return self._refuse(frame, m.ErrorCode.SEQUENCE_REUSED, seq)
        return None

    def _request(
        self, frame: ReceivedFrame, message: m.Message, *, new_session: bool = False
    ) -> RequestReceived:
        """Count a request, use up its number, and return its event.

        *new_session*: it is a HELLO that opens one.
        """
        self.count("requests")
        header = frame.header
        self._take_control_seq(frame)
        return RequestReceived(
            message=message,
            seq=header.seq,
            session=header.session,
            t_wire_us=header.time_us,
            immediate=bool(header.flags & IMMEDIATE),
            t_rx_us=frame.t_rx_us,
            new_session=new_session,
            renews_lease=frame.in_session,
            crc=frame.crc,
        )

    def _take_control_seq(self, frame: ReceivedFrame) -> None:
        """Note the newest number of a request in this session; an older one changes nothing."""
        seq = frame.header.seq
        if frame.in_session and m.signed_difference(seq, self._control_newest, 16) > 0:
            self._control_newest = seq

    def _refuse(
        self,
        frame: ReceivedFrame,
        code: m.ErrorCode,
        number: int,
        *,
        is_remembered: bool = False,
    ) -> FrameDropped:
        """Send ERROR with *code* and detail *number* for a request; the board never sees it.

        *is_remembered*: a repetition of the request gets the same ERROR.
        """
        error = m.Error(request=frame.header.type, code=code, detail=number)
        session = 0 if code is m.ErrorCode.STALE_SESSION else self.session
        wire = self._response(error, frame.header.seq, self.departure_us(frame.t_rx_us), session)
        self._queue(wire, self._output_limit)
        if is_remembered:
            self._answered = _Answered(frame.header.seq, frame.crc, wire)
        return self._drop(frame, "requests")

    # --- Out -----------------------------------------------------------------------------------

    def open_session(self, nonce: int) -> None:
        """Make *nonce* the open session: every sequence space is reset.  HG-4.6.

        Raises
        ------
        LocalProtocolError
            If *nonce* is not 1 to 65535.
        """
        if not 1 <= nonce <= 0xFFFF:
            raise LocalProtocolError(f"session nonce {nonce}; it is 1 to 65535")
        self.session = nonce
        self._greeting = None
        self._start_sequences(0)

    def reply(self, request: RequestReceived, message: m.Message, now_us: int) -> None:
        """Answer *request* with *message*; call :meth:`open_session` before the reply to a HELLO.

        Parameters
        ----------
        now_us : int
            Device time, unwrapped, at which the first byte leaves.

        Raises
        ------
        LocalProtocolError
            If *message* does not answer such a request.
        """
        due = request.message.TYPE + m.RESPONSE_OFFSET
        if due != message.TYPE:
            raise LocalProtocolError(f"{message.TYPE.name} does not answer {request.message!r}")
        if isinstance(message, m.HelloReply):
            if message.nonce != self.session:
                raise LocalProtocolError(
                    f"HELLO_REPLY with nonce {message.nonce}; the open session is {self.session}"
                )
            self._greeting, self._control_newest = message, request.seq
        self._answer(request, message, now_us)

    def refuse(self, request: RequestReceived, code: m.ErrorCode, detail: int, now_us: int) -> None:
        """Answer *request* with ERROR.  HG-10.1."""
        self._answer(request, m.Error(request.message.TYPE, code, detail & 0xFFFFFFFF), now_us)

    def send_event(
        self, message: m.Message, *, now_us: int, flags: int = 0, droppable: bool = False
    ) -> bool:
        """Send an event of the open session.

        Parameters
        ----------
        now_us : int
            Device time for the header, unwrapped: of the latch in a trace, else of sending.
        droppable : bool
            True for a trace, which is dropped when half of the output is full.

        Returns
        -------
        bool
            False if nothing was sent: no session (HG-4.7), or no room.
        """
        if message.TYPE not in m.EVENT_RANGE:
            raise LocalProtocolError(f"{message.TYPE.name} is not an event")
        if not self.session:
            return False
        body = m.build_body(
            message, flags=flags, seq=self._event_seq, time_us=now_us, session=self.session
        )
        limit = self._output_limit // 2 if droppable else self._output_limit
        sent = self._queue(encode_frame(body, self._stuff), limit)
        self._event_seq += sent  # one that was not sent leaves no gap: a gap is the line's fault
        return sent

    def data_to_send(self, limit: int | None = None) -> bytes:
        """Return whole frames that wait for the line.

        Parameters
        ----------
        limit : int or None
            Most bytes to return; None: all.
        """
        if limit is None or self.output_bytes <= limit:
            taken = b"".join(self._frames)
            self._frames.clear()
        else:
            taken = b"".join(self._oldest(limit))
        self.output_bytes -= len(taken)
        return taken

    def _oldest(self, limit: int) -> Iterator[bytes]:
        """Remove and yield the oldest queued frames that fit in *limit* bytes."""
        while self._frames and len(self._frames[0]) <= limit:
            limit -= len(self._frames[0])
            yield self._frames.popleft()

    def _answer(self, request: RequestReceived, message: m.Message, now_us: int) -> None:
        """Queue the response to a request; remember it for repetitions unless it is idempotent."""
        wire = self._response(message, request.seq, now_us)
        if request.message.TYPE not in _IDEMPOTENT:
            self._answered = _Answered(request.seq, request.crc, wire)
        self._queue(wire, self._output_limit)

    def _response(
        self, message: m.Message, seq: int, now_us: int, session: int | None = None
    ) -> bytes:
        """Return the frame of a response or event; its session is the open one if None is given."""
        session = self.session if session is None else session
        body = m.build_body(message, flags=0, seq=seq, time_us=now_us, session=session)
        return encode_frame(body, self._stuff)

    def _queue(self, wire: bytes, limit: int) -> bool:
        """Queue a whole frame; return False if more than *limit* bytes would wait (HG-9.6)."""
        has_room = self.output_bytes + len(wire) <= limit
        if has_room:
            self._frames.append(wire)
            self.output_bytes += len(wire)
        return has_room


def _at_once(t_rx_us: int) -> int:
    """Return the apply time of an IMMEDIATE frame: its arrival."""
    return t_rx_us

"""Requests and stream frames with any values in their fields, and their answers."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Sequence
from typing import Any, Final, TypeVar

from haptogram_protocol import messages as m
from haptogram_protocol.annotation.frames import annotated_type_name
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import DELIMITER, MAX_ENCODED_BYTES
from haptogram_protocol.state import OutputState

from ..outcome import check, check_equal, fail
from .recording import error_name, message_text, moved_counters_text
from .wire import RawFrameClient, ReceivedByClient, decoded_frame, encoded_frame

_M = TypeVar("_M", bound=m.Message)
#: Five times the time in which a board answers (HG-4.11/3).
PROCESSED_US: Final = 50_000
#: Largest burst, whatever the window or free memory: it may be 4 GB.
LONGEST_BURST_BYTES: Final = 1 << 17
#: Later than every device time.
NO_TIME_US: Final = 1 << 62
_ECHO_BITS: Final = 64
_KNOCK_US: Final = 100_000  # how soon a board that boots is asked again
_PING_BYTES: Final = 26  # largest size of a PING on the line
_PAUSES_KEPT: Final = 256
#: How much lower the number of such a PING is than the newest: more than any window holds.
_PAUSE_BEHIND: Final = 0x1000


def flags_at_once(message: m.Message) -> int:
    """Return the flags of a request that is carried out as it comes: PLAY begins at once."""
    return int(m.Flag.IMMEDIATE) if isinstance(message, m.Play) else 0


class RequestClient:
    """Sends requests and stream frames of any content; keeps no rule that binds a host.

    Parameters
    ----------
    wire : RawFrameClient
        Open port.
    random_source : random.Random
        Source of nonces and contents: the same seed gives the same bytes.

    Attributes
    ----------
    session : int
        Session in the header of the next frame.
    seq : int
        Number of the last request, unwrapped.
    stream_next : int
        Unwrapped number of the next stream frame.
    knocks : int
        How often the first request after a restart was repeated: the board was deaf meanwhile.
    rx_window : int
        Encoded bytes that the board takes without an answer (HG-2.7/2).
    processed_us : int
        Time after which the board has processed what it has received.
    in_time_from_us : int
        Stream frames for this device time or a later one are to come before their time.
    in_time_us : int
        The first such time of a frame that was made since the last look at it.
    pauses : int
        How often the client waited for the board, by a PING that counts in ``requests``.
    """

    def __init__(self, wire: RawFrameClient, random_source: random.Random) -> None:
        self.wire = wire
        self.random = random_source
        self.session = 0
        self.seq = 0
        self.stream_next = m.FIRST_STREAM_SEQ
        self.knocks = 0
        self.rx_window = MAX_ENCODED_BYTES + 2  # the least of HG-4.3/8
        self.processed_us = PROCESSED_US
        self.pauses = 0
        self.in_time_from_us = self.in_time_us = NO_TIME_US
        self._unanswered: list[tuple[bytes, int, int]] = []  # with the mark before, and the time
        self._unanswered_bytes = 0
        self._answers_of_pauses: deque[ReceivedByClient] = deque(maxlen=_PAUSES_KEPT)
        self._boots_until_us: int | None = None
        self._answers_strangers = True
        wire.ask_time = self.ask_time

    def expect_boot(self, timeout_s: float) -> None:
        """Repeat the next request until it is answered, for at most *timeout_s*."""
        self._boots_until_us = self.wire.now_us() + round(timeout_s * 1e6)

    # --- frames --------------------------------------------------------------------------------

    def body(
        self,
        kind: int,
        payload: bytes = b"",
        *,
        seq: int,
        flags: int = 0,
        time_us: int = 0,
        session: int | None = None,
    ) -> bytes:
        """Return header and payload of a frame."""
        if session is None:
            session = 0 if kind == m.Hello.TYPE else self.session
        return (
            m.Header.LAYOUT.pack(kind, flags, seq & 0xFFFF, time_us & 0xFFFFFFFF, session) + payload
        )

    def request_wire(
        self, message: m.Message, *, seq: int | None = None, **header: Any
    ) -> tuple[bytes, int]:
        """Return a request's bytes and number: the next number unless *seq* is given."""
        seq = self.next_seq() if seq is None else seq
        return encoded_frame(
            self.body(message.TYPE, message.serialize(), seq=seq, **header)
        ), seq & 0xFFFF

    def stream_wire(self, message: m.Message, at_us: int | None = None, **header: Any) -> bytes:
        """Return the bytes of a stream frame, to be latched at *at_us* or as soon as complete.

        The frame takes the next stream number unless *seq* is given.
        """
        return self.stream_raw(message.TYPE, message.serialize(), at_us, **header)

    def stream_raw(
        self,
        kind: int,
        payload: bytes,
        at_us: int | None = None,
        *,
        seq: int | None = None,
        flags: int | None = None,
        session: int | None = None,
    ) -> bytes:
        """Return the bytes of any stream frame; see :meth:`stream_wire`."""
        if seq is None:
            seq, self.stream_next = self.stream_next, self.stream_next + 1
        if flags is None:
            flags = m.Flag.IMMEDIATE if at_us is None else 0
        time_us = at_us or 0
        if not flags & m.Flag.IMMEDIATE and time_us >= self.in_time_from_us:
            self.in_time_us = min(self.in_time_us, time_us)
        return encoded_frame(
            self.body(kind, payload, seq=seq, flags=flags, time_us=time_us, session=session)
        )

    def next_seq(self) -> int:
        """Return the number of the next request."""
        self.seq += 1
        return self.seq & 0xFFFF

    def send(self, *wires: bytes) -> None:
        """Send frames, or bytes that are no frames, without a pause.

        Where more than ``rx_window`` bytes would be unanswered at the board, which need not take
        them (HG-2.7/2), a PING of no session goes in between, and its refusal is awaited.
        """
        size = sum(map(len, wires))
        self._make_room(size)
        if size <= self.rx_window:
            self._put(wires)
            return
        run: list[bytes] = []
        for wire in wires:
            if run and sum(map(len, run)) + len(wire) > self.rx_window - _PING_BYTES:
                self._put(run)
                self._make_room(self.rx_window)
                run = []
            run.append(wire)
        self._put(run)

    def stream(self, message: m.Message, at_us: int | None = None, **header: Any) -> None:
        """Send a stream frame; see :meth:`stream_wire`."""
        self.send(self.stream_wire(message, at_us, **header))

    def _put(self, wires: Sequence[bytes]) -> None:
        """Send encoded frames and count their bytes as unanswered.

        If they do not fit in the board's receive window, they are sent at the rate of the line.
        """
        mark, data = self.mark(), b"".join(wires)
        self._unanswered_bytes += len(data)
        self.wire.send(data, paced=len(data) > self.rx_window)
        sent_us = self.wire.now_us() + self.wire.backlog_us
        self._unanswered += [(wire, mark, sent_us) for wire in wires]

    def _make_room(self, size: int) -> None:
        """Wait until the board has answered a PING, unless *size* bytes fit in its receive window.

        The PING bears session 0, which is never open: the board refuses it before it looks at its
        number (HG-3.8, HG-4.9/4, HG-4.12). So it takes no number from the requests that were made
        before :meth:`send`, leaves the remembered reply as it is, and renews no lease (HG-6.7/1).
        """
        if self._unanswered_bytes + size <= self.rx_window - _PING_BYTES:
            return
        self._forget_answered()
        fits = self._unanswered_bytes + size <= self.rx_window - _PING_BYTES
        if fits or not self._unanswered or not self._unanswered[-1][0].endswith(DELIMITER):
            return
        self._answers_of_pauses.append(self.answer_to(m.Ping.TYPE, *self._pause()))
        self._forget_unanswered()

    def _pause(self) -> tuple[int, int]:
        """Send a PING of session 0; return its number and the first index of a possible answer."""
        self.pauses += 1
        seq, since = (self.seq - _PAUSE_BEHIND) & 0xFFFF, self.mark()
        ping = m.Ping(self.random.getrandbits(_ECHO_BITS))
        self._put([encoded_frame(self.body(ping.TYPE, ping.serialize(), seq=seq, session=0))])
        return seq, since

    def ask_time(self) -> int | None:
        """Return the device time in the refusal of a PING of no session, modulo 2^32.

        None within a frame, whose rest is still to come, and for a board that refuses none.
        """
        if not (self._answers_strangers and self.wire.ended_whole):
            return None
        answer = self.try_answer(*self._pause())
        if answer is None or answer.header is None:
            self._answers_strangers = False
            return None
        self._answers_of_pauses.append(answer)
        self._forget_unanswered()
        return answer.header.time_us

    def _forget_answered(self) -> None:
        """Drop the unanswered frames up to the last one that the board has surely processed.

        It was answered, or was sent `processed_us` ago: a time in which the board reads any frame.
        """
        for place in reversed(range(len(self._unanswered))):
            wire, since, sent_us = self._unanswered[place]
            is_old = self.wire.now_us() - sent_us >= self.processed_us
            if is_old or self._is_answered(_ordered_request_seq(wire), since):
                self._unanswered = self._unanswered[place + 1 :]
                self._unanswered_bytes = sum(len(wire) for wire, _, _ in self._unanswered)
                return

    def _is_answered(self, seq: int | None, since: int) -> bool:
        """Return True if a response with sequence number *seq* was received from index *since* on.

        None is the number of a MUTE, or of what is no request: always False.
        """
        answers = self.wire.received[since:] if seq is not None else ()
        return any(p.is_response and p.header is not None and p.header.seq == seq for p in answers)

    def _forget_unanswered(self) -> None:
        """Treat all sent bytes as read by the board."""
        self._unanswered, self._unanswered_bytes = [], 0

    # --- requests and answers ------------------------------------------------------------------

    def ask(self, message: m.Message, **header: Any) -> ReceivedByClient:
        """Send a request and return its answer, a refusal too; FAILED if none comes."""
        return self.ask_raw(message.TYPE, message.serialize(), **header)

    def ask_at_once(self, message: m.Message, **header: Any) -> ReceivedByClient:
        """Send a request, PLAY to begin at once, and return its answer; see :meth:`ask`."""
        return self.ask(message, flags=flags_at_once(message), **header)

    def exchange(self, *wires: bytes) -> list[ReceivedByClient]:
        """Send frames without a pause; return the answer to each request among them.

        FAILED if one has none.
        """
        since = self.mark()
        self.send(*wires)
        headers = [header for wire in wires if (header := _frame_header(wire)) is not None]
        requests = [header for header in headers if header.type in m.REQUEST_RANGE]
        return [self.answer_to(header.type, header.seq, since) for header in requests]

    def ask_raw(
        self, kind: int, payload: bytes = b"", *, seq: int | None = None, **header: Any
    ) -> ReceivedByClient:
        """Send any request and return its answer; FAILED if none comes."""
        if seq is None:
            self._make_room(len(payload) + _PING_BYTES)
        seq = self.next_seq() if seq is None else seq & 0xFFFF
        wire = encoded_frame(self.body(kind, payload, seq=seq, **header))
        since = self.mark()
        self._put([wire])
        self.knock(wire, seq, since)
        answer = self.answer_to(kind, seq, since)
        if kind != m.Mute.TYPE:  # which may overtake what was sent before (HG-3.8/2)
            self._forget_unanswered()
        return answer

    def knock(self, wire: bytes, seq: int, since: int) -> None:
        """Repeat the first request after a restart until it is answered, or the boot time is over.

        The repetitions bear one number, so that the board carries the request out once.
        """
        until_us, self._boots_until_us = self._boots_until_us, None
        if until_us is None:
            return
        wait_us = min(_KNOCK_US, self.wire.limits.answer_us) + self.wire.backlog_us

        def answered(piece: ReceivedByClient) -> bool:
            return piece.header is not None and piece.is_response and piece.header.seq == seq

        while (
            self.wire.wait_for(answered, since, wait_us) is None and self.wire.now_us() < until_us
        ):
            self.send(wire)
            self.knocks += 1
        if self.knocks:
            self.wire.idle(wait_us)  # a board may have kept them all, and answers each

    def answer_to(self, kind: int, seq: int, since: int) -> ReceivedByClient:
        """Return the answer to the request *seq* from piece *since* on; FAILED if none comes."""
        counted = self.wire.counters
        found = self.await_answer(seq, since)
        if found is None:
            patience_s = (self.wire.limits.answer_us + self.wire.sent_for_us) / 1e6
            fail(
                f"no answer to {annotated_type_name(kind)} (seq {seq}) within {patience_s:.4g} s; "
                f"{self.wire.recording.before(seq)}; {self.text_since(since, counted)}"
            )
        return found

    def await_answer(self, seq: int, since: int) -> ReceivedByClient | None:
        """Return the answer to the request *seq*; if it comes late, something was held up."""
        found = self.try_answer(seq, since)
        if found is None and not self.wire.is_virtual:
            found = self.try_answer(seq, since)
            self.wire.note_held_up(self.wire.limits.answer_us if found else 0)
        return found

    def try_answer(self, seq: int, since: int) -> ReceivedByClient | None:
        """Return the answer to the request *seq*, None if none comes in time."""
        sent_us = self.wire.backlog_us + self.wire.sent_for_us
        timeout_us = self.wire.limits.answer_us + sent_us

        def answers(piece: ReceivedByClient) -> bool:
            return piece.header is not None and piece.is_response and piece.header.seq == seq

        asked_us = self.wire.now_us() + sent_us
        found = self.wire.wait_for(answers, since, timeout_us)
        if found is not None:
            self.wire.trip_us = max(self.wire.trip_us, self.wire.begun_us(found) - asked_us)
        return found

    def text_since(self, since: int, counted: m.Counters | None = None) -> str:
        """Return in words what has come from piece *since* on, and what moved since *counted*."""
        headers = [piece.header for piece in self.wire.received[since:] if piece.header is not None]
        came = sorted({annotated_type_name(header.type) for header in headers})
        told = f"since then {', '.join(came)} came" if came else "nothing came since then"
        now = self.wire.counters
        if counted is None or now is None or now is counted:
            return told
        return f"{told}; counted since the STATUS before: {moved_counters_text(counted, now)}"

    def call(self, message: m.Message, reply: type[_M], **header: Any) -> _M:
        """Send a request and return its reply; FAILED if it is refused or not answered."""
        return self.reply_in(self.ask(message, **header), reply, message.TYPE)

    def ping(self, echo: int, **header: Any) -> m.Pong:
        """Send PING and return PONG; see :meth:`call`."""
        return self.call(m.Ping(echo), m.Pong, **header)

    def reply_in(self, answer: ReceivedByClient, reply: type[_M], kind: int | None = None) -> _M:
        """Return the reply in *answer*; FAILED if the answer is something else."""
        if isinstance(answer.message, reply):
            return answer.message
        name = annotated_type_name(reply.TYPE - m.RESPONSE_OFFSET if kind is None else kind)
        if answer.message is None:
            fail(f"the answer to {name} cannot be read: {answer.fault}")
        got = self.answer_text(answer).replace(f") to {name},", "),")  # only another is named
        seq = answer.header.seq if answer.header is not None else 0
        asked, before = self.wire.recording.request(seq) or name, self.wire.recording.before(seq)
        when = f" at t {answer.header.time_us}" if " for t " in asked and answer.header else ""
        fail(f"{asked} was answered{when} by {got}, not by {reply.TYPE.name}; {before}")

    def refused(
        self,
        message: m.Message,
        code: m.ErrorCode,
        detail: int | None = None,
        **header: Any,
    ) -> m.Error:
        """Send a request and return the ERROR; FAILED unless it has this code and detail."""
        return self.refused_raw(message.TYPE, message.serialize(), code, detail, **header)

    def refused_raw(
        self,
        kind: int,
        payload: bytes,
        code: m.ErrorCode,
        detail: int | None = None,
        **header: Any,
    ) -> m.Error:
        """Send any request and return the ERROR; FAILED unless it has this code and detail."""
        return self.error_in(self.ask_raw(kind, payload, **header), kind, code, detail)

    def refused_as_used(self, message: m.Message, seq: int | None = None) -> None:
        """FAILED unless a request with a used number, or the last one, gets SEQUENCE_REUSED."""
        used, flags = (self.seq if seq is None else seq) & 0xFFFF, flags_at_once(message)
        self.refused(message, m.ErrorCode.SEQUENCE_REUSED, used, seq=used, flags=flags)

    def error_in(
        self, answer: ReceivedByClient, kind: int, code: m.ErrorCode, detail: int | None = None
    ) -> m.Error:
        """Return the ERROR in *answer*; FAILED unless it has this code and detail."""
        wanted = f"ERROR({code.name})" + ("" if detail is None else f", detail {detail:#x}")
        message, seq = answer.message, answer.header.seq if answer.header is not None else 0
        is_due = isinstance(message, m.Error) and (message.request, message.code) == (kind, code)
        if isinstance(message, m.Error) and is_due and detail in (None, message.detail):
            return message
        name = self.wire.recording.request(seq) or annotated_type_name(kind)
        fail(f"{name} should be refused with {wanted}; got {self.answer_text(answer)}")

    @staticmethod
    def answer_text(answer: ReceivedByClient) -> str:
        """Return an answer in words."""
        if answer.message is None:
            return answer.fault or "nothing"
        if isinstance(answer.message, m.Error):
            request, detail = annotated_type_name(answer.message.request), answer.message.detail
            state = {s.value: f" ({s.name})" for s in OutputState}.get(detail, "")
            told = state if answer.message.code == m.ErrorCode.BAD_STATE else ""
            return f"{error_name(answer.message)} to {request}, detail {detail:#x}{told}"
        return message_text(answer.message)

    # --- received frames -----------------------------------------------------------------------

    def mark(self) -> int:
        """Return the number of the next piece to come, for ``since`` in the methods below."""
        return len(self.wire.received)

    def barrier(self) -> None:
        """Wait until the board has read everything sent so far: frames are taken in order."""
        echo = self.random.getrandbits(_ECHO_BITS)
        got = self.call(m.Ping(echo), m.Pong).echo
        check_equal(got, echo, f"PONG carries {got:016x}, not the number of PING")

    def events(self, kind: type[_M], since: int = 0) -> list[tuple[m.Header, _M]]:
        """Return the events of one kind from piece *since* on, with their headers."""
        return [
            (piece.header, piece.message)
            for piece in self.wire.received[since:]
            if piece.header is not None and isinstance(piece.message, kind)
        ]

    def responses(self, since: int) -> list[ReceivedByClient]:
        """Return the responses from piece *since* on, but for those of :meth:`send` itself."""
        pauses = set(map(id, self._answers_of_pauses))
        pieces = self.wire.received[since:]
        return [piece for piece in pieces if piece.is_response and id(piece) not in pauses]

    def check_answered(self, seq: int, text: str, *wires: bytes) -> None:
        """Send *wires*; FAILED with *text* unless the request *seq* among them is answered."""
        since = self.mark()
        self.send(*wires)
        if self.try_answer(seq, since) is None:
            fail(text)

    def unanswered(self, frames: str, *wires: bytes) -> None:
        """Send *wires*, called *frames* in the message; FAILED if the board answers them."""
        since = self.mark()
        self.send(*wires)
        self.barrier()
        answers = self.responses(since)[:-1]  # the last one is the barrier's
        check(
            not answers,
            f"{frames} is answered by {self.answer_text(answers[0]) if answers else ''}",
        )

    def await_event(
        self, kind: type[_M], since: int, timeout_us: int
    ) -> tuple[m.Header, _M] | None:
        """Return the first event of a kind from piece *since* on; None if none comes in time."""
        timeout_us += 2 * self.wire.limits.slack_us
        found = self.wire.wait_for(lambda piece: isinstance(piece.message, kind), since, timeout_us)
        if found is None or found.header is None or not isinstance(found.message, kind):
            return None
        return found.header, found.message


def _frame_header(wire: bytes) -> m.Header | None:
    """Return the header of an encoded frame; None if the bytes are no valid frame."""
    try:
        return m.Header.of_body(decoded_frame(wire.strip(DELIMITER)))
    except RemoteProtocolError:
        return None


def _ordered_request_seq(wire: bytes) -> int | None:
    """Return the number of an encoded request; None for MUTE, which overtakes, and no request."""
    header = _frame_header(wire)
    if header is None or header.type not in m.REQUEST_RANGE or header.type == m.Mute.TYPE:
        return None
    return header.seq

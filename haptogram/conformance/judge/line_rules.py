"""Rules of the bytes that a board sends: every frame as it stands on the line.

A receiver has to forgive what no sender may do: a delimiter that two frames share, a spare code
byte, bytes between frames.  Here nothing is forgiven.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.annotation.frames import annotated_frame_text
from haptogram_protocol.cobs import cobs_encode
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import DELIMITER, HEADER_BYTES, MAX_ENCODED_BYTES

from ..client.wire import ReceivedByClient, decoded_frame
from ..outcome import check

TRACES: Final = (m.Trace, m.TracePlayback, m.TraceDrive)
_LATE: Final = int(m.Flag.LATE)  # an operation on a flag takes microseconds
_SHORTEST_TEXT: Final = 8
_PROMPT_US: Final = 10_000  # HG-4.11/3
_ERROR_CODES: Final = frozenset(int(code) for code in m.ErrorCode)
#: Clauses that a piece which is no frame breaks, by its defect.
_DAMAGED: Final = {"cobs": "HG-2.2/1", "crc": "HG-2.4/1", "short": "HG-3.1/1"}

#: Finding about a frame by clause; an empty text: the clause is met.
Broken: TypeAlias = Iterator[tuple[str, str]]


class LineRules:
    """Judges every piece that comes, whatever it holds.

    Parameters
    ----------
    is_lossless : bool
        Whether the line can neither lose nor change a byte.
    """

    def __init__(self, *, is_lossless: bool) -> None:
        self._is_lossless = is_lossless
        self.begin_board()

    def begin_board(self, line_us: Callable[[int], int] | None = None) -> None:
        """Note that a board has started, or its port was opened; bytes take *line_us* there."""
        self._line_us = line_us
        self._alone: tuple[tuple[int, int], int, int] | None = None  # request, time, size
        self._sessions: tuple[int, ...] = ()  # the open one, then the one before
        self._minor = 0  # of the board's version
        self._was_frame = False
        self._begun = b""
        self._asked: Counter[tuple[int, int]] = Counter()  # requests, by their type and number
        self._open = 0  # of them that wait for an answer

    # --- What is sent ----------------------------------------------------------------------------

    def take_sent(self, data: bytes, t_us: int = 0) -> None:
        """Note bytes that are sent: each request in them has one answer."""
        waits = self._open > 0
        self._alone = None
        *ended, rest = (self._begun + data).split(DELIMITER)
        self._begun = rest[: MAX_ENCODED_BYTES + 1]
        for piece in ended:
            if len(piece) <= MAX_ENCODED_BYTES and piece[1:2] and piece[1] in m.REQUEST_RANGE:
                with contextlib.suppress(RemoteProtocolError):  # nobody answers a damaged frame
                    header = m.Header.of_body(decoded_frame(piece))
                    self._asked[header.type, header.seq] += 1
                    self._open += self._asked[header.type, header.seq] > 0
                    if not (waits or self._begun) and len(data) == len(piece) + 2:
                        self._alone = (header.type, header.seq), t_us, len(data)

    def _extra_bytes(self, piece: ReceivedByClient) -> str:
        """Return a text on bytes after the last field; '' for none, or in a later minor version."""
        if piece.message is None or piece.message.TAIL or self._minor > m.VERSION_MINOR:
            return ""
        size = len(piece.body) - HEADER_BYTES - piece.message.LAYOUT.size
        return f"{size} bytes behind the last field of {piece.message.TYPE.name}" if size else ""

    # --- What comes ------------------------------------------------------------------------------

    def broken_by(self, piece: ReceivedByClient) -> Broken:
        """Yield the clauses that a piece is judged by, each with what breaks it."""
        header, was_frame = piece.header, self._was_frame
        self._was_frame = header is not None
        if (
            isinstance(piece.message, m.HelloReply)
            and piece.message.nonce not in self._sessions[:1]
        ):
            self._sessions = (piece.message.nonce, *self._sessions[:1])
            self._minor = piece.message.minor
        if not self._sessions:
            return  # nobody has answered HELLO: this may be no board
        if header is None:
            yield from self._broken_by_junk(piece)
            return
        shared = piece.shared and was_frame
        yield "HG-2.1/1", "this frame shares a zero with the one before" if shared else ""
        # Only a code byte 1 after a full block, at the end, can be left out.
        is_odd = piece.piece.endswith(b"\x01") and piece.piece != cobs_encode(piece.unstuffed)
        yield "HG-2.2/1", "this frame is stuffed in another way" if is_odd else ""
        yield "HG-2.4/1", ""  # or it would be no frame
        size = len(piece.piece)
        yield "HG-2.6/1", f"{size} bytes between delimiters" if size > MAX_ENCODED_BYTES else ""
        is_of_host = not (piece.is_response or piece.is_event)
        yield "HG-3.1/1", "the board sends a frame of the host" if is_of_host else ""
        yield "HG-3.2/3", piece.fault if piece.reason == "bad_length" else self._extra_bytes(piece)
        allowed = _LATE if isinstance(piece.message, TRACES) else 0
        wrong = header.flags & ~allowed
        yield "HG-3.4/3", f"flags {wrong:#04x} have no meaning here" if wrong else ""
        yield "HG-11.5/2", _unnamed_in_frame(piece)
        yield from self._broken_by_session(piece, header)
        if piece.is_response:
            yield "HG-4.11/1", self._unmatched_response(piece, header)
            yield from self._late_answer(piece, header)
        self._alone = None

    def _broken_by_junk(self, piece: ReceivedByClient) -> Broken:
        """Yield the clause that bytes that are no frame break, and a text.

        On a lossy line only readable text breaks one: 8 or more printable ASCII characters.
        """
        is_text = len(piece.piece) >= _SHORTEST_TEXT and piece.piece.isascii()
        is_text = is_text and piece.piece.decode("ascii").strip().isprintable()
        if self._is_lossless or is_text:
            text = f"{len(piece.piece)} bytes that are no frame: {piece.fault}"
            yield _DAMAGED.get(piece.reason, "HG-2.2/1"), text

    def _broken_by_session(self, piece: ReceivedByClient, header: m.Header) -> Broken:
        """Yield HG-3.7/1, with a text if a frame is not of the open session, else ''.

        An event may be of the session before.
        """
        due = self._sessions if piece.is_event else self._sessions[:1]
        error = piece.message
        if isinstance(error, m.Error) and error.code == m.ErrorCode.STALE_SESSION:
            due = (0,)  # HG-4.12/1
        text = f"the session is {header.session:#06x}, due is {due[0]:#06x}"
        yield "HG-3.7/1", text if header.session not in due else ""

    def _unmatched_response(self, piece: ReceivedByClient, header: m.Header) -> str:
        """Return a text if a response answers no open request, else ''."""
        if piece.message is None:
            return ""
        kind = header.type - m.RESPONSE_OFFSET
        if isinstance(piece.message, m.Error):
            kind = piece.message.request
        asked = kind, header.seq
        if asked not in self._asked:
            return f"no request of the type {kind:#04x} has the number {header.seq}"
        self._open -= self._asked[asked] > 0
        self._asked[asked] -= 1
        return "this request was answered before" if self._asked[asked] < 0 else ""

    def _late_answer(self, piece: ReceivedByClient, header: m.Header) -> Broken:
        """Yield HG-4.11/3, broken if a request sent alone is answered after more than 10 ms.

        Nothing for other requests, nor on a lossy line. Time on the line is not counted.
        """
        alone, line_us = self._alone, self._line_us
        if not (self._is_lossless and alone and line_us and header.seq == alone[0][1]):
            return
        took_us = piece.t_us - alone[1] - line_us(alone[2] + len(piece.piece) + 2)
        text = f"the answer begins {took_us / 1000:.1f} ms after its request; due is 10 ms at most"
        yield "HG-4.11/3", text if took_us > _PROMPT_US else ""


def judge_line_rule(pieces: Iterable[ReceivedByClient], clause: str) -> None:
    """FAILED if one of *pieces* breaks the rule of *clause*; the first one answers HELLO."""
    rules = LineRules(is_lossless=True)
    for piece in pieces:
        texts = (text for of, text in rules.broken_by(piece) if of == clause)
        check(not (text := "".join(texts)), f"{text}: {annotated_frame_text(piece.piece)}")


def _unnamed_in_frame(piece: ReceivedByClient) -> str:
    """Return which type, value, code or bit of a frame is in no table, '' if all are."""
    if piece.reason in ("unknown_type", "bad_value"):
        return piece.fault
    message = piece.message
    if isinstance(message, m.Error) and message.code not in _ERROR_CODES:
        return f"error code {message.code} is in no table"
    if isinstance(message, m.TraceReply):
        spare = [record.flags for record in message.records if record.flags & ~_LATE]
        return f"flags {spare[0]:#04x} of a latch in the ring" if spare else ""
    return ""

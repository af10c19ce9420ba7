"""The bytes that a case exchanged, and their meaning in words."""

from __future__ import annotations

import enum
import itertools
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.annotation.frames import (
    Annotated,
    annotated_frame,
    annotated_frame_text,
    annotated_message_text,
    annotated_type_name,
)
from haptogram_protocol.framing import DELIMITER

_KEPT_TRANSFERS: Final = 200  # transfers kept from the beginning of a case, and from its end
_SHOWN_BYTES: Final = 96  # bytes that are shown of one transfer
_PER_LINE: Final = 32
_ALWAYS_US: Final = 1 << 63
_TOLD_BEFORE: Final = 4  # frames, of those before one
_TOLD_NUMBERS: Final = 12  # listed numbers of stream frames that are in no order
_TOLD_FIELDS: Final = 100  # characters of a message


class TransferDirection(enum.StrEnum):
    """Sender of bytes."""

    HOST = "host "
    BOARD = "board"


@dataclass(slots=True)
class Transfer:
    """Bytes that one write or one read transferred."""

    t_us: int
    direction: TransferDirection
    data: bytes


class DialogueRecording:
    """Keeps the first and the last transfers, in bounded memory."""

    def __init__(self) -> None:
        self._first: list[Transfer] = []
        self._last: deque[Transfer] = deque(maxlen=_KEPT_TRANSFERS)
        self._dropped = 0

    def add(self, t_us: int, direction: TransferDirection, data: bytes) -> None:
        """Keep a transfer."""
        transfer = Transfer(t_us, direction, bytes(data))
        if len(self._first) < _KEPT_TRANSFERS:
            self._first.append(transfer)
            return
        self._dropped += len(self._last) == _KEPT_TRANSFERS
        self._last.append(transfer)

    def transcript(self) -> tuple[str, ...]:
        """Return the transfers as lines: time, sender, hex, and the frames inside."""
        if not self._first:
            return ()
        start_us = self._first[0].t_us
        lines = _client_transcript_lines(self._first, start_us)
        if self._dropped:
            lines.append(f"... {self._dropped} transfers left out ...")
            return (*lines, *_client_transcript_lines(self._last, start_us))
        return tuple(_client_transcript_lines([*self._first, *self._last], start_us))

    def request(self, seq: int) -> str:
        """Return the host's last request with the number *seq* in words; empty if none is kept."""
        sent = [frame for frame in self._frames(TransferDirection.HOST) if _seq_of(frame) == seq]
        found = sent[-1] if sent else None
        if found is None or found.message is None:
            return found.name if found is not None else ""
        header = found.header
        has_time = header is not None and header.time_us and not header.flags & m.Flag.IMMEDIATE
        return message_text(found.message) + (
            f" for t {header.time_us}" if header is not None and has_time else ""
        )

    def before(self, seq: int) -> str:
        """Return in words what the host sent before its last request *seq*, with the answers."""
        sent = list(self._frames(TransferDirection.HOST))
        places = (place for place, frame in enumerate(sent) if _seq_of(frame) == seq)
        return f"sent before: {self._sent_text(sent[: max(places, default=0)])}"

    def between(self, from_us: int, until_us: int) -> str:
        """Return in words what the host sent last between two times, with the answers."""
        sent = self._frames(TransferDirection.HOST, from_us, until_us)
        return f"sent between: {self._sent_text(list(sent))}"

    def _sent_text(self, sent: Sequence[Annotated]) -> str:
        """Return the frames *sent* as text, in order; "nothing" if there are none.

        Each has its answer, if no other frame sent has its number. Equal neighbours are shown as
        one with their count; only the last 4 of these groups are shown.
        """
        answers: dict[int | None, str] = {
            frame.header.seq: _answer_name(frame)
            for frame in self._frames(TransferDirection.BOARD)
            if frame.header is not None and frame.header.type in m.RESPONSE_RANGE
        }

        times = Counter(map(_seq_of, self._frames(TransferDirection.HOST)))

        def text_of(frame: Annotated) -> str:
            answer = answers.get(_seq_of(frame)) if times[_seq_of(frame)] == 1 else None
            return " -> ".join(filter(None, (_sent_name(frame), answer)))

        runs = [(text, list(run)) for text, run in itertools.groupby(sent, text_of)]
        told = (
            (text if len(run) == 1 else f"{len(run)} x {text}") + _stream_numbers(run)
            for text, run in runs[-_TOLD_BEFORE:]
        )
        return ", ".join(told) or "nothing"

    def _frames(
        self, sender: TransferDirection, from_us: int = 0, until_us: int = _ALWAYS_US
    ) -> Iterator[Annotated]:
        """Yield the frames of *sender* recorded from *from_us* to *until_us*, ends included."""
        for transfer, pieces in _client_pieces([*self._first, *self._last]):
            if transfer.direction is sender and from_us <= transfer.t_us <= until_us:
                yield from map(annotated_frame, pieces)


def counter_steps(before: m.Counters, after: m.Counters) -> dict[str, int]:
    """Return by how much every counter grew."""
    return {
        name: (getattr(after, name) - getattr(before, name)) & 0xFFFFFFFF
        for name in m.Counters.WIRE
    }


def moved_counters_text(before: m.Counters, after: m.Counters) -> str:
    """Return the counters that grew, and by how much."""
    steps = counter_steps(before, after)
    return ", ".join(f"{name} {step}" for name, step in steps.items() if step) or "nothing"


def message_text(message: m.Message) -> str:
    """Return the type and the first fields of a message."""
    name, text = annotated_type_name(message.TYPE), annotated_message_text(message)
    cut = text if len(text) <= _TOLD_FIELDS else f"{text[:_TOLD_FIELDS].rpartition(',')[0]}, ..."
    return f"{name} ({cut})" if message.serialize() else name


def error_name(error: m.Error) -> str:
    """Return an ERROR with the name of its code."""
    known = m.ErrorCode._value2member_map_.get(error.code)
    return f"ERROR({getattr(known, 'name', error.code)})"


def _answer_name(frame: Annotated) -> str:
    """Return the name of a response, or of the code of an ERROR."""
    return error_name(frame.message) if isinstance(frame.message, m.Error) else frame.name


def _sent_name(frame: Annotated) -> str:
    """Return the name of a sent frame, with IMMEDIATE if so flagged.

    If its bytes cannot be decoded: why not.
    """
    if frame.header is None:
        return frame.text
    return frame.name + " IMMEDIATE" * bool(frame.header.flags & m.Flag.IMMEDIATE)


def _stream_numbers(run: Sequence[Annotated]) -> str:
    """Return the numbers and due times of equal stream frames as text, '' for other frames."""
    headers = [h for frame in run if (h := frame.header) is not None and h.type in m.STREAM_RANGE]
    if not headers:
        return ""
    numbers, times = [h.seq for h in headers], [h.time_us for h in headers]
    in_turn = all((two - one) & 0xFFFF == 1 for one, two in itertools.pairwise(numbers))
    text = " " + (_span_text(numbers) if in_turn else ", ".join(map(str, numbers[:_TOLD_NUMBERS])))
    return text if headers[0].flags & m.Flag.IMMEDIATE else f"{text} for t {_span_text(times)}"


def _span_text(numbers: Sequence[int]) -> str:
    """Return the first and the last number as "A to B", or as one number if they are equal."""
    return " to ".join(map(str, dict.fromkeys([numbers[0], numbers[-1]])))


def _seq_of(frame: Annotated) -> int | None:
    """Return the sequence number of a request; None for any other frame."""
    is_request = frame.header is not None and frame.header.type in m.REQUEST_RANGE
    return frame.header.seq if frame.header is not None and is_request else None


def _client_pieces(transfers: Iterable[Transfer]) -> Iterator[tuple[Transfer, list[bytes]]]:
    """Yield each transfer with the non-empty pieces between zero bytes that end in it."""
    partial = dict.fromkeys(TransferDirection, b"")
    for transfer in transfers:
        *ended, partial[transfer.direction] = (partial[transfer.direction] + transfer.data).split(
            DELIMITER
        )
        yield transfer, [piece for piece in ended if piece]


def _client_transcript_lines(transfers: Iterable[Transfer], start_us: int) -> list[str]:
    """Format transfers as lines, timed from *start_us*; each frame follows its last byte."""
    return [
        line
        for transfer, pieces in _client_pieces(transfers)
        for line in _client_transcript_lines_of(transfer, start_us, pieces)
    ]


def _client_transcript_lines_of(
    transfer: Transfer, start_us: int, pieces: list[bytes]
) -> list[str]:
    """Return the lines of a transfer: time since *start_us*, sender, bytes, *pieces* as frames."""
    head = f"{(transfer.t_us - start_us) / 1e6:+11.6f} s {transfer.direction.value} "
    shown = transfer.data[:_SHOWN_BYTES]
    rows = [shown[start : start + _PER_LINE].hex(" ") for start in range(0, len(shown), _PER_LINE)]
    if len(transfer.data) > _SHOWN_BYTES:
        rows[-1] += f" ... ({len(transfer.data)} bytes)"
    indent = " " * len(head)
    texts = [(head if number == 0 else indent) + row for number, row in enumerate(rows)]
    return texts + [f"{indent}= {annotated_frame_text(piece)}" for piece in pieces]

"""The bytes that a case exchanged, and their meaning in words."""

from __future__ import annotations

import enum
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from haptogram_protocol.annotation.frames import annotated_frame_text
from haptogram_protocol.framing import DELIMITER

_KEPT_TRANSFERS: Final = 200  # from the beginning of a case, and as many from its end
_SHOWN_BYTES: Final = 96  # of one transfer
_PER_LINE: Final = 32


class TransferDirection(enum.StrEnum):
    """Sender of bytes."""

    HOST = "host "
    BOARD = "board"


@dataclass(frozen=True, slots=True)
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


def _client_transcript_lines(transfers: Iterable[Transfer], start_us: int) -> list[str]:
    """Return transfers as lines; a frame is described behind its last byte."""
    partial = dict.fromkeys(TransferDirection, b"")
    lines = []
    for transfer in transfers:
        *ended, rest = (partial[transfer.direction] + transfer.data).split(DELIMITER)
        partial[transfer.direction] = rest
        lines += _client_transcript_lines_of(
            transfer, start_us, [piece for piece in ended if piece]
        )
    return lines


def _client_transcript_lines_of(
    transfer: Transfer, start_us: int, pieces: list[bytes]
) -> list[str]:
    head = f"{(transfer.t_us - start_us) / 1e6:+11.6f} s {transfer.direction.value} "
    shown = transfer.data[:_SHOWN_BYTES]
    rows = [shown[start : start + _PER_LINE].hex(" ") for start in range(0, len(shown), _PER_LINE)]
    if len(transfer.data) > _SHOWN_BYTES:
        rows[-1] += f" ... ({len(transfer.data)} bytes)"
    indent = " " * len(head)
    texts = [(head if number == 0 else indent) + row for number, row in enumerate(rows)]
    return texts + [f"{indent}= {annotated_frame_text(piece)}" for piece in pieces]

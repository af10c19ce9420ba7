"""The drives that a host has sent in a run, by session and number of their frames."""

from __future__ import annotations

import contextlib
from collections import defaultdict, deque
from typing import Final, TypeAlias

from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import DELIMITER, MAX_ENCODED_BYTES, decode_frame
from haptogram_protocol.messages import FIRST_STREAM_SEQ, STREAM_RANGE, drive_codes, parse_body

#: Phase codes and amplitude codes of all transducers, in registers of 8 bits.
Codes: TypeAlias = tuple[bytes, bytes]

_KEPT: Final = 4096  # stream frames


class SentDrives:
    """Codes of the stream frames that a host has sent.

    Frames are decoded when a board tells of a latch: most runs of frames are never asked for.
    """

    def __init__(self) -> None:
        self._pieces: deque[bytes] = deque(maxlen=_KEPT)
        self._begun = b""
        self._codes: defaultdict[tuple[int, int], list[Codes | None]] = defaultdict(list)

    def forget(self) -> None:
        """Forget all frames: another board answers now."""
        self._pieces.clear()
        self._codes.clear()
        self._begun = b""

    def take(self, data: bytes) -> None:
        """Note bytes that are sent."""
        *ended, rest = data.split(DELIMITER)
        if ended:
            ended[0] = self._begun + ended[0]
            self._begun = b""
        self._begun = (self._begun + rest)[: MAX_ENCODED_BYTES + 1]
        self._pieces += (piece for piece in ended if piece[1:2] and piece[1] in STREAM_RANGE)

    def codes_of(self, session: int, index: int, transducers: int) -> list[Codes]:
        """Return the codes of every frame that was sent with the unwrapped number *index*.

        Empty if there is none, and where the board computes the drive of one of them.
        """
        while self._pieces:
            self._decode(self._pieces.popleft(), transducers)
        found = self._codes.get((session, index & 0xFFFF), [])
        known = [codes for codes in found if codes is not None]
        return known if index >= FIRST_STREAM_SEQ and len(known) == len(found) else []

    def _decode(self, piece: bytes, transducers: int) -> None:
        """Keep the codes of a frame, unless it is damaged or has a wrong length."""
        with contextlib.suppress(RemoteProtocolError):
            header, message = parse_body(decode_frame(piece))
            codes = drive_codes(message, transducers)
            if len(self._codes) >= _KEPT:
                self._codes.clear()
            self._codes[header.session, header.seq].append(codes)

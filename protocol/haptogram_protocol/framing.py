"""Bytes on the line: COBS, CRC-32 and a bounded decoder.  SPEC.md chapter 2.

A frame travels as ``00 COBS(body | CRC-32(body)) 00``.  COBS leaves no zero inside, so a zero
always ends a frame: whatever was damaged, the receiver finds the next frame but one.
"""

from __future__ import annotations

from typing import Final
from zlib import crc32

from .cobs import BLOCK, PURE_PYTHON, Cobs, Stuffing, cobs_decode, cobs_encode
from .errors import LocalProtocolError, RemoteProtocolError

DELIMITER: Final = b"\x00"  # HG-2.1
CRC_BYTES: Final = 4  # HG-2.4
HEADER_BYTES: Final = 10  # HG-3.1
MAX_ENCODED_BYTES: Final = 4096  # HG-2.6: between two delimiters, whatever the size of the array
MAX_BODY_BYTES: Final = MAX_ENCODED_BYTES - CRC_BYTES - (MAX_ENCODED_BYTES // BLOCK + 1)
_SHORTEST: Final = HEADER_BYTES + CRC_BYTES
_CRC_OF_ALL: Final = 0x2144DF1C  # CRC-32 of anything with its own CRC-32 after it

# One error for all noise; it is compared and never raised.
_NOT_COBS: Final = RemoteProtocolError("a COBS code byte points past the end", reason="cobs")


def encode_frame(body: bytes, stuff: Stuffing = cobs_encode) -> bytes:
    """Return the bytes of one frame on the line.  HG-2.1 to HG-2.6.

    Parameters
    ----------
    body : bytes
        Header and payload.
    stuff : callable
        COBS encoder; :func:`.cobs.fastest_cobs` gives a compiled one.

    Returns
    -------
    bytes
        Delimiter, COBS of *body* and its CRC-32, delimiter.

    Raises
    ------
    LocalProtocolError
        If *body* is longer than :data:`MAX_BODY_BYTES`.
    """
    if len(body) > MAX_BODY_BYTES:
        raise LocalProtocolError(f"frame body of {len(body)} bytes; the limit is {MAX_BODY_BYTES}")
    crc = crc32(body).to_bytes(CRC_BYTES, "little")
    return DELIMITER + stuff(body + crc) + DELIMITER


def decode_frame(encoded: bytes, unstuff: Stuffing = cobs_decode) -> bytes:
    """Return the body of one frame: header and payload.

    Parameters
    ----------
    encoded : bytes
        Bytes between two delimiters.
    unstuff : callable
        COBS decoder.

    Raises
    ------
    RemoteProtocolError
        With the reason ``cobs``, ``short`` or ``crc``.
    """
    decoded = unstuff(encoded)
    if crc32(decoded) == _CRC_OF_ALL and len(decoded) >= _SHORTEST:
        return decoded[:-CRC_BYTES]
    raise _framing_damage(decoded)


def _framing_damage(decoded: bytes) -> RemoteProtocolError:
    """Return the error for a decoded frame of less than 14 bytes, or with a wrong CRC."""
    if len(decoded) < _SHORTEST:
        return RemoteProtocolError(
            f"frame of {len(decoded)} bytes; header and CRC-32 need {_SHORTEST}",
            reason="short",
        )
    right, crc = crc32(decoded[:-CRC_BYTES]), int.from_bytes(decoded[-CRC_BYTES:], "little")
    return RemoteProtocolError(
        f"CRC-32 of the frame is {right:08x}, not {crc:08x} as sent", reason="crc"
    )


def end_of_frame(data: bytes, at: int) -> int:
    """Return the index after the next delimiter of *data* from *at* on, or its length."""
    found = data.find(DELIMITER, at)
    return len(data) if found < 0 else found + 1


class FrameDecoder:
    """Cut a stream of bytes into frames, in bounded memory.

    The decoder keeps at most :data:`MAX_ENCODED_BYTES` between two calls. It discards a longer run
    without a delimiter up to the next delimiter, and reports the run once (HG-2.6).

    Parameters
    ----------
    cobs : Cobs
        COBS decoder; :func:`.cobs.fastest_cobs` gives a compiled one.
    """

    def __init__(self, cobs: Cobs = PURE_PYTHON) -> None:
        self._unstuff, self._refusal = cobs.decode, cobs.refusal
        self._partial = b""
        self._discarding = False

    @property
    def buffered(self) -> int:
        """Number of bytes kept for a frame whose end has not come yet."""
        return len(self._partial)

    def reset(self) -> None:
        """Forget a partial frame (the port was closed and opened again)."""
        self._partial = b""
        self._discarding = False

    def feed(self, chunk: bytes) -> list[bytes | RemoteProtocolError]:
        """Return, in order, a body for every whole frame and an error for every damaged one.

        Parameters
        ----------
        chunk : bytes
            Any number of bytes; frames may begin and end anywhere in them.

        Returns
        -------
        list of bytes or RemoteProtocolError
            An error is returned, not raised: its ``reason`` is ``crc``, ``cobs``, ``short`` or
            ``oversize``.
        """
        *ended, rest = (self._partial + chunk).split(DELIMITER)
        if ended and self._discarding:  # reported when the limit was passed
            self._discarding = False
            del ended[0]
        # HG-2.3: two delimiters without a byte between them are neither frame nor error
        decode = self._decode
        found = [decode(encoded) for encoded in ended if encoded]
        if not self._discarding and len(rest) > MAX_ENCODED_BYTES:
            self._discarding = True
            found.append(_oversized_frame())
        self._partial = b"" if self._discarding else rest
        return found

    def _decode(self, encoded: bytes) -> bytes | RemoteProtocolError:
        """Return the body of an encoded frame, or the error of it."""
        # Errors are not raised here: a traceback would hold the caller's frame, which holds the
        # list, which holds the error. Every damaged frame would be a cycle, in processes that
        # switch the cycle collector off. Raising also takes longer than decoding a frame.
        size = len(encoded)
        if encoded[0] > size:  # the first byte gives most noise away
            return _NOT_COBS
        if size > MAX_ENCODED_BYTES:
            return _oversized_frame()
        try:
            decoded = self._unstuff(encoded)
        except self._refusal:
            return _NOT_COBS
        if crc32(decoded) == _CRC_OF_ALL and size > _SHORTEST:  # COBS adds a byte
            return decoded[:-CRC_BYTES]
        return _framing_damage(decoded)


def _oversized_frame() -> RemoteProtocolError:
    """Return the error for a run of more than 4096 bytes without a delimiter."""
    return RemoteProtocolError(
        f"more than {MAX_ENCODED_BYTES} bytes without a delimiter", reason="oversize"
    )

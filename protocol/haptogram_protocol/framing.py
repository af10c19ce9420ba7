"""Bytes on the line: COBS, CRC-32 and a bounded decoder.  SPEC.md chapter 2.

A frame travels as ``00 COBS(body | CRC-32(body)) 00``.  Consistent Overhead Byte Stuffing (Cheshire
and Baker, IEEE/ACM Trans. Networking 7(2), 1999) leaves no zero inside, so a zero always ends a
frame and the receiver is in step again after one frame at the most, whatever was damaged.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

from .errors import LocalProtocolError, RemoteProtocolError

DELIMITER: Final = b"\x00"  # HG-2.1
CRC_BYTES: Final = 4  # HG-2.4
HEADER_BYTES: Final = 10  # HG-3.1
MAX_ENCODED_BYTES: Final = 4096  # HG-2.6: between two delimiters, whatever the size of the array
_BLOCK: Final = 254  # longest run of non-zero bytes under one COBS code byte
_FULL: Final = 0xFF  # code byte of such a run; no zero is implied after it
MAX_BODY_BYTES: Final = MAX_ENCODED_BYTES - CRC_BYTES - (MAX_ENCODED_BYTES // _BLOCK + 1)

Stuffing: TypeAlias = Callable[[bytes], bytes]

_zeros = re.compile(rb"\x00+").match
_ones = re.compile(rb"\x01+").match


def cobs_encode(data: bytes) -> bytes:
    """Return *data* without zero bytes; one byte longer, and one more per 254 bytes without a zero.

    The work goes by runs, not by bytes: a plane wave or a muted frame (all bytes zero) costs no
    more than noise.
    """
    out = bytearray()
    rest = data + DELIMITER  # the phantom zero that ends the last run
    start, end = 0, len(rest)
    while start < end:
        run = _zeros(rest, start)
        if run:  # each zero is an empty block
            out += b"\x01" * (run.end() - start)
            start = run.end()
            continue
        stop = rest.index(0, start)
        while stop - start >= _BLOCK:
            out.append(_FULL)
            out += rest[start : start + _BLOCK]
            start += _BLOCK
        if start == stop == end - 1:
            break  # a full last block implies no zero, so nothing is left to say
        out.append(stop - start + 1)
        out += rest[start:stop]
        start = stop + 1
    return bytes(out)


def cobs_decode(encoded: bytes) -> bytes:
    """Return the bytes that :func:`cobs_encode` was given.

    Raises
    ------
    RemoteProtocolError
        If a code byte is zero or points past the end (reason ``cobs``).
    """
    out = bytearray()
    start, end = 0, len(encoded)
    zero_due = False  # a block stands for its bytes and a zero, unless it is full or the last one
    while start < end:
        if zero_due:
            out += DELIMITER
        run = _ones(encoded, start)
        if run:  # empty blocks: a zero each, the last one still due
            out += bytes(run.end() - start - 1)
            start, zero_due = run.end(), True
            continue
        code = encoded[start]
        stop = start + code
        if code == 0 or stop > end:
            raise RemoteProtocolError(
                f"COBS code {code} at byte {start} of {end} points past the end", reason="cobs"
            )
        out += encoded[start + 1 : stop]
        start, zero_due = stop, code != _FULL
    return bytes(out)


class Cobs(NamedTuple):
    """An implementation of COBS: both ends of a connection take one, the default or a faster one.

    It must give the same bytes and raise the same errors as :func:`cobs_encode` and
    :func:`cobs_decode`.
    """

    encode: Stuffing = cobs_encode
    decode: Stuffing = cobs_decode


PURE_PYTHON: Final = Cobs()


def encode_frame(body: bytes, stuff: Stuffing = cobs_encode) -> bytes:
    """Return the bytes for the line: both delimiters, COBS of body and CRC-32.  HG-2.1 to HG-2.6.

    Parameters
    ----------
    body : bytes
        Header and payload.
    stuff : callable
        COBS encoder; a compiled one may be passed in.

    Raises
    ------
    LocalProtocolError
        If *body* is longer than :data:`MAX_BODY_BYTES`.
    """
    if len(body) > MAX_BODY_BYTES:
        raise LocalProtocolError(f"frame body of {len(body)} bytes; the limit is {MAX_BODY_BYTES}")
    crc = zlib.crc32(body).to_bytes(CRC_BYTES, "little")
    return DELIMITER + stuff(body + crc) + DELIMITER


def decode_frame(encoded: bytes, unstuff: Stuffing = cobs_decode) -> bytes:
    """Return the body of one frame, given the bytes between two delimiters.

    Raises
    ------
    RemoteProtocolError
        With the reason ``cobs``, ``short`` or ``crc``.
    """
    decoded = unstuff(encoded)
    body, crc = decoded[:-CRC_BYTES], decoded[-CRC_BYTES:]
    if len(body) < HEADER_BYTES:
        raise RemoteProtocolError(
            f"frame of {len(decoded)} bytes; header and CRC take {HEADER_BYTES + CRC_BYTES}",
            reason="short",
        )
    if zlib.crc32(body) != int.from_bytes(crc, "little"):
        raise RemoteProtocolError(
            f"CRC-32 is {zlib.crc32(body):08x}, the frame says {int.from_bytes(crc, 'little'):08x}",
            reason="crc",
        )
    return body


class FrameDecoder:
    """Cut a stream of bytes into frames, in bounded memory.

    At most :data:`MAX_ENCODED_BYTES` are kept between two calls.  A longer run without a delimiter
    is discarded up to the next delimiter and reported once (HG-2.6).
    """

    def __init__(self, unstuff: Stuffing = cobs_decode) -> None:
        self._unstuff = unstuff
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
        """Return, in order, a body for every whole frame and an error for every damaged one."""
        found: list[bytes | RemoteProtocolError] = []
        *ended, rest = chunk.split(DELIMITER)
        for piece in ended:
            encoded, self._partial = self._partial + piece, b""
            if self._discarding:  # reported when the limit was passed
                self._discarding = False
            elif len(encoded) > MAX_ENCODED_BYTES:
                found.append(_oversize())
            elif encoded:  # HG-2.3: nothing between two delimiters is no frame and no error
                found.append(self._decode(encoded))
        if not self._discarding:
            self._partial += rest
            if len(self._partial) > MAX_ENCODED_BYTES:
                self._partial, self._discarding = b"", True
                found.append(_oversize())
        return found

    def _decode(self, encoded: bytes) -> bytes | RemoteProtocolError:
        try:
            return decode_frame(encoded, self._unstuff)
        except RemoteProtocolError as error:
            # Its traceback would hold the caller's frame, and that the list which holds the error:
            # a cycle for every damaged frame, in processes that switch the cycle collector off.
            return error.with_traceback(None)


def _oversize() -> RemoteProtocolError:
    return RemoteProtocolError(
        f"more than {MAX_ENCODED_BYTES} bytes without a delimiter", reason="oversize"
    )

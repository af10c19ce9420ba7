"""Consistent Overhead Byte Stuffing: bytes without a zero among them.  SPEC.md HG-2.2.

Cheshire and Baker, IEEE/ACM Trans. Networking 7(2), 1999. A piece is the run of bytes before a
zero; it travels after its code byte, which is its length and one. A piece of 254 bytes or more
travels in blocks of 254 with the code byte 255, after which no zero is implied.

Plane waves and muted frames are zeros throughout, so the work must not grow with the number of
zeros: few of them are handled piece by piece, many all at once.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

from .errors import RemoteProtocolError

Stuffing: TypeAlias = Callable[[bytes], bytes]

BLOCK: Final = 254  # longest run of non-zero bytes under one code byte
_FULL: Final = 0xFF  # code byte of such a run; no zero is implied after it
_ZERO: Final = b"\x00"
_FEW: Final = 32  # pieces that are done one by one sooner than all at once
_CODES: Final = [bytes([length + 1]) for length in range(BLOCK + 1)]  # by the length of the piece
_NON_ZERO: Final = bytes([0]) + bytes([0xFF]) * 255  # translates a byte to a mask of its bits
_ONES: Final = int.from_bytes(b"\x01" * BLOCK, "little")
_EMPTY_PIECES: Final = b"\x01" * 8  # that many are decoded faster at once than one by one
_runs_of_empty_pieces = re.compile(rb"\x01{8,}").finditer


# --- Encoder ------------------------------------------------------------------------------------


def cobs_encode(data: bytes) -> bytes:
    """Return *data* in COBS, without zero bytes.

    The result is one byte longer than *data*, and one more per 254 bytes without a zero. The time
    depends on the length, and hardly on the content.

    Parameters
    ----------
    data : bytes
        Any bytes.

    Returns
    -------
    bytes
        Encoded bytes without delimiters.
    """
    return _cobs_piece_by_piece(data) if data.count(0) <= _FEW else _cobs_all_at_once(data)


def _cobs_piece_by_piece(data: bytes) -> bytes:
    """Encode as COBS each piece between zeros; the quicker way up to 32 zeros."""
    pieces = data.split(_ZERO)
    out = b"".join([_CODES[len(p)] + p if len(p) < BLOCK else _cobs_blocks(p) for p in pieces])
    # A full block at the very end implies no zero, so no code byte follows it.
    last = len(pieces[-1])
    return out[:-1] if last and last % BLOCK == 0 else out


def _cobs_blocks(piece: bytes) -> bytes:
    """Return bytes without a zero as COBS blocks of up to 254, a code byte before each."""
    whole = len(piece) - len(piece) % BLOCK
    full = [_CODES[BLOCK] + piece[at : at + BLOCK] for at in range(0, whole, BLOCK)]
    return b"".join([*full, _CODES[len(piece) - whole], piece[whole:]])


def _cobs_all_at_once(data: bytes) -> bytes:
    """Encode as COBS by arithmetic on long integers; the quicker way beyond 32 zeros."""
    out = []
    rest = data + _ZERO  # the phantom zero that ends the last piece
    start, end = 0, len(rest)
    while start < end:
        stop = rest.rfind(0, start, start + BLOCK) + 1
        if stop:
            out.append(_short_cobs_pieces(rest[start:stop]))
        else:
            stop = start + BLOCK
            out.append(_CODES[BLOCK] + rest[start:stop])
            if stop == end - 1:
                break  # no code byte follows a full block at the end
        start = stop
    return b"".join(out)


def _short_cobs_pieces(chunk: bytes) -> bytes:
    """Return the code of at most 254 bytes that end with a zero.

    It is the chunk with its last zero in front, and in place of every zero the distance to the
    next. Long integers process all bytes at once. The distances are found by doubling: the number
    of non-zero bytes after a place, counted up to 2n, is that up to n, plus that of the place n
    further on if all n are non-zero.
    """
    size = len(chunk)
    moved = _ZERO + chunk[:-1]
    non_zero = int.from_bytes(moved.translate(_NON_ZERO), "little")
    ones = _ONES >> 8 * (BLOCK - size)
    unbroken = non_zero >> 8  # a mask of the places with no zero among the next n
    run = unbroken & ones
    bits = 8  # 8 n
    while unbroken:
        run += run >> bits & unbroken
        unbroken &= unbroken >> bits
        bits *= 2
    distances = (run + ones) & ~non_zero
    return (int.from_bytes(moved, "little") | distances).to_bytes(size, "little")


# --- Decoder ------------------------------------------------------------------------------------


def cobs_decode(encoded: bytes) -> bytes:
    """Return the bytes that :func:`cobs_encode` was given.

    Parameters
    ----------
    encoded : bytes
        Bytes between two delimiters.

    Raises
    ------
    RemoteProtocolError
        If a code byte is zero or points past the end (reason ``cobs``).
    """
    out = bytearray(encoded)  # every code byte becomes the zero before its piece
    without_zero = [0]  # but for the first, and those after a full block
    at = 0
    if _EMPTY_PIECES in encoded:
        for run in _runs_of_empty_pieces(encoded):
            at = _walk_cobs_codes(encoded, at, run.start(), out, without_zero)
            empty = run.end() - at  # unless a piece reaches beyond the run
            if empty > 0:
                out[at : run.end()] = bytes(empty)
                at = run.end()
    _walk_cobs_codes(encoded, at, len(encoded), out, without_zero)
    for place in reversed(without_zero):
        del out[place : place + 1]
    return bytes(out)


def _walk_cobs_codes(
    encoded: bytes, at: int, stop: int, out: bytearray, without_zero: list[int]
) -> int:
    """Decode COBS from *at* to *stop*: put a zero in *out* for each code byte.

    Returns the place of the next code byte. Code bytes that stand for no zero are added to
    *without_zero*. RemoteProtocolError if one points past the end.
    """
    code = 1
    while at < stop:
        code = encoded[at]
        out[at] = 0
        at += code
        if not 0 < code < _FULL:
            if code == 0:
                break
            without_zero.append(at)
    if code == 0 or at > len(encoded):
        raise RemoteProtocolError(
            f"COBS code {code} at byte {at - code} of {len(encoded)} points past the end",
            reason="cobs",
        )
    return at


class Cobs(NamedTuple):
    """An implementation of COBS, for either end of a connection.

    Attributes
    ----------
    encode, decode : callable
        Functions that return the same bytes as :func:`cobs_encode` and :func:`cobs_decode`.
    refusal : type
        Exception of *decode* for bytes, none of them zero, that are not COBS.
    """

    encode: Stuffing = cobs_encode
    decode: Stuffing = cobs_decode
    refusal: type[Exception] = RemoteProtocolError


PURE_PYTHON: Final = Cobs()


def fastest_cobs() -> Cobs:
    """Return COBS in C if the package ``cobs`` brings it, otherwise :data:`PURE_PYTHON`.

    The package ``cobs`` is optional (extra ``fast``); its C extension is compiled when it is
    installed and imports in a millisecond. Without a C compiler the package is pure Python, which
    is no faster than :data:`PURE_PYTHON`.
    """
    try:
        from cobs.cobs import _cobs_ext as in_c
    except ImportError:
        return PURE_PYTHON
    return Cobs(in_c.encode, in_c.decode, in_c.DecodeError)

"""The fastest COBS that is installed, for those who put a connection together.

The package ``cobs`` (extra ``fast``) has it in C, and imports in a millisecond.  It is built where
it is installed; where there is no C compiler it comes in Python, which gains nothing over ours.
"""

from __future__ import annotations

from haptogram_protocol.framing import PURE_PYTHON, Cobs, Stuffing, cobs_decode


def fastest_cobs() -> Cobs:
    """Return COBS in C if it is installed, otherwise in Python; both do the same."""
    try:
        from cobs.cobs import _cobs_ext
    except ImportError:
        return PURE_PYTHON

    in_c: Stuffing = _cobs_ext.decode

    def decode(encoded: bytes) -> bytes:
        try:
            return in_c(encoded)
        except _cobs_ext.DecodeError:
            pass
        return cobs_decode(encoded)  # has the last word: what is refused, and why, is the same

    return Cobs(_cobs_ext.encode, decode)

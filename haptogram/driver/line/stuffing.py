"""The fastest COBS that is installed, for those who put a connection together.

The package ``cobs`` (extra ``fast``) has it in C, and imports in a millisecond.  It is built where
it is installed; where there is no C compiler it comes in Python, which gains nothing over ours.
"""

from __future__ import annotations

from haptogram_protocol.cobs import PURE_PYTHON, Cobs


def fastest_cobs() -> Cobs:
    """Return COBS in C if it is installed, otherwise in Python."""
    try:
        from cobs.cobs import _cobs_ext as in_c
    except ImportError:
        return PURE_PYTHON
    return Cobs(in_c.encode, in_c.decode, in_c.DecodeError)

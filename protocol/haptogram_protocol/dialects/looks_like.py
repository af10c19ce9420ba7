"""Which wire the first bytes of a client look like, for a message to a user who chose another.

The answer is a guess: SonicSurface and Ultraino's SimpleFPGA send the same frames.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from ..framing import FrameDecoder
from .codec import Dialect
from .table import DIALECTS

__all__ = ["HAPTOGRAM", "HTTP2", "LOOKED_AT_BYTES", "looks_like_dialect"]

HAPTOGRAM: Final = "haptogram"
HTTP2: Final = "http/2"  # gRPC, which autd3 36 spoke on the link of "Remote"
LOOKED_AT_BYTES: Final = 4096
_HTTP2_PREFACE: Final = re.compile(rb"PRI \* HTTP/2\.0\r\n")  # RFC 9113, 3.4


def looks_like_dialect(
    data: bytes, dialects: Iterable[Dialect] = DIALECTS.values()
) -> tuple[str, ...]:
    """Return the names of the wires that *data* looks like; none if it looks like none.

    Parameters
    ----------
    data : bytes
        What a client sent; only its first 4096 bytes count.
    dialects : iterable of Dialect
        The dialects in question. Haptogram's own wire and HTTP/2 are looked for in any case.
    """
    start = data[:LOOKED_AT_BYTES]
    names = [dialect.name for dialect in dialects if dialect.signature.search(start)]
    if any(isinstance(body, bytes) for body in FrameDecoder().feed(start)):
        names.append(HAPTOGRAM)
    if _HTTP2_PREFACE.match(start):
        names.append(HTTP2)
    return tuple(names)

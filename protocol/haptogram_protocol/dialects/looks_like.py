"""Which wire the first bytes of a client look like, for a message to a user who chose another.

The answer is a guess: SonicSurface and Ultraino's SimpleFPGA send the same frames.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from ..framing import FrameDecoder
from .codec import Dialect

HAPTOGRAM: Final = "haptogram"
HTTP2: Final = "HTTP/2 (gRPC, as autd3 36 and older)"
AUTD3_SDK: Final = "autd3-sdk"
LOOKED_AT_BYTES: Final = 4096
# Wires that are no dialect here: RFC 9113, 3.4; shinolab/autd3-sdk 110b80c, link-remote/wire.rs
_OTHERS: Final = {HTTP2: b"PRI * HTTP/2.0\r\n", AUTD3_SDK: b"ARMT"}


def looks_like_dialect(data: bytes, dialects: Iterable[Dialect] | None = None) -> tuple[str, ...]:
    """Return the names of the wires that *data* looks like; none if it looks like none.

    Parameters
    ----------
    data : bytes
        Bytes of a client; only the first 4096 count.
    dialects : iterable of Dialect, optional
        The dialects in question, by default all. Haptogram's own wire, HTTP/2 and autd3-sdk are
        looked for in any case.
    """
    from .table import DIALECTS  # which loads every module here

    start = data[:LOOKED_AT_BYTES]
    every = DIALECTS.values() if dialects is None else dialects
    alike = [dialect for dialect in every if dialect.signature.search(start)]
    links = [dialect for dialect in alike if not dialect.bauds]  # a handshake is no chance
    names = [dialect.name for dialect in links or alike]
    if any(isinstance(body, bytes) for body in FrameDecoder().feed(start)):
        names.append(HAPTOGRAM)
    names += [name for name, preface in _OTHERS.items() if start.startswith(preface)]
    return tuple(names)

"""Bytes on a line of a UART, from its edges: 8 data bits, the lowest first, no parity."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from .capture import ChannelEdges

#: Samples in a bit that are needed: with fewer, two samples of jitter move an edge by half a bit.
LEAST_SAMPLES_A_BIT: Final = 4.0
_BITS: Final = 10  # start, data, stop
_STOP: Final = 9.5  # bits from the start edge to the middle of the stop bit


def decoded_uart_bytes(
    edges: ChannelEdges, bit: float
) -> tuple[NDArray[np.uint8], NDArray[np.float64], int]:
    """Return the bytes of a line, when each has ended, and the characters without a stop bit.

    Parameters
    ----------
    edges : ChannelEdges
        The line, high while it idles.
    bit : float
        Ticks of a bit.

    Returns
    -------
    values : (B,) numpy.ndarray of uint8
        The bytes.
    ends : (B,) numpy.ndarray of float
        Tick at which the stop bit of each has ended.
    damaged : int
        Characters whose stop bit is low, which are left out.

    Examples
    --------
    >>> import numpy as np
    >>> from haptogram.evidence.captures.capture import ChannelEdges
    >>> line = ChannelEdges(np.array([100, 110, 120, 170, 180, 190]), True)  # 0x41
    >>> values, ends, damaged = decoded_uart_bytes(line, 10.0)
    >>> values.tolist(), ends.tolist(), damaged
    ([65], [200.0], 0)
    """
    starts = _uart_start_edges(edges, bit)
    samples = starts[:, None] + bit * (np.arange(_BITS - 1) + 1.5)
    levels = edges.levels_at(samples, after=True)
    whole = levels[:, -1]
    values = np.packbits(levels[whole, :-1], axis=1, bitorder="little").ravel()
    return values, starts[whole] + _BITS * bit, int((~whole).sum())


def _uart_start_edges(edges: ChannelEdges, bit: float) -> NDArray[np.float64]:
    """Return the times of falling edges that begin a character, from the first pause on.

    A pause lasts 10 bits, *bit* being the time of one; without a pause, from the first edge on.
    """
    falling = edges.times[int(not edges.first_level) :: 2].astype(np.float64)
    if not len(falling):
        return falling
    # The level before each falling edge is high since the edge before it.
    pauses = np.diff(edges.times, prepend=0)[int(not edges.first_level) :: 2]
    quiet = np.flatnonzero(pauses >= _BITS * bit)
    following = np.searchsorted(falling, falling + _STOP * bit).tolist()
    place = int(quiet[0]) if len(quiet) else 0
    found = []
    while place < len(falling):
        found.append(place)
        place = following[place]
    return falling[found]

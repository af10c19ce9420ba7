"""Levels of the two lines of a UART, from the bytes that they carry."""

from __future__ import annotations

from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray

from .pin_waveforms import Edges

_BITS: Final = 10  # start, eight of data with the lowest first, stop


class UartWaveform:
    """The bytes of one line, each with the time at which its start bit begins.

    Parameters
    ----------
    byte_us : float
        Time of a byte on the line, ten bits.
    """

    def __init__(self, byte_us: float) -> None:
        self._byte_us = byte_us
        self._bursts: list[tuple[float, bytes]] = []

    @property
    def end_us(self) -> float:
        """When the last byte has ended."""
        if not self._bursts:
            return -np.inf
        begin_us, data = self._bursts[-1]
        return begin_us + len(data) * self._byte_us

    def carry(self, begin_us: float, data: bytes) -> None:
        """Put bytes on the line, back to back, from *begin_us* on, after those that it carries."""
        self._bursts.append((max(begin_us, self.end_us), data))

    def cut(self, t_us: float) -> None:
        """Lose the bytes that have not ended by *t_us*."""
        while self._bursts and self.end_us > t_us:
            begin_us, data = self._bursts.pop()
            if kept := data[: max(0, int((t_us - begin_us) / self._byte_us))]:
                self._bursts.append((begin_us, kept))

    def edges(self, channel: int, first_us: float, samples_per_us: float) -> Edges:
        """Return sample, channel and level of the edges, of a line that is high while it idles.

        Sample 0 is at *first_us*, and what comes before it is left out.
        """
        begins = [begin + self._byte_us * np.arange(len(data)) for begin, data in self._bursts]
        times_us = np.concatenate(begins) if begins else np.zeros(0)
        data = np.frombuffer(b"".join(data for _, data in self._bursts), np.uint8)
        levels = np.ones((len(data), _BITS), np.bool_)
        levels[:, 0] = False
        levels[:, 1:-1] = np.unpackbits(data[:, None], axis=1, bitorder="little")
        bits_us: FloatArray = times_us[:, None] + np.arange(_BITS) * (self._byte_us / _BITS)
        flat = levels.ravel()
        changed = np.diff(flat, prepend=np.True_)
        samples = np.ceil((bits_us.ravel()[changed] - first_us) * samples_per_us - 1e-6)
        inside = samples >= 0.0
        found = samples[inside].astype(np.int64)
        return found, np.full(len(found), channel), flat[changed][inside]

"""Levels of the drive pins: a drive as square pulses, sampled as a logic analyser samples them.

A weight A e^{+j phi} becomes a pulse of the duty d with sin(pi d) = A, d up to one half, whose
centre lags the middle of the carrier's high half by phi: the amplitude leaves the phase alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import ComplexArray, FloatArray

from ..board.events import CarrierState

#: Delay, of a period, that leaves half of the fundamental in the 0.5 ms that transducers ring.
_DRAWN_OUT: Final = 0.72
_LONGEST: Final = 0.55  # longest prolongation of a period by a byte: 614 cycles for 396
_SHARE: Final = 0.29  # share of the periods in which a byte of 115 200 baud arrives

Samples: TypeAlias = NDArray[np.int64]
Edges: TypeAlias = tuple[Samples, Samples, NDArray[np.bool_]]
_BITS: Final = 10  # start, eight of data with the lowest first, stop


@dataclass(frozen=True, eq=False, slots=True)
class PinWaveformPulses:
    """The pulses of C pins; times in periods of the carrier.

    Attributes
    ----------
    rises : (C,) numpy.ndarray
        When a pulse rises, 0 to 1.
    duties : (C,) numpy.ndarray
        Share of a period for which the pin is high, 0 to 0.5.

    Examples
    --------
    >>> import numpy as np
    >>> from sim_device.backdoor.pin_waveforms import PinWaveformPulses
    >>> made = PinWaveformPulses.of_weights(np.array([1.0, 1j, 0.5]))
    >>> made.rises.round(4).tolist(), made.duties.round(4).tolist()
    ([0.0, 0.25, 0.1667], [0.5, 0.5, 0.1667])
    """

    rises: FloatArray
    duties: FloatArray

    @classmethod
    def of_weights(cls, weights: ComplexArray) -> PinWaveformPulses:
        """Return the pulses whose fundamentals are *weights* (C,)."""
        duties = np.arcsin(np.minimum(np.abs(weights), 1.0)) / math.pi
        centres = np.angle(weights) / math.tau + 0.25
        return cls(np.remainder(centres - duties / 2.0, 1.0), duties)

    def levels(self, at: float, starts: FloatArray) -> NDArray[np.bool_]:
        """Return the level of each pin at a time, if periods of the carrier begin at *starts*."""
        near = starts[(starts > at - 2.0) & (starts <= at)]
        passed = at - near[:, None] - self.rises + 1e-9
        high = (passed >= 0.0) & (passed < self.duties)
        return np.asarray(high.any(axis=0))


def starts_of_periods(carrier: CarrierState, begin: float, end: float) -> FloatArray:
    """Return when periods of a carrier begin, from before *begin* to *end*.

    Those that are drawn out move by up to _DRAWN_OUT of a period, until one is left out.
    """
    first = 2 * math.floor(begin / 2.0) - 2
    starts = np.arange(first, math.ceil(end) + 1, dtype=np.float64)
    if carrier is CarrierState.HALVED:
        return starts[::2]
    if carrier is CarrierState.DRAWN_OUT:
        random = np.random.default_rng(first & 0xFFFFFFFF)
        longer = random.uniform(0.0, _LONGEST, len(starts)) * (random.random(len(starts)) < _SHARE)
        late = np.cumsum(np.where(starts >= begin, longer, 0.0))
        is_whole = np.diff(late // _DRAWN_OUT, prepend=0.0) == 0.0
        starts = (starts + late % _DRAWN_OUT)[is_whole]
    return starts


class PinWaveformSampler:
    """Samples pins from one drive to the next.

    Parameters
    ----------
    count : int
        Number of pins.
    samples : float
        Samples in a period of the carrier.
    """

    def __init__(self, count: int, samples: float) -> None:
        self._levels = np.zeros(count, np.bool_)
        self._samples = samples

    def edges(
        self, pulses: PinWaveformPulses, begin: float, end: float, starts: FloatArray
    ) -> Edges:
        """Return sample, pin and level of each edge from *begin* until *end*, in periods, in order.

        An edge shows in the first sample at or after it.
        """
        first = pulses.levels(begin, starts)
        changed = np.flatnonzero(first != self._levels)
        found = [(np.full(len(changed), begin), changed, first[changed])]
        found += self._periodic(pulses, begin, end, starts[:, None])
        times, pins, levels = (np.concatenate(parts) for parts in zip(*found, strict=True))
        samples = np.ceil(times * self._samples - 1e-6).astype(np.int64)
        order = np.argsort(times, kind="stable")
        samples, pins, levels = samples[order], pins[order], levels[order]
        self._levels[pins] = levels  # of the edges of a pin the last one stays
        return samples, pins, levels

    def _periodic(
        self, pulses: PinWaveformPulses, begin: float, end: float, starts: FloatArray
    ) -> Iterator[tuple[FloatArray, Samples, NDArray[np.bool_]]]:
        """Yield (times, pins, levels) of edges between *begin* and *end*: rises first, then falls.

        *starts* (K, 1) are the begins of carrier periods; each has one pulse of every sounding pin.
        Times are in carrier periods.
        """
        sounding = np.flatnonzero(pulses.duties > 0.0)
        rises, duties = pulses.rises[sounding], pulses.duties[sounding]
        for offsets, level in ((rises, True), (rises + duties, False)):
            times = (starts + offsets).ravel()
            pins = np.tile(sounding, len(starts))
            inside = (times > begin + 1e-9) & (times < end - 1e-9)
            yield times[inside], pins[inside], np.full(int(inside.sum()), level)


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

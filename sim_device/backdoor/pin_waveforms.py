"""Levels of the drive pins: a drive as square pulses, sampled as a logic analyser samples them.

A weight A e^{+j phi} becomes a pulse of the duty d with sin(pi d) = A, d up to one half, whose
centre lags the middle of the carrier's high half by phi: the amplitude leaves the phase alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import ComplexArray, FloatArray

Samples: TypeAlias = NDArray[np.int64]
Edges: TypeAlias = tuple[Samples, Samples, NDArray[np.bool_]]


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

    def levels(self, periods: float) -> NDArray[np.bool_]:
        """Return the level of each pin *periods* after a carrier boundary."""
        passed = np.remainder(periods - self.rises + 1e-9, 1.0)
        high: NDArray[np.bool_] = (passed < self.duties) & (self.duties > 0.0)
        return high


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

    def edges(self, pulses: PinWaveformPulses, begin: float, end: float) -> Edges:
        """Return sample, pin and level of each edge from *begin* until *end*, in periods, in order.

        An edge shows in the first sample at or after it.
        """
        first = pulses.levels(begin)
        changed = np.flatnonzero(first != self._levels)
        found = [(np.full(len(changed), begin), changed, first[changed])]
        found += self._periodic(pulses, begin, end)
        times, pins, levels = (np.concatenate(parts) for parts in zip(*found, strict=True))
        samples = np.ceil(times * self._samples - 1e-6).astype(np.int64)
        order = np.argsort(times, kind="stable")
        samples, pins, levels = samples[order], pins[order], levels[order]
        self._levels[pins] = levels  # of the edges of a pin the last one stays
        return samples, pins, levels

    def _periodic(
        self, pulses: PinWaveformPulses, begin: float, end: float
    ) -> Iterator[tuple[FloatArray, Samples, NDArray[np.bool_]]]:
        sounding = np.flatnonzero(pulses.duties > 0.0)
        rises, duties = pulses.rises[sounding], pulses.duties[sounding]
        number = np.arange(math.floor(begin) - 1, math.ceil(end) + 1)[:, None]
        for offsets, level in ((rises, True), (rises + duties, False)):
            times = (number + offsets).ravel()
            pins = np.tile(sounding, len(number))
            inside = (times > begin + 1e-9) & (times < end - 1e-9)
            yield times[inside], pins[inside], np.full(int(inside.sum()), level)

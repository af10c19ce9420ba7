"""By how much each pin is off in all frames."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from haptogram.acoustics import Calibration, TransducerArray
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.model.calibration import MAX_GAIN
from haptogram.acoustics.solvers.focus_fit import wrapped_phases
from haptogram.records.pins import PinRecord

from .faults import PinDrives


@dataclass(frozen=True, eq=False, slots=True)
class ElementOffsets:
    """The E pins of a capture, over all frames that were judged; NaN: none in which it sounds.

    Attributes
    ----------
    elements : tuple of int
        Their elements.
    channels : tuple of str
        Their channels.
    phase_rad, spread_rad : (E,) numpy.ndarray
        Mean lag behind the drives that were meant, and its standard deviation from frame to frame.
    gain, gain_spread : (E,) numpy.ndarray
        Amplitude over the one that was meant, and its standard deviation.
    duty : (E,) numpy.ndarray
        Share of a period for which the pin is driven, on average.
    known : (E,) numpy.ndarray of complex
        Gain and lag of each pin that were known, and taken off before.
    """

    elements: tuple[int, ...]
    channels: tuple[str, ...]
    phase_rad: FloatArray
    spread_rad: FloatArray
    gain: FloatArray
    gain_spread: FloatArray
    duty: FloatArray
    known: ComplexArray

    @classmethod
    def of(cls, record: PinRecord, drives: PinDrives, judged: Any) -> ElementOffsets:
        """Return the offsets of the (F, E) *drives* in the (F,) *judged* frames."""
        meant, seen = drives.run.weights[judged], drives.weights[judged]
        sounding = (np.abs(meant) > drives.limit_amplitude) & (np.abs(seen) > 0.0)
        turned = np.where(sounding, seen * np.conj(meant), 0.0)
        sizes = np.where(sounding, np.abs(seen) / np.where(sounding, np.abs(meant), 1.0), np.nan)
        phase = np.where(sounding.any(axis=0), np.angle(turned.sum(axis=0)), np.nan)
        away = np.where(sounding, wrapped_phases(np.angle(turned) - phase), np.nan)
        gain, gain_spread = _mean_and_spread(sizes)
        pins = [record.pins[element] for element in drives.run.elements]
        widths = [float(np.mean(p.falls - p.rises)) if len(p.rises) else math.nan for p in pins]
        return cls(
            drives.run.elements,
            tuple(pin.channel for pin in pins),
            phase,
            _mean_and_spread(away)[1],
            gain,
            gain_spread,
            np.array(widths),
            np.array([pin.response for pin in pins], dtype=np.complex128),
        )

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield the elements for JSON; phases are in degrees, null: nothing is known."""
        table = np.stack(
            [
                np.degrees(self.phase_rad),
                np.degrees(self.spread_rad),
                self.gain,
                self.gain_spread,
                self.duty,
            ],
            axis=1,
        )
        names = "phase_deg", "phase_spread_deg", "gain", "gain_spread", "duty"
        for element, channel, values in zip(
            self.elements, self.channels, table.tolist(), strict=True
        ):
            known = (round(value, 5) if math.isfinite(value) else None for value in values)
            yield {"element": element, "channel": channel, **dict(zip(names, known, strict=True))}


def _mean_and_spread(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and deviation (E,) of each column of *values* (F, E) but NaN; NaN if all are."""
    known = np.isfinite(values)
    count = np.maximum(known.sum(axis=0), 1)
    none = ~known.any(axis=0)
    mean = np.where(known, values, 0.0).sum(axis=0) / count
    square = np.where(known, (values - mean) ** 2, 0.0).sum(axis=0) / count
    return np.where(none, np.nan, mean), np.where(none, np.nan, np.sqrt(square))


def calibration_of_pins(every: Sequence[ElementOffsets], array: TransducerArray) -> Calibration:
    """Return gain and lag of the elements of an array, as captures show them; places as they are.

    An element of which no capture shows anything is as it was meant.
    """
    gain, phase = np.ones(array.count), np.zeros(array.count)
    for one in every:
        gain[np.array(one.elements)[np.isnan(one.duty)]] = 0.0  # no pulse at all: dead
        shown = np.isfinite(one.phase_rad)
        places = np.array(one.elements)[shown]
        gain[places] = one.gain[shown] * np.abs(one.known[shown])
        phase[places] = wrapped_phases(one.phase_rad[shown] + np.angle(one.known[shown]))
    return Calibration(np.minimum(gain, MAX_GAIN), phase, array.positions_m)

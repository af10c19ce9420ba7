"""The intended drives of a run at the pins that were captured, frame by frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Self, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import phase_step_rad
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.model.drive import REGISTER_BITS
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Intended
from haptogram.records.pins import PinPulses

Bools: TypeAlias = NDArray[np.bool_]

#: Periods that a frame lasts at least: a latch and what surrounds it take three, a phase two.
LEAST_PERIODS: Final = 5.0
_ROUNDING: Final = 1e-6  # rounding of times in whole microseconds
_CODES: Final = 256
_HALF: Final = 0.5
_EVERY: Final = slice(None)
_FUNDAMENTALS: Final[WeakKeyDictionary[PinPulses, ComplexArray]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class PinRunDrives:
    """F frames of a run at E elements; times in periods of the carrier since the first frame.

    Attributes
    ----------
    starts : (F,) numpy.ndarray
        When each frame is due, ascending.
    phases, amplitudes : (F, N) numpy.ndarray of uint8
        Codes of the whole array, phases of 8 bits.
    elements : tuple of int
        Elements that were captured.
    allowed_rad : (F,) numpy.ndarray
        By how much a board may differ that computes the drive, or that has other steps.
    held : (F, 2) numpy.ndarray or None
        Periods of the capture between which alone each frame is judged: beside them the carrier is
        not steady.
    """

    starts: FloatArray
    phases: NDArray[np.uint8]
    amplitudes: NDArray[np.uint8]
    elements: tuple[int, ...]
    allowed_rad: FloatArray
    held: FloatArray | None = None

    @classmethod
    def of(cls, intended: Sequence[Intended], elements: Sequence[int], carrier_hz: float) -> Self:
        """Return the drives of *intended* at *elements*.

        Raises
        ------
        ConfigurationError
            No frames, frames without a time, or frames that are too short.
        """
        due = [frame.t_apply_us for frame in intended]
        times_us = np.array([t for t in due if t is not None], dtype=np.float64)
        if not len(due) or len(times_us) < len(due):
            raise ConfigurationError(
                f"{len(due) - len(times_us)} of {len(due)} frames have no time to apply; pins are "
                "joined with frames by their times"
            )
        starts = (times_us - times_us[0]) * 1e-6 * carrier_hz
        shortest = float(np.diff(starts).min(initial=np.inf))
        if shortest < LEAST_PERIODS - _ROUNDING:
            raise ConfigurationError(
                f"a frame of {shortest / carrier_hz * 1e6:g} µs is too short to be told from pins, "
                f"must be {LEAST_PERIODS / carrier_hz * 1e6:g} µs at least: "
                f"{carrier_hz / LEAST_PERIODS:g} frames/s"
            )
        phases = np.stack([f.drive.in_bits(REGISTER_BITS).phase_codes for f in intended])
        amplitudes = np.stack([frame.drive.amplitude_codes for frame in intended])
        # Steps that codes of 8 bits do not meet are off by half a code.
        computed = np.array(
            [
                1.0 if frame.board_computed else _HALF if _CODES % frame.steps else 0.0
                for frame in intended
            ]
        )
        return cls(
            starts,
            phases.astype(np.uint8),
            amplitudes,
            tuple(elements),
            computed * phase_step_rad(8),
        )

    @property
    def count(self) -> int:
        """Number of frames."""
        return len(self.starts)

    @cached_property
    def gap(self) -> float:
        """Periods that most frames last; a run of one frame takes 40."""
        return float(np.median(np.diff(self.starts))) if self.count > 1 else 40.0

    @cached_property
    def ends(self) -> FloatArray:
        """(F,) when each frame is over."""
        return np.append(self.starts[1:], self.starts[-1] + self.gap)

    @cached_property
    def weights(self) -> ComplexArray:
        """(F, E) weights A e^{+j phi}."""
        return self.weights_of(list(self.elements))

    def weights_of(
        self, elements: Sequence[int], frames: slice | NDArray[np.intp] = _EVERY
    ) -> ComplexArray:
        """Return the (F, E) weights of these elements, in all or in some *frames*."""
        turns = np.exp(2j * math.pi / _CODES * np.arange(_CODES)).astype(np.complex64)
        places = list(elements)
        found: ComplexArray = turns[self.phases[frames][:, places]] * (
            self.amplitudes[frames][:, places] / np.float32(_CODES - 1)
        )
        return found


def fundamentals_of_run_drives(pulses: PinPulses) -> tuple[FloatArray, ComplexArray]:
    """Return centre (P,) in periods and fundamental (P,) of each pulse.

    A pulse from a to b has (e^{jb} - e^{ja}) / 2j: A e^{+j phi} as in a drive. Every place of the
    run that is tried asks for those of all pins: they are kept as long as the pulses are.
    """
    centres = (pulses.rises + pulses.falls) / 2.0
    found = _FUNDAMENTALS.get(pulses)
    if found is None:
        widths = np.minimum(pulses.falls - pulses.rises, 1.0).astype(np.float32)
        angles = (2.0 * np.pi * np.remainder(centres, 1.0)).astype(np.float32)
        found = np.empty(len(angles), np.complex64)
        sizes = np.sin(np.float32(np.pi) * widths)
        found.real, found.imag = sizes * np.cos(angles), sizes * np.sin(angles)
        found /= np.complex64(pulses.response)
        _FUNDAMENTALS[pulses] = found
    return centres, found

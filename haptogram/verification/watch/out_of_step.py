"""Elements of a focus out of step, alone or together, and a carrier that is not steady.

The place of a focus is fitted to all elements, so that what is left of each phase is rounding.
Elements whose numbers have something in common, and which are all off by more than rounding, are
off by a rule.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import BoolArray, ComplexArray, FloatArray
from haptogram.acoustics.field.reference import arrival_at_point
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.reconstruct.estimates import Vector
from haptogram.acoustics.reconstruct.patterns.fit import PatternPhases, fit_pattern_point
from haptogram.acoustics.reconstruct.patterns.found import OneFocus, Placed
from haptogram.acoustics.solvers.focus_fit import fit_focus, wrapped_phases

from ..groups import groups_of_elements
from .defect import Defect, Diagnosis
from .latch import HALVED, UPLOAD, SeenLatch
from .mistakes import Aim, MistakeFit

_ROUNDING: Final = 0.32  # RMS error in steps: rounding and cutting off leave 0.29
_LEAST_LAG: Final = 0.75  # least lag of a group, in steps: codes that are cut off are off by less
_SPREAD: Final = 0.6  # spread within a group, in steps: rounding, and the fit of the place
_SOUNDING: Final = 1e-6
_LEAST: Final = 0.95  # least amplitude while bytes arrive, relative to the usual one
_MOST: Final = 1000  # most latches whose phases are compared
_NAMED: Final = 8  # elements; more are counted


class CommonLosses:
    """Collects what is left of the phases of foci, and how loud they are.

    Parameters
    ----------
    model : AcousticModel
        Array and air.
    """

    def __init__(self, model: AcousticModel) -> None:
        self._model = model
        self._sum: ComplexArray = np.zeros(model.array.count, np.complex128)
        self._taken: dict[int, int] = {}  # drives: the latch that showed each first
        self._right = 0  # drives in which nothing is off
        self._last: tuple[ComplexArray, int, Vector] | None = None
        self._usual: Placed | None = None
        self._halved: list[int] = []
        self._level, self._least = 0.0, 1.0  # of the last latch; share left while bytes arrive
        self._is_low = self._usual_is_low = False

    def take(self, latch: SeenLatch, pattern: object) -> None:
        """Look at the drive of a latch, and its pattern."""
        level, before = latch.level, self._level
        if latch.cause == UPLOAD and level > 0.0 < before:  # the drive of the latch before it
            self._is_low = level < before
            self._least = min(self._least, level / before, before / level)
        self._level = level
        if not latch.is_of_client or latch.torn or not isinstance(pattern, Placed):
            return
        self._usual, self._usual_is_low = pattern, self._is_low
        if latch.counted.get(HALVED):
            self._halved.append(latch.number)
        drive = hash(latch.weights.tobytes())
        if not isinstance(pattern, OneFocus) or drive in self._taken or len(self._taken) == _MOST:
            return
        self._taken[drive] = latch.number
        step_rad = math.tau / latch.steps
        if not pattern.outliers and pattern.residual_rms_rad <= _ROUNDING * step_rad:
            self._right += 1
            return
        weights = np.where(np.isfinite(latch.weights), latch.weights, 0.0)
        active, residual = self._phase_errors(weights, pattern.position_m)
        self._sum[active] += np.exp(1j * (residual - np.median(residual)))
        self._last = weights, latch.steps, pattern.position_m

    def groups(self, reversed_elements: Collection[int]) -> tuple[list[Diagnosis], set[int]]:
        """Return the groups that are out of step, and all their elements; without reversed ones."""
        if self._last is None or 2 * self._right > len(self._taken):
            return [], set()
        weights, steps, near_m = self._last
        lags = np.where(np.abs(self._sum) > 0.0, np.angle(self._sum), np.nan)
        limit_rad, spread_rad = _LEAST_LAG * math.tau / steps, _SPREAD * math.tau / steps
        lags[np.abs(lags) > math.pi - math.tau / steps] = np.nan  # the polarity of single elements
        lags[list(reversed_elements)] = np.nan
        every = dict(enumerate(lags.tolist()))
        found, _ = groups_of_elements(every, every, limit_rad, steps, spread_rad=spread_rad)
        if not found:
            return [], set()
        right, members = weights.copy(), set[int]()
        for group in found:
            right[list(group.members)] *= np.exp(-1j * group.lag_rad)
            members.update(group.members)
        place, pressure = self._focus(weights, near_m)
        other, full = self._focus(right, near_m)
        moved_mm = 1e3 * float(np.linalg.norm(place - other))
        text = "; ".join(group.text for group in found)
        detail = (
            f"{text}; the focus moves by {moved_mm:.2f} mm and has {pressure:.0f} Pa instead of "
            f"{full:.0f} Pa"
        )
        return [Diagnosis(Defect.TOGETHER, detail, tuple(self._taken.values()))], members

    def levels(self) -> list[Diagnosis]:
        """Return the losses of a carrier that is not steady."""
        found = []
        if self._halved and self._usual is not None:
            pressure = self._usual.pressure_rms_pa
            detail = (
                "pins pulse in every second period; a transducer hears -6.0 dB, "
                f"{pressure:.0f} Pa instead of {2.0 * pressure:.0f} Pa"
            )
            found.append(Diagnosis(Defect.CARRIER, detail, tuple(self._halved)))
        if self._usual is not None and self._least < _LEAST:
            pressure = self._usual.pressure_rms_pa / (self._least if self._usual_is_low else 1.0)
            detail = (
                f"{20.0 * math.log10(self._least):.1f} dB, {self._least * pressure:.0f} Pa instead "
                f"of {pressure:.0f} Pa"
            )
            found.append(Diagnosis(Defect.UPLOAD, detail, ()))
        return found

    def _focus(self, weights: ComplexArray, near_m: Vector) -> tuple[FloatArray, float]:
        """Return the position (m) of the focus of *weights* near *near_m*, and the pressure there.

        The pressure is in Pa RMS.
        """
        sounding = np.abs(weights) > _SOUNDING
        place = fit_focus(self._model, np.angle(weights), near_m, active=sounding).position_m
        return place, arrival_at_point(self._model, weights, place)[0]

    def _phase_errors(self, weights: ComplexArray, near_m: Vector) -> tuple[BoolArray, FloatArray]:
        """Return a mask (N,) of sounding elements, and (M,) the phase errors in rad of these M.

        The errors are to a focus near *near_m*, fitted with the speed of sound.
        """
        array, radiated = self._model.array, self._model.radiated(weights)
        active = np.abs(radiated) > _SOUNDING
        phases = PatternPhases(
            array.local_m(array.positions_m[active]),
            np.angle(radiated[active]),
            self._model.wavenumber,
        )
        start = array.local_m(np.array(near_m))
        return active, fit_pattern_point(phases, start, free_speed=True).residual_rad


class ElementMistakes:
    """Collects elements out of step, frame by frame.

    Parameters
    ----------
    model : AcousticModel
        Array and air.
    """

    def __init__(self, model: AcousticModel) -> None:
        self._model = model
        self._off: dict[tuple[int, int], list[int]] = defaultdict(list)  # element, steps: latches
        self._swapped: dict[tuple[int, int], list[int]] = defaultdict(list)
        self._taken = 0

    def take(self, number: int, aim: Aim) -> None:
        """Look at a latch that is not as expected."""
        if self._taken == _MOST:
            return
        positions, k = self._model.array.positions_m, self._model.wavenumber
        rows = aim.phases_rad[None], aim.target_m[None], np.array([aim.step_rad])
        residual = MistakeFit(positions, k, *rows).residual_of_focus()
        if residual is None:
            return
        error = np.abs(np.nan_to_num(residual))
        off = np.flatnonzero(error > aim.step_rad)
        rest = error[error <= aim.step_rad]
        if math.sqrt(float(np.mean(rest**2))) > _ROUNDING * aim.step_rad:
            return  # air or array are not quite those that are thought
        self._taken += bool(len(off))
        if len(off) == 2 and self._is_swap(aim, residual, off):
            first, second = off.tolist()
            self._swapped[first, second].append(number)
            return
        half = round(math.pi / aim.step_rad)  # which has no sign
        for element in off.tolist():
            steps = round(residual[element] / aim.step_rad)
            self._off[element, max(steps, half) if steps == -half else steps].append(number)

    def diagnoses(self, known: Collection[int]) -> list[Diagnosis]:
        """Return the defects, but for elements that are named otherwise."""
        found = [
            Diagnosis(Defect.ELEMENTS, f"elements {a} and {b} are swapped", tuple(latches))
            for (a, b), latches in self._swapped.items()
        ][:_NAMED]
        off = {key: latches for key, latches in self._off.items() if key[0] not in known}
        if len(off) > _NAMED:
            latches = sorted({number for of_one in off.values() for number in of_one})
            count = len({element for element, _ in off})
            return [*found, Diagnosis(Defect.ELEMENTS, f"{count} elements", tuple(latches))]
        return found + [
            Diagnosis(Defect.ELEMENTS, f"element {element}, {steps:+d} steps", tuple(latches))
            for (element, steps), latches in sorted(off.items())
        ]

    def _is_swap(self, aim: Aim, residual: FloatArray, pair: NDArray[np.intp]) -> bool:
        """Return True if two elements have each other's phase, to within a phase step."""
        distance = np.linalg.norm(self._model.array.positions_m[pair] - aim.target_m, axis=1)
        between = float(self._model.wavenumber * (distance[1] - distance[0]))
        errors = wrapped_phases(residual[pair] - between * np.array([-1.0, 1.0]))
        return bool(np.abs(errors).max() <= aim.step_rad and math.isfinite(between))

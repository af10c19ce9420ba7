"""From a drive to the pattern that it makes.

A pattern is named if it explains the phases of all elements but a few to within half a step, in the
root mean square, for a speed of sound that may differ a little from that of the model. The simplest
one that does is named, if random phases would hardly be explained as well. Otherwise nothing is.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import BoolArray, ComplexArray, FloatArray
from haptogram.acoustics.field.reference import arrival_at_point, points_with_field
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.reconstruct.estimates import as_vector
from haptogram.acoustics.reconstruct.patterns.chance import (
    is_beyond_chance,
    log_chance_of_explanation,
)
from haptogram.acoustics.reconstruct.patterns.explain import (
    Explanation,
    explain_turning_pattern,
    explain_twin_trap,
)
from haptogram.acoustics.reconstruct.patterns.fit import PatternPhases, pattern_residual_rms
from haptogram.acoustics.reconstruct.patterns.found import (
    Off,
    OneFocus,
    Pattern,
    TwinTrap,
    Uniform,
    Unnamed,
    Vortex,
)
from haptogram.acoustics.reconstruct.patterns.search import (
    PatternSearch,
    Start,
    array_sides_of_pattern,
)
from haptogram.acoustics.reconstruct.patterns.several import find_foci_pattern
from haptogram.acoustics.solvers.focus_fit import fit_focus, wrapped_phases
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_whole

MIN_ACTIVE: Final = 8  # twice the unknowns of a focus; chance decides about more
_SILENT: Final = 1e-6
_MOST_FITS: Final = 14
_SUFFICES: Final = 0.95  # share of explained elements that ends the search
_FINEST_STEPS: Final = 256  # finer codes are treated like these
_PLANE_M: Final = 1e-4
_LEAST_SIDE: Final = 0.3  # least share of the elements on each side of a trap
_TRAP_IS_BETTER: Final = 0.85  # largest RMS residual of a trap, relative to that of a focus


class PatternClassifier:
    """Names the pattern of drive after drive of one array.

    It remembers the last pattern, and looks there first.

    Parameters
    ----------
    model : AcousticModel
        Array and air, in any pose.
    steps : int
        Phase steps in a period, 2 to 65 536: they say how well a pattern must fit.

    Raises
    ------
    ConfigurationError
        Steps out of range.

    Examples
    --------
    >>> from haptogram.acoustics import AcousticModel, focus_phases
    >>> model = AcousticModel.default()
    >>> found = PatternClassifier(model, 256).classify(
    ...     np.exp(1j * focus_phases(model, (0.02, 0.0, 0.15)))
    ... )
    >>> found.kind, [round(1e3 * value, 1) + 0.0 for value in found.position_m]
    ('one focus', [20.0, 0.0, 150.0])
    """

    def __init__(self, model: AcousticModel, steps: int) -> None:
        check_whole("steps", steps, 2, 65_536)
        self._radiated_by = model.radiated
        self._model = replace(model, calibration=None)  # of what is radiated
        self._step_rad = 2.0 * math.pi / min(steps, _FINEST_STEPS)
        self._local = model.array.local_m(model.array.positions_m)
        self._sides = array_sides_of_pattern(model.array)
        self._searches: dict[int, PatternSearch] = {}
        self._last: Explanation | None = None

    def classify(self, weights: ArrayLike, near_m: ArrayLike | None = None) -> Pattern:
        """Return the pattern of (N,) complex *weights*; elements that are not finite are silent.

        Parameters
        ----------
        near_m : (3,) array_like, optional
            Where to look for a focus first.

        Raises
        ------
        ConfigurationError
            Weights that are not one per element.
        """
        drive = self._radiated(weights)
        active = np.abs(drive) > _SILENT
        if not active.any():
            return Off()
        phases = PatternPhases(self._local[active], np.angle(drive[active]), self._model.wavenumber)
        in_phase = (
            np.abs(wrapped_phases(phases.phases_rad - phases.phases_rad[0])).max() < self._limit_rad
        )
        if in_phase and self._is_plane:
            return Uniform(int(active.sum()))
        places = [] if near_m is None else [np.asarray(near_m, dtype=np.float64)]
        found = self._placed(drive, active, phases, places)
        if found is not None:
            return found
        return Uniform(int(active.sum())) if in_phase else self._unnamed(drive, active)

    def warm_up(self) -> None:
        """Prepare the search volume, for which the first drive would wait."""
        self._search_for(np.ones(self._model.array.count, dtype=np.bool_))

    def reset(self) -> None:
        """Forget the last pattern: the next drive is searched for."""
        self._last = None

    @property
    def _limit_rad(self) -> float:
        """The largest RMS residual of a pattern whose phases are quantised: half a step."""
        return self._step_rad / 2.0 + 1e-6

    @cached_property
    def _is_plane(self) -> bool:
        """Return True if all elements lie in one plane, within 0.1 mm."""
        return bool(np.ptp(self._local[:, 2]) < _PLANE_M)

    def _radiated(self, weights: ArrayLike) -> ComplexArray:
        """Return (N,) what *weights* radiate by the model's calibration; refuse a wrong number.

        A weight that is not finite counts as 0.
        """
        drive = np.asarray(weights, dtype=np.complex128)
        if drive.shape != (self._model.array.count,):
            raise ConfigurationError(
                f"weights have shape {drive.shape}, must be ({self._model.array.count},)"
            )
        return self._radiated_by(np.where(np.isfinite(drive), drive, 0.0))

    def _placed(
        self,
        drive: ComplexArray,
        active: BoolArray,
        phases: PatternPhases,
        places: list[FloatArray],
    ) -> Pattern | None:
        """Return a pattern with one or several foci that the phases match; None if none.

        The last pattern's place and *places* are tried first. Fewer than 8 elements match nothing.
        """
        if len(phases.phases_rad) < MIN_ACTIVE:
            return None
        explained = self._fit_from_last(phases)
        if explained is None:
            explained = self._found(phases, active, drive, places)
        if explained is not None:
            explained = self._best_standing_fit(explained, phases, active)
            return self._as_pattern(explained, drive, active)
        search = self._search_for(active)
        return find_foci_pattern(self._model, drive, active, search.loudest, self._step_rad)

    def _found(
        self,
        phases: PatternPhases,
        active: BoolArray,
        drive: ComplexArray,
        places: list[FloatArray],
    ) -> Explanation | None:
        """Return a focus, vortex or trap that explains phases beyond chance; None if there is none.

        *places* are tried first. The sides of the array may be half a turn apart.
        """
        search, halves = self._search_for(active), self._half_turn(active)
        arrivals = np.where(np.abs(drive) > _SILENT, np.exp(1j * np.angle(drive)), 0.0)
        turned = arrivals.copy()
        if halves is not None:
            turned[active] *= np.exp(1j * halves)
        for find in (self._focused_at, self._searched_among):
            found = find(phases, places, search, arrivals)
            if found is None and halves is not None:
                found = _as_trap(find(phases.turned(halves), places, search, turned), halves)
            if found is not None:
                return found
        return None

    def _half_turn(self, active: BoolArray) -> FloatArray | None:
        """Return phase pi for active elements of the far side, 0 else; None for one side.

        It is one side if the array has no other, or 30 % of the active elements or less are on one.
        """
        if len(self._sides) == 1:
            return None
        far = self._sides[1][active]
        return np.where(far, math.pi, 0.0) if _LEAST_SIDE < far.mean() < 1 - _LEAST_SIDE else None

    def _best_standing_fit(
        self, found: Explanation, phases: PatternPhases, active: BoolArray
    ) -> Explanation:
        """Return the best fit among *found* and its neighbours: foci and traps of a standing wave.

        Between two sides a focus has neighbours: foci half a wavelength away, and traps, which have
        half a turn between the sides, a quarter away. A trap wins if its RMS is below 0.85 of a
        focus's.
        """
        halves = self._half_turn(active)
        if halves is None or found.charge or found.normal is not None:
            return found
        quarter = np.array([0.0, 0.0, math.pi / 2.0 / phases.wavenumber])
        turned, best = phases.turned(halves), {False: found}
        for quarters in (-2, -1, 1, 2):
            is_trap, start = quarters % 2 == 1, found.fit.position_m + quarters * quarter
            other = explain_turning_pattern(
                turned if is_trap else phases, start, self._limit_rad, near=True
            )
            if other is None or other.used.sum() < found.used.sum() or not self._is_usable(other):
                continue
            if is_trap not in best or _rms_of(other) < _rms_of(best[is_trap]):
                best[is_trap] = other
        if True in best and _rms_of(best[True]) < _TRAP_IS_BETTER * _rms_of(best[False]):
            return _as_trap(best[True], halves) or found
        return best[False]

    def _fit_from_last(self, phases: PatternPhases) -> Explanation | None:
        """Return a fit that starts at the last pattern; None unless it explains all elements.

        None as well if there is no last pattern.
        """
        last = self._last
        if last is None:
            return None
        place, limit_rad = last.fit.position_m, self._limit_rad
        if last.normal is None:
            axis = last.fit.axis_m if last.charge else None
            found = explain_turning_pattern(
                phases, place, limit_rad, charge=last.charge, axis_m=axis, near=True
            )
        elif len(last.added_rad) == len(phases.phases_rad):
            found = explain_turning_pattern(
                phases.turned(last.added_rad), place, limit_rad, near=True
            )
            if found is not None:
                found = replace(found, added_rad=last.added_rad, normal=last.normal)
        else:
            return None
        return self._proven(phases, found) if found is not None and found.used.all() else None

    def _search_for(self, active: BoolArray) -> PatternSearch:
        """Return the search of the side of the array that has the most active elements."""
        number = int(np.argmax([np.count_nonzero(active & side) for side in self._sides]))
        if number not in self._searches:
            self._searches[number] = PatternSearch(self._model, self._sides[number])
        return self._searches[number]

    def _focused_at(
        self,
        phases: PatternPhases,
        places: list[FloatArray],
        search: PatternSearch,
        arrivals: ComplexArray,
    ) -> Explanation | None:
        """Return a focus at one of *places* or at the point that a bowl array faces; else None.

        It explains 95 % of the elements or more; the first that does is taken.
        """
        for place in [*places, *search.foci_of_bowl(arrivals)]:
            local = self._model.array.local_m(place[None])[0]
            found = explain_turning_pattern(phases, local, self._limit_rad, near=True)
            if found is not None and found.used.mean() >= _SUFFICES:
                found = self._proven(phases, found)
                if found is not None:
                    return found
        return None

    def _searched_among(
        self, phases: PatternPhases, _: list[FloatArray], search: PatternSearch, heard: ComplexArray
    ) -> Explanation | None:
        """Return the fit with the fewest outliers among the likeliest starts; None if none fits.

        Up to 14 starts with an axis in the array's middle, then 14 with one at the start; a fit to
        95 % of the elements ends the search.
        """
        best: Explanation | None = None
        for below in (False, True):
            for start in search.starts(heard, below=below)[:_MOST_FITS]:
                found = self._from_start(phases, start, search, heard != 0.0)
                if found is not None and (best is None or found.used.sum() > best.used.sum()):
                    best = found
                if best is not None and best.used.mean() >= _SUFFICES:
                    return best
        return best

    def _from_start(
        self, phases: PatternPhases, start: Start, search: PatternSearch, active: BoolArray
    ) -> Explanation | None:
        """Return a twin trap, focus or vortex fitted from a start; None unless it is beyond chance.

        Beyond chance: random phases fit as well with a probability of at most 1e-4.
        """
        place = self._model.array.local_m(start.position_m)
        axis = place[:2] if start.below else search.middle_m
        side, limit_rad = search.side[active], self._limit_rad
        if start.charge is None:
            found = explain_twin_trap(phases, place, limit_rad, axis, start.turn_rad, side)
        else:
            found = explain_turning_pattern(
                phases, place, limit_rad, charge=start.charge, axis_m=axis, side=side
            )
        return None if found is None else self._proven(phases, found)

    def _proven(self, phases: PatternPhases, found: Explanation) -> Explanation | None:
        """Return *found*, or a simpler pattern that fits too, if it is beyond chance; else None.

        Beyond chance: random phases fit as well with a probability of at most 1e-4. None too where
        the field model is not valid.
        """
        if not self._is_usable(found):
            return None
        simplest = self._simplest(phases, found)
        return simplest if is_beyond_chance(simplest, self._step_rad) else None

    def _simplest(self, phases: PatternPhases, found: Explanation) -> Explanation:
        """Return the vortex *found*, or a focus at its place if random phases fit that more rarely.

        A vortex axis far from the array turns no phases, but can be fitted to a few outliers.
        Patterns without a charge are returned as they are.
        """
        if not found.charge:
            return found
        focus = explain_turning_pattern(phases, found.fit.position_m, self._limit_rad, near=True)
        if focus is None or not self._is_usable(focus):
            return found
        return min(focus, found, key=lambda one: log_chance_of_explanation(one, self._step_rad))

    def _is_usable(self, found: Explanation) -> bool:
        """Return True if the field model is valid where an explanation has its pattern."""
        return self._has_field(self._model.array.world_m(found.fit.position_m))

    def _has_field(self, place: FloatArray) -> bool:
        """Return True if the field model is valid at a place."""
        return bool(points_with_field(self._model, place[None])[0])

    def _as_pattern(self, found: Explanation, drive: ComplexArray, active: BoolArray) -> Pattern:
        """Return *found* as a pattern, and keep it, where the next drive's search starts.

        Its place is fitted again with the model's speed of sound, where that fit is observable and
        the field model valid.
        """
        self._last = found
        turn, used = np.zeros(len(drive)), np.zeros(len(drive), np.bool_)
        turn[active], used[active] = found.added_rad, found.used
        focused = drive * np.exp(-1j * turn)
        start = self._model.array.world_m(found.fit.position_m)
        fit = fit_focus(self._model, np.angle(focused), start, step_rad=self._step_rad, active=used)
        # Close to the array it may end behind it, or in its plane, in the air of the model.
        is_place = fit.observable.all() and self._has_field(fit.position_m)
        place = fit.position_m if is_place else start
        pressure, coherence = arrival_at_point(self._model, focused, place)
        common: dict[str, Any] = {
            "position_m": as_vector(place),
            "std_m": as_vector(fit.std_m),
            "bound_m": as_vector(fit.bound_m),
            "residual_rms_rad": _rms_of(found),
            "coherence": coherence,
            "pressure_rms_pa": pressure,
            "speed_share": -found.fit.speed_share,
            "outliers": tuple(int(n) for n in np.flatnonzero(active)[~found.used]),
            "outlier_rad": tuple(float(off) for off in found.fit.residual_rad[~found.used]),
        }
        if found.normal is not None:
            return TwinTrap(**common, normal=as_vector(found.normal @ self._model.array.axes))
        if found.charge:
            axis = self._model.array.world_m(np.append(found.fit.axis_m, 0.0))
            return Vortex(**common, charge=found.charge, axis_m=as_vector(axis))
        return OneFocus(**common)

    def _unnamed(self, drive: ComplexArray, active: BoolArray) -> Unnamed:
        """Return an unnamed pattern with the point of greatest pressure."""
        loudest = self._search_for(active).loudest(drive, 1)[0]
        return Unnamed(as_vector(loudest), arrival_at_point(self._model, drive, loudest)[1])


def _rms_of(found: Explanation) -> float:
    """Return the RMS residual, in rad, of the elements that an explanation uses."""
    return pattern_residual_rms(found.fit.residual_rad[found.used])


def _as_trap(found: Explanation | None, halves: FloatArray) -> Explanation | None:
    """Return a focus as a trap between the two sides of the array; None if *found* is no focus.

    *halves*, pi for elements of one side and 0 else, was added to the phases before the fit.
    """
    if found is None or found.charge or found.normal is not None:
        return None
    return replace(found, added_rad=halves, normal=np.array([0.0, 0.0, 1.0]))

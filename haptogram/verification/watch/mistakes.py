"""Defects by name from where foci are and where they were expected.

A hypothesis says where every focus would be: the elements in another order, the targets in other
axes, the air of another speed of sound. One is named if it alone explains all foci: the expectation
itself does not, no other simple one comes near, and no two are needed where one suffices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.model.medium import air_temperature_c
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.reconstruct.patterns.fit import PatternPhases, fit_pattern_point

from .defect import Defect, Diagnosis

LEAST_TARGETS: Final = 3
_EXPLAINS: Final = 2.5  # standard deviations of rounding, in the root mean square
_WORST: Final = 6.0  # of one coordinate: errors of rounding are not all independent
_MARGIN: Final = 2.5  # between the explanation and the next best one
_LEAST_RIVAL: Final = 4.0  # standard deviations that the next best one must be off
_MOST_SHIFT_M: Final = 0.03
_MOST_SPEED: Final = 0.04
_STEP: Final = 0.01  # share of the speed of sound for a slope
_MM: Final = 1e3

Places: TypeAlias = FloatArray
#: From (T, 3) targets to where their foci would be.
Moves: TypeAlias = Callable[[Places], Places]


@dataclass(frozen=True, eq=False, slots=True)
class Aim:
    """One target and the focus that was found.

    Attributes
    ----------
    target_m, found_m : (3,) numpy.ndarray
        In the world.
    std_m : (3,) numpy.ndarray
        Standard deviation of that by the rounding of the phases; infinite where it does not show.
    """

    target_m: FloatArray
    found_m: FloatArray
    std_m: FloatArray


@dataclass(frozen=True, slots=True)
class _Order:
    """Another order of the elements, which mirrors or turns the array onto itself."""

    name: str
    matrix: tuple[tuple[int, int], tuple[int, int]]


_ORDERS: Final = (
    _Order("x mirrored", ((-1, 0), (0, 1))),
    _Order("y mirrored", ((1, 0), (0, -1))),
    _Order("x and y mirrored (turned by 180 degrees)", ((-1, 0), (0, -1))),
    _Order("x and y exchanged (transposed)", ((0, 1), (1, 0))),
    _Order("x and y exchanged and mirrored", ((0, -1), (-1, 0))),
    _Order("turned by 90 degrees", ((0, -1), (1, 0))),
    _Order("turned by 270 degrees", ((0, 1), (-1, 0))),
)


def name_client_mistake(model: AcousticModel, aims: Sequence[Aim]) -> Diagnosis | None:
    """Return the mistake that explains where the foci are; None: none does, or several do."""
    if len(_distinct_aims_of_mistakes(aims)) < LEAST_TARGETS:
        return None
    case = _MistakeCase(model, aims)
    if case.misfit(case.targets) <= _EXPLAINS:
        return None
    for hypotheses in (case.simple(), case.double()):
        scored = sorted(
            ((case.misfit(places), name) for name, places in hypotheses), key=_first_client_mistake
        )
        best, name = scored[0]
        if best > _EXPLAINS:
            continue
        rivals = [score for score, other in scored if other.key != name.key]
        if rivals and rivals[0] < max(_MARGIN * best, _LEAST_RIVAL):
            return None
        return name.diagnosis()
    return None


def is_mistake_explained_alone(
    model: AcousticModel, aims: Sequence[Aim], rivals: Sequence[Aim]
) -> bool:
    """Return True if *aims* are on target, and *rivals* neither are nor show another mistake."""
    if (
        len(_distinct_aims_of_mistakes(rivals)) < LEAST_TARGETS
        or name_client_mistake(model, rivals) is not None
    ):
        return False
    misfit, rival = (_MistakeCase(model, each).misfit_of_targets() for each in (aims, rivals))
    return misfit <= _EXPLAINS and rival >= max(_MARGIN * misfit, _LEAST_RIVAL)


def hint_at_mistaken_speed(model: AcousticModel, aims: Sequence[Aim]) -> str | None:
    """Return which speed of sound would explain foci that are not on target; None: none does.

    Unlike :func:`name_client_mistake` it takes any number of targets. What fits as well is named
    beside it: a single focus is as well explained by a shift.
    """
    if not aims:
        return None
    case = _MistakeCase(model, aims)
    if case.misfit_of_targets() <= _EXPLAINS:
        return None
    fitting = [name.parts[0] for name, places in case.simple() if case.misfit(places) <= _EXPLAINS]
    speed = next((text for defect, text in fitting if defect is Defect.SPEED), None)
    others = dict.fromkeys(text for defect, text in fitting if defect is not Defect.SPEED)
    if speed is None or not others:
        return speed
    return (
        f"{speed}; foci {', or '.join(others)}, fit as well: {LEAST_TARGETS} targets or more tell "
        "which it is"
    )


def _first_client_mistake(item: tuple[float, _MistakeName]) -> float:
    return item[0]


def _distinct_aims_of_mistakes(aims: Sequence[Aim]) -> set[tuple[float, ...]]:
    return {tuple(np.round(aim.target_m, 6).tolist()) for aim in aims}


@dataclass(frozen=True, slots=True)
class _MistakeName:
    """What a hypothesis says; those with the same key say the same."""

    parts: tuple[tuple[Defect, str], ...]

    @property
    def key(self) -> tuple[tuple[Defect, str], ...]:
        """The defects, and which order; figures do not count."""
        return tuple((d, text if d is Defect.ORDER else "") for d, text in self.parts)

    def diagnosis(self) -> Diagnosis:
        (defect, detail), *others = self.parts
        more = "".join(f"; and {other}: {text}" for other, text in others)
        return Diagnosis(defect, detail + more, ())


class _MistakeCase:
    """Targets and foci of one run, and what hypotheses make of them."""

    def __init__(self, model: AcousticModel, aims: Sequence[Aim]) -> None:
        self._model = model
        self.targets = np.array([aim.target_m for aim in aims])
        self.found = np.array([aim.found_m for aim in aims])
        std = np.array([aim.std_m for aim in aims])
        self._seen = np.isfinite(std)
        self._std = np.where(self._seen, std, 1.0)

    def misfit(self, places: Places) -> float:
        """Return how many standard deviations the foci are off *places*."""
        off = np.where(self._seen, (self.found - places) / self._std, 0.0)
        if not np.isfinite(off).all():
            return np.inf
        mean = float(np.sqrt((off**2).sum() / max(self._seen.sum(), 1)))
        return max(mean, float(np.abs(off).max()) * _EXPLAINS / _WORST)

    def misfit_of_targets(self) -> float:
        """Return how many standard deviations the foci are off their targets."""
        return self.misfit(self.targets)

    def simple(self) -> Iterator[tuple[_MistakeName, Places]]:
        """Yield each mistake by itself."""
        for name, places in self._orders():
            yield _MistakeName(((Defect.ORDER, name),)), places
        yield self._shifted(self.targets, ())
        yield self._in_other_air(self.targets, ())

    def double(self) -> Iterator[tuple[_MistakeName, Places]]:
        """Yield two mistakes at once."""
        for name, places in self._orders():
            if not self._is_near(places):
                continue
            order = ((Defect.ORDER, name),)
            yield self._in_other_air(places, order)
            yield self._shifted(places, order)
        yield self._both()

    def _is_near(self, places: Places) -> bool:
        """Return True if a shift or other air could bring *places* to the foci."""
        off = np.linalg.norm(np.where(self._seen, self.found - places, 0.0), axis=1)
        return bool(off.max() < _MOST_SHIFT_M)

    def _orders(self) -> Iterator[tuple[str, Places]]:
        """Yield the foci of elements, or of coordinates, in another order.

        Elements that are mirrored or turned onto each other do so around their centre, and
        coordinates around the origin.
        """
        array = self._model.array
        axes = array.axes
        for order in _ORDERS:
            turn = np.eye(3)
            turn[:2, :2] = order.matrix
            yield order.name, array.world_m(array.local_m(self.targets) @ turn.T)
            yield order.name, self.targets @ (axes.T @ turn @ axes).T

    def _shifted(
        self, places: Places, before: tuple[tuple[Defect, str], ...]
    ) -> tuple[_MistakeName, Places]:
        """Return the best common shift of all foci."""
        weights = np.where(self._seen, self._std**-2.0, 0.0)
        total = np.maximum(weights.sum(axis=0), 1e-30)
        shift = (weights * (self.found - places)).sum(axis=0) / total
        length = float(np.linalg.norm(shift))
        text = ", ".join(f"{round(_MM * value, 1) + 0.0:.1f}" for value in shift)
        name = _MistakeName((*before, (Defect.AXES, f"shifted by ({text}) mm")))
        return name, places + (shift if length <= _MOST_SHIFT_M else np.nan)

    def _in_other_air(
        self, places: Places, before: tuple[tuple[Defect, str], ...]
    ) -> tuple[_MistakeName, Places]:
        """Return the best speed of sound that the client may have assumed."""
        share, moved = 0.0, places
        for _ in range(3):
            slope = (self._foci_for(places, share + _STEP) - moved) / _STEP
            scaled = np.where(self._seen, slope / self._std, 0.0)
            off = np.where(self._seen, (self.found - moved) / self._std, 0.0)
            share += float((scaled * off).sum() / max((scaled**2).sum(), 1e-30))
            share = float(np.clip(share, -_MOST_SPEED, _MOST_SPEED))
            moved = self._foci_for(places, share)
        speed = self._model.medium.sound_speed_m_s * (1.0 + share)
        here = f"the air has {self._model.medium.sound_speed_m_s:.1f} m/s"
        its_air_c = air_temperature_c(speed)
        option = f"--temperature-c {its_air_c:.1f}"
        text = f"the client assumes {speed:.1f} m/s, air of {its_air_c:.1f} C ({option}); {here}"
        return _MistakeName((*before, (Defect.SPEED, text))), moved

    def _both(self) -> tuple[_MistakeName, Places]:
        """Return the best speed of sound and shift together."""
        name, moved = self._in_other_air(self.targets, ())
        for _ in range(4):
            shift = (self.found - moved).mean(axis=0)
            back = _MistakeCase(self._model, self._aims(shift))
            name, moved = back._in_other_air(self.targets, ())
        return self._shifted(moved, name.parts)

    def _aims(self, shift: FloatArray) -> list[Aim]:
        spread = np.where(self._seen, self._std, np.inf)
        rows = zip(self.targets, self.found - shift, spread, strict=True)
        return [Aim(target, found, std) for target, found, std in rows]

    def _foci_for(self, places: Places, share: float) -> Places:
        """Return where foci are whose phases were computed for a speed higher by *share*."""
        array, k = self._model.array, self._model.wavenumber
        local = array.local_m(array.positions_m)
        found = []
        for place in places:
            start = array.local_m(place)
            distance = np.linalg.norm(start - local, axis=1)
            phases = PatternPhases(local, -k / (1.0 + share) * distance, k)
            found.append(fit_pattern_point(phases, start).position_m)
        return array.world_m(np.array(found))

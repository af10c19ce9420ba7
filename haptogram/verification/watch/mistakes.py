"""Defects by name from the phases that came and the foci that were expected.

A hypothesis says which phases a mistake would have made. One is named if it alone explains the
phases of nearly all frames: no mistake at all does not, no other simple one comes near, and no two
are needed where one suffices.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.model.medium import air_temperature_c
from haptogram.acoustics.model.model import AcousticModel

from .defect import Defect, Diagnosis
from .mistake_fit import UNKNOWNS, MistakeFit
from .rearrangements import Part, Rearrangement

LEAST_TARGETS: Final = 3
_EXPLAINS: Final = 2.5  # standard deviations of rounding, in the root mean square
_MARGIN: Final = 2.5  # ratio between the best explanation and the next
_LEAST_RIVAL: Final = 4.0  # standard deviations that the next best one must be off
_IS_NOISE: Final = 1.3  # standard deviations: nothing but rounding is left
_BETTER: Final = 6.0  # standard deviations by which it is more likely than the next best one
_MM: Final = 1e3


@dataclass(frozen=True, eq=False, slots=True)
class Aim:
    """One target, and the phases that came.

    Attributes
    ----------
    target_m : (3,) numpy.ndarray
        In the world.
    phases_rad : (N,) numpy.ndarray
        Of the elements, not a number where they are silent.
    step_rad : float
        Step of the phases.
    found_m : (3,) numpy.ndarray or None
        The focus that they make; None if they make none.
    """

    target_m: FloatArray
    phases_rad: FloatArray
    step_rad: float
    found_m: FloatArray | None


class ClientMistakes:
    """Looks for the mistake that explains the phases of a run.

    Parameters
    ----------
    model : AcousticModel
        Array and air.
    rearrangements : sequence of Rearrangement
        The single mistakes that are thought of, the one that is none first.
    client_axes : (3, 3) numpy.ndarray
        Rows are our axes in those of the client.
    aims : sequence of Aim
        Frames that were expected to have one focus.
    """

    def __init__(
        self,
        model: AcousticModel,
        rearrangements: Sequence[Rearrangement],
        client_axes: FloatArray,
        aims: Sequence[Aim],
    ) -> None:
        self._model, self._axes = model, client_axes
        self._none, *self._others = rearrangements
        self._targets = np.array([aim.target_m for aim in aims])
        self._phases = np.array([aim.phases_rad for aim in aims])
        self._steps = np.array([aim.step_rad for aim in aims])
        lost = np.full(3, np.nan)
        self._found = np.array([lost if aim.found_m is None else aim.found_m for aim in aims])
        self._distinct = len({tuple(np.round(aim.target_m, 6).tolist()) for aim in aims})

    def diagnosis(self) -> Diagnosis | None:
        """Return the mistake that is proven; None: none explains the phases, or several do."""
        for scored in self._levels():
            best, parts = scored[0]
            if best > _EXPLAINS:
                continue
            rivals = [score for score, other in scored if _key(other) != _key(parts)]
            if rivals and not self._is_beyond(best, rivals[0]):
                return None
            (defect, detail), *others = parts
            more = "".join(f"; and {other}: {text}" for other, text in others)
            return Diagnosis(defect, detail + more, ()) if self._is_enough(parts) else None
        return None

    def hint(self) -> str | None:
        """Return mistakes that explain the phases and are not proven; None: none, or a shift."""
        for scored in self._levels():
            fitting = dict.fromkeys(
                "; and ".join(f"{defect}: {text}" for defect, text in parts)
                for score, parts in scored
                if score <= _EXPLAINS
            )
            if fitting and not all(str(Defect.AXES) in text for text in fitting):
                tell = (
                    f"{LEAST_TARGETS} targets or more tell"
                    if self._distinct < LEAST_TARGETS
                    else "targets further apart, at other heights and off the axes, tell"
                )
                which = "whether it is" if len(fitting) == 1 else "which it is"
                return f"{', or '.join(fitting)}: {tell} {which}"
        return None

    def _is_beyond(self, best: float, rival: float) -> bool:
        """Return True if the score *rival* is so far worse than *best* that it is ruled out."""
        unlikely = math.sqrt(UNKNOWNS * len(self._targets) * max(0.0, rival**2 - best**2))
        is_clear = best <= _IS_NOISE and unlikely >= _BETTER
        return is_clear or rival >= max(_MARGIN * best, _LEAST_RIVAL)

    def _is_enough(self, parts: tuple[Part, ...]) -> bool:
        """Return True if enough distinct targets were seen; a mistake without foci needs none."""
        is_focus = np.isfinite(self._found).all(axis=1).mean() > 0.5
        is_simple = not is_focus and len(parts) == 1
        return is_simple or self._distinct >= LEAST_TARGETS

    def _levels(self) -> Iterator[list[tuple[float, tuple[Part, ...]]]]:
        """Yield scores of hypotheses of one mistake, then of two, each sorted by score."""
        score, none = self._score, self._none
        if score(none)[0] <= _EXPLAINS:
            return
        single = [score(other) for other in self._others]
        yield _sorted([*single, score(none, speed=True), score(none, shift=True)])
        double = [score(none, speed=True, shift=True)]
        for other in self._others:
            double += [score(other, speed=True), score(other, shift=True)]
            if other.parts[0][0] is Defect.ORDER:
                sign = next(o for o in self._others if o.sign < 0)
                parts = (*sign.parts, *other.parts)
                double.append(score(replace(other, sign=-1, parts=parts)))
        yield _sorted(double)

    def _score(
        self, what: Rearrangement, *, speed: bool = False, shift: bool = False
    ) -> tuple[float, tuple[Part, ...]]:
        """Return by how many standard deviations a hypothesis is off, and its names.

        Parameters
        ----------
        speed, shift : bool
            Whether the client may assume another speed of sound, and another origin.
        """
        phases = what.sign * self._phases[:, what.index] + what.added_rad
        places = what.move(self._targets)
        positions, k = self._model.array.positions_m, self._model.wavenumber
        fit = MistakeFit(positions, k, phases, places, self._steps)
        solved = fit.solved(self._found - places if shift else None, speed=speed)
        parts = what.parts
        if speed:
            parts += ((Defect.SPEED, self._speed_text(solved.share)),)
        if shift:
            parts += ((Defect.AXES, self._shift_text(solved.shift_m)),)
        return fit.misfit(solved), parts

    def _speed_text(self, share: float) -> str:
        """Return the sound speed that the client assumes, and the air that would have it."""
        here = self._model.medium.sound_speed_m_s
        assumed = here / (1.0 + share)
        air_c = air_temperature_c(assumed)
        return (
            f"the client assumes {assumed:.1f} m/s, air of {air_c:.1f} C (--temperature-c "
            f"{air_c:.1f}); the air has {here:.1f} m/s"
        )

    def _shift_text(self, shift_m: FloatArray) -> str:
        """Return a shift in mm along the client's axes."""
        values = (round(_MM * value, 1) + 0.0 for value in shift_m @ self._axes)
        return f"shifted by ({', '.join(f'{value:.1f}' for value in values)}) mm"


def _sorted(
    scored: list[tuple[float, tuple[Part, ...]]],
) -> list[tuple[float, tuple[Part, ...]]]:
    """Return the hypotheses by score, the best first."""
    return sorted(scored, key=lambda item: item[0])


def _key(parts: tuple[Part, ...]) -> tuple[tuple[Defect, str], ...]:
    """Return the defects and their kinds as a key, without figures."""
    return tuple((d, "" if d in (Defect.AXES, Defect.SPEED) else text) for d, text in parts)

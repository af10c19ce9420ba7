"""Defects by name from the phases that came and the foci that were expected.

A hypothesis says which phases a mistake would have made. One is named if it alone explains the
phases of nearly all frames: no mistake at all does not, no other simple one comes near, and no two
are needed where one suffices.

Its fit has one speed of sound and one shift for all frames: phi_tn + k (1 + s) |x_t + d - r_n| =
psi_t, with a share s by which the wave number of the client is higher, a shift d of all places,
and a common phase psi of each frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import BoolArray, FloatArray
from haptogram.acoustics.model.medium import air_temperature_c
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.reconstruct.patterns.chance import log_chance
from haptogram.acoustics.solvers.focus_fit import wrapped_phases

from .defect import Defect, Diagnosis
from .rearrangements import Part, Rearrangement

_MOST_SPEED: Final = 0.045
_SPEEDS: Final = np.linspace(-0.04, 0.04, 9)
_MOST_SHIFT_M: Final = 0.03
_PROBES: Final = 3  # frames that say whether a hypothesis is worth a fit
_AGREE: Final = 0.6  # least agreement of the phases for a fit to begin
_ROUNDS: Final = 6
_FRAMES: Final = 0.8  # share of the frames that a mistake must explain
_ELEMENTS: Final = 0.8  # share of the elements of a frame that a mistake must explain
_WORST: Final = 2.4  # largest misfit of one frame, relative to that of all
_SEEN: Final = 1e-5  # least singular value of the slopes, relative to the largest
_CERTAIN: Final = math.log(1e-7)  # log of the chance: 1 in 10 000, for 1000 hypotheses
UNKNOWNS: Final = 4  # unknowns of a frame with a focus of its own: a place, and the speed of sound


@dataclass(frozen=True, eq=False, slots=True)
class MistakeParameters:
    """Assumptions of a client; *is_near* is False if nothing comes near the phases."""

    share: float
    shift_m: FloatArray
    is_near: bool = True


class MistakeFit:
    """Phases of all frames against the places that a hypothesis says.

    Parameters
    ----------
    positions_m : (N, 3) numpy.ndarray
        Elements.
    wavenumber : float
        In the air, rad/m.
    phases_rad : (T, N) numpy.ndarray
        Of each frame, not a number where an element is silent.
    places_m : (T, 3) numpy.ndarray
        Where the foci should be.
    steps_rad : (T,) numpy.ndarray
        Steps of the phases.
    """

    def __init__(
        self,
        positions_m: FloatArray,
        wavenumber: float,
        phases_rad: FloatArray,
        places_m: FloatArray,
        steps_rad: FloatArray,
    ) -> None:
        self._positions, self._k = positions_m, wavenumber
        self._sounding = np.isfinite(phases_rad)
        self._phases = np.where(self._sounding, phases_rad, 0.0)
        self._places, self._steps = places_m, steps_rad

    def solved(self, offsets_m: FloatArray | None, *, speed: bool) -> MistakeParameters:
        """Return the best share and shift.

        Parameters
        ----------
        offsets_m : (T, 3) numpy.ndarray or None
            From each place to the focus that was found, not a number where none was; None: there is
            no shift.
        speed : bool
            Whether the share is fitted, or 0.
        """
        shift = np.zeros(3)
        if offsets_m is not None:
            seen = offsets_m[np.isfinite(offsets_m).all(axis=1)]
            if not len(seen) or np.linalg.norm(np.median(seen, axis=0)) > _MOST_SHIFT_M:
                return MistakeParameters(0.0, shift, is_near=False)
            shift = np.median(seen, axis=0)
        shares = _SPEEDS if speed else np.zeros(1)
        agrees = [self._agreement(share, shift) for share in shares]
        share = float(shares[int(np.argmax(agrees))])
        if max(agrees) < _AGREE:
            return MistakeParameters(share, shift, is_near=False)
        if not speed and offsets_m is None:
            return MistakeParameters(share, shift)
        return self._settled(share, shift, free=(speed, offsets_m is not None))

    def misfit(self, found: MistakeParameters) -> float:
        """Return by how many standard deviations of rounding the places are off.

        What each frame's own best place and speed of sound would still explain is what the
        hypothesis does not; infinite where the phases are no focus, or where chance may look alike.
        """
        if not found.is_near:
            return math.inf
        residual = self._residual(found.share, found.shift_m)
        used = self._used(residual)
        limits = self._steps / 2.0
        rms = np.sqrt((residual**2 * used).sum(axis=1) / np.maximum(used.sum(axis=1), 1))
        share = used.sum(axis=1) / np.maximum(self._sounding.sum(axis=1), 1)
        right = (rms <= limits + 1e-6) & (share >= _ELEMENTS)
        if right.mean() < _FRAMES or not self._is_beyond_chance(used, rms, right):
            return math.inf
        frames = np.flatnonzero(right).tolist()
        squares = [self._unexplained_variance(t, residual[t], used[t], found) for t in frames]
        worst = math.sqrt(max(squares)) / _WORST
        return max(math.sqrt(math.fsum(squares) / len(squares)), worst)

    def residual_of_focus(self) -> FloatArray | None:
        """Return (N,) what the phases of the one frame are off; None if most are not its focus."""
        none = MistakeParameters(0.0, np.zeros(3))
        residual = self._residual(none.share, none.shift_m)
        is_focus = math.isfinite(self.misfit(none))
        return np.where(self._sounding, residual, np.nan)[0] if is_focus else None

    def _unexplained_variance(
        self, frame: int, residual: FloatArray, used: BoolArray, found: MistakeParameters
    ) -> float:
        """Return how much of a frame's phase errors another place and speed could still explain.

        *residual* (N,) has the errors in rad, *found* the place and speed so far. The unit is the
        variance by rounding, for each unknown that is fitted: 1 is what rounding alone leaves.
        """
        slopes = self._slopes(frame, found)[used]
        slopes = slopes - slopes.mean(axis=0)
        size = np.maximum(np.linalg.norm(slopes, axis=0), 1e-12)
        left, values, _ = np.linalg.svd(slopes / size, full_matrices=False)
        kept = left[:, values > _SEEN * values[0]]
        explained = kept.T @ (residual[used] - residual[used].mean())
        variance = self._steps[frame] ** 2 / 12.0
        return float(explained @ explained / variance / kept.shape[1])

    def _is_beyond_chance(self, used: BoolArray, rms: FloatArray, right: BoolArray) -> bool:
        """Return True if chance makes phases fit so well in less than 1 of 10 million cases.

        Counted are the frames of the mask *right* (T,), with elements *used* (T, N) and errors
        *rms* (T,) in rad.
        """
        chances = [
            log_chance(int(self._sounding[t].sum()), int(used[t].sum()), rms[t], step, UNKNOWNS)
            for t, step in enumerate(self._steps)
            if right[t]
        ]
        return bool(sum(chances) <= _CERTAIN)

    def _distances(self, shift: FloatArray) -> FloatArray:
        """Return (T, N) from each focus moved by *shift* (3,) to each element, in m."""
        gaps = (self._places + shift)[:, None, :] - self._positions
        distances: FloatArray = np.linalg.norm(gaps, axis=2)
        return distances

    def _agreement(self, share: float, shift: FloatArray) -> float:
        """Return the median phase coherence, 0 to 1, of the first 3 frames.

        *share* is the error of the wavenumber, *shift* (3,) that of the foci in m.
        """
        few = slice(0, _PROBES)
        distances = self._distances(shift)[few]
        waves = np.exp(1j * (self._phases[few] + self._k * (1.0 + share) * distances))
        sounding = self._sounding[few]
        sums = np.abs((waves * sounding).sum(axis=1)) / np.maximum(sounding.sum(axis=1), 1)
        return float(np.median(sums))

    def _residual(self, share: float, shift: FloatArray) -> FloatArray:
        """Return (T, N) phase errors in rad, against foci that are moved by *shift* (3,) in m.

        The wavenumber is larger by *share* (0.01: 1 %); what all elements of a frame have in common
        is taken away.
        """
        arrival = self._phases + self._k * (1.0 + share) * self._distances(shift)
        common = np.angle((np.exp(1j * arrival) * self._sounding).sum(axis=1))
        residual: FloatArray = wrapped_phases(arrival - common[:, None])
        used = self._used(residual)
        mean = (residual * used).sum(axis=1) / np.maximum(used.sum(axis=1), 1)
        residual = residual - mean[:, None]
        return residual

    def _used(self, residual: FloatArray) -> BoolArray:
        """Return a mask (T, N) of elements that sound and are no outliers.

        An outlier is off by over a phase step, and over 3 times the median of its frame.
        """
        deviation = np.where(self._sounding, np.abs(residual), np.nan)
        middle = np.nanmedian(deviation, axis=1) if len(deviation) else np.zeros(0)
        limit = np.maximum(self._steps, 3.0 * middle)
        return self._sounding & (np.abs(residual) <= limit[:, None] + 1e-6)

    def _settled(
        self, share: float, shift: FloatArray, free: tuple[bool, bool]
    ) -> MistakeParameters:
        """Return speed error and shift (m) after 6 Gauss-Newton steps from *share* and *shift*.

        *free* tells which of both are fitted. Once they exceed 4.5 % or 30 mm the fit stops, and
        its result is marked with is_near False.
        """
        columns = [*([0] if free[0] else []), *([1, 2, 3] if free[1] else [])]
        for _ in range(_ROUNDS):
            found = MistakeParameters(share, shift)
            residual = self._residual(share, shift)
            used = self._used(residual)
            rows, wanted = [], []
            for frame, mask in enumerate(used):
                slopes = self._slopes(frame, found)[mask]
                rows.append((slopes - slopes.mean(axis=0))[:, columns])
                wanted.append(residual[frame][mask] - residual[frame][mask].mean())
            matrix = np.concatenate(rows)
            size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
            step = np.zeros(4)
            step[columns] = (
                -np.linalg.lstsq(matrix / size, np.concatenate(wanted), rcond=1e-6)[0] / size
            )
            share, shift = share + float(step[0]), shift + step[1:]
            if abs(share) > _MOST_SPEED or np.linalg.norm(shift) > _MOST_SHIFT_M:
                return MistakeParameters(share, shift, is_near=False)
        return MistakeParameters(share, shift)

    def _slopes(self, frame: int, found: MistakeParameters) -> FloatArray:
        """Return (N, 4) the change of each phase in rad with *share* and with x, y, z in m."""
        gaps = self._places[frame] + found.shift_m - self._positions
        distances = np.linalg.norm(gaps, axis=1)
        rays = gaps / np.maximum(distances, 1e-9)[:, None]
        return self._k * np.column_stack([distances, (1.0 + found.share) * rays])


# --- Mistakes of a client ------------------------------------------------------------------------


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
            is_focus = np.isfinite(self._found).all(axis=1).mean() > 0.5
            is_simple = not is_focus and len(parts) == 1  # a mistake without foci
            is_enough = is_simple or self._distinct >= LEAST_TARGETS
            return Diagnosis(defect, detail + more, ()) if is_enough else None
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
        """Return True if the hypothesis of score *best* rules out the one of score *rival*.

        It does if *rival* is at least 2.5 times *best*, and 4. Where *best* is mere rounding (up to
        1.3), 6 standard deviations between them also do.
        """
        unlikely = math.sqrt(UNKNOWNS * len(self._targets) * max(0.0, rival**2 - best**2))
        is_clear = best <= _IS_NOISE and unlikely >= _BETTER
        return is_clear or rival >= max(_MARGIN * best, _LEAST_RIVAL)

    def _levels(self) -> Iterator[list[tuple[float, tuple[Part, ...]]]]:
        """Yield scores of hypotheses of one mistake, then of two, each sorted by score.

        Nothing if the phases are explained without a mistake.
        """
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
        """Return the score of a hypothesis on the client's mistake, and the names of its parts.

        The score is how far the phases are off it, in standard deviations of rounding. *what* is a
        rearrangement, such as of channels, sign or axes; *speed*, *shift*: another speed of sound,
        another origin are fitted too.
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
            shifts = (round(_MM * value, 1) + 0.0 for value in solved.shift_m @ self._axes)
            shift_text = f"shifted by ({', '.join(f'{value:.1f}' for value in shifts)}) mm"
            parts += ((Defect.AXES, shift_text),)
        return fit.misfit(solved), parts

    def _speed_text(self, share: float) -> str:
        """Return the text on the sound speed that the client assumes: the real / (1 + *share*)."""
        here = self._model.medium.sound_speed_m_s
        assumed = here / (1.0 + share)
        air_c = air_temperature_c(assumed)
        return (
            f"the client assumes {assumed:.1f} m/s, air of {air_c:.1f} C (--temperature-c "
            f"{air_c:.1f}); the air has {here:.1f} m/s"
        )


def _sorted(
    scored: list[tuple[float, tuple[Part, ...]]],
) -> list[tuple[float, tuple[Part, ...]]]:
    """Return the hypotheses by score, the best first."""
    return sorted(scored, key=lambda item: item[0])


def _key(parts: tuple[Part, ...]) -> tuple[tuple[Defect, str], ...]:
    """Return the (defect, text) pairs without figures, so that equal mistakes compare equal.

    Text is "" for shifted axes and speed of sound, which have figures.
    """
    return tuple((d, "" if d in (Defect.AXES, Defect.SPEED) else text) for d, text in parts)

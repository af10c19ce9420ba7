"""The fit of one hypothesis to the phases of a run: a speed of sound and a shift, for all frames.

phi_tn + k (1 + s) |x_t + d - r_n| = psi_t: a share s by which the client's wave number is higher, a
shift d of all places, and a common phase psi of each frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import BoolArray, FloatArray
from haptogram.acoustics.reconstruct.patterns.chance import log_chance
from haptogram.acoustics.solvers.focus_fit import wrapped_phases

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
        """Return the part of a frame's residual that place and speed still explain, normalised."""
        slopes = self._slopes(frame, found)[used]
        slopes = slopes - slopes.mean(axis=0)
        size = np.maximum(np.linalg.norm(slopes, axis=0), 1e-12)
        left, values, _ = np.linalg.svd(slopes / size, full_matrices=False)
        kept = left[:, values > _SEEN * values[0]]
        explained = kept.T @ (residual[used] - residual[used].mean())
        variance = self._steps[frame] ** 2 / 12.0
        return float(explained @ explained / variance / kept.shape[1])

    def _is_beyond_chance(self, used: BoolArray, rms: FloatArray, right: BoolArray) -> bool:
        """Return True if the agreement of the right frames is unlikely by chance."""
        chances = [
            log_chance(int(self._sounding[t].sum()), int(used[t].sum()), rms[t], step, UNKNOWNS)
            for t, step in enumerate(self._steps)
            if right[t]
        ]
        return bool(sum(chances) <= _CERTAIN)

    def _distances(self, shift: FloatArray) -> FloatArray:
        """Return (frames, elements) from each focus moved by *shift* to each element, in m."""
        gaps = (self._places + shift)[:, None, :] - self._positions
        distances: FloatArray = np.linalg.norm(gaps, axis=2)
        return distances

    def _agreement(self, share: float, shift: FloatArray) -> float:
        """Return the median over frames of their phase coherence, 0 to 1."""
        few = slice(0, _PROBES)
        distances = self._distances(shift)[few]
        waves = np.exp(1j * (self._phases[few] + self._k * (1.0 + share) * distances))
        sounding = self._sounding[few]
        sums = np.abs((waves * sounding).sum(axis=1)) / np.maximum(sounding.sum(axis=1), 1)
        return float(np.median(sums))

    def _residual(self, share: float, shift: FloatArray) -> FloatArray:
        """Return phase errors at foci moved by *shift* in air whose wavenumber is 1 + *share*."""
        arrival = self._phases + self._k * (1.0 + share) * self._distances(shift)
        common = np.angle((np.exp(1j * arrival) * self._sounding).sum(axis=1))
        residual: FloatArray = wrapped_phases(arrival - common[:, None])
        used = self._used(residual)
        mean = (residual * used).sum(axis=1) / np.maximum(used.sum(axis=1), 1)
        residual = residual - mean[:, None]
        return residual

    def _used(self, residual: FloatArray) -> BoolArray:
        """Return a mask of elements that sound and whose residual is not an outlier."""
        deviation = np.where(self._sounding, np.abs(residual), np.nan)
        middle = np.nanmedian(deviation, axis=1) if len(deviation) else np.zeros(0)
        limit = np.maximum(self._steps, 3.0 * middle)
        used: BoolArray = self._sounding & (np.abs(residual) <= limit[:, None] + 1e-6)
        return used

    def _settled(
        self, share: float, shift: FloatArray, free: tuple[bool, bool]
    ) -> MistakeParameters:
        """Return speed error and shift after some Gauss-Newton steps; *free*: which may change."""
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
        """Return (N, 4) the change of each phase with *share* and with the three coordinates."""
        gaps = self._places[frame] + found.shift_m - self._positions
        distances = np.linalg.norm(gaps, axis=1)
        rays = gaps / np.maximum(distances, 1e-9)[:, None]
        slopes: FloatArray = self._k * np.column_stack([distances, (1.0 + found.share) * rays])
        return slopes

"""From a drive back to the focus that it makes: no target and no wire enter here.

A drive is a single focus if one point explains the phase of every active element to within half a
step of the phase code, in the root mean square. A correct drive never fails this: the target itself
leaves at most half a step on each element, and the fit can only do better.

Where numba is installed, the compiled search of :mod:`.tracking` says where to start. What is
answered comes from the fit in double precision all the same: where one point alone explains the
phases, positions with and without numba agree to a nanometre. A few elements, or few bits, can suit
several points, and which of them is found depends on where the search began. The force comes from
the fast field engine (1e-4 of it).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import takewhile
from typing import Final, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics.arrays import BoolArray, ComplexArray, FloatArray
from haptogram.acoustics.field.engines.compiled import load_kernels
from haptogram.acoustics.field.engines.engine import choose_engine
from haptogram.acoustics.field.reference import FieldEngine, arrival_at_point, points_in_front
from haptogram.acoustics.levels.force import ReflectingDisc, level_db_spl
from haptogram.acoustics.model.drive import (
    MAX_PHASE_BITS,
    REGISTER_BITS,
    Drive,
    as_weights,
    check_phase_bits,
    phase_step_rad,
    quantise_phase,
)
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.reconstruct.acquisition import HOPELESS_RAD, FocusAcquisition
from haptogram.acoustics.reconstruct.estimates import (
    NoFocus,
    NotSingle,
    Reconstruction,
    SingleFocus,
    as_vector,
)
from haptogram.acoustics.reconstruct.tracking import FocusTracker
from haptogram.acoustics.reconstruct.warm import (
    CLEARANCE_M,
    COARSE_RAD,
    REACH_M,
    DriveToFind,
    WarmReconstructor,
    quick_limits_rad,
)
from haptogram.acoustics.solvers.focus import focus_target_heights_m
from haptogram.acoustics.solvers.focus_fit import PhaseFit, fit_focus
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_number
from haptogram.settings.frozen import dataclass

_Found = TypeVar("_Found")
_MIN_TRACKED: Final = 4
_AT_ONCE: Final = 512  # drives of a call of compiled code
_SILENT: Final = 1e-6  # largest amplitude of a silent element; far below half an amplitude step
_MAX_STARTS: Final = 12
_TRIM_ROUNDS: Final = 6
_MIN_AGREEING: Final = 8  # twice the unknowns: fewer would agree on some point by chance
_MAX_RIVAL_STARTS: Final = 48
_EQUAL: Final = 3.0  # standard deviations of what rounding leaves


@dataclass(frozen=True, eq=False, slots=True)
class _ReconstructedDrive:
    """A complex drive, and the inputs of its fit."""

    weights: ComplexArray
    phases_rad: FloatArray
    active: BoolArray
    step_rad: float
    codes: NDArray[np.uint8] | None  # of 8 bits; None if some that can be heard are silent
    slack_rad: float

    @property
    def limit_rad(self) -> float:
        """Half a phase step, and the slack: the largest RMS residual of a drive that focuses."""
        return self.step_rad / 2.0 + 1e-9 + self.slack_rad


class Reconstructor:
    """Reconstructs the focus of drive after drive of one array.

    It remembers the last focus and starts there; the first drive, and any that jumped too far, is
    searched for in the whole volume that :func:`check_focus_target` lets through.

    Parameters
    ----------
    model : AcousticModel
        The array and the medium that the drives act in.
    phase_bits : int, optional
        Resolution of the phases of complex weights, by default 8 bits; a `Drive` of fewer bits, or
        without this one, counts by its own.
    engine : FieldEngine, optional
        Engine that computes the field on the disc; by default the fastest for the model.

    Examples
    --------
    >>> found = Reconstructor(model).reconstruct(drive)
    >>> type(found).__name__, [round(1e3 * value, 1) + 0.0 for value in found.position_m]
    ('SingleFocus', [0.0, 0.0, 150.0])
    """

    def __init__(
        self,
        model: AcousticModel,
        phase_bits: int | None = None,
        engine: FieldEngine | None = None,
    ) -> None:
        self._model = model
        self._phase_bits = None if phase_bits is None else check_phase_bits(phase_bits)
        self._engine = choose_engine(model) if engine is None else engine
        self._disc = ReflectingDisc(self._engine)
        self._heard = None if model.calibration is None else model.calibration.heard
        self._heard_count = model.array.count if self._heard is None else int(self._heard.sum())
        self._acquisition: FocusAcquisition | None = None
        self._last_focus: FloatArray | None = None
        self._at_once = 1

    def warm_up(self) -> None:
        """Prepare search volumes and machine code, for which the first drive would wait."""
        tracker = self._tracker
        if tracker is None:
            self._acquisition_for(np.ones(self._model.array.count, dtype=np.bool_))
        else:
            tracker.warm_up()
        ahead = self._model.array.world_m(np.array([0.0, 0.0, 0.1]))
        if self._warm is not None:
            self._warm.warm_up(ahead)
        self._disc.force_n(np.ones(self._model.array.count), ahead)

    def reset(self) -> None:
        """Forget the last focus: the next drive is searched for."""
        self._last_focus = None

    def reconstruct(self, drive: Drive) -> Reconstruction:
        """Return the focus of *drive*.

        Raises
        ------
        ConfigurationError
            The drive is not one of this array.
        """
        if drive.count != self._model.array.count:
            raise ConfigurationError(
                f"drive of {drive.count}, array of {self._model.array.count} elements"
            )
        (found,) = self.reconstruct_all([DriveToFind(drive, self.step_rad(drive.phase_bits))])
        return found

    def step_rad(self, bits: int, commanded_bits: int | None = None) -> float:
        """Return the step by which phases of *bits* are judged, once as coarse as commanded."""
        coarser = (known or MAX_PHASE_BITS for known in (self._phase_bits, commanded_bits))
        return phase_step_rad(min(bits, *coarser))

    def reconstruct_all(self, asked: Sequence[DriveToFind]) -> list[Reconstruction]:
        """Return the foci of drives of this array, as one call of :meth:`reconstruct` for each.

        Those that are beside the one before are found at once, in compiled code where it serves.
        """
        return self._all_of(asked, self.reconstruct_weights)

    def reconstruct_all_quickly(self, asked: Sequence[DriveToFind]) -> list[Reconstruction | None]:
        """Return those foci; None as of :meth:`reconstruct_quickly`."""
        return self._all_of(asked, self.reconstruct_quickly)

    def _all_of(
        self, asked: Sequence[DriveToFind], reconstruct: Callable[..., _Found]
    ) -> list[Reconstruction | _Found]:
        """Return the field of each drive: foci near the last one at once, others one by one.

        *reconstruct* finds the others; a muted drive is NoFocus.
        """
        found: list[Reconstruction | _Found] = []
        while len(found) < len(asked):
            beside = self._foci_beside_last(asked[len(found) : len(found) + self._at_once])
            found += beside
            # Where one has jumped the next one may: not to prepare many in vain.
            self._at_once = min(_AT_ONCE, 2 * self._at_once) if beside else 1
            if not beside:
                drive, step_rad, slack_rad = asked[len(found)]
                how, muted = {"step_rad": step_rad, "slack_rad": slack_rad}, drive.is_muted
                found.append(NoFocus("muted") if muted else reconstruct(drive.weights(), **how))
        return found

    def _foci_beside_last(self, asked: Sequence[DriveToFind]) -> list[SingleFocus]:
        """Return foci of the first drives, each found from the one before, until that fails.

        An empty list if the first fails, or there is no focus before.
        """
        warm = self._warm
        if warm is None or self._last_focus is None:
            return []
        some = list(takewhile(warm.serves, asked))
        if not some:
            return []
        foci = warm.foci(some, self._last_focus)
        if foci:
            self._last_focus = np.array(foci[-1].position_m)
        return foci

    @cached_property
    def _warm(self) -> WarmReconstructor | None:
        """Return the compiled reconstructor that starts at the last focus; None if unavailable."""
        if self.why_not_compiled is not None or self._tracker is None:
            return None
        return WarmReconstructor(self._model, self._disc, self._tracker)

    @cached_property
    def why_not_compiled(self) -> str | None:
        """Reason why no focus is found in compiled code; None: it is, beside the last one."""
        return WarmReconstructor.why_not(self._model, self._disc)

    def reconstruct_weights(
        self,
        weights: ArrayLike,
        *,
        step_rad: float | None = None,
        slack_rad: float = 0.0,
    ) -> Reconstruction:
        """Return the focus of (N,) complex *weights*: a drive after correction, ceiling, faults.

        Parameters
        ----------
        step_rad : float, optional
            Step of the phases to judge by, in radians, if they are not of `phase_bits`.
        slack_rad : float
            RMS residual that a focus may leave on top of half a phase step, in radians.

        Raises
        ------
        ConfigurationError
            Weights that are not finite or not one per element, or a step that is not within
            pi and a millionth of it.
        """
        if step_rad is None:
            step_rad = phase_step_rad(self._phase_bits or REGISTER_BITS)
        radiated = self._as_radiated_drive(weights, step_rad, slack_rad)
        if isinstance(radiated, NoFocus):
            return radiated
        found, tried = self._locate_quickly(radiated)
        return self._search(tried, radiated) if found is None else found

    def reconstruct_quickly(
        self, weights: ArrayLike, *, step_rad: float, slack_rad: float = 0.0
    ) -> Reconstruction | None:
        """Return the focus that the compiled search or the last focus leads to.

        None: only the search from every place of the volume would tell, which takes a hundred times
        as long where there is no focus. Parameters and errors are those of
        :meth:`reconstruct_weights`.
        """
        radiated = self._as_radiated_drive(weights, step_rad, slack_rad)
        return radiated if isinstance(radiated, NoFocus) else self._locate_quickly(radiated)[0]

    def _best_of_rivals(
        self, here: PhaseFit, radiated: _ReconstructedDrive
    ) -> tuple[PhaseFit, list[FloatArray]]:
        """Return the best fit of a focus, and other places (3,), in m, that fit equally well.

        Rounding to a step leaves a twelfth of its square in the mean square, with a deviation of
        sqrt(1 / 180 / N); fits within three deviations above count as equal. *here* is the first
        fit.
        """
        active, step_rad = radiated.active, radiated.step_rad
        others = self._acquisition_for(active).fits(
            radiated.phases_rad, active, step_rad, _MAX_RIVAL_STARTS
        )
        fits = [here, *(fit for fit in others if self._explains(fit, radiated))]
        fits.sort(key=lambda fit: fit.residual_rms_rad)
        spread = _EQUAL * math.sqrt(1.0 / (180.0 * np.count_nonzero(active)))
        limit_rad = step_rad * math.sqrt(1.0 / 12.0 + spread) + radiated.slack_rad
        best, *equal = fits
        rivals: list[FloatArray] = []
        for fit in equal:
            known = (best.position_m, *rivals)
            apart_m = min(float(np.linalg.norm(fit.position_m - place)) for place in known)
            if fit.residual_rms_rad <= limit_rad and apart_m > self._model.wavelength_m / 4.0:
                rivals.append(fit.position_m)
        return best, rivals

    def _as_radiated_drive(
        self, given: ArrayLike, step_rad: float, slack_rad: float
    ) -> _ReconstructedDrive | NoFocus:
        """Return phases and active elements of weights (N,); NoFocus if none exceeds 1e-6.

        *step_rad*: the step of the phases; *slack_rad*: RMS residual that a focus may leave beyond
        half of it.
        """
        check_number("step_rad", step_rad, 1e-6 * math.pi, math.pi)
        weights = as_weights(given)
        if weights.shape != (self._model.array.count,):
            raise ConfigurationError(
                f"drive has shape {weights.shape}, array has {self._model.array.count} elements"
            )
        active = np.abs(weights) > _SILENT
        if self._heard is not None:
            active &= self._heard
        if not active.any():
            return NoFocus("zero amplitude")
        phases = np.angle(weights)
        everything = np.count_nonzero(active) == self._heard_count
        codes = quantise_phase(phases, REGISTER_BITS).astype(np.uint8) if everything else None
        return _ReconstructedDrive(weights, phases, active, step_rad, codes, slack_rad)

    def _locate_quickly(
        self, radiated: _ReconstructedDrive
    ) -> tuple[Reconstruction | None, list[PhaseFit]]:
        """Return the focus by compiled search or from the last one, or None; and fits tried."""
        start, way = self._quick_search(radiated)
        if start is not None:
            fit = self._fit(radiated, start, radiated.active)
            if self._explains(fit, radiated):
                return self._as_focus(fit, radiated, way), []
        tried: list[PhaseFit] = []
        if self._last_focus is not None:
            tried.append(self._fit(radiated, self._last_focus, radiated.active))
            if self._explains(tried[0], radiated):
                return self._as_focus(tried[0], radiated, "warm"), tried
            jumped = self._acquisition_for(radiated.active).widening_fit(
                radiated.phases_rad, radiated.active, radiated.step_rad, self._last_focus
            )
            if self._explains(jumped, radiated):
                return self._as_focus(jumped, radiated, "warm"), tried
            partial = self._fit_most(tried[0], radiated)
            if partial is not None:
                return self._all_or_most(partial, radiated), tried
        return None, tried

    @cached_property
    def _tracker(self) -> FocusTracker | None:
        """The compiled search; None without numba, or with fewer than four elements."""
        if load_kernels() is None or self._heard_count < _MIN_TRACKED:
            return None
        return FocusTracker(self._model)

    def _quick_search(
        self, radiated: _ReconstructedDrive
    ) -> tuple[FloatArray | None, Literal["warm", "global"]]:
        """Return the focus by compiled code, or None; "warm" if it started at the last focus."""
        if self._tracker is None or radiated.codes is None:
            return None, "global"
        limit_rad = float(quick_limits_rad(radiated.limit_rad))
        if self._last_focus is not None:
            fix = self._tracker.fit(radiated.codes, as_vector(self._last_focus))
            if self._tracker.explains(fix, limit_rad):
                return np.array(fix.position_m), "warm"
        fix = self._tracker.acquire(radiated.codes, limit_rad)
        found = self._tracker.explains(fix, limit_rad)
        return (np.array(fix.position_m) if found else None), "global"

    def _search(self, tried: list[PhaseFit], radiated: _ReconstructedDrive) -> Reconstruction:
        """Return a focus of all elements, found in the whole volume; else a NotSingle.

        That is of most elements, with the others as outliers, or of none. *tried*: fits that failed
        before; those that fail here are added.
        """
        acquisition = self._acquisition_for(radiated.active)
        for fit in acquisition.fits(
            radiated.phases_rad, radiated.active, radiated.step_rad, _MAX_STARTS
        ):
            if self._explains(fit, radiated):
                return self._as_focus(fit, radiated, "global")
            tried.append(fit)
        # Only when no start explains all elements may some be wrong: from a bad start, a correct
        # drive looks like one with outliers.
        for fit in tried:
            partial = self._fit_most(fit, radiated)
            if partial is not None:
                return self._all_or_most(partial, radiated)
        starts = acquisition.starts(radiated.phases_rad, radiated.active)[:_MAX_STARTS]
        return self._not_single(tried, starts, radiated)

    def _all_or_most(self, partial: PhaseFit, radiated: _ReconstructedDrive) -> Reconstruction:
        """Return a focus of all elements; else *partial* as not single, with its outliers."""
        whole = self._fit(radiated, partial.position_m, radiated.active)
        if self._explains(whole, radiated):
            return self._as_focus(whole, radiated, "global")
        return self._mostly_single(partial, radiated)

    def _acquisition_for(self, active: BoolArray) -> FocusAcquisition:
        """Return the search volume; a new one if the drive leaves the array's middle silent.

        Silent means over half of the elements of its first fit.
        """
        if self._acquisition is None:
            everything = np.ones(self._model.array.count, dtype=np.bool_)
            self._acquisition = FocusAcquisition(self._model, everything)
        if active[self._acquisition.subarray].mean() < 0.5:
            self._acquisition = FocusAcquisition(self._model, active)
        return self._acquisition

    def _fit(self, radiated: _ReconstructedDrive, start: FloatArray, used: BoolArray) -> PhaseFit:
        """Fit a focus to the phases of the elements *used*, from *start*."""
        return fit_focus(
            self._model, radiated.phases_rad, start, step_rad=radiated.step_rad, active=used
        )

    def _fit_most(self, fit: PhaseFit, radiated: _ReconstructedDrive) -> PhaseFit | None:
        """Return a fit that tolerates some outlier elements; None if there is none.

        Elements beyond both twice the drive's RMS limit and 3 times the median residual are left
        out, and the fit is done again, up to 6 times. None as well if fewer than 8 elements would
        stay.
        """
        if fit.residual_rms_rad > HOPELESS_RAD:
            return None
        for _ in range(_TRIM_ROUNDS):
            deviation = np.abs(fit.residual_rad)
            typical = float(np.median(deviation[radiated.active]))
            used = radiated.active & (deviation <= max(2.0 * radiated.limit_rad, 3.0 * typical))
            if used.sum() < _MIN_AGREEING:
                return None
            fit = self._fit(radiated, fit.position_m, used)
            if self._explains(fit, radiated):
                return fit
        return None

    def _explains(self, fit: PhaseFit, radiated: _ReconstructedDrive) -> bool:
        """Return True if the RMS residual is within the drive's limit and a focus can be there."""
        return fit.residual_rms_rad <= radiated.limit_rad and self._is_reachable(fit.position_m)

    def _is_reachable(self, position: FloatArray) -> bool:
        """Return True if a focus can be at *position*: in front, and in reach of the array.

        It is 15 mm to 1.25 m from the nearest element.
        """
        array = self._model.array
        offsets = array.positions_m - position
        nearest = math.sqrt(np.einsum("ni,ni->n", offsets, offsets).min())
        height_m = float(array.axes[2] @ (position - array.centre_m))
        low_m = min(0.0, focus_target_heights_m(array)[0])
        above = height_m > low_m and CLEARANCE_M <= nearest <= REACH_M
        return bool(above and points_in_front(self._model, position[None])[0])

    def _as_focus(
        self, fit: PhaseFit, radiated: _ReconstructedDrive, acquired: Literal["warm", "global"]
    ) -> SingleFocus:
        """Return a fit as a focus, with pressure and force there; the next search starts at it."""
        rivals: list[FloatArray] = []
        if radiated.step_rad >= COARSE_RAD:
            fit, rivals = self._best_of_rivals(fit, radiated)
        self._last_focus = fit.position_m
        pressure, coherence = arrival_at_point(self._model, radiated.weights, fit.position_m)
        return SingleFocus(
            position_m=as_vector(fit.position_m),
            std_m=as_vector(fit.std_m),
            bound_m=as_vector(fit.bound_m),
            observable=(bool(fit.observable[0]), bool(fit.observable[1]), bool(fit.observable[2])),
            residual_rms_rad=fit.residual_rms_rad,
            coherence=coherence,
            pressure_rms_pa=pressure,
            level_db_spl=level_db_spl(pressure),
            force_n=self._force_n(radiated.weights, fit.position_m),
            acquired=acquired,
            rivals_m=tuple(map(as_vector, rivals)),
        )

    def _force_n(self, weights: ComplexArray, position: FloatArray) -> float:
        """Return the force (N) on a disc around a focus; infinite where it leaves the field."""
        try:
            return self._disc.force_n(weights, position)
        except ConfigurationError:  # low beside the array: the disc reaches behind it
            return math.inf

    def _mostly_single(self, fit: PhaseFit, radiated: _ReconstructedDrive) -> NotSingle:
        """Return a fit to most elements as not a single focus, with its outlier elements."""
        self._last_focus = fit.position_m
        residual = fit.residual_rad[radiated.active]
        pressure, coherence = arrival_at_point(self._model, radiated.weights, fit.position_m)
        wrong = radiated.active & (np.abs(fit.residual_rad) > 2.0 * radiated.limit_rad)
        return NotSingle(
            residual_rms_rad=math.sqrt(float(np.mean(residual**2))),
            position_m=as_vector(fit.position_m),
            pressure_rms_pa=pressure,
            coherence=coherence,
            outliers=tuple(int(n) for n in np.flatnonzero(wrong)),
        )

    def _not_single(
        self, tried: list[PhaseFit], starts: list[FloatArray], radiated: _ReconstructedDrive
    ) -> NotSingle:
        """Return a NotSingle at the loudest of *starts* and tried points; with the least residual.

        The residual is the least RMS of the fits *tried*.
        """
        points = [fit.position_m for fit in tried if self._is_reachable(fit.position_m)] + starts
        loudness = np.abs(self._engine.pressure(radiated.weights, np.array(points)))
        loudest = points[int(loudness.argmax())]
        pressure, coherence = arrival_at_point(self._model, radiated.weights, loudest)
        return NotSingle(
            residual_rms_rad=min(fit.residual_rms_rad for fit in tried),
            position_m=as_vector(loudest),
            pressure_rms_pa=pressure,
            coherence=coherence,
        )

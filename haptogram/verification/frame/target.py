"""The demands of a target on the field: computed once, used for every frame of the target."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics import AcousticModel, fit_focus, focus_phases
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.field.reference import propagators
from haptogram.acoustics.levels.shift import focal_shift_covariance
from haptogram.acoustics.model.own_axes import axes_about_normal
from haptogram.acoustics.solvers import focus_fit
from haptogram.errors import ConfigurationError
from haptogram.settings.frozen import dataclass

from ..tolerance import Tolerance, Uncertainty, VerdictUncertainty, tolerance_text
from .peaks import LOST, TURNED_RATIO, ExpectedPeak, FramePeakAxes, expected_frame_peak

Bools = NDArray[np.bool_]

_MM: Final = 1e3
_NEAR: Final = 0.01  # largest bound of the first order, relative to the distance
_SECOND_ORDER: Final = 1.04  # factor on the first-order bound
#: Limits of observable coordinates and their bounds, in the order of the compiled loops.
OBSERVED: Final[FloatArray] = np.array([focus_fit.LEAST_SEEN_SHARE, _NEAR, _SECOND_ORDER, LOST])
_SAME_LINE: Final = 1e-6
_AT_CENTRE_M: Final = 1e-6
_AIRS: Final = 41  # speeds tried between the slowest and the fastest tolerated air
_WIDTH_RAD: Final = 2.0 * 0.831  # -3 dB width of a focus, in radians of phase


@dataclass(frozen=True, eq=False)
class FrameTarget:
    """One focus, in the air and over the array that the frame was really radiated in.

    Attributes
    ----------
    model : AcousticModel
        Array and air.
    position_m : (3,) numpy.ndarray
        The target.
    amplitudes : (N,) numpy.ndarray
        Intended amplitudes, 0 to 1.
    phase_limit_rad : float
        Largest error of a latched phase that is none of the host: half a step, and what a board
        that computes may add.
    tolerance : Tolerance
        Which misses pass on top.
    """

    model: AcousticModel
    position_m: FloatArray
    amplitudes: FloatArray
    phase_limit_rad: float
    tolerance: Tolerance

    @cached_property
    def active(self) -> Bools:
        """(N,) the elements that shall sound and can be heard."""
        calibration = self.model.calibration
        return (self.amplitudes > 0.0) & (True if calibration is None else calibration.heard)

    @cached_property
    def phases_rad(self) -> FloatArray:
        """(N,) the phases that focus on the target."""
        return focus_phases(self.model, self.position_m)

    def drive_of_host(self, off: FloatArray) -> ComplexArray:
        """Return (N,) the weights of a host that is off.

        By *off* (4,): metres along x, y and z, and a share of the speed of sound.
        """
        calibration = self.model.calibration
        lags = 0.0 if calibration is None else calibration.phase_rad
        rays = self.position_m + off[:3] - self.model.array.positions_m
        k = self.model.wavenumber / (1.0 + float(off[3]))
        weights: ComplexArray = np.exp(-1j * (k * np.linalg.norm(rays, axis=1) + lags))
        return weights

    def of_host(self, off: FloatArray, limit_rad: float) -> FrameTarget:
        """Return the demands of the place that such a host takes, in the air that it assumes."""
        if not off.any() and limit_rad == self.phase_limit_rad:
            return self
        speed_m_s = self.model.medium.sound_speed_m_s * (1.0 + float(off[3]))
        return FrameTarget(
            self.model.with_sound_speed(speed_m_s),
            self.position_m + off[:3],
            self.amplitudes,
            limit_rad,
            Tolerance(),
        )

    @cached_property
    def arrivals(self) -> ComplexArray:
        """(N,) peak pressure at the target, of each element at unit weight."""
        arrivals: ComplexArray = propagators(self.model, self.position_m[None, :])[0]
        return arrivals

    @cached_property
    def loudness(self) -> FloatArray:
        """(N,) peak pressure at the target, of each element with its ideal phase.

        Below 0 where the target is in a side lobe of opposite sign, as wide pistons have them.
        """
        loudness: FloatArray = (self.arrivals * np.exp(1j * self.phases_rad)).real
        return loudness

    @property
    def intended_pressure_rms_pa(self) -> float:
        """Pressure at the target, of the intended amplitudes with ideal phases."""
        return abs(float(self.loudness @ self.amplitudes)) / math.sqrt(2.0)

    @cached_property
    def axis(self) -> FloatArray:
        """(3,) unit vector from the centre of the elements that shall sound to the target.

        Each element counts by its intended amplitude. At that centre, which only elements around it
        have, it is the array's own z.
        """
        shares = self.amplitudes / self.amplitudes.sum()
        ray = self.position_m - shares @ self.model.array.positions_m
        length = np.linalg.norm(ray)
        axis: FloatArray = ray / length if length > _AT_CENTRE_M else self.model.array.axes[2]
        return axis

    @property
    def distance_m(self) -> float:
        """Distance from the array's centre, or from the nearest element if that is more."""
        places = np.vstack([self.model.array.centre_m, self.model.array.positions_m])
        distances: list[float] = np.linalg.norm(self.position_m - places, axis=1).tolist()
        centre, *elements = distances
        return max(centre, min(elements))

    # --- the fitted focus (S2) -----------------------------------------------------------------

    @cached_property
    def _response(self) -> tuple[FloatArray, Bools]:
        """Return (3, N) how many m each rad of phase moves the focus, and which of x, y, z show."""
        return focus_fit.focus_phase_response(self.model, self.position_m, active=self.active)

    @property
    def response(self) -> FloatArray:
        """(3, N) displacement of the fitted focus per radian of phase, in m/rad."""
        return self._response[0]

    @cached_property
    def bound_m(self) -> FloatArray:
        """(3,) S2: the largest error per axis that rounding can make; infinite: not observable.

        sum_n |J+_in| times the phase limit, to first order; 4 % more where that is no small
        part of the distance.  A coordinate that rounding may move by 0.4 of the distance is
        not observable.
        """
        response, observable = self._response
        bound_m = np.abs(response).sum(axis=1) * self.phase_limit_rad
        bound_m *= np.where(bound_m > _NEAR * self.distance_m, _SECOND_ORDER, 1.0)
        return np.where(observable & (bound_m < LOST * self.distance_m), bound_m, np.inf)

    def nearest_focus_m(self, phases_rad: FloatArray, active: Bools) -> FloatArray:
        """Return (3,) the offset of the focus that a fit finds from the target on."""
        return self._fit(phases_rad, active).position_m - self.position_m

    def _fit(self, phases_rad: FloatArray, active: Bools) -> focus_fit.PhaseFit:
        """Return the focus near the target that best fits (N,) the phases of *active* elements."""
        return fit_focus(self.model, phases_rad, self.position_m, phase_bits=8, active=active)

    @cached_property
    def observable(self) -> Bools:
        """(3,) whether each coordinate of the focus shows in the phases."""
        return np.isfinite(self.bound_m)

    def errors_mm(self, offset_m: FloatArray) -> dict[str, float | None]:
        """Return the parts of an offset across and along the beam, in mm, as the verdict has them.

        None where it depends on a coordinate that cannot be observed.
        """
        lost = ~self.observable
        seen = np.where(lost, 0.0, offset_m)
        along = float(seen @ self.axis)
        lateral = np.eye(3) - np.outer(self.axis, self.axis)
        across = float(np.linalg.norm(seen - along * self.axis))
        is_across_lost = np.abs(lateral[:, lost]).max(initial=0.0) > _SAME_LINE
        is_along_lost = np.abs(self.axis[lost]).max(initial=0.0) > _SAME_LINE
        return {
            "lateral_error_mm": None if is_across_lost else _MM * across,
            "axial_error_mm": None if is_along_lost else _MM * along,
        }

    # --- the pressure peak (S4) ----------------------------------------------------------------

    @cached_property
    def covariance(self) -> FloatArray:
        """(3, 3) C: the covariance of the unit vectors from the elements to the target."""
        return focal_shift_covariance(
            self.model, self.position_m, self.amplitudes * np.abs(self.arrivals)
        )

    def directions(self) -> list[FramePeakAxes]:
        """Return the plane across the beam and the line along it, if this array tells them."""
        found = []
        for axes in (axes_about_normal(self.axis)[:2], self.axis[None, :]):
            direction = self.direction(axes)
            if np.linalg.eigvalsh(direction.metric)[0] > TURNED_RATIO * self.model.wavenumber**2:
                found.append(direction)
        return found

    def direction(self, axes: FloatArray) -> FramePeakAxes:
        """Return the direction along *axes* (D, 3) with its metric."""
        metric = self.model.wavenumber**2 * (axes @ self.covariance @ axes.T)
        return FramePeakAxes(axes, metric)

    @cached_property
    def peaks(self) -> list[ExpectedPeak]:
        """The peaks of the ideal drive across and along the beam, as far as they have a place."""
        ideal = self.amplitudes * np.exp(1j * self.phases_rad)
        found = (
            expected_frame_peak(self.model, ideal, self.position_m, direction, self.phase_limit_rad)
            for direction in self.directions()
        )
        return [peak for peak in found if peak is not None]

    # --- tolerance and uncertainty -------------------------------------------------------------

    @cached_property
    def air_phases_rad(self) -> FloatArray:
        """(N,) how the phases change over the tolerated range of the speed of sound."""
        distances = np.linalg.norm(self.position_m - self.model.array.positions_m, axis=1)
        change: FloatArray = distances - distances[self.active].mean()
        return self._speed_share * self.model.wavenumber * change

    @property
    def _speed_share(self) -> float:
        """Return the tolerance of the sound speed, as a share of it."""
        return self.tolerance.speed_share(self.model.medium)

    @cached_property
    def _air_fits(self) -> tuple[focus_fit.PhaseFit, focus_fit.PhaseFit]:
        """The foci fitted to hosts whose air has the fastest and the slowest sound tolerated."""
        speed_m_s, share = self.model.medium.sound_speed_m_s, self._speed_share
        hosts = (self.model.with_sound_speed(speed_m_s * (1.0 + sign * share)) for sign in (1, -1))
        fast, slow = (focus_phases(host, self.position_m) for host in hosts)
        return self._fit(fast, self.active), self._fit(slow, self.active)

    @cached_property
    def tolerated_m(self) -> FloatArray:
        """(3,) how far tolerated air moves the fitted focus per axis, in metres."""
        moved = [np.abs(fit.position_m - self.position_m) for fit in self._air_fits]
        return np.maximum(*moved)

    @cached_property
    def aberration_rad(self) -> float:
        """Largest phase error of an element that tolerated air leaves of a focus."""
        return max(float(np.abs(fit.residual_rad[self.active]).max()) for fit in self._air_fits)

    def beyond_m(self, offset_m: FloatArray) -> float:
        """Return the part of an offset (3,) beyond rounding and tolerated air, in metres."""
        fast, slow = (fit.position_m - self.position_m for fit in self._air_fits)
        share = np.linspace(-1.0, 1.0, _AIRS)[:, None]
        drift = (fast - slow) / 2.0 * share + (fast + slow) / 2.0 * share**2
        beyond = np.maximum(np.abs(offset_m - drift) - self.bound_m, 0.0)
        return float(np.linalg.norm(beyond, axis=1).min())

    @cached_property
    def _steepness_rad_m(self) -> float:
        """RMS change of the phases in rad per metre of a miss, in the steepest direction."""
        steepest = float(np.linalg.eigvalsh(self.covariance)[-1])
        return self.model.wavenumber * math.sqrt(max(steepest, 0.0))

    @property
    def width_m(self) -> float:
        """Width of the focus (-3 dB) where it is narrowest, in metres; infinite for one element.

        2 * 0.831 / (k sqrt(C)), C the largest variance of the directions to the elements.
        """
        steepness = self._steepness_rad_m
        return _WIDTH_RAD / steepness if steepness > 0.0 else math.inf

    @cached_property
    def tolerated_rad(self) -> float:
        """RMS change of the phases that a tolerated miss in tolerated air makes."""
        slack = self._steepness_rad_m * self.tolerance.miss_mm / _MM
        return float(slack + np.sqrt(np.mean(self.air_phases_rad[self.active] ** 2)))

    def shown_miss(self, known: Uncertainty) -> dict[str, Any]:
        """Return in mm which miss shows, and how well the place is known; None: one never does."""
        x, y, z = (_MM * float(b) if math.isfinite(b) else None for b in self.bound_m)
        if not self.observable.all():
            return {"bound_mm": (x, y, z), "smallest_miss_mm": None, "uncertainty_mm": None}
        longest_mm = _MM * float(np.linalg.norm(self.bound_m + self.tolerated_m))
        return {
            "bound_mm": (x, y, z),
            "smallest_miss_mm": longest_mm + self.tolerance.miss_mm,
            "uncertainty_mm": frame_target_uncertainty(
                self.model, self.position_m, self.response, known
            ),
        }

    def miss(self, offset_m: FloatArray) -> dict[str, Any]:
        """Return place and error of a focus; None for a part that cannot be observed."""
        place_m = (self.position_m + offset_m).tolist()
        return {
            "measured_m": tuple(
                value if seen else None
                for value, seen in zip(place_m, self.observable, strict=True)
            ),
            **self.errors_mm(offset_m),
        }


def check_frame_tolerance(model: AcousticModel, points_m: ArrayLike, tolerance: Tolerance) -> None:
    """Raise if a tolerance is more than half of the focus at one of (T, 3) points, in metres.

    Raises
    ------
    ConfigurationError
        It names the tolerance, the focus and the largest tolerance.
    """
    if tolerance.is_strict:
        return
    everything = np.ones(model.array.count)
    for point in np.unique(np.atleast_2d(np.asarray(points_m, dtype=np.float64)), axis=0):
        target = FrameTarget(model, point, everything, 0.0, tolerance)
        if target.tolerated_rad > _WIDTH_RAD / 2.0:
            x, y, z = _MM * point
            raise ConfigurationError(
                f"tolerance of {tolerance_text(tolerance)}; the focus at ({x:.1f}, {y:.1f}, "
                f"{z:.1f}) mm is {_MM * target.width_m:.1f} mm wide (-3 dB), and a tolerance can "
                "be half of that at most, air included"
            )


def frame_target_uncertainty(
    model: AcousticModel, position_m: FloatArray, response: FloatArray, known: Uncertainty
) -> VerdictUncertainty:
    """Return the uncertainty of a place that moves by *response* (D, N) per radian of phase.

    Phases that are off by k r dc / c, all together, by k times the error of a position along the
    ray, or by themselves, each element for itself.
    """
    distances = np.linalg.norm(position_m - model.array.positions_m, axis=1)
    air_rad = known.speed_share(model.medium) * model.wavenumber * distances
    scatter = _MM * float(np.linalg.norm(response))
    return VerdictUncertainty(
        air=_MM * float(np.linalg.norm(response @ air_rad)),
        positions=scatter * model.wavenumber * known.position_mm / _MM,
        phases=scatter * known.phase_rad,
    )

"""The criteria S1 to S5 of one frame.

S1  element residual: every latched phase is within half a step of the one that focuses on the
    target, up to a phase that all share.
S2  the focus that was reconstructed, without knowing the target, is where the target is, within
    what the quantisation can do at the worst.
S3  coherence at the target, |sum w_n g_n| / sum |A_n g_n| with the *intended* amplitudes A_n.
S4  the peak of |p| across and along the beam is where diffraction puts it.
S5  every latched amplitude is the intended one, within half a step.

A frame with several foci is judged by S3 and S5, and by S2 where a solver made its drive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics import (
    AcousticModel,
    Drive,
    NotSingle,
    SingleFocus,
    fit_focus,
    phase_step_rad,
)
from haptogram.acoustics.drive import FULL_AMPLITUDE
from haptogram.acoustics.focus import wrap
from haptogram.records import Intended

from .target import (
    LEAST_FRESNEL_NUMBER,
    LONGEST_SHIFT_RAD,
    PREDICTION_SHARE,
    Complexes,
    Direction,
    Floats,
    TargetField,
    metric_length,
    peak_offset_m,
    predicted_shift_m,
)

ROUNDING_RAD: Final = 1e-9  # of the arithmetic, on top of half a phase step
#: S4: what the search for a peak may miss it by, in radians of phase, on top of rounding and of the
#: prediction; 1 mm beside the target of a 16 x 16 array is 0.5 or more.
PEAK_SLACK_RAD: Final = 0.01
_AMPLITUDE_STEP: Final = 1.0 / FULL_AMPLITUDE
#: Several foci made by a solver: what reaches them together, and the weakest of them, at the least.
#: Random phases reach an efficiency of F / N, the solvers 0.5 and more; their weakest focus of many
#: has a third of the mean and more, one that is missing next to nothing.
_LEAST_EFFICIENCY: Final = 0.25
_LEAST_BALANCE: Final = 0.2


def allowed_codes(intended: Intended) -> int:
    """Return by how many register codes the board may differ from the host, for its arithmetic."""
    return 1 if intended.board_computed else 0


def phase_limit_rad(intended: Intended) -> float:
    """Return S1's limit: half a step, and one more step of 8 bits where the board computes."""
    allowance_rad = allowed_codes(intended) * phase_step_rad(8)
    return phase_step_rad(intended.phase_bits) / 2.0 + allowance_rad + ROUNDING_RAD


def phase_error_rad(target: TargetField, latched: Drive, active: NDArray[np.bool_]) -> float:
    """S1: half the range of phi_n + k r_n(target) over the active elements, common phase out."""
    arrival = np.angle(latched.weights()[active]) - target.phases_rad[active]
    common = np.angle(np.exp(1j * arrival).sum())
    return float(np.ptp(wrap(arrival - common))) / 2.0


def focus_offset_m(target: TargetField, focus: SingleFocus | NotSingle) -> Floats:
    """S2: return where the reconstructed focus is, seen from the target, (3,) in metres."""
    return np.array(focus.position_m) - target.position_m


def on_target(offset_m: Floats, bound_m: Floats) -> bool:
    """S2: tell whether every coordinate that can be observed is within its bound."""
    return bool((np.abs(offset_m) <= bound_m).all())


def explains(
    model: AcousticModel, intended: Intended, latched: Drive, position_m: ArrayLike
) -> bool:
    """Tell whether the latched phases suit a focus at *position_m* within the rounding."""
    active = latched.amplitude_codes > 0
    phases = np.angle(latched.weights())
    fit = fit_focus(model, phases, position_m, phase_bits=intended.phase_bits, active=active)
    # A fit that runs off to the target says nothing about the place where it was started.
    stayed = bool((np.abs(fit.position_m - np.asarray(position_m)) <= fit.bound_m).all())
    return stayed and fit.residual_rms_rad <= phase_limit_rad(intended)


def coherence(target: TargetField, latched: Complexes, intended: Complexes) -> float:
    """S3: |sum w_n g_n| / sum |A_n g_n| at the target."""
    largest = float(np.abs(intended * target.arrivals).sum())
    return abs(complex((latched * target.arrivals).sum())) / largest if largest > 0.0 else 0.0


def least_coherence(target: TargetField, intended: Intended) -> float:
    """Return S3's limit, cos(pi / 2^b), with the allowances of S1 and S5 where the board computes.

    With one amplitude step less, sum |a_n g_n| falls short by that step's share of it.
    """
    loudness = np.abs(target.arrivals)
    largest = float(np.abs(intended.drive.weights()) @ loudness)
    missing = allowed_codes(intended) * _AMPLITUDE_STEP * float(loudness.sum())
    share = max(0.0, 1.0 - missing / largest) if largest > 0.0 else 0.0
    return math.cos(min(phase_limit_rad(intended), math.pi)) * share - ROUNDING_RAD


@dataclass(frozen=True, slots=True, eq=False)
class PeakError:
    """S4 in one direction: how far the peak is from its place, and how far it may be.

    Both in the metric of the focus, radians of phase.

    Attributes
    ----------
    offset_m : (3,) numpy.ndarray
        From its place to the peak.
    """

    error_rad: float
    limit_rad: float
    offset_m: Floats

    @property
    def ok(self) -> bool:
        """Whether the peak is where it belongs."""
        return self.error_rad <= self.limit_rad


def peak_errors(
    model: AcousticModel,
    target: TargetField,
    latched: Complexes,
    amplitudes: Floats,
    phase_limit: float,
) -> list[PeakError]:
    """S4: return the errors of the peak across and along the beam; none where nothing can tell.

    Rounding moves the peak by (k^2 C)^-1 sum_n s_n k (u_n - u) d_n, s_n the shares of the elements
    and |d_n| <= *phase_limit*: by Cauchy and Schwarz at most sqrt(D) times that, for D directions.
    """
    errors = []
    for direction in target.directions:
        expected_m = _expected_offset_m(model, target, amplitudes, direction)
        shift_rad = metric_length(expected_m, direction)
        if shift_rad > LONGEST_SHIFT_RAD:
            continue
        place_m = target.position_m + expected_m
        offset_m = peak_offset_m(model, latched, place_m, direction)
        error_rad = metric_length(offset_m, direction)
        rounding_rad = math.sqrt(len(direction.axes)) * phase_limit
        limit_rad = PEAK_SLACK_RAD + rounding_rad + PREDICTION_SHARE * shift_rad
        errors.append(PeakError(error_rad, limit_rad, offset_m))
    return errors


def _expected_offset_m(
    model: AcousticModel, target: TargetField, amplitudes: Floats, direction: Direction
) -> Floats:
    """Return the predicted focal shift; where there is no prediction, that of an ideal drive."""
    if target.fresnel_number >= LEAST_FRESNEL_NUMBER:
        return predicted_shift_m(model, target, amplitudes, direction)
    ideal = amplitudes * np.exp(1j * target.phases_rad)
    return peak_offset_m(model, ideal, target.position_m, direction)


def amplitudes_ok(intended: Intended, latched: Drive) -> bool:
    """S5: tell whether no amplitude is off by more than half a step."""
    difference = latched.amplitude_codes.astype(int) - intended.drive.amplitude_codes.astype(int)
    return int(np.abs(difference).max()) <= allowed_codes(intended)


def several_foci_ok(
    intended: Intended, latched: Complexes, targets: list[TargetField], asked: Complexes
) -> bool:
    """Judge several foci in one frame, each by the pressure at its point.

    |p(t_i) - e^{j psi} p_ideal(t_i)| <= 2 sin(pi / 2^(b+1)) sum_n |a_n g_n(t_i)|, plus half an
    amplitude step of every element; psi is the common phase that fits best.

    Parameters
    ----------
    asked : (N,) numpy.ndarray of complex
        What the foci ask for in the air that there really is, at most 1: what made them, asked
        again. That a solver did make them is for S2.
    """
    ideal = _as_driven(intended, asked)
    arrivals = np.array([target.arrivals for target in targets])
    found, wanted = arrivals @ latched, arrivals @ ideal
    common = np.exp(1j * np.angle(np.vdot(wanted, found)))
    phase_limit = 2.0 * math.sin(phase_limit_rad(intended) / 2.0)
    allowance = (0.5 + allowed_codes(intended)) * _AMPLITUDE_STEP
    limit = phase_limit * (np.abs(arrivals) @ np.abs(ideal))
    limit += allowance * np.abs(arrivals).sum(axis=1)
    return bool((np.abs(found - common * wanted) <= limit).all())


@dataclass(frozen=True, slots=True)
class FociLevels:
    """What reaches several foci of one frame.

    Attributes
    ----------
    efficiency : float
        sum_i (|p(t_i)| / sum_n |a_n g_n(t_i)|)^2, a_n the intended amplitudes: each focus over what
        the same output would make of it alone.  1 if they share it without loss; less of
        foci that take from each other; more of foci so near that one beam serves several.
    balance : float
        The least |p(t_i)| / A_i over the mean of them, A_i the wanted amplitudes.
    """

    efficiency: float
    balance: float

    @classmethod
    def of(cls, intended: Intended, latched: Complexes, targets: list[TargetField]) -> FociLevels:
        """Return the levels of the foci of *intended* under the drive *latched*."""
        arrivals = np.array([target.arrivals for target in targets])
        levels = np.abs(arrivals @ latched)
        alone = np.abs(arrivals) @ np.abs(intended.drive.weights())
        wanted = np.array([focus.amplitude for focus in intended.foci])
        asked = wanted > 0.0
        shares = levels[asked] / wanted[asked]
        mean = float(shares.mean()) if asked.any() else 0.0
        return cls(
            float(((levels / alone) ** 2).sum()),
            float(shares.min()) / mean if mean > 0.0 else 0.0,
        )

    @property
    def ok(self) -> bool:
        """S2: whether every focus is there.

        Coarse: foci that share an aperture pull at each other, by up to half their own width, so
        no bound in millimetres holds for all of them.
        """
        return self.efficiency >= _LEAST_EFFICIENCY and self.balance >= _LEAST_BALANCE


def _as_driven(intended: Intended, asked: Complexes) -> Complexes:
    """Return *asked* as a drive can be: one that holds phases only drives every element in full."""
    if (intended.drive.amplitude_codes == FULL_AMPLITUDE).all():
        in_full: Complexes = np.exp(1j * np.angle(asked))
        return in_full
    return asked

"""The criteria S1 to S5 of a frame: one list, for one focus and for several.

With a tolerance of the user, S2 is wider by it, and the others ask for the drive of a host that is
within it: see :mod:`.tolerated`.  Several foci share an aperture and pull at each other, so each is
compared with what the ideal drive makes of it: see :mod:`.ideal_drive`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from haptogram.acoustics import AcousticModel, Drive, phase_step_rad
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.model.drive import FULL_AMPLITUDE, REGISTER_BITS
from haptogram.acoustics.solvers.focus_fit import wrapped_phases
from haptogram.records.frame import Intended

from ..faults import UNNAMED
from .peaks import ExpectedPeak
from .target import FrameTarget
from .tolerated import ToleratedHost
from .verdict import FrameStatus

#: Question of each criterion: for one focus, and for each of several beside their ideal drive.
CRITERIA: Final = {
    "S1": (
        "every latched phase is within half a step of the one that focuses on the target",
        "every phase",
    ),
    "S2": (
        "the focus that was reconstructed, without knowing the target, is where the target is",
        "the place of the pressure peak next to the target",
    ),
    "S3": (
        "the sound of all transducers arrives at the target in step (coherence)",
        "the pressure there",
    ),
    "S4": (
        "the peak of the pressure is where that of the ideal drive is: diffraction pulls both "
        "towards the array",
        "",
    ),
    "S5": ("every latched amplitude is the intended one, within half a step", "every amplitude"),
}

_ROUNDING_RAD: Final = 1e-9  # rounding of the arithmetic, on top of half a phase step
AMPLITUDE_STEP: Final = 1.0 / FULL_AMPLITUDE
_MM: Final = 1e3


def allowed_frame_codes(intended: Intended) -> int:
    """Return by how many register codes the board may differ from the host, for its arithmetic."""
    return 1 if intended.board_computed else 0


def frame_phase_limit_rad(intended: Intended, grain_rad: float = 0.0) -> float:
    """Return S1's limit: half a step, and one more step of 8 bits where the board computes.

    Parameters
    ----------
    grain_rad : float
        Error of phases by positions that the wire rounds to whole micrometres: see
        :func:`frame_position_grain_rad`.
    """
    allowance_rad = allowed_frame_codes(intended) * phase_step_rad(REGISTER_BITS)
    return judged_frame_step_rad(intended) / 2.0 + allowance_rad + grain_rad + _ROUNDING_RAD


def judged_frame_step_rad(intended: Intended) -> float:
    """Return the step of the phases; one of the registers more, if steps lie between their codes.

    Boards of 10 or 24 steps have phases between those of 8 bits.
    """
    bits = max(REGISTER_BITS, intended.drive.phase_bits)
    between = phase_step_rad(bits) if (1 << bits) % intended.steps else 0.0
    return math.tau / intended.steps + between


def frame_position_grain_rad(model: AcousticModel) -> float:
    """Return the largest phase error from positions that a host knows in whole micrometres."""
    off_m = model.array.positions_m - model.array.on_wire().positions_m
    return model.wavenumber * float(np.linalg.norm(off_m, axis=1).max())


def common_frame_error_rad(error: FloatArray) -> float:
    """Return half the range of phase errors, the phase that all share taken out."""
    common = np.angle(np.exp(1j * error).sum())
    return float(np.ptp(wrapped_phases(error - common))) / 2.0


def is_frame_on_target(target: FrameTarget, offset_m: FloatArray) -> bool:
    """S2: return True if every coordinate that can be observed is within its bound."""
    return target.beyond_m(offset_m) <= target.tolerance.miss_mm / _MM


def are_foci_within(
    offsets_m: FloatArray, limits_m: FloatArray | Sequence[FloatArray], tolerance_mm: float
) -> bool:
    """Return True if what is left of (F, 3) offsets beyond limits is no longer than a tolerance."""
    beyond = np.maximum(np.abs(offsets_m) - limits_m, 0.0)
    return bool((np.linalg.norm(beyond, axis=1) <= tolerance_mm / _MM).all())


def frame_coherence_at_target(target: FrameTarget, latched: ComplexArray) -> float:
    """S3: |sum w_n g_n| / sum |A_n g_n| at the target."""
    largest = float(target.amplitudes @ np.abs(target.arrivals))
    return abs(complex((latched * target.arrivals).sum())) / largest if largest > 0.0 else 0.0


def least_frame_coherence(target: FrameTarget, allowed_codes: int = 0) -> float:
    """Return S3's limit, cos of the phase limit, less the amplitude codes that may be missing.

    Less, too, the elements that have the target in a side lobe of opposite sign.
    """
    levels = target.amplitudes * target.loudness
    largest = float(np.abs(levels).sum())
    if not largest > 0.0:
        return least_coherence(target.phase_limit_rad, 0.0)
    missing = allowed_codes * AMPLITUDE_STEP * float(np.abs(target.loudness).sum()) / largest
    against = (largest - abs(float(levels.sum()))) / 2.0 / largest
    share = max(0.0, 1.0 - missing - against)
    return least_coherence(target.phase_limit_rad, share) - against


def least_coherence(limit_rad: float, share: float) -> float:
    """Return the least coherence of phases within *limit_rad* with a *share* of the amplitudes."""
    return math.cos(min(limit_rad, math.pi)) * share - _ROUNDING_RAD


def peak_offsets_m(
    model: AcousticModel, peaks: Sequence[ExpectedPeak | None], latched: ComplexArray
) -> list[FloatArray | None]:
    """Return (D,) how far each peak of *latched* is from its place; None where there is none."""
    return [None if peak is None else peak.offset_m(model, latched) for peak in peaks]


def are_peaks_in_place(
    peaks: Sequence[ExpectedPeak | None], offsets_m: Sequence[FloatArray | None]
) -> bool:
    """Return True if every peak that has a place is within its limit of it."""
    return all(
        offset is not None and bool((np.abs(offset) <= peak.rounding_m).all())
        for peak, offset in zip(peaks, offsets_m, strict=True)
        if peak is not None
    )


def judge_frame_drive(
    target: FrameTarget, host: ToleratedHost, latched: ComplexArray, allowed_codes: int = 0
) -> tuple[dict[str, bool], dict[str, Any]]:
    """Return S1, S3 and S4 of a drive, and the measures that they rest on.

    Parameters
    ----------
    target : FrameTarget
        Where the focus shall be.
    host : ToleratedHost
        The host within the tolerance whose phases come nearest: it is asked of its drive.
    """
    asked = target.of_host(host.off, host.limit_rad) if host.explains else target
    offsets_m = peak_offsets_m(asked.model, asked.peaks, latched)
    verdicts = {
        "S1": host.explains,
        "S3": frame_coherence_at_target(asked, latched)
        >= least_frame_coherence(asked, allowed_codes),
    }
    measures: dict[str, Any] = {
        "intended_pressure_rms_pa": target.intended_pressure_rms_pa,
        "phase_error_rad": host.error_rad,
        "coherence": frame_coherence_at_target(target, latched),
    }
    if offsets_m:
        lengths = [
            peak.direction.length_rad(offset_m @ peak.direction.axes)
            for peak, offset_m in zip(asked.peaks, offsets_m, strict=True)
            if offset_m is not None
        ]
        measures["peak_error"] = max(lengths, default=None)
        verdicts["S4"] = are_peaks_in_place(asked.peaks, offsets_m)
    return verdicts, measures


def frame_amplitudes_ok(intended: Intended, latched: Drive) -> bool:
    """S5: return True if no amplitude is off by more than half a step."""
    difference = latched.amplitude_codes.astype(int) - intended.drive.amplitude_codes.astype(int)
    return int(np.abs(difference).max()) <= allowed_frame_codes(intended)


def frame_status_of(
    verdicts: Mapping[str, bool], faults: tuple[str, ...], *, focused: bool
) -> FrameStatus:
    """Return the status of a frame whose drive was seen.

    Parameters
    ----------
    verdicts : mapping of str to bool
        S1 to S5, those that were judged.
    faults : tuple of str
        Faults that the codes prove.
    focused : bool
        Whether the drive has a single focus.
    """
    is_placed = "S1" in verdicts or "S2" in verdicts  # else nobody knows where its foci are
    if all(verdicts.values()) and (is_placed or not faults):
        return FrameStatus.CORRUPT if faults else FrameStatus.ON_TARGET
    if not faults or (focused and faults == (UNNAMED,)):
        return FrameStatus.OFF_TARGET  # the drive that was sent, in other air; or for another point
    return FrameStatus.WRONG_DRIVE

"""The verdict on one drive: a model, a target and what an array radiates, without board or run."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any, Final, cast

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics import AcousticModel, Drive, check_focus_target
from haptogram.acoustics.arrays import as_complex_array, as_float_array, as_float_vector
from haptogram.acoustics.model.drive import FULL_AMPLITUDE
from haptogram.acoustics.solvers.several import METHODS, Method, frame_weights
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Evidence, Focus, FrameKey, Intended, Observation
from haptogram.settings.arguments import check_argument_kind, check_choice, check_number

from ..tolerance import Tolerance, Uncertainty
from .judge import FrameJudge
from .verdict import FrameVerdict

_KEY: Final = FrameKey(0, 0, 0, 0)


def judge(
    model: AcousticModel,
    target: ArrayLike | Focus | Sequence[Focus],
    drive: Drive | ArrayLike,
    *,
    phase_bits: int = 8,
    amplitudes: ArrayLike | None = None,
    solver: Method = "naive",
    tolerance: Tolerance | None = None,
    uncertainty: Uncertainty | None = None,
) -> FrameVerdict:
    """Judge one drive of an array by the criteria S1 to S5, as a frame of ``haptogram verify``.

    Parameters
    ----------
    model : AcousticModel
        Array and air in which the drive is radiated.
    target : (3,) or (F, 3) array_like, Focus, or sequence of Focus
        Where the drive shall focus, in metres: one point or several.
    drive : Drive, or (N,) array_like of complex
        Phases and amplitudes to judge.  Weights are A e^{j phi}, 0 <= A <= 1, positive phi a lag;
        they are rounded to *phase_bits* and to 255 steps of amplitude.
    phase_bits : int
        Resolution of the phases of weights, 1 to 16 bits; a Drive has its own.
    amplitudes : (N,) array_like, optional
        Intended amplitudes of the elements, 0 to 1; by default those that the foci ask for: all 1
        for one focus of full amplitude.
    solver : str
        Method that makes the ideal drive of several foci, see :func:`.acoustics.solve_foci`.
    tolerance : Tolerance, optional
        Which misses pass on top of those of rounding; by default none.
    uncertainty : Uncertainty, optional
        How well array and air are known; by default exactly.

    Returns
    -------
    FrameVerdict
        True if the drive is on target.  No board was asked, so its evidence is None.

    Raises
    ------
    ConfigurationError
        A target out of reach; phases or amplitudes of another number of elements, or out of range;
        an unknown solver, or foci that it refuses; a tolerance of more than half of the focus.

    Examples
    --------
    >>> import numpy as np
    >>> from haptogram.acoustics import AcousticModel, focus_phases
    >>> model = AcousticModel.default(nx=16, ny=16)
    >>> target = (0.01, 0.02, 0.15)
    >>> phases = focus_phases(model, target)
    >>> verdict = judge(model, target, np.exp(1j * phases))
    >>> verdict.passed, verdict.criteria
    (True, {'S1': True, 'S2': True, 'S3': True, 'S4': True, 'S5': True})
    >>> f"{verdict.error_mm:.2f} mm off, {verdict.pressure_rms_pa:.0f} Pa"
    '0.03 mm off, 3736 Pa'
    >>> judge(model, target, np.exp(-1j * phases)).faults
    ('opposite sign of all phases',)
    """
    check_argument_kind("model", model, AcousticModel, "an AcousticModel")
    check_choice("solver", solver, METHODS)
    check_argument_kind("tolerance", tolerance, (Tolerance, type(None)), "a Tolerance")
    check_argument_kind("uncertainty", uncertainty, (Uncertainty, type(None)), "an Uncertainty")
    latched = drive if isinstance(drive, Drive) else _judged_weights(drive, phase_bits)
    if latched.count != model.array.count:
        raise ConfigurationError(f"drive of {latched.count}, array of {model.array.count} elements")
    foci = _judged_foci(model, target)
    asked = frame_weights(model, foci, solver)
    if amplitudes is not None:
        levels = as_float_vector("amplitudes", amplitudes, model.array.count)
        check_number("amplitudes", float(levels.min()), 0.0, 1.0)
        asked = levels * np.exp(1j * np.angle(asked))
    wanted = Drive.from_weights(asked, latched.phase_bits)
    seen = Observation(_KEY, 0, False, Evidence.EXTERNAL, latched)

    def judged(sent: Drive) -> FrameVerdict:
        intended = Intended(0, _KEY, None, foci, sent, latched.phase_bits, solver=solver)
        found = FrameJudge(model, carrier_us=1, tolerance=tolerance, uncertainty=uncertainty)
        return dataclasses.replace(found.judge(intended, seen), evidence=None, t_latch_us=None)

    verdict = judged(wanted)
    # Nobody sent another drive, and a tolerance has many; of several foci with other amplitudes,
    # but with amplitudes only where the foci ask for them.
    others = len(foci) > 1 and amplitudes is None and not (tolerance or Tolerance()).is_strict
    others &= _is_of_phases_alone(wanted) == _is_of_phases_alone(latched)
    is_another = verdict.is_wrong and all(verdict.criteria.values())
    if is_another or (others and not verdict.passed and not latched.is_muted):
        own = judged(latched)
        is_of_host = not own.is_wrong and own.criteria.get("S1", False)  # its foci may not show
        verdict = own if is_another or is_of_host else verdict
    return verdict


def _judged_weights(weights: ArrayLike, phase_bits: int) -> Drive:
    """Return complex weights as a drive of *phase_bits*; refuse real numbers."""
    values = as_complex_array("drive", weights)
    if not np.iscomplexobj(np.asarray(weights)):
        raise ConfigurationError(
            "drive holds real numbers, must be complex weights: of phases in radians, "
            "amplitudes * np.exp(1j * phases)"
        )
    return Drive.from_weights(values, phase_bits)


def _is_of_phases_alone(drive: Drive) -> bool:
    """Return True if every element of *drive* has its full amplitude."""
    return bool((drive.amplitude_codes == FULL_AMPLITUDE).all())


def _judged_foci(
    model: AcousticModel, target: ArrayLike | Focus | Sequence[Focus]
) -> tuple[Focus, ...]:
    """Return the foci of *target*, points or foci; refuse none, or one out of the array's reach."""
    if isinstance(target, Focus):
        entries: Iterable[Any] = [target]
    elif isinstance(target, Sequence) and any(isinstance(entry, Focus) for entry in target):
        entries = target
    else:
        entries = np.atleast_2d(as_float_array("target", cast("ArrayLike", target)))
    foci = tuple(entry if isinstance(entry, Focus) else Focus.at(entry) for entry in entries)
    if not foci:
        raise ConfigurationError("target holds 0 foci, must be 1 or more")
    for focus in foci:
        check_focus_target(model, focus.position_m)
    return foci

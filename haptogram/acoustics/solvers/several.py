"""Drives that make several foci at once.

All solvers but the naive one know how the foci disturb each other. `G` is the (F, N) matrix of
propagators from elements to foci, `a` the wanted relative amplitudes, `w` the drive.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Final, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import ComplexArray, FloatArray, as_float_vector, as_point_array
from haptogram.acoustics.field.engines.compiled import load_kernels
from haptogram.acoustics.field.engines.parallel import ParallelPistons
from haptogram.acoustics.field.reference import propagators
from haptogram.acoustics.model.drive import saturated_weights
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.solvers.focus import check_focus_targets, superpose_foci
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_choice, check_number, check_whole

if TYPE_CHECKING:
    from haptogram.records.frame import Focus

Method: TypeAlias = Literal["naive", "ibp", "gs", "wgs", "gspat", "gradient"]
METHODS: Final[tuple[Method, ...]] = get_args(Method)
_MAX_FOCI: Final = 256
_MAX_ROUNDS: Final = 10_000
#: Exponent of the step of the weights. With 1 the drive swings between two states for ever, for
#: one pair in six of foci on a raster of 7 x 7 places, 20 mm apart.
_DAMPING: Final = 0.75
_LARGEST_WEIGHT: Final = 2.0**40  # a point that cannot be served gains weight in every round
#: Range of amplitudes whose squares fit single precision; those of their weights, which grow with
#: the ratio of the largest to the smallest, fit as well up to the same ratio.
_LEVELS: Final = (1e-6, 1e6)


def solve_foci(
    model: AcousticModel,
    points_m: ArrayLike,
    amplitudes: ArrayLike | None = None,
    *,
    method: Method = "wgs",
    rounds: int = 50,
) -> ComplexArray:
    """Return a drive that makes foci of given relative amplitudes.

    Parameters
    ----------
    points_m : (F, 3) array_like
        Foci, in metres; at most 256.
    amplitudes : (F,) array_like, optional
        Their relative amplitudes, 1e-6 to 1e6, the largest up to 1e6 times the smallest; all equal
        if not given.
    method : {"naive", "ibp", "gs", "wgs", "gspat", "gradient"}
        Superposition, scaled so that the largest weight is 1; iterative backpropagation (A. Marzo
        and B. W. Drinkwater, PNAS 116(1), 2019); Gerchberg-Saxton, and its weighted form (R. Di
        Leonardo, F. Ianni and G. Ruocco, Opt. Express 15(4), 2007) with damped weights; GS-PAT
        (D. Martinez Plasencia et al., ACM Trans. Graph. 39(4), 2020); least squares by L-BFGS.
    rounds : int
        Iterations, 1 to 10 000; the naive method has none.

    Returns
    -------
    (N,) numpy.ndarray of complex128
        Weights, magnitudes at most 1: exactly 1 for gs, wgs and gradient.

    Raises
    ------
    ConfigurationError
        An unknown method; no focus or too many; out of reach (:func:`.focus.check_focus_targets`);
        amplitudes or rounds out of range; a focus that no element reaches.

    Examples
    --------
    >>> pair = [(-0.03, 0.0, 0.15), (0.03, 0.0, 0.15)]
    >>> levels = np.abs(pressure(model, solve_foci(model, pair, method="gs"), pair))
    >>> bool(abs(levels[0] / levels[1] - 1.0) < 0.02)
    True
    """
    points = as_point_array("points_m", points_m)
    check_choice("method", method, METHODS)
    if not 1 <= len(points) <= _MAX_FOCI:
        raise ConfigurationError(f"{len(points)} foci, must be 1 to {_MAX_FOCI}")
    check_whole("rounds", rounds, 1, _MAX_ROUNDS)
    check_focus_targets(model, points)
    count = len(points)
    levels = np.ones(count) if amplitudes is None else _checked_foci_levels(amplitudes, count)
    solved = _solved_for_pistons(model, points, levels, rounds) if method == "wgs" else None
    if solved is not None:
        return solved
    start = superpose_foci(model, points, levels, np.zeros(len(points)))
    start /= np.abs(start).max()
    matrix = _solver_propagators(model, points)
    return start if method == "naive" else _SOLVERS[method](matrix, levels, start, rounds)


def weights_for_foci(
    model: AcousticModel,
    points_m: ArrayLike,
    amplitudes: ArrayLike,
    phases_rad: ArrayLike,
    *,
    method: Method = "naive",
) -> ComplexArray:
    """Return the drive that makes foci: of a solver where there are several, else superposition.

    Parameters
    ----------
    points_m : (F, 3) array_like
        Foci, in metres.
    amplitudes, phases_rad : (F,) array_like
        Of the foci; a solver makes relative amplitudes, and chooses the phases itself.

    Returns
    -------
    (N,) numpy.ndarray of complex128
        Weights; magnitudes above 1 are cut to 1 (:func:`.drive.saturated_weights`).

    Raises
    ------
    ConfigurationError
        As :func:`.focus.superpose_foci` and :func:`solve_foci`.

    Examples
    --------
    >>> one = weights_for_foci(model, [target], [1.0], [0.0])
    >>> bool(np.allclose(one, weights))
    True
    """
    check_choice("method", method, METHODS)
    if method == "naive" or len(as_point_array("points_m", points_m)) == 1:
        return saturated_weights(superpose_foci(model, points_m, amplitudes, phases_rad))
    return solve_foci(model, points_m, amplitudes, method=method)


def frame_weights(model: AcousticModel, foci: Sequence[Focus], method: Method) -> ComplexArray:
    """Return :func:`weights_for_foci` of the foci of a record."""
    points, levels, lags = zip(
        *((f.position_m, f.amplitude, f.phase_rad) for f in foci), strict=True
    )
    return weights_for_foci(model, points, levels, lags, method=method)


def _iterative_backpropagation(
    matrix: ComplexArray, wanted: FloatArray, drive: ComplexArray, rounds: int
) -> ComplexArray:
    """Return *drive* (N,) after *rounds* of iterative back-propagation, magnitudes clipped to 1.

    *matrix* (F, N): propagators to the foci; *wanted* (F,): their levels, set anew in each round.
    """
    back = matrix.conj().T / (np.abs(matrix) ** 2).sum(axis=1)
    scale = _reachable_foci_levels(matrix, wanted)
    for _ in range(rounds):
        drive = _clip_solved_drive(back @ (scale * wanted * _solver_phasor(matrix @ drive)))
    return drive


def _gerchberg_saxton(
    matrix: ComplexArray, wanted: FloatArray, drive: ComplexArray, rounds: int
) -> ComplexArray:
    """Return *drive* (N,) after *rounds* of Gerchberg and Saxton, all elements at full amplitude.

    *matrix* (F, N): propagators to the foci; *wanted* (F,): their levels, set anew in each round.
    """
    for _ in range(rounds):
        drive = _solver_phasor(matrix.conj().T @ (wanted * _solver_phasor(matrix @ drive)))
    return drive


def _weighted_gerchberg_saxton(
    matrix: ComplexArray, wanted: FloatArray, drive: ComplexArray, rounds: int
) -> ComplexArray:
    """Return *drive* (N,) after *rounds* of Gerchberg and Saxton, weighted to even out foci.

    *matrix* (F, N): propagators to the foci; *wanted* (F,): their levels.
    """
    kernels = load_kernels()
    if kernels is None:
        return weighted_gerchberg_saxton(matrix, wanted, drive, rounds)
    scaled = matrix / np.abs(matrix).max()
    unit = _solver_phasor(drive)
    re, im, level, x, y = (
        part.astype(np.float32) for part in (scaled.real, scaled.imag, wanted, unit.real, unit.imag)
    )
    kernels.gerchberg_saxton_kernel(re, im, level, rounds, x, y)
    return _solver_phasor(x + 1j * y.astype(np.float64))


def _solved_for_pistons(
    model: AcousticModel, points: FloatArray, wanted: FloatArray, rounds: int
) -> ComplexArray | None:
    """Return the drive (N,) by weighted Gerchberg and Saxton in compiled code; None if unsuited.

    Suited is an array of parallel pistons below all *points*, each heard there. *wanted* (F,):
    levels of the foci.
    """
    pistons = _pistons_to_solve(model)
    if pistons is None:
        return None
    count = model.array.count
    re, im = np.empty((2, len(points), count), np.float32)
    x, y = np.empty((2, count), np.float32)
    if not pistons.kernels.foci_waves_kernel(
        points.copy(), wanted.copy(), pistons.places, pistons.medium, re, im, x, y
    ):
        return None
    pistons.kernels.gerchberg_saxton_kernel(re, im, wanted.astype(np.float32), rounds, x, y)
    return _solver_phasor(x + 1j * y.astype(np.float64))


@lru_cache(maxsize=8)
def _pistons_to_solve(model: AcousticModel) -> ParallelPistons | None:
    """Return the kernels' data of the array; None if calibrated, or not of parallel pistons."""
    is_served = model.calibration is None and ParallelPistons.why_not(model) is None
    return ParallelPistons.of(model) if is_served else None


def weighted_gerchberg_saxton(
    matrix: ComplexArray, wanted: FloatArray, drive: ComplexArray, rounds: int
) -> ComplexArray:
    """Return the phase-only drive of weighted Gerchberg-Saxton, in numpy: the reference.

    Parameters
    ----------
    matrix : (F, N) numpy.ndarray of complex
        Propagators.
    wanted : (F,) numpy.ndarray
        Relative amplitudes.
    drive : (N,) numpy.ndarray of complex
        Where to start; only its phases count.
    rounds : int
        Iterations.
    """
    weight, drive = wanted.copy(), _solver_phasor(drive)
    back = matrix.conj().T.copy()
    for _ in range(rounds):
        pressure = matrix @ drive
        level = np.abs(pressure) + np.finfo(pressure.real.dtype).tiny
        weight = weight * ((level / wanted).mean() * wanted / level) ** _DAMPING
        if weight.max() > _LARGEST_WEIGHT:
            weight = weight / _LARGEST_WEIGHT
        drive = _solver_phasor(back @ (weight * (pressure / level)))
    return drive


def _gs_pat(
    matrix: ComplexArray, wanted: FloatArray, drive: ComplexArray, rounds: int
) -> ComplexArray:
    """Return *drive* (N,) after *rounds* of GS-PAT on F foci alone, by their F x F couplings.

    *matrix* (F, N): propagators to the foci; *wanted* (F,): their levels.
    """
    back = matrix.conj().T / (np.abs(matrix) ** 2).sum(axis=1)
    between = matrix @ back
    scale = _reachable_foci_levels(matrix, wanted)
    pressure = matrix @ drive
    for _ in range(rounds):
        pressure = scale * wanted * _solver_phasor(between @ pressure)
    # The last step of the paper: amplitudes squared over what came out, to even out the foci.
    reached = between @ pressure
    return _clip_solved_drive(
        back @ ((scale * wanted) ** 2 * reached / np.maximum(np.abs(reached) ** 2, 1e-30))
    )


def _gradient_solver(
    matrix: ComplexArray, wanted: FloatArray, drive: ComplexArray, rounds: int
) -> ComplexArray:
    """Return the drive (N,) whose phases, from *drive*'s on, minimise the squared errors of |p|.

    An error is |p| at a focus less its *wanted* level, scaled to full power. By L-BFGS in at most
    *rounds* steps; all elements are full.
    """
    from scipy.optimize import minimize  # slow to import, and only this solver needs it

    goal = _reachable_foci_levels(matrix, wanted) * wanted
    unit = float((goal**2).sum())

    def misfit(phases: FloatArray) -> tuple[float, FloatArray]:
        waves = np.exp(1j * phases)
        pressure = matrix @ waves
        level = np.maximum(np.abs(pressure), 1e-30)
        miss = level - goal
        # d|p_i| / d phi_n = Im(conj(g_in w_n) p_i) / |p_i|
        slope = (((miss / level) * pressure) @ matrix.conj() * waves.conj()).imag
        return float((miss**2).sum()) / unit, 2.0 * slope / unit

    found = minimize(
        misfit, np.angle(drive), jac=True, method="L-BFGS-B", options={"maxiter": rounds}
    )
    result: ComplexArray = np.exp(1j * found.x)
    return result


_Solver: TypeAlias = Callable[[ComplexArray, FloatArray, ComplexArray, int], ComplexArray]
_SOLVERS: Final[dict[str, _Solver]] = {
    "ibp": _iterative_backpropagation,
    "gs": _gerchberg_saxton,
    "wgs": _weighted_gerchberg_saxton,
    "gspat": _gs_pat,
    "gradient": _gradient_solver,
}


def _solver_propagators(model: AcousticModel, points: FloatArray) -> ComplexArray:
    """Return the propagators (F, N); raise ConfigurationError if a focus gets no sound at all."""
    matrix = propagators(model, points)
    silent = np.flatnonzero(~matrix.any(axis=1))
    if silent.size:
        raise ConfigurationError(
            f"focus {silent[0]} gets no sound: the directivity of every element is 0 towards it"
        )
    return matrix


def _checked_foci_levels(amplitudes: ArrayLike, count: int) -> FloatArray:
    """Return the wanted amplitudes of *count* foci; raise unless they are within 1e-6 to 1e6.

    Their ratio is at most 1e6 as well. It raises ConfigurationError.
    """
    levels = as_float_vector("amplitudes", amplitudes, count)
    low, high = float(levels.min()), float(levels.max())
    for level in (low, high):
        check_number("an amplitude", level, *_LEVELS)
    check_number("the ratio of the amplitudes", high / low, 1.0, _LEVELS[1])
    return levels


def _reachable_foci_levels(matrix: ComplexArray, wanted: FloatArray) -> float:
    """Return the factor that scales the wanted levels to full power, interference ignored."""
    largest = np.abs(matrix).sum(axis=1)
    return float(1.0 / np.sqrt(((wanted / largest) ** 2).sum()))


def _solver_phasor(values: ComplexArray) -> ComplexArray:
    """Return complex *values* with magnitude 1; zero stays zero."""
    level = np.abs(values)
    return values / np.where(level > 0.0, level, 1.0)


def _clip_solved_drive(drive: ComplexArray) -> ComplexArray:
    """Return *drive* with magnitudes of at most 1."""
    return drive / np.maximum(np.abs(drive), 1.0)

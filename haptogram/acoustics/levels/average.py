"""The field averaged over a sequence of drives, as a hand feels one pass of a shape.

Skin and hearing follow a squared pressure averaged over milliseconds to seconds, so frames add up
as mean squares, not as phasors.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics.arrays import ComplexArray, FloatArray, as_point_array
from haptogram.acoustics.field.reference import FieldEngine
from haptogram.acoustics.levels.dynamics import Resonator
from haptogram.acoustics.model.drive import as_drive_sequence
from haptogram.settings.arguments import check_number

_FRAME_S: Final = (1e-9, 1e9)  # in a shorter one rounding hides how far a resonator moves
_VALUES_PER_CHUNK: Final = 1 << 20  # 16 MB of complex128


def mean_square_pressure(
    engine: FieldEngine,
    weights: ArrayLike,
    points_m: ArrayLike,
    frame_s: float,
    resonator: Resonator | None = None,
) -> FloatArray:
    """Return the mean of p(t)^2 over a sequence that is repeated without end.

    Without a *resonator* each frame counts as settled from its start: sum |p_i|^2 / (2 F).  With
    one, each element's envelope approaches its command exponentially; by linearity so does the
    field, p_i(t) = P_i + (s_i - P_i) e^{-t/tau}, and the mean of its square is in closed form.
    Travel times, which shift the frames of the elements by fractions of a millisecond against each
    other, are left out.

    Parameters
    ----------
    engine : FieldEngine
        Engine that computes the field.
    weights : (F, N) array_like of complex
        The drives, each held for *frame_s*.
    points_m : (M, 3) array_like
        Points, in metres; worked through in chunks, so that memory stays bounded.
    frame_s : float
        Duration of a frame, 1e-9 to 1e9 s.
    resonator : Resonator, optional
        Envelope of the transducers.

    Returns
    -------
    (M,) numpy.ndarray
        In Pa^2; its square root is the RMS pressure.

    Raises
    ------
    ConfigurationError
        No drive, a duration out of range, or as
        :func:`~haptogram.acoustics.field.reference.pressure`.

    Examples
    --------
    >>> other = np.exp(1j * focus_phases(model, (0.03, 0.0, 0.15)))
    >>> alone, shared = (
    ...     mean_square_pressure(engine, drives, [target], 1e-3)[0]
    ...     for drives in (weights[None], [weights, other])
    ... )
    >>> bool(shared < 0.6 * alone)
    True
    """
    drives = as_drive_sequence(weights, engine.model.array.count)
    check_number("frame_s", frame_s, *_FRAME_S, "s")
    points = as_point_array("points_m", points_m)
    size = max(1, _VALUES_PER_CHUNK // len(drives))
    result = np.empty(len(points))
    for start in range(0, len(points), size):
        chunk = slice(start, start + size)
        settled = engine.pressure(drives, points[chunk])
        result[chunk] = _settled_mean_square(settled, frame_s, resonator)
    return result


def _settled_mean_square(
    settled: ComplexArray, frame_s: float, resonator: Resonator | None
) -> FloatArray:
    """Return the time average (M,) of |p|^2 over the fields *settled* (F, M), *frame_s* each.

    The fields repeat without end. A *resonator* follows them; without one they change at once.
    """
    if resonator is None or resonator.time_constant_s == 0.0:
        plain: FloatArray = 0.5 * np.mean(np.abs(settled) ** 2, axis=0)
        return plain
    left = resonator.decay(frame_s)
    share = resonator.time_constant_s / frame_s
    state = periodic_resonator_start(settled, left)
    total = np.zeros(settled.shape[1])
    for field in settled:
        gap = state - field
        # Means over the frame of 1, e^{-t/tau} and e^{-2t/tau}.
        total += np.abs(field) ** 2 + 0.5 * share * (1.0 - left**2) * np.abs(gap) ** 2
        total += 2.0 * share * (1.0 - left) * np.real(np.conj(field) * gap)
        state = field + left * gap
    return 0.5 * total / len(settled)


def periodic_resonator_start(settled: ComplexArray, left: float) -> ComplexArray:
    """Return the state before the first frame that the last frame leads back to."""
    state = np.zeros(settled.shape[1], dtype=np.complex128)
    for field in settled:
        state = field + left * (state - field)
    return state / (1.0 - left ** len(settled))

"""The numbers behind pictures and tables: errors, their bounds, and the frames to look at."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from haptogram.acoustics import AcousticModel
from haptogram.acoustics.arrays import FloatArray
from haptogram.verification import FrameStatus, FrameVerdict, RunVerdict

Vector: TypeAlias = tuple[float, float, float]

_MM: Final = 1e3
_CORNERS: Final = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def plotted_targets_mm(frames: Sequence[FrameVerdict]) -> FloatArray:
    """Return the intended foci, (F, 3)."""
    return _MM * np.array([frame.target_m for frame in frames], dtype=np.float64).reshape(-1, 3)


def plotted_focus_mm(frame: FrameVerdict) -> FloatArray:
    """Return the measured focus, (3,); a coordinate that cannot be observed is the target's."""
    target = _MM * np.array(frame.target_m)
    if frame.measured_m is None or frame.bound_mm is None:
        return target
    found = np.array(frame.measured_m, dtype=np.float64)  # None is NaN
    return np.where(np.isnan(found), target, _MM * found)


def plotted_relative_error(frame: FrameVerdict) -> float | None:
    """Return the error over its bound, on the axis where that is largest; None: not measured."""
    if frame.measured_m is None or frame.bound_mm is None:
        return None
    offset = np.abs(plotted_focus_mm(frame) - _MM * np.array(frame.target_m))
    ratios = [
        float(error) / bound
        for error, bound in zip(offset, frame.bound_mm, strict=True)
        if bound is not None and bound > 0.0
    ]
    return max(ratios, default=None)


def plotted_bounds_mm(
    model: AcousticModel, frame: FrameVerdict
) -> tuple[float, float | None] | None:
    """Return the largest errors across and along the beam that are within the bounds per axis.

    The bounds per axis span a box; its corners are the farthest.  Along the beam it is None where
    the axial error is not observable.
    """
    if frame.bound_mm is None or frame.lateral_error_mm is None:
        return None
    box = np.array([0.0 if bound is None else bound for bound in frame.bound_mm])
    ray = np.array(frame.target_m) - model.array.centre_m
    axis = ray / np.linalg.norm(ray)
    corners = _CORNERS * box
    along = corners @ axis
    across = np.linalg.norm(corners - along[:, None] * axis, axis=1)
    axial = None if frame.axial_error_mm is None else float(np.abs(along).max())
    return float(across.max()), axial


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSeries:
    """Errors of many frames in one direction, with the bound of each, in mm."""

    name: str
    errors_mm: FloatArray
    bounds_mm: FloatArray


def plotted_error_series(run: RunVerdict, model: AcousticModel) -> tuple[ErrorSeries, ErrorSeries]:
    """Return the lateral and the axial errors, without their signs."""
    lateral, axial = [], []
    for frame in run.frames:
        bounds = plotted_bounds_mm(model, frame)
        if bounds is None:
            continue
        lateral.append((frame.lateral_error_mm, bounds[0]))
        if bounds[1] is not None and frame.axial_error_mm is not None:
            axial.append((abs(frame.axial_error_mm), bounds[1]))
    return _plotted_series("lateral", lateral), _plotted_series("axial", axial)


def _plotted_series(name: str, pairs: Sequence[tuple[float | None, float]]) -> ErrorSeries:
    table = np.array(pairs, dtype=np.float64).reshape(-1, 2)
    return ErrorSeries(name, table[:, 0], table[:, 1])


def worst_frames_of_run(run: RunVerdict, number: int) -> list[FrameVerdict]:
    """Return the *number* frames to look at first: wrong ones, then the largest errors."""
    judged = [frame for frame in run.frames if frame.criteria or frame.faults]
    return sorted(judged, key=_plotted_badness, reverse=True)[:number]


def _plotted_badness(frame: FrameVerdict) -> tuple[bool, float, int]:
    """Return a sort key: wrong frames first, then by relative error."""
    wrong = frame.status is not FrameStatus.ON_TARGET
    return wrong, plotted_relative_error(frame) or 0.0, -frame.number


def plotted_frames_of_run(frames: Sequence[FrameVerdict], most: int) -> list[FrameVerdict]:
    """Return at most about *most* frames, evenly taken, with every one that is not on target."""
    step = -(-len(frames) // most)
    return [
        frame
        for place, frame in enumerate(frames)
        if step <= 1 or place % step == 0 or frame.status is not FrameStatus.ON_TARGET
    ]

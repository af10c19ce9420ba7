"""|p| in two planes through one focus, as a whole and close up."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from haptogram.acoustics import AcousticModel, Drive, NumpyEngine, focus_phases
from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.levels.harmonic import finite_amplitude_text
from haptogram.report.figures import PictureField, PicturePlane, sample_picture_plane
from haptogram.verification import FrameVerdict, RunVerdict

from .series import Vector, plotted_focus_mm, worst_frames_of_run

_SIDE_MM: Final = 160.0
_STEP_MM: Final = 1.25  # 7 points to a wavelength at 40 kHz
_LOWEST_MM: Final = 10.0  # above the array: nearer, single elements outshine the field
_ABOVE_FOCUS_MM: Final = 50.0
_CLOSE_SIDE_MM: Final = 30.0
_CLOSE_STEP_MM: Final = 0.5

_Range: TypeAlias = tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class RunFieldPicture:
    """The field around one focus, in two planes.

    Attributes
    ----------
    frame : FrameVerdict
        The frame whose focus is shown.
    latched : bool
        Whether the field is that of the latched drive; if not, of the ideal drive of the target.
    phase_bits : int
        Number of bits of each phase of that drive.
    level, upright : PictureField
        The plane z = target, and the vertical one through the target along the array's longer side.
    close_level, close_upright : PictureField
        The same around the target.
    """

    frame: FrameVerdict
    latched: bool
    phase_bits: int
    level: PictureField
    upright: PictureField
    close_level: PictureField
    close_upright: PictureField

    @property
    def most_kpa(self) -> float:
        """Highest pressure of all maps."""
        fields = self.level, self.upright, self.close_level, self.close_upright
        return max(float(np.nanmax(field_rms_kpa(field), initial=0.0)) for field in fields)

    @property
    def marks_mm(self) -> tuple[FloatArray, FloatArray]:
        """Target and measured focus, (3,) each."""
        return 1e3 * np.array(self.frame.target_m), plotted_focus_mm(self.frame)


def frame_field_picture(
    run: RunVerdict,
    model: AcousticModel,
    drives: Mapping[int, Drive] | None,
    phase_bits: int,
) -> RunFieldPicture | None:
    """Return the field of one frame of *run*, of a wrong frame if its drive is known.

    Parameters
    ----------
    drives : mapping of int to Drive, or None
        Drives that were latched, by frame number.  A frame without one is shown with the focus
        phases of its target, rounded to *phase_bits*, at full amplitude.

    Returns
    -------
    RunFieldPicture or None
        None if no frame was sent.
    """
    frame = _choose_pictured_frame(run, drives or {})
    if frame is None:
        return None
    drive = (drives or {}).get(frame.number)
    latched = drive is not None
    if drive is None:
        phases_rad = focus_phases(model, np.array(frame.target_m))
        drive = Drive.from_weights(np.exp(1j * phases_rad), phase_bits)
    fields = _panel_fields(model, drive, frame.target_m)
    return RunFieldPicture(frame, latched, drive.phase_bits, *fields)


def _choose_pictured_frame(run: RunVerdict, drives: Mapping[int, Drive]) -> FrameVerdict | None:
    candidates = worst_frames_of_run(run, len(run.frames)) or run.frames
    shown = [frame for frame in candidates if frame.number in drives] or [
        # The ideal drive would show a wrong frame as a right one.
        *(frame for frame in candidates if all(frame.criteria.values()) and not frame.faults),
        *candidates,
    ]
    return shown[0] if shown else None


def field_rms_kpa(field: PictureField) -> FloatArray:
    """Return the RMS pressure on a plane; NaN where a point lies in an element or behind it."""
    rms: FloatArray = np.abs(field.values) / math.sqrt(2.0) / 1e3
    return rms


def _panel_fields(model: AcousticModel, drive: Drive, target_m: Vector) -> Iterator[PictureField]:
    """Yield the level and the upright plane, then both close up."""
    half_extent = model.array.half_extent_m
    side = 1 if half_extent[1] > half_extent[0] else 0
    wide = [
        _panel_height(model, target_m) if axis == 2 else _panel_window(model, target_m, axis)
        for axis in range(3)
    ]
    close = [_panel_range(1e3 * middle, _CLOSE_SIDE_MM) for middle in target_m]
    engine, weights = NumpyEngine(model), drive.weights()
    for ranges, step_mm in ((wide, _STEP_MM), (close, _CLOSE_STEP_MM)):
        for across, up in ((0, 1), (side, 2)):
            name = "xyz"[across] + "xyz"[up]
            plane = PicturePlane(name, target_m, ranges[across], ranges[up], step_mm / 1e3)
            yield sample_picture_plane(engine, weights, plane)


def _panel_height(model: AcousticModel, target_m: Vector) -> _Range:
    """Return the heights from just above the array to well above the target, in m."""
    bottom = min(1e3 * float(model.array.centre_m[2]), 1e3 * target_m[2] - _ABOVE_FOCUS_MM)
    top = max(bottom + _SIDE_MM, 1e3 * target_m[2] + _ABOVE_FOCUS_MM)
    low = bottom + _LOWEST_MM
    steps = math.floor((top - low) / _STEP_MM + 0.5)
    return 1e-3 * low, 1e-3 * (low + steps * _STEP_MM)


def _panel_window(model: AcousticModel, target_m: Vector, axis: int) -> _Range:
    """Return the range around the array's middle, or the target if it is not near it, in m."""
    middle, target = 1e3 * float(model.array.centre_m[axis]), 1e3 * target_m[axis]
    if abs(target - middle) > 0.75 * _SIDE_MM / 2.0:
        middle = target
    return _panel_range(middle, _SIDE_MM)


def _panel_range(middle_mm: float, side_mm: float) -> _Range:
    """Return the interval of a given side length around its middle."""
    return 1e-3 * (middle_mm - side_mm / 2.0), 1e-3 * (middle_mm + side_mm / 2.0)


def run_finite_amplitude(run: RunVerdict, model: AcousticModel) -> Iterator[str]:
    """Yield the limits of the linear field, at the focus that strains it most."""
    heard = [frame for frame in run.frames if frame.pressure_rms_pa is not None]
    if not heard:
        return

    def reach(frame: FrameVerdict) -> float:
        return (frame.pressure_rms_pa or 0.0) * math.dist(frame.target_m, model.array.centre_m)

    frame, engine = max(heard, key=reach), NumpyEngine(model)
    ideal = np.exp(1j * focus_phases(model, frame.target_m))
    full_pa = float(np.abs(engine.pressure(ideal, [frame.target_m])[0])) / math.sqrt(2.0)
    weights = ideal * (frame.pressure_rms_pa or 0.0) / full_pa
    text = finite_amplitude_text(engine, weights, frame.target_m)
    if text is not None:
        yield f"Frame {frame.number}, {text}."

"""The picture of ``haptogram field``, and the figures of a focus as text."""

from __future__ import annotations

import argparse
import math
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from haptogram.acoustics import (
    NoFocus,
    NumpyEngine,
    Reconstructor,
    SingleFocus,
    force_on_disc_n,
    level_db_spl,
)
from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.field.engines.engine import choose_engine, why_not_compiled
from haptogram.acoustics.levels.average import mean_square_pressure
from haptogram.acoustics.levels.dynamics import Resonator
from haptogram.acoustics.levels.harmonic import finite_amplitude_text
from haptogram.acoustics.levels.lobes import largest_secondary_lobe
from haptogram.acoustics.levels.shift import find_pressure_peak, predict_focal_shift
from haptogram.acoustics.levels.spot import measure_spot
from haptogram.errors import ConfigurationError, refusals_of
from haptogram.report import figures
from haptogram.report.figures.planes import MAX_POINTS
from haptogram.settings.arguments import Progress

from ..shell.positions import position_text
from .scene import FieldScene

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_NO_FOCUS: Final = 0.25  # largest shift of a focus, relative to the target's distance


def check_field_picture_size(arguments: argparse.Namespace) -> None:
    """Raise, before the work begins, if the picture would have too many samples or none.

    Raises
    ------
    ConfigurationError
        Names the step, the half width and the limit.
    """
    step_mm, half_mm = arguments.step_mm, arguments.half_width_mm
    if step_mm >= half_mm:
        raise ConfigurationError(
            f"step_mm is {step_mm:g}, must be below {half_mm:g} mm with --half-width-mm {half_mm:g}"
        )
    samples = (2 * half_mm / step_mm + 1) ** 2
    if samples > MAX_POINTS:
        raise ConfigurationError(
            f"step_mm is {step_mm:g}; with --half-width-mm {half_mm:g} the picture has "
            f"{samples:.3g} samples, must be at most {MAX_POINTS}: take a larger step"
        )


def draw_field_picture(
    arguments: argparse.Namespace, scene: FieldScene, progress: Progress | None
) -> Figure:
    """Return the picture that the command line asks for.

    Raises
    ------
    ConfigurationError
        Sizes out of range; no matplotlib.
    """
    engine = choose_engine(scene.model)
    plane = figures.PicturePlane.around(
        scene.model.array,
        arguments.plane,
        scene.look_m,
        arguments.half_width_mm / 1e3,
        arguments.step_mm / 1e3,
    )
    if scene.is_sequence:
        resonator = Resonator.from_bandwidth()
        field = figures.sample_picture_mean(
            engine, scene.weights, plane, scene.frame_s, resonator, progress=progress
        )
    else:
        field = figures.sample_picture_plane(engine, scene.weights[0], plane, progress)
    return figures.draw_plane_figure(
        field,
        quantity=arguments.quantity,
        targets_m=scene.targets_m,
        title=_scene_title(arguments, scene),
        decibels=bool(arguments.decibels),
    )


def _scene_title(arguments: argparse.Namespace, scene: FieldScene) -> str:
    """Return a line that names the drive or the object."""
    array = arguments.preset or f"{scene.model.array.count} elements"
    if arguments.drive:
        return f"{array}, drive of {arguments.drive.name}"
    if scene.is_sequence:
        frames = f"mean over {len(scene.weights)} frames of {scene.frame_s * 1e3:g} ms"
        return f"{array}, {Path(arguments.object).name}: {frames}"
    return f"{array}, focus at ({position_text(scene.targets_m[0])}) mm"


def describe_field_scene(scene: FieldScene) -> Iterator[str]:
    """Yield the figures of the focus, or of the sequence, line by line."""
    engine = NumpyEngine(scene.model)
    yield f"array: {scene.model.array.count} elements, k = {scene.model.wavenumber:.2f} rad/m"
    slower = why_not_compiled(scene.model)
    if slower is not None:
        yield slower
    if scene.is_sequence:
        share = Resonator.from_bandwidth().dwell_mean_square(scene.frame_s)
        yield (
            f"sequence: {len(scene.weights)} points of {scene.frame_s * 1e3:g} ms; from rest, a "
            f"transducer of 2 kHz bandwidth delivers {share:.0%} of the static force in a dwell"
        )
    elif len(scene.targets_m):
        yield from _describe_field_focus(engine, scene)
    else:
        yield from _describe_field_drive(scene)
    if scene.place_m is not None:
        with refusals_of("--at-mm:"):
            yield _describe_field_place(engine, scene, scene.place_m)


def _describe_field_place(
    engine: NumpyEngine, scene: FieldScene, place_m: tuple[float, float, float]
) -> str:
    """Return a line on the RMS pressure at a place; of a sequence, averaged over its frames.

    A level in dB SPL follows, unless the pressure is 0.
    """
    if scene.is_sequence:
        lag = Resonator.from_bandwidth()
        square = mean_square_pressure(engine, scene.weights, [place_m], scene.frame_s, lag)[0]
    else:
        square = abs(engine.pressure(scene.weights[0], [place_m])[0]) ** 2 / 2.0
    rms = math.sqrt(square)
    level = f", {level_db_spl(rms):.1f} dB SPL" if rms > 0.0 else ""
    return f"at ({position_text(place_m)}) mm: {rms:.0f} Pa RMS{level}"


def _describe_field_drive(scene: FieldScene) -> Iterator[str]:
    """Yield lines on the focus of a drive from a file and its nonlinearity, or that it has none."""
    found = Reconstructor(scene.model, scene.phase_bits).reconstruct_weights(scene.weights[0])
    if isinstance(found, NoFocus):
        yield f"no focus: {found.reason}"
        return
    place = position_text(found.position_m)
    what = "focus" if isinstance(found, SingleFocus) else "no single focus; best explained from"
    yield f"{what} ({place}) mm: {found.pressure_rms_pa:.0f} Pa RMS there"
    if isinstance(found, SingleFocus):
        yield from textwrap.wrap(found.ambiguity_text, 98, subsequent_indent="  ")
        yield from _describe_finite_amplitude(scene, found.position_m)


def _describe_finite_amplitude(scene: FieldScene, focus_m: ArrayLike) -> Iterator[str]:
    """Yield a warning where the sound is too loud for linear acoustics; else nothing."""
    text = finite_amplitude_text(NumpyEngine(scene.model), scene.weights[0], focus_m)
    yield from () if text is None else textwrap.wrap(text, 98, subsequent_indent="  ")


def _describe_field_focus(engine: NumpyEngine, scene: FieldScene) -> Iterator[str]:
    """Yield lines about pressure, peak and spot of the focus at the first target."""
    target, weights = scene.targets_m[0], scene.weights[0]
    rms = float(np.abs(engine.pressure(weights, [target])[0])) / math.sqrt(2.0)
    yield f"target ({position_text(target)}) mm: {rms:.0f} Pa RMS, {level_db_spl(rms):.1f} dB SPL"
    yield _describe_field_peak(engine, weights, target)
    spot = measure_spot(engine, weights, target)
    across = " x ".join(_extent_text(width_m) for width_m in spot.width_6db_m)
    yield f"spot at -6 dB: {across} mm; depth at -3 dB: {_extent_text(sum(spot.depth_3db_m))} mm"
    yield from _describe_finite_amplitude(scene, target)
    force = force_on_disc_n(engine, weights, target)
    yield (
        "force on a reflecting disc of 20 mm diameter, parallel to the array's face: "
        f"{force * 1e3:.2f} mN"
    )
    lobe = largest_secondary_lobe(engine, weights, target)
    if lobe is not None:
        yield (
            f"largest secondary lobe in the plane of that disc: {lobe.level_db:.1f} dB at "
            f"({position_text(lobe.position_m)}) mm"
        )


def _describe_field_peak(engine: NumpyEngine, weights: ArrayLike, target: FloatArray) -> str:
    """Return a line on the pressure peak: its shift from the target, or why there is no focus."""
    try:
        peak = find_pressure_peak(engine, weights, target)
    except ConfigurationError as error:
        return f"no focus: {error}"
    shift_m = float(np.linalg.norm(peak - target))
    expected = predict_focal_shift(engine.model, target, np.abs(weights))
    if shift_m > _NO_FOCUS * np.linalg.norm(target - engine.model.array.centre_m):
        why = "the aperture is too small to focus there"
    elif expected.valid:
        expected_m = float(np.linalg.norm(expected.offset_m))
        why = f"expected about {expected_m * 1e3:.2f} mm, by diffraction"
    else:
        why = "by diffraction; too far for a prediction, as the aperture is small for this distance"
    return f"maximum ({position_text(peak)}) mm: {shift_m * 1e3:.2f} mm from the target ({why})"


def _extent_text(size_m: float) -> str:
    """Return a length in mm as text; if infinite, that it goes beyond the searched volume."""
    return f"{size_m * 1e3:.1f}" if math.isfinite(size_m) else "(beyond what was looked at)"

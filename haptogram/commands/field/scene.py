"""Scene of ``haptogram field``: a model, its drives, the place to look at, levels at an ear."""

from __future__ import annotations

import argparse
import math
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from haptogram import acoustics
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.field.reference import pressure_level_in_front
from haptogram.acoustics.levels.exposure import GUIDELINE, STATEMENT, worst_exposure
from haptogram.acoustics.local_maximum import STEPS, climb_to_maximum
from haptogram.acoustics.model.csv_rows import read_element_rows
from haptogram.acoustics.solvers.focus import MIN_TARGET_DISTANCE_M
from haptogram.errors import ConfigurationError, refusals_of
from haptogram.objects.modulation import FocusFrames, Modulation
from haptogram.objects.run_frames import check_run_foci_in_reach, sample_object_of_run
from haptogram.objects.shapes import Circle
from haptogram.published import find_preset
from haptogram.settings.command_line import settings_of
from haptogram.settings.shape import ShapeConfig

from ..shell.array_options import array_model
from ..shell.positions import metres_of_position, position_text

_PATH_RADIUS_M: Final = 0.020
_PATH_STEP_M: Final = 1e-3


@dataclass(frozen=True, eq=False, slots=True)
class FieldScene:
    """One model and what drives it.

    Attributes
    ----------
    model : AcousticModel
        The array in its air.
    weights : (F, N) numpy.ndarray
        Its drives, with rounded phases and amplitudes; one unless it is an object.
    targets_m : (T, 3) numpy.ndarray
        Foci that were asked for; none for a drive from a file.
    look_m : (float, float, float)
        Where the picture is centred.
    frame_s : float
        Duration of a drive.
    place_m : (float, float, float) or None
        Place to look at that was asked for.
    phase_bits : int
        Resolution of the phases.
    """

    model: acoustics.AcousticModel
    weights: ComplexArray
    targets_m: FloatArray
    look_m: tuple[float, float, float]
    frame_s: float
    place_m: tuple[float, float, float] | None = None
    phase_bits: int = 8

    @classmethod
    def from_arguments(cls, arguments: argparse.Namespace) -> FieldScene:
        """Return the scene that the command line asks for."""
        model = array_model(arguments)
        frame_s = 1.0 / arguments.rate_hz
        place = None if arguments.at_mm is None else metres_of_position(arguments.at_mm)
        if arguments.drive:
            drive = read_field_drive_file(arguments.drive, model.array.count, arguments.phase_bits)
            weights = drive.weights()
            look = place or _scene_peak(model, weights)
            return cls(
                model, weights[None], np.empty((0, 3)), look, frame_s, place, drive.phase_bits
            )
        if arguments.object:
            targets = sample_object_of_run(settings_of(arguments, ShapeConfig))
            look = metres_of_position(arguments.center_mm)
        else:
            look = _field_focus(arguments)
            targets = np.array([look])
        check_run_foci_in_reach(model, targets, "center_mm" if arguments.object else "focus_mm")
        phases = acoustics.focus_phases(model, targets)
        drives = [
            acoustics.Drive.from_weights(np.exp(1j * row), arguments.phase_bits) for row in phases
        ]
        weights = np.stack([drive.weights() for drive in drives])
        return cls(model, weights, targets, place or look, frame_s, place)

    @property
    def is_sequence(self) -> bool:
        """True if there is more than one drive."""
        return len(self.weights) > 1


def modulated_field_scene(arguments: argparse.Namespace, scene: FieldScene) -> FocusFrames:
    """Return a pass of the focus as it is modulated.

    Raises
    ------
    ConfigurationError
        A drive from a file, which has no focus; a frequency or a rate out of range.
    """
    if not len(scene.targets_m):
        raise ConfigurationError("a modulation needs a focus; a drive from a file has none")
    points = scene.targets_m
    if arguments.modulation == "stm":
        points = Circle(_PATH_RADIUS_M, points[0]).sample(_PATH_STEP_M)
    modulation = Modulation(arguments.modulation, arguments.modulation_hz)
    return modulation.frames(points, arguments.rate_hz)


def read_field_drive_file(path: Path, count: int, phase_bits: int) -> acoustics.Drive:
    """Read the codes of *count* elements from a CSV file with the header ``phase,amplitude``.

    Raises
    ------
    ConfigurationError
        Names the file, and the line where there is one.
    """
    rows = read_element_rows(path, "drive")
    if not rows or rows[0][1] != ["phase", "amplitude"]:
        raise ConfigurationError(f"{path}: the first line must be phase,amplitude")
    codes = np.array(
        [_field_drive_file_codes(f"{path}:{number}", cells) for number, cells in rows[1:]],
        dtype=int,
    )
    if len(codes) != count:
        raise ConfigurationError(f"{path}: {len(codes)} elements, the array has {count}")
    with refusals_of(f"{path}:"):
        return acoustics.Drive(codes[:, 0], codes[:, 1], phase_bits)


def _field_drive_file_codes(where: str, cells: list[str]) -> tuple[int, int]:
    """Return the phase and amplitude code in the *cells* of a row of a drive file.

    ConfigurationError, naming the row *where*, if they are not two whole numbers.
    """
    try:
        phase, amplitude = (int(np.int64(cell)) for cell in cells)
    except (OverflowError, ValueError) as error:
        raise ConfigurationError(f"{where}: {','.join(cells)!r} is not two codes") from error
    return phase, amplitude


def _field_focus(arguments: argparse.Namespace) -> tuple[float, float, float]:
    """Return the focus in m: --focus-mm, else that of --preset, else 150 mm ahead."""
    if arguments.focus_mm is None and arguments.preset:
        return find_preset(arguments.preset).focus_m
    return metres_of_position(arguments.focus_mm or (0.0, 0.0, 150.0))


def _scene_peak(
    model: acoustics.AcousticModel, weights: ComplexArray
) -> tuple[float, float, float]:
    """Return the place (m) of the pressure maximum, climbed to from a grid along the array's axes.

    The grid is as wide as the array, and 30 to 300 mm high.
    """
    reach = float(model.array.half_extent_m[:2].max())
    side = np.linspace(-reach, reach, 25)
    heights = np.linspace(0.03, 0.30, 46)
    points = np.stack(np.meshgrid(side, side, heights, indexing="ij"), axis=-1).reshape(-1, 3)
    points = model.array.world_m(points)
    engine = acoustics.NumpyEngine(model)
    level = pressure_level_in_front(engine, weights, points)
    best = points[[int(np.argmax(level))]]
    spacing = max(side[1] - side[0], heights[1] - heights[0])
    steps = STEPS @ model.array.axes
    top, _ = climb_to_maximum(
        lambda places: pressure_level_in_front(engine, weights, places), best, spacing, steps
    )
    x, y, z = (np.round(top, 5) + 0.0).tolist()  # a hundredth of a millimetre, and no minus zero
    return x, y, z


_LISTENER_M: Final = 0.5


def describe_field_levels(arguments: argparse.Namespace, scene: FieldScene) -> Iterator[str]:
    """Yield the levels at the loudest place half a metre away and, if asked for, at an ear."""
    engine = acoustics.choose_engine(scene.model)
    worst = worst_exposure(engine, scene.weights, _LISTENER_M, scene.frame_s)
    yield (
        f"loudest {_LISTENER_M:g} m from the centre: {worst.equivalent_db_spl:.1f} dB SPL at "
        f"({position_text(worst.position_m)}) mm"
    )
    yield from textwrap.wrap(STATEMENT, 98, initial_indent="  ", subsequent_indent="  ")
    if arguments.ear_mm is not None:
        yield from _describe_ear_in_field(arguments, scene)


def _describe_ear_in_field(arguments: argparse.Namespace, scene: FieldScene) -> Iterator[str]:
    """Yield the levels of the ultrasound at --ear-mm.

    ConfigurationError for a place within the array.
    """
    engine, lag = acoustics.choose_engine(scene.model), acoustics.Resonator.from_bandwidth()
    ear = metres_of_position(arguments.ear_mm)
    distance_m = math.dist(ear, scene.model.array.centre_m)
    if distance_m < MIN_TARGET_DISTANCE_M:
        raise ConfigurationError(
            f"--ear-mm is within the array, {distance_m * 1e3:.1f} mm from its centre; "
            f"it can be from {MIN_TARGET_DISTANCE_M * 1e3:g} mm on"
        )
    weights, what = _scene_sequence(arguments, scene)
    with refusals_of("--ear-mm:"):
        exposure = acoustics.exposure_at(engine, weights, [ear], scene.frame_s, lag)[0]
    at = f"({position_text(ear)}) mm, {distance_m * 1e3:.0f} mm from the centre"
    yield f"at an ear at {at}; {what}:"
    yield (
        f"  ultrasound: {exposure.maximum_db_spl:.1f} dB SPL at most, "
        f"{exposure.equivalent_db_spl:.1f} dB SPL on average (Leq)"
    )
    yield from textwrap.wrap(GUIDELINE, 98, initial_indent="    ", subsequent_indent="    ")


def _scene_sequence(arguments: argparse.Namespace, scene: FieldScene) -> tuple[ComplexArray, str]:
    """Return the drives (F, N) that the scene repeats, and their description.

    One focus is modulated as the options say.
    """
    if scene.is_sequence or not len(scene.targets_m):
        count = len(scene.weights)
        return scene.weights, (
            f"{count} drives of {scene.frame_s * 1e3:g} ms" if count > 1 else "a steady drive"
        )
    name = arguments.modulation.upper()
    what = f"{name} at {arguments.modulation_hz:g} Hz, {arguments.rate_hz:g} frames/s"
    return modulated_field_scene(arguments, scene).weights(scene.model), what

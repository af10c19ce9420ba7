"""The frames that a run displays and the array that its host assumes, from the settings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import AcousticModel, Medium, Transducer, TransducerArray
from haptogram.acoustics.solvers.focus import check_focus_targets
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Focus
from haptogram.settings.array import ArrayConfig
from haptogram.settings.run.frames import PaceConfig
from haptogram.settings.run.verify import VerifyConfig
from haptogram.settings.shape import UNITS_M, ModulationConfig, ShapeConfig

from . import shapes as tactile
from .modulation import FocusFrames, Modulation

#: Length of a mesh that can be displayed, and felt as one.
LEAST_MESH_M: Final = 1e-3
MOST_MESH_M: Final = 2.0
#: A run keeps its frames, with what was seen of them: some 6 kB each.
MOST_FRAMES: Final = 200_000


def host_model_of_run_frames(
    config: ArrayConfig, array: TransducerArray | None = None
) -> AcousticModel:
    """Return the array and the air that the host assumes; by default the virtual board's array."""
    if array is None:
        array = TransducerArray.parse(config.virtual_array, pitch_m=config.pitch_mm / 1e3)
    transducer = Transducer()
    air = Medium.air(config.temperature_c, frequency_hz=transducer.frequency_hz)
    return AcousticModel(array, air, transducer)


def frames_of_run(shape: ShapeConfig, pace: PaceConfig, modulated: ModulationConfig) -> FocusFrames:
    """Return the frames of one pass: the object's points, modulated and held as the settings say.

    Raises
    ------
    ConfigurationError
        As :func:`sample_object_of_run` and :meth:`haptogram.objects.modulation.Modulation.frames`.
    """
    x, y, z = (coordinate / 1e3 for coordinate in modulated.shift_mm)
    modulation = Modulation(
        modulated.modulation,
        modulated.modulation_hz,
        modulated.depth,
        (x, y, z),
        None if modulated.dwell_ms is None else modulated.dwell_ms / 1e3,
    )
    frames = modulation.frames(sample_object_of_run(shape, pace.repeat), pace.rate_hz)
    _check_frame_count(pace.repeat, frames.count, "frames")
    return frames


def sample_object_of_run(config: ShapeConfig, repeat: int = 1) -> NDArray[np.float64]:
    """Return the (T, 3) points to display, in metres, in the order of one pass.

    Raises
    ------
    ConfigurationError
        A resolution that the object cannot have, a mesh that cannot be read, or more frames than
        one run can keep.
    """
    points = _shape_of_run(config).sample(config.resolution_mm / 1e3)
    _check_frame_count(repeat, len(points), "points")
    return points


def _check_frame_count(repeat: int, count: int, of_what: str) -> None:
    """Refuse more than MOST_FRAMES frames: *count* of *of_what*, *repeat* times."""
    if count * repeat > MOST_FRAMES:
        raise ConfigurationError(
            f"{repeat} times {count} {of_what} are {count * repeat} frames; "
            f"a run keeps them all, and can have {MOST_FRAMES}"
        )


def _shape_of_run(config: ShapeConfig) -> tactile.TactileObject:
    """Return the object that the options describe, in metres."""
    radius_m = config.radius_mm / 1e3
    x, y, z = (coordinate / 1e3 for coordinate in config.center_mm)
    center_m = (x, y, z)
    match config.object:
        case "point":
            return tactile.Point(center_m)
        case "line":
            return tactile.Line((x - radius_m, y, z), (x + radius_m, y, z))
        case "circle":
            return tactile.Circle(radius_m, center_m)
        case "sphere":
            return tactile.Sphere(radius_m, center_m)
        case "hemisphere":
            return tactile.Hemisphere(radius_m, center_m)
    unit_m = UNITS_M[config.unit]
    mesh = tactile.MeshSurface.from_file(config.object, center_m=center_m, unit_m=unit_m)
    _check_mesh_size(mesh, config)
    return mesh


def _check_mesh_size(mesh: tactile.MeshSurface, config: ShapeConfig) -> None:
    """Refuse a mesh not 1 mm to 2 m long in the unit *config* names; suggest another unit."""
    size_m = float(np.ptp(mesh.mesh.bounds, axis=0).max())
    size = size_m / UNITS_M[config.unit]
    if LEAST_MESH_M <= size_m <= MOST_MESH_M:
        return
    fitting = [u for u, m in UNITS_M.items() if LEAST_MESH_M <= size * m <= MOST_MESH_M]
    hint = f"; the file may be in {' or '.join(fitting)}: give --unit" if fitting else ""
    raise ConfigurationError(
        f"{config.object}: the mesh is {size_m * 1e3:.3g} mm long with --unit {config.unit}; it "
        f"can be {LEAST_MESH_M * 1e3:g} to {MOST_MESH_M * 1e3:g} mm long{hint}"
    )


def check_run_foci_in_reach(
    model: AcousticModel, points_m: NDArray[np.float64], name: str = "center_mm"
) -> None:
    """Refuse foci out of the array's reach; the error begins with *name*, their setting.

    Raises
    ------
    ConfigurationError
        As :func:`haptogram.acoustics.check_focus_target`.
    """
    try:
        check_focus_targets(model, points_m)
    except ConfigurationError as error:
        raise ConfigurationError(f"{name} puts a focus out of reach: {error}") from error


def targets_of_run(
    config: VerifyConfig, shown: FocusFrames
) -> Sequence[Focus] | Sequence[Sequence[Focus]]:
    """Return the focus, or the foci, of each frame of one pass.

    Raises
    ------
    ConfigurationError
        If the object has fewer points than a frame has foci.
    """
    foci = [
        Focus.at(point, amplitude / config.drive.foci)
        for point, amplitude in zip(shown.points_m.tolist(), shown.amplitudes.tolist(), strict=True)
    ]
    return foci if config.drive.foci == 1 else _run_foci_at_once(foci, config.drive.foci)


def _run_foci_at_once(foci: list[Focus], count: int) -> list[list[Focus]]:
    """Return for every frame *count* of the foci, evenly apart in the order of *foci*.

    Raises a ConfigurationError if the object has fewer points.
    """
    total = len(foci)
    if count > total:
        raise ConfigurationError(f"{count} foci at once, and the object has {total} points")
    return [
        [foci[(number + place * total // count) % total] for place in range(count)]
        for number in range(total)
    ]

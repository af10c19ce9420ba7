"""The fields by which array, air and transducers of a board are written down as JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from haptogram.acoustics.model.calibration import Calibration
    from haptogram.acoustics.model.model import AcousticModel


def model_record_fields(model: AcousticModel) -> dict[str, Any]:
    """Return the fields of *model*, of JSON types; docs/backdoor.md describes them."""
    array, medium, transducer = model.array, model.medium, model.transducer
    return {
        "grid_shape": list(array.grid_shape) if array.grid_shape else None,
        "pitch_m": array.pitch_m,
        "positions_m": array.positions_m.tolist(),
        "normals": array.normals.tolist(),
        "geometry_hash": array.digest(),
        "calibration": calibration_record_fields(model.calibration),
        "medium": {
            "sound_speed_m_s": medium.sound_speed_m_s,
            "density_kg_m3": medium.density_kg_m3,
            "absorption_np_m": medium.absorption_np_m,
        },
        "transducer": {
            "directivity": repr(transducer.directivity),
            "source_strength_pa_m": transducer.source_strength_pa_m,
            "frequency_hz": transducer.frequency_hz,
        },
    }


def calibration_record_fields(calibration: Calibration | None) -> dict[str, Any] | None:
    """Return the fields of a calibration; None: there is none."""
    names = ("gain", "phase_rad", "positions_m")
    if calibration is None:
        return None
    return {name: getattr(calibration, name).tolist() for name in names}

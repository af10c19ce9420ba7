"""Linear acoustics of phased arrays: drive -> field -> focus, in float64.

Every function is pure and every value frozen; nothing reads a clock, a file descriptor or the wire.
Phasors are peak values, the time factor is e^{-j w t}, a wave runs as e^{+j k r}.

Names that the reconstruction of a focus does not need are imported when they are first asked for.
The examples of all public names go on from the one here.

Examples
--------
>>> import numpy as np
>>> from haptogram.acoustics import *
>>> array = TransducerArray.grid(16, 16, pitch_m=0.01)
>>> model = AcousticModel(array, Medium.air(), Transducer())
>>> target = (0.0, 0.0, 0.15)
>>> weights = np.exp(1j * focus_phases(model, target))
>>> drive = Drive.from_weights(weights, phase_bits=8)
>>> engine = NumpyEngine(model)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Final

from haptogram.acoustics.field.engines.engine import NumbaEngine, choose_engine
from haptogram.acoustics.field.reference import (
    FieldEngine,
    NumpyEngine,
    points_in_front,
    pressure,
    propagators,
)
from haptogram.acoustics.levels.force import force_on_disc_n, level_db_spl, radiation_pressure_pa
from haptogram.acoustics.model.drive import (
    Drive,
    dequantise_phase,
    phase_step_rad,
    quantise_phase,
    saturated_weights,
)
from haptogram.acoustics.model.geometry import TransducerArray
from haptogram.acoustics.model.medium import Medium, iso_9613_absorption_np_m
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.model.transducer import (
    CircularPiston,
    Directivity,
    PointSource,
    Transducer,
)
from haptogram.acoustics.reconstruct.estimates import (
    NoFocus,
    NotSingle,
    Reconstruction,
    SingleFocus,
)
from haptogram.acoustics.reconstruct.reconstruction import Reconstructor
from haptogram.acoustics.solvers.focus import check_focus_target, focus_phases, superpose_foci
from haptogram.acoustics.solvers.focus_fit import PhaseFit, fit_focus

if TYPE_CHECKING:
    from haptogram.acoustics.levels.average import mean_square_pressure
    from haptogram.acoustics.levels.dynamics import Resonator
    from haptogram.acoustics.levels.exposure import Exposure, exposure_at, worst_exposure
    from haptogram.acoustics.levels.harmonic import shock_lengths
    from haptogram.acoustics.levels.lobes import SecondaryLobe, largest_secondary_lobe
    from haptogram.acoustics.levels.shift import FocalShift, find_pressure_peak, predict_focal_shift
    from haptogram.acoustics.levels.spot import FocalSpot, measure_spot
    from haptogram.acoustics.model.calibration import Calibration
    from haptogram.acoustics.model.directivities import RectangularPiston
    from haptogram.acoustics.reconstruct.tracking import Fix, FocusTracker
    from haptogram.acoustics.solvers.several import solve_foci, weights_for_foci

__all__ = [
    "AcousticModel",
    "Calibration",
    "CircularPiston",
    "Directivity",
    "Drive",
    "Exposure",
    "FieldEngine",
    "Fix",
    "FocalShift",
    "FocalSpot",
    "FocusTracker",
    "Medium",
    "NoFocus",
    "NotSingle",
    "NumbaEngine",
    "NumpyEngine",
    "PhaseFit",
    "PointSource",
    "Reconstruction",
    "Reconstructor",
    "RectangularPiston",
    "Resonator",
    "SecondaryLobe",
    "SingleFocus",
    "Transducer",
    "TransducerArray",
    "check_focus_target",
    "choose_engine",
    "dequantise_phase",
    "exposure_at",
    "find_pressure_peak",
    "fit_focus",
    "focus_phases",
    "force_on_disc_n",
    "iso_9613_absorption_np_m",
    "largest_secondary_lobe",
    "level_db_spl",
    "mean_square_pressure",
    "measure_spot",
    "phase_step_rad",
    "points_in_front",
    "predict_focal_shift",
    "pressure",
    "propagators",
    "quantise_phase",
    "radiation_pressure_pa",
    "saturated_weights",
    "shock_lengths",
    "solve_foci",
    "superpose_foci",
    "weights_for_foci",
    "worst_exposure",
]

_LATER: Final = {
    "levels.average": "mean_square_pressure",
    "levels.dynamics": "Resonator",
    "levels.exposure": "Exposure exposure_at worst_exposure",
    "levels.harmonic": "shock_lengths",
    "levels.lobes": "SecondaryLobe largest_secondary_lobe",
    "levels.shift": "FocalShift find_pressure_peak predict_focal_shift",
    "levels.spot": "FocalSpot measure_spot",
    "model.calibration": "Calibration",
    "model.directivities": "RectangularPiston",
    "reconstruct.tracking": "Fix FocusTracker",
    "solvers.several": "solve_foci weights_for_foci",
}
_HOME: Final = {name: module for module, names in _LATER.items() for name in names.split()}


def __getattr__(name: str) -> object:
    """Import a public name when it is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)

"""Linear acoustics of phased arrays: drive -> field -> focus, in float64.

Everything here is a pure function of its arguments or a frozen value; nothing reads a clock, a file
descriptor or the wire. Phasors are peak values, the time factor is e^{-j w t}, a wave runs as
e^{+j k r}.
"""

from haptogram.acoustics.drive import Drive, dequantise_phase, phase_step_rad, quantise_phase
from haptogram.acoustics.field import FieldEngine, NumpyEngine, pressure, propagators
from haptogram.acoustics.focus import (
    PhaseFit,
    check_target,
    fit_focus,
    focus_phases,
    superpose,
)
from haptogram.acoustics.geometry import TransducerArray
from haptogram.acoustics.medium import Medium
from haptogram.acoustics.model import AcousticModel
from haptogram.acoustics.radiation import force_on_disc_n, level_db_spl, radiation_pressure_pa
from haptogram.acoustics.reconstruction import (
    NoFocus,
    NotSingle,
    Reconstruction,
    Reconstructor,
    SingleFocus,
)
from haptogram.acoustics.transducer import CircularPiston, Directivity, PointSource, Transducer

__all__ = [
    "AcousticModel",
    "CircularPiston",
    "Directivity",
    "Drive",
    "FieldEngine",
    "Medium",
    "NoFocus",
    "NotSingle",
    "NumpyEngine",
    "PhaseFit",
    "PointSource",
    "Reconstruction",
    "Reconstructor",
    "SingleFocus",
    "Transducer",
    "TransducerArray",
    "check_target",
    "dequantise_phase",
    "fit_focus",
    "focus_phases",
    "force_on_disc_n",
    "level_db_spl",
    "phase_step_rad",
    "pressure",
    "propagators",
    "quantise_phase",
    "radiation_pressure_pa",
    "superpose",
]

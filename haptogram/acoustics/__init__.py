"""Linear acoustics of phased arrays: drive -> field -> focus, in float64.

Everything here is a pure function of its arguments or a frozen value; nothing reads a clock, a file
descriptor or the wire. Phasors are peak values, the time factor is e^{-j w t}, a wave runs as
e^{+j k r}.

What is not needed to rebuild a focus is imported when it is first asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Final

from haptogram.acoustics.drive import (
    Drive,
    dequantise_phase,
    phase_step_rad,
    quantise_phase,
    saturated,
)
from haptogram.acoustics.engine import NumbaEngine, Numpy32Engine, choose_engine
from haptogram.acoustics.estimates import NoFocus, NotSingle, Reconstruction, SingleFocus
from haptogram.acoustics.field import FieldEngine, NumpyEngine, in_front, pressure, propagators
from haptogram.acoustics.focus import (
    PhaseFit,
    check_target,
    fit_focus,
    focus_phases,
    superpose,
)
from haptogram.acoustics.geometry import TransducerArray
from haptogram.acoustics.medium import Medium, iso_9613_absorption_np_m
from haptogram.acoustics.model import AcousticModel
from haptogram.acoustics.radiation import force_on_disc_n, level_db_spl, radiation_pressure_pa
from haptogram.acoustics.reconstruction import Reconstructor
from haptogram.acoustics.transducer import CircularPiston, Directivity, PointSource, Transducer

if TYPE_CHECKING:
    from haptogram.acoustics.average import mean_square_pressure
    from haptogram.acoustics.batch import FocusCodes
    from haptogram.acoustics.calibration import Calibration
    from haptogram.acoustics.demodulation import (
        demodulated_level_db_a,
        demodulated_lines,
        radiated_power_w,
    )
    from haptogram.acoustics.directivities import MeasuredDirectivity, RectangularPiston
    from haptogram.acoustics.dynamics import (
        Resonator,
        amplitude_to_duty,
        duty_to_amplitude,
        hop_response,
    )
    from haptogram.acoustics.exposure import (
        Exposure,
        a_weighting_db,
        exposure_at,
        switching_level_db_a,
        worst_place,
    )
    from haptogram.acoustics.grid import GridField, box_points_m
    from haptogram.acoustics.lobes import (
        GratingLobe,
        SecondaryLobe,
        grating_lobes,
        largest_secondary_lobe,
    )
    from haptogram.acoustics.plane import PlaneField
    from haptogram.acoustics.shift import (
        FocalShift,
        find_peak,
        paraxial_shift_m,
        predict_focal_shift,
    )
    from haptogram.acoustics.solvers import Quality, quality, solve, weights_for_foci
    from haptogram.acoustics.spot import FocalSpot, measure_spot, predict_width_m
    from haptogram.acoustics.tracking import Fix, FocusTracker
    from haptogram.acoustics.waveform import instantaneous_pressure, rms_pressure

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
    "FocusCodes",
    "FocusTracker",
    "GratingLobe",
    "GridField",
    "MeasuredDirectivity",
    "Medium",
    "NoFocus",
    "NotSingle",
    "NumbaEngine",
    "Numpy32Engine",
    "NumpyEngine",
    "PhaseFit",
    "PlaneField",
    "PointSource",
    "Quality",
    "Reconstruction",
    "Reconstructor",
    "RectangularPiston",
    "Resonator",
    "SecondaryLobe",
    "SingleFocus",
    "Transducer",
    "TransducerArray",
    "a_weighting_db",
    "amplitude_to_duty",
    "box_points_m",
    "check_target",
    "choose_engine",
    "demodulated_level_db_a",
    "demodulated_lines",
    "dequantise_phase",
    "duty_to_amplitude",
    "exposure_at",
    "find_peak",
    "fit_focus",
    "focus_phases",
    "force_on_disc_n",
    "grating_lobes",
    "hop_response",
    "in_front",
    "instantaneous_pressure",
    "iso_9613_absorption_np_m",
    "largest_secondary_lobe",
    "level_db_spl",
    "mean_square_pressure",
    "measure_spot",
    "paraxial_shift_m",
    "phase_step_rad",
    "predict_focal_shift",
    "predict_width_m",
    "pressure",
    "propagators",
    "quality",
    "quantise_phase",
    "radiated_power_w",
    "radiation_pressure_pa",
    "rms_pressure",
    "saturated",
    "solve",
    "superpose",
    "switching_level_db_a",
    "weights_for_foci",
    "worst_place",
]

_LATER: Final = {
    "Calibration": "calibration",
    "Exposure": "exposure",
    "Fix": "tracking",
    "FocalShift": "shift",
    "FocalSpot": "spot",
    "FocusCodes": "batch",
    "FocusTracker": "tracking",
    "GratingLobe": "lobes",
    "GridField": "grid",
    "MeasuredDirectivity": "directivities",
    "PlaneField": "plane",
    "Quality": "solvers",
    "RectangularPiston": "directivities",
    "Resonator": "dynamics",
    "SecondaryLobe": "lobes",
    "a_weighting_db": "exposure",
    "amplitude_to_duty": "dynamics",
    "box_points_m": "grid",
    "demodulated_level_db_a": "demodulation",
    "demodulated_lines": "demodulation",
    "duty_to_amplitude": "dynamics",
    "exposure_at": "exposure",
    "find_peak": "shift",
    "grating_lobes": "lobes",
    "hop_response": "dynamics",
    "instantaneous_pressure": "waveform",
    "largest_secondary_lobe": "lobes",
    "mean_square_pressure": "average",
    "measure_spot": "spot",
    "paraxial_shift_m": "shift",
    "predict_focal_shift": "shift",
    "predict_width_m": "spot",
    "quality": "solvers",
    "radiated_power_w": "demodulation",
    "rms_pressure": "waveform",
    "solve": "solvers",
    "switching_level_db_a": "exposure",
    "weights_for_foci": "solvers",
    "worst_place": "exposure",
}


def __getattr__(name: str) -> object:
    """Import what is first asked for now."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_LATER[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

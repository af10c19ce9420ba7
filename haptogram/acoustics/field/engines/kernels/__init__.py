"""Compiled inner loops; plain arrays in, plain arrays out, nothing is checked here.

Only :mod:`haptogram.acoustics.field.engines.compiled` imports this package, and only where numba
is installed.
Lengths are in wavelengths and phases in half turns, so that r modulo the wavelength is exact.
"""

from haptogram.acoustics.field.engines.kernels.blocks import usable_points_kernel
from haptogram.acoustics.field.engines.kernels.discs import disc_stress_kernel
from haptogram.acoustics.field.engines.kernels.fields import (
    free_pressure_kernel,
    free_waves_kernel,
    lattice_pressure_kernel,
    lattice_waves_kernel,
    polar_form_kernel,
)
from haptogram.acoustics.field.engines.kernels.foci import fit_phases_kernel
from haptogram.acoustics.field.engines.kernels.focused import MEASURES as FOCUSED_MEASURES
from haptogram.acoustics.field.engines.kernels.focused import focused_frames_kernel
from haptogram.acoustics.field.engines.kernels.judged import MEASURES as JUDGED_MEASURES
from haptogram.acoustics.field.engines.kernels.judged import judged_frames_kernel
from haptogram.acoustics.field.engines.kernels.multifocus import (
    foci_waves_kernel,
    gerchberg_saxton_kernel,
)
from haptogram.acoustics.field.engines.kernels.pistons import MOST_GAIN_SQUARE, MOST_LOSS
from haptogram.acoustics.field.engines.kernels.search import best_cell_kernel, cell_scores_kernel
from haptogram.acoustics.field.engines.kernels.waves import ARCTANGENT, COSINE, SINE

__all__ = [
    "ARCTANGENT",
    "COSINE",
    "FOCUSED_MEASURES",
    "JUDGED_MEASURES",
    "MOST_GAIN_SQUARE",
    "MOST_LOSS",
    "SINE",
    "best_cell_kernel",
    "cell_scores_kernel",
    "disc_stress_kernel",
    "fit_phases_kernel",
    "foci_waves_kernel",
    "focused_frames_kernel",
    "free_pressure_kernel",
    "free_waves_kernel",
    "gerchberg_saxton_kernel",
    "judged_frames_kernel",
    "lattice_pressure_kernel",
    "lattice_waves_kernel",
    "polar_form_kernel",
    "usable_points_kernel",
]

"""Compiled inner loops; plain arrays in, plain arrays out, nothing is checked here.

Only :mod:`haptogram.acoustics.field.engines.compiled` imports this package, and only where numba
is installed.
Lengths are in wavelengths and phases in half turns, so that r modulo the wavelength is exact.
"""

from haptogram.acoustics.field.engines.kernels.blocks import usable_points
from haptogram.acoustics.field.engines.kernels.fields import (
    free_pressure,
    free_waves,
    lattice_pressure,
    lattice_waves,
    polar_form,
)
from haptogram.acoustics.field.engines.kernels.foci import fit_phases, focus_codes
from haptogram.acoustics.field.engines.kernels.multifocus import weighted_gerchberg_saxton
from haptogram.acoustics.field.engines.kernels.search import best_cell, cell_scores
from haptogram.acoustics.field.engines.kernels.waves import ARCTANGENT, COSINE, SINE

__all__ = [
    "ARCTANGENT",
    "COSINE",
    "SINE",
    "best_cell",
    "cell_scores",
    "fit_phases",
    "focus_codes",
    "free_pressure",
    "free_waves",
    "lattice_pressure",
    "lattice_waves",
    "polar_form",
    "usable_points",
    "weighted_gerchberg_saxton",
]

"""Arrays of parallel pistons, as the compiled loops of double precision take them."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.field.engines.compiled import Kernels, load_kernels
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.model.transducer import CircularPiston
from haptogram.settings.frozen import dataclass

_FURTHEST_M: Final = 1.25  # largest distance from a point to the nearest element
_PARALLEL: Final = 1e-12
_FEWEST: Final = 4


@dataclass(frozen=True, eq=False, slots=True)
class ParallelPistons:
    """Arguments of the compiled loops of double precision.

    Attributes
    ----------
    kernels : module
        The loops.
    places : (4, N) numpy.ndarray
        Places of the elements, in metres, and room for phases.
    medium : (8,) numpy.ndarray
        See :mod:`.kernels.pistons`.
    """

    kernels: Kernels
    places: FloatArray
    medium: FloatArray

    @classmethod
    def why_not(cls, model: AcousticModel) -> str | None:
        """Return why these loops do not serve *model*; None: they do."""
        array, directivity, kernels = model.array, model.transducer.directivity, load_kernels()
        if kernels is None:
            return "numba is not installed"
        if model.response is not None:
            return "elements with a calibration"
        if array.count < _FEWEST:
            return f"fewer than {_FEWEST} elements"
        if np.abs(array.normals - array.normals[0]).max() > _PARALLEL:
            return "elements that do not look one way"
        if not isinstance(directivity, CircularPiston):
            return f"elements that are no circular pistons: {type(directivity).__name__}"
        size = (model.wavenumber * directivity.radius_m / 2.0) ** 2
        span_m = 2.0 * float(np.linalg.norm(array.positions_m - array.centre_m, axis=1).max())
        loss = model.medium.absorption_np_m * (_FURTHEST_M + span_m)
        if size > kernels.MOST_GAIN_SQUARE or loss > kernels.MOST_LOSS:
            return "large pistons, or much absorption"
        return None

    @classmethod
    def of(cls, model: AcousticModel) -> ParallelPistons:
        """Return the pistons of a model for which :meth:`why_not` returns None."""
        kernels, source, piston = load_kernels(), model.transducer, model.transducer.directivity
        assert kernels is not None
        assert isinstance(piston, CircularPiston)
        normal = model.array.normals[0]
        medium = [
            1.0 / model.wavelength_m,
            math.sqrt(2.0) * source.source_strength_pa_m,
            model.medium.absorption_np_m,
            (model.wavenumber * piston.radius_m / 2.0) ** 2,
            *normal,
            (model.array.positions_m @ normal).max(),
        ]
        places = np.zeros((4, model.array.count))
        places[:3] = model.array.positions_m.T
        return cls(kernels, places, np.array(medium))

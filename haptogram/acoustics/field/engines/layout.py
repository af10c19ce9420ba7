"""An array as the compiled loops take it."""

from __future__ import annotations

from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.model.lattice import Lattice, find_lattice
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.model.transducer import GRAZING
from haptogram.settings.frozen import dataclass

_FAR: Final = 72.0  # wavelengths
_FLAT: Final = 1e-9  # largest distance from a plane, in wavelengths, and error of a unit vector
_FAR_ANYWHERE: Final = 16.0  # the same for bowls and rings: all elements may have the same error

SingleArray: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True, eq=False, slots=True)
class EngineLayout:
    """Lengths in wavelengths, in a frame at the array's centroid.

    Attributes
    ----------
    lattice : Lattice or None
        If there is one, the frame's axes are its own; else those of a flat array, or of the world.
    flat : bool
        Whether all elements lie in the plane of the frame and look along its z.
    radius_m : float
        Largest distance of an element from the centroid, in metres.
    frame : (4, 3) numpy.ndarray
        The axes over the wavelength, and the origin in metres.
    constants : (4,) numpy.ndarray
        Radius, absorption in nepers per wavelength, and the least cosine that an element radiates
        to: -2 if it has no baffle; how far away the rounding errors of many elements average out.
    positions_m : (N, 3) numpy.ndarray
        Positions of the elements, in metres.
    elements : (N, 6) numpy.ndarray
        Positions and normals, in the frame.
    x, y : (nx,), (ny,) numpy.ndarray
        Coordinates of the lattice; empty without one.
    nodes : (nx, ny) numpy.ndarray of int64
        The element at each node, -1 for none.
    """

    lattice: Lattice | None
    flat: bool
    radius_m: float
    frame: FloatArray
    constants: FloatArray
    positions_m: FloatArray
    elements: FloatArray
    x: FloatArray
    y: FloatArray
    nodes: NDArray[np.int64]

    @classmethod
    def of(cls, model: AcousticModel) -> EngineLayout:
        """Return the layout of *model*; every array is a writeable copy, C-contiguous."""
        wavelength, array = model.wavelength_m, model.array
        lattice = find_lattice(array)
        offsets = array.positions_m - array.centre_m
        flat = np.abs(offsets @ array.axes[2]).max() < _FLAT * wavelength
        flat = bool(flat and np.abs(array.normals - array.axes[2]).max() < _FLAT)
        axes = lattice.axes if lattice else array.axes if flat else np.eye(3)
        radius_m = float(np.linalg.norm(offsets, axis=1).max())
        loss = model.medium.absorption_np_m * wavelength
        radii = np.linalg.norm(offsets, axis=1) / wavelength
        is_spread = len(set(radii.round(3).tolist())) > array.count / 8  # unlike a ring or a few
        far = _FAR if lattice or (flat and is_spread) else _FAR_ANYWHERE
        front = GRAZING if model.transducer.directivity.baffled else -2.0
        return cls(
            lattice=lattice,
            flat=flat,
            radius_m=radius_m,
            frame=np.concatenate([axes / wavelength, array.centre_m[None, :]]),
            constants=np.array([radius_m / wavelength, loss, front, far]),
            positions_m=array.positions_m.copy(),
            elements=np.hstack([offsets @ axes.T / wavelength, array.normals @ axes.T]),
            x=lattice.x_m / wavelength if lattice else np.empty(0),
            y=lattice.y_m / wavelength if lattice else np.empty(0),
            nodes=lattice.elements.copy() if lattice else np.empty((0, 0), dtype=np.int64),
        )


def as_single_precision(values: FloatArray) -> SingleArray:
    """Return *values* in single precision, C-contiguous."""
    return np.ascontiguousarray(values, dtype=np.float32)

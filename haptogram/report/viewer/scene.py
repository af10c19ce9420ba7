"""A scene: array, medium and frames as a header of JSON and columns of numbers; its document.

The page of the viewer reads a scene from a report, a recording or a running board alike::

    b"HGV1" | u32 length of the header | header, JSON | columns, each from a multiple of 8 bytes on

Numbers are little-endian. The header lists name, type and shape of each column.
"""

from __future__ import annotations

import base64
import json
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import AcousticModel, RectangularPiston
from haptogram.acoustics.model.drive import FULL_AMPLITUDE, REGISTER_BITS

from ..formats.document import TONES, Document
from .frames import STATUSES, ViewerFrame, frame_columns, odd_frames_of_viewer

MAGIC: Final = b"HGV1"
_ALIGNMENT: Final = 8
_GAINS: Final = 1025  # points over the cosine: linear between them is good to 1e-6


@dataclass(frozen=True, slots=True)
class ViewerScene:
    """One scene.

    Attributes
    ----------
    header : mapping
        JSON types: what is said once.
    columns : mapping of str to numpy.ndarray
        uint8, uint32, float32 or float64; the first index of a frame's column is the frame.
    """

    header: Mapping[str, Any]
    columns: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        model: AcousticModel,
        frames: Sequence[ViewerFrame],
        *,
        counters: Mapping[str, Any] | None = None,
        client_axes: Sequence[Sequence[float]] | None = None,
    ) -> Self:
        """Return the scene of *frames* that an array radiates.

        Parameters
        ----------
        counters : mapping, optional
            Counters to show beside the view, by name.
        client_axes : (3, 3) sequence of float, optional
            Our axes in those of the board's own programs, ours = rows @ theirs: each focus is told
            in theirs as well.
        """
        return cls(
            {
                **_viewer_constants(model),
                "statuses": STATUSES,
                "counters": dict(counters or {}),
                "texts": odd_frames_of_viewer(frames),
                "client_axes": None if client_axes is None else [*map(list, client_axes)],
            },
            {**_viewer_elements(model), **frame_columns(frames, model.array.count)},
        )

    def pack(self) -> bytes:
        """Return the bytes of the scene."""
        named = {name: np.ascontiguousarray(values) for name, values in self.columns.items()}
        layout = [[name, values.dtype.str[1:], values.shape] for name, values in named.items()]
        header = json.dumps({**self.header, "columns": layout}, allow_nan=False).encode()
        start = MAGIC + struct.pack("<I", len(header)) + header
        parts = (start, *(values.tobytes() for values in named.values()))
        return b"".join(part + bytes(-len(part) % _ALIGNMENT) for part in parts)

    def embedded(self) -> str:
        """Return the scene for a page: compressed, in base64."""
        return base64.b64encode(zlib.compress(self.pack(), 9)).decode("ascii")


def other_axes_of_viewer(
    client_axes: Sequence[Sequence[float]] | None,
) -> Sequence[Sequence[float]] | None:
    """Return the axes of a board's own programs, ours = rows @ theirs; None where they are ours."""
    return None if client_axes is None or np.array_equal(client_axes, np.eye(3)) else client_axes


def _viewer_constants(model: AcousticModel) -> dict[str, Any]:
    """Return what the page needs to compute the field, by name with unit, beside the elements.

    Wavelength, absorption, source strength, sides of rectangular elements, steps of the codes.
    """
    rectangle = _viewer_rectangle(model)
    return {
        "sides_mm": [1e3 * rectangle.width_m, 1e3 * rectangle.height_m] if rectangle else [],
        "wavelength_mm": 1e3 * model.wavelength_m,
        "absorption_np_m": model.medium.absorption_np_m,
        "source_pa_m": model.transducer.source_strength_pa_m,
        "baffled": model.transducer.directivity.baffled,
        "phase_steps": 1 << REGISTER_BITS,
        "amplitude_steps": FULL_AMPLITUDE,
    }


def _viewer_elements(model: AcousticModel) -> dict[str, NDArray[np.float32]]:
    """Return places, normals, responses and directivity of the elements.

    A directivity that depends on the direction around the axis has no table, ``gains`` is empty;
    a rectangle has the ``width_axes`` of its elements instead. The page draws no field of others.
    """
    array, directivity = model.array, model.transducer.directivity
    response = np.ones(array.count, complex) if model.response is None else model.response
    cosines = np.linspace(0.0 if directivity.baffled else -1.0, 1.0, _GAINS)
    tabled = not hasattr(directivity, "gain_towards")
    gains = directivity.gain(cosines, model.wavenumber) if tabled else np.empty(0)
    rectangle = _viewer_rectangle(model)
    width_axes = rectangle.side_axes(array.normals)[0] if rectangle else np.empty((0, 3))
    return {
        "positions_mm": (1e3 * array.positions_m).astype(np.float32),
        "normals": array.normals.astype(np.float32),
        "response": np.stack([response.real, response.imag], axis=1).astype(np.float32),
        "gains": np.asarray(gains, dtype=np.float32),
        "width_axes": width_axes.astype(np.float32),
    }


def _viewer_rectangle(model: AcousticModel) -> RectangularPiston | None:
    """Return the elements' directivity if they are rectangular pistons; else None."""
    directivity = model.transducer.directivity
    return directivity if isinstance(directivity, RectangularPiston) else None


def view_document(
    scene: ViewerScene | None, *, title: str, lead: list[str], verdict: str = ""
) -> Document:
    """Return a document that shows *scene*, or what the server of its page tells it if it is None.

    Parameters
    ----------
    title : str
        Heading of the page.
    lead : list of str
        Sentences below the heading.
    verdict : str
        Verdict of the run that is shown; empty: there is none.
    """
    return Document(
        command="view",
        heading=f"{verdict.upper()}: {title}" if verdict else title,
        title=title,
        tone=TONES.get(verdict.lower(), "plain"),
        lead=[sentence.removesuffix(".") for sentence in lead],
        template="view.html",
        content=lambda: {"scene": scene and scene.embedded()},
    )

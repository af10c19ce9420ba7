"""The presets, as presets.toml describes them: systems with their published figures, and ours."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram import acoustics
from haptogram.acoustics.levels.dynamics import Resonator
from haptogram.acoustics.levels.spot import FocalSpot, measure_spot
from haptogram.acoustics.model.boards.grids import autd_units
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.acoustics.model.model import AcousticModel
from haptogram.errors import ConfigurationError
from haptogram.objects.shapes import Hemisphere
from haptogram.settings.arguments import did_you_mean
from haptogram.settings.text_file import read_toml_file

Point: TypeAlias = Sequence[float]

_PAPER_OBJECT: Final = Hemisphere(radius_m=0.050, center_m=(0.0, 0.0, 0.100))
_PAPER_WAVELENGTH_M: Final = 2.0 * math.pi / 730.603  # wavelength by the wave number that it prints


def _weights(model: AcousticModel, focus_m: Point) -> NDArray[np.complex128]:
    """Return (N,) weights: full amplitude on every element, in phase at the focus."""
    weights: NDArray[np.complex128] = np.exp(1j * acoustics.focus_phases(model, focus_m))
    return weights


def _force_mn(model: AcousticModel, focus_m: Point) -> float:
    """Return the force on a reflecting disc of 20 mm diameter at the focus, at full amplitude."""
    return 1e3 * acoustics.force_on_disc_n(model, _weights(model, focus_m), focus_m)


def _pressure_rms_pa(model: AcousticModel, focus_m: Point) -> float:
    """Return the RMS pressure at the focus, all elements in phase there at full amplitude."""
    value = acoustics.pressure(model, _weights(model, focus_m), [focus_m])[0]
    return math.sqrt(0.5) * abs(complex(value))


def _source_strength_pa_m(model: AcousticModel, focus_m: Point, force_n: float) -> float:
    """Return the RMS source strength with which our model gives *force_n* at the focus."""
    share = 1e3 * force_n / _force_mn(model, focus_m)
    return model.transducer.source_strength_pa_m * math.sqrt(share)


def _spot(model: AcousticModel, focus_m: Point) -> FocalSpot:
    """Return the size of the spot at the focus, all elements in phase there."""
    return measure_spot(acoustics.NumpyEngine(model), _weights(model, focus_m), focus_m)


def _side_mm(model: AcousticModel, base_mm: float = 0.0) -> float:
    """Return the side of the array: span of the centres along x, plus one pitch if known.

    In mm; *base_mm* is added.
    """
    extent_m = 2.0 * float(model.array.half_extent_m[0])
    return base_mm + 1e3 * (extent_m + (model.array.pitch_m or 0.0))


def _mean_over_paper_object(
    of_focus: Callable[[AcousticModel, Point], float], model: AcousticModel
) -> float:
    """Return the mean of *of_focus* over foci 10 mm apart on the paper's hemisphere.

    Its radius is 50 mm, its centre 100 mm over the array.
    """
    points = _PAPER_OBJECT.sample(0.010).tolist()
    return float(np.mean([of_focus(model, point) for point in points]))


def _quantised_share(model: AcousticModel, focus_m: Point, bits: int) -> float:
    """Return |p| at the focus with phases of 2^bits steps, over |p| with exact ones."""
    exact = acoustics.focus_phases(model, focus_m)
    coarse = acoustics.dequantise_phase(acoustics.quantise_phase(exact, bits), bits)
    levels = np.abs(acoustics.pressure(model, np.exp(1j * np.stack([exact, coarse])), [focus_m]))[
        :, 0
    ]
    return float(levels[1] / levels[0])


def _weakest_share(model: AcousticModel, points_m: ArrayLike) -> float:
    """Return the weakest |p| of several simultaneous foci over that of a single one.

    Naive superposition, all in phase, scaled to full amplitude of the strongest element.
    """
    points = np.asarray(points_m)
    weights = acoustics.superpose_foci(model, points, np.ones(len(points)), np.zeros(len(points)))
    levels = np.abs(acoustics.pressure(model, weights / np.abs(weights).max(), points))
    single = [_pressure_rms_pa(model, point) * math.sqrt(2.0) for point in points]
    return float((levels / np.array(single)).min())


def _paper_width_mm(_: AcousticModel) -> float:
    """Return the focal width by equation (9) of the paper, as its authors corrected it.

    For its 16 x 16 elements of 10 mm, at 100 mm.
    """
    return 1e3 * 2.0 * _PAPER_WAVELENGTH_M * 0.1 / (math.sqrt(256) * 0.010)


#: By name: the function of a model, and of the arguments of a figure, and the unit.
QUANTITIES: Final[dict[str, tuple[Callable[..., float], str]]] = {
    "elements": (lambda model: float(model.array.count), ""),
    "centre of the rows": (lambda model: 1e3 * abs(float(model.array.centre_m[1])), "mm"),
    "side": (_side_mm, "mm"),
    "force": (_force_mn, "mN"),
    "pressure": (_pressure_rms_pa, "Pa RMS"),
    "source strength": (_source_strength_pa_m, "Pa m RMS"),
    "null to null": (lambda model, focus_m: 1e3 * _spot(model, focus_m).null_to_null_m[0], "mm"),
    "width at -6 dB": (lambda model, focus_m: 1e3 * _spot(model, focus_m).width_6db_m[0], "mm"),
    "pressure maximum": (
        lambda model, focus_m, base_mm: base_mm + 1e3 * _spot(model, focus_m).axial_peak_m,
        "mm",
    ),
    "sideband": (
        lambda _, modulation_hz: Resonator.from_bandwidth().modulation_response(modulation_hz),
        "of static",
    ),
    "pressure with few phase steps": (_quantised_share, "of exact"),
    "weakest of several foci": (_weakest_share, "of one"),
    "paper's focus width": (_paper_width_mm, "mm"),
    "mean force over the paper's hemisphere": (
        lambda model: _mean_over_paper_object(_force_mn, model),
        "mN",
    ),
    "mean pressure over the paper's hemisphere": (
        lambda model: 1e-3 * _mean_over_paper_object(_pressure_rms_pa, model),
        "kPa RMS",
    ),
}


# --- Presets ------------------------------------------------------------------------------------

_TEXTS: Final = ("quantity", "ours", "published", "source", "remark")  # keys that are no arguments


@dataclass(frozen=True, eq=False)
class Preset:
    """A system, ready to be modelled.

    Attributes
    ----------
    name, title : str
        Short name for the command line; what it is.
    source : str
        Publication or repository.
    array_source : str
        Where the geometry is from, and what of it is assumed.
    array : mapping of str to Any
        Kind of the array, and its arguments.
    focus_m : (float, float, float)
        A focus that is typical of it.
    figures : sequence of mapping
        Its published figures, each with the quantity of ours that is compared.
    piston_m, point_source_pa_m : float or None
        Radius of its pistons, or strength of its point sources; None: the default transducer.
    medium : sequence of float or None
        Speed of sound and density of air without absorption; None: the default air.
    """

    name: str
    title: str
    source: str
    array_source: str
    array: Mapping[str, Any]
    focus_m: tuple[float, float, float]
    figures: Sequence[Mapping[str, Any]]
    piston_m: float | None = None
    point_source_pa_m: float | None = None
    medium: Sequence[float] | None = None

    def build(self) -> AcousticModel:
        """Return the model."""
        ((kind, argument),) = self.array.items()
        if kind == "board":
            array = LAYOUTS[argument].array()
        else:
            array = (autd_units if kind == "autd_units" else acoustics.TransducerArray.grid)(
                *argument
            )
        transducer = acoustics.Transducer()
        if self.piston_m is not None:
            transducer = acoustics.Transducer(acoustics.CircularPiston(self.piston_m))
        elif self.point_source_pa_m is not None:
            transducer = acoustics.Transducer(acoustics.PointSource(), self.point_source_pa_m)
        air = acoustics.Medium.air() if self.medium is None else acoustics.Medium(*self.medium)
        return AcousticModel(array, air, transducer)


def compare_preset(preset: Preset) -> list[dict[str, Any]]:
    """Return the published figures of a preset next to ours, as plain values."""
    model = preset.build()
    rows = []
    for figure in preset.figures:
        compute, unit = QUANTITIES[figure["ours"]]
        arguments = {name: value for name, value in figure.items() if name not in _TEXTS}
        rows.append(
            {
                "preset": preset.name,
                "quantity": figure["quantity"],
                "published": figure.get("published", "-"),
                "ours": float(compute(model, **arguments)),
                "unit": unit,
                "source": figure.get("source", "ours"),
                "remark": figure.get("remark", ""),
            }
        )
    return rows


_FILE: Final = Path(__file__).with_name("presets.toml")
PRESETS: Final = tuple(
    Preset(**values | {"focus_m": tuple(values["focus_m"])})
    for values in read_toml_file(_FILE, "the list of presets")["preset"]
)


def find_preset(name: str) -> Preset:
    """Return the preset of that name.

    Raises
    ------
    ConfigurationError
        If there is none; names those that there are.
    """
    for preset in PRESETS:
        if preset.name == name:
            return preset
    known = [preset.name for preset in PRESETS]
    guess = did_you_mean(name, known)
    raise ConfigurationError(f"preset is {name!r}; known are {', '.join(known)}{guess}")

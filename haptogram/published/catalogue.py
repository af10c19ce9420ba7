"""The presets, as presets.toml describes them: systems with their published figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from haptogram.acoustics import (
    AcousticModel,
    CircularPiston,
    Medium,
    PointSource,
    Transducer,
    TransducerArray,
)
from haptogram.acoustics.model.boards.grids import autd_units
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.errors import ConfigurationError
from haptogram.published.quantities import QUANTITIES
from haptogram.settings.arguments import did_you_mean
from haptogram.settings.text_file import read_toml_file

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
            array = (autd_units if kind == "autd_units" else TransducerArray.grid)(*argument)
        transducer = Transducer()
        if self.piston_m is not None:
            transducer = Transducer(CircularPiston(self.piston_m))
        elif self.point_source_pa_m is not None:
            transducer = Transducer(PointSource(), self.point_source_pa_m)
        air = Medium.air() if self.medium is None else Medium(*self.medium)
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

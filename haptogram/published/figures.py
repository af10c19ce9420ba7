"""Presets, and the quantities that their published figures are compared with."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import (
    AcousticModel,
    NumpyEngine,
    dequantise_phase,
    focus_phases,
    force_on_disc_n,
    pressure,
    quantise_phase,
    superpose_foci,
)
from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.levels.dynamics import Resonator
from haptogram.acoustics.levels.spot import FocalSpot, measure_spot
from haptogram.acoustics.model.boards.layout import BoardLayout

Point: TypeAlias = tuple[float, float, float]


class Quantity(NamedTuple):
    """A quantity of a preset's model, and its unit."""

    of: Callable[[AcousticModel], float]
    unit: str = ""


@dataclass(frozen=True, slots=True)
class PublishedFigure:
    """One published figure, and how to compute ours.

    Attributes
    ----------
    quantity : str
        Name of the quantity.
    ours : Quantity
        Computes ours from the preset's model.
    published : str
        The published value with its unit, or a dash.
    source : str
        Where it is published; "recollection" where no source was at hand.
    remark : str
        Note for the comparison.
    """

    quantity: str
    ours: Quantity
    published: str = "-"
    source: str = "ours"
    remark: str = ""


@dataclass(frozen=True, slots=True)
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
    build : callable
        Makes the model.
    focus_m : (float, float, float)
        A focus that is typical of it.
    figures : tuple of Figure
        Its published figures.
    layout : BoardLayout or None
        Axes of the board's own programs, where it has some.
    """

    name: str
    title: str
    source: str
    array_source: str
    build: Callable[[], AcousticModel]
    focus_m: Point
    figures: tuple[PublishedFigure, ...]
    layout: BoardLayout | None = None


def compare_preset(preset: Preset) -> list[dict[str, Any]]:
    """Return the published figures of a preset next to ours, as plain values."""
    model = preset.build()
    return [
        {
            "preset": preset.name,
            "quantity": figure.quantity,
            "published": figure.published,
            "ours": float(figure.ours.of(model)),
            "unit": figure.ours.unit,
            "source": figure.source,
            "remark": figure.remark,
        }
        for figure in preset.figures
    ]


def published_element_count(published: str, source: str) -> PublishedFigure:
    """Return the number of elements as a figure."""
    count = Quantity(lambda model: float(model.array.count))
    return PublishedFigure("number of elements", count, published, source)


def _preset_focus_weights(model: AcousticModel, focus_m: Point) -> NDArray[np.complex128]:
    """Return full amplitude on every element, in phase at the focus."""
    weights: NDArray[np.complex128] = np.exp(1j * focus_phases(model, focus_m))
    return weights


def _force_n(model: AcousticModel, focus_m: Point) -> float:
    return force_on_disc_n(model, _preset_focus_weights(model, focus_m), focus_m)


def _pressure_rms_pa(model: AcousticModel, focus_m: Point) -> float:
    value = pressure(model, _preset_focus_weights(model, focus_m), [focus_m])[0]
    return math.sqrt(0.5) * abs(complex(value))


def _mean(
    of_focus: Callable[[AcousticModel, Point], float], points: Callable[[], FloatArray]
) -> Callable[[AcousticModel], float]:
    """Return a function that averages a figure over target points."""
    return lambda model: float(
        np.mean([of_focus(model, (x, y, z)) for x, y, z in points().tolist()])
    )


def published_force_mn(focus_m: Point) -> Quantity:
    """Return the force on a reflecting disc of 20 mm diameter at the focus."""
    return Quantity(lambda model: 1e3 * _force_n(model, focus_m), "mN")


def published_pressure_rms_pa(focus_m: Point) -> Quantity:
    """Return the RMS pressure at the focus."""
    return Quantity(lambda model: _pressure_rms_pa(model, focus_m), "Pa RMS")


def published_strength_pa_m(focus_m: Point, force_n: float) -> Quantity:
    """Return the RMS source strength with which our model gives a force."""

    def compute(model: AcousticModel) -> float:
        share = force_n / _force_n(model, focus_m)
        return model.transducer.source_strength_pa_m * math.sqrt(share)

    return Quantity(compute, "Pa m RMS")


def published_spot_mm(
    focus_m: Point, part: Callable[[FocalSpot], float], base_mm: float = 0.0
) -> Quantity:
    """Return a measure of the focal spot, added to *base_mm*."""

    def compute(model: AcousticModel) -> float:
        weights = _preset_focus_weights(model, focus_m)
        return base_mm + 1e3 * part(measure_spot(NumpyEngine(model), weights, focus_m))

    return Quantity(compute, "mm")


def published_extent_mm(axis: int, base_mm: float = 0.0) -> Quantity:
    """Return the span of the centres along an axis, plus one pitch if there is one."""

    def compute(model: AcousticModel) -> float:
        extent_m = 2.0 * float(model.array.half_extent_m[axis])
        return base_mm + 1e3 * (extent_m + (model.array.pitch_m or 0.0))

    return Quantity(compute, "mm")


def published_mean_pressure_kpa(points: Callable[[], FloatArray]) -> Quantity:
    """Return the RMS pressure at the focus, averaged over foci."""
    mean = _mean(_pressure_rms_pa, points)
    return Quantity(lambda model: 1e-3 * mean(model), "kPa RMS")


def published_mean_force_mn(points: Callable[[], FloatArray]) -> Quantity:
    """Return the force at the focus, averaged over foci."""
    mean = _mean(_force_n, points)
    return Quantity(lambda model: 1e3 * mean(model), "mN")


def published_quantised_share(focus_m: Point, bits: int) -> Quantity:
    """Return |p| at the focus with phases of 2^bits steps, over |p| with exact ones."""

    def compute(model: AcousticModel) -> float:
        exact = focus_phases(model, focus_m)
        coarse = dequantise_phase(quantise_phase(exact, bits), bits)
        levels = np.abs(pressure(model, np.exp(1j * np.stack([exact, coarse])), [focus_m]))[:, 0]
        return float(levels[1] / levels[0])

    return Quantity(compute, "of exact")


def published_several_foci_share(points_m: tuple[Point, ...]) -> Quantity:
    """Return the weakest |p| of several simultaneous foci over that of a single one.

    Naive superposition, all in phase, scaled to full amplitude of the strongest element.
    """

    def compute(model: AcousticModel) -> float:
        count = len(points_m)
        weights = superpose_foci(model, points_m, np.ones(count), np.zeros(count))
        levels = np.abs(pressure(model, weights / np.abs(weights).max(), points_m))
        single = [_pressure_rms_pa(model, point) * math.sqrt(2.0) for point in points_m]
        return float((levels / np.array(single)).min())

    return Quantity(compute, "of one")


def published_sideband(modulation_hz: float) -> Quantity:
    """Return the share of a modulation that a common transducer (2 kHz at -6 dB) passes."""
    share = Resonator.from_bandwidth().modulation_response
    return Quantity(lambda _: share(modulation_hz), "of static")

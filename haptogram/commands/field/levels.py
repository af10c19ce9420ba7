"""Levels of ``haptogram field``: the ultrasound at an ear, and its audible part."""

from __future__ import annotations

import argparse
import math
import textwrap
from collections.abc import Iterator
from typing import Final

from haptogram.acoustics import (
    Resonator,
    choose_engine,
    demodulated_level_db_a,
    exposure_at,
    switching_level_db_a,
)
from haptogram.acoustics.arrays import ComplexArray
from haptogram.acoustics.levels.exposure import GUIDELINE, STATEMENT, worst_exposure
from haptogram.acoustics.solvers.focus import MIN_TARGET_DISTANCE_M
from haptogram.errors import ConfigurationError

from ..shell.positions import metres_of_position, position_text
from .scene import FieldScene, modulated_field_scene

_LISTENER_M: Final = 0.5


def describe_field_levels(arguments: argparse.Namespace, scene: FieldScene) -> Iterator[str]:
    """Yield the levels at the loudest place half a metre away and, if asked for, at an ear."""
    engine = choose_engine(scene.model)
    worst = worst_exposure(engine, scene.weights, _LISTENER_M, scene.frame_s)
    yield (
        f"loudest {_LISTENER_M:g} m from the centre: {worst.equivalent_db_spl:.1f} dB SPL at "
        f"({position_text(worst.position_m)}) mm"
    )
    yield from textwrap.wrap(STATEMENT, 98, initial_indent="  ", subsequent_indent="  ")
    if arguments.ear_mm is not None:
        yield from _describe_ear_in_field(arguments, scene)


def _describe_ear_in_field(arguments: argparse.Namespace, scene: FieldScene) -> Iterator[str]:
    engine, lag = choose_engine(scene.model), Resonator.from_bandwidth()
    ear = metres_of_position(arguments.ear_mm)
    distance_m = math.dist(ear, scene.model.array.centre_m)
    if distance_m < MIN_TARGET_DISTANCE_M:
        raise ConfigurationError(
            f"--ear-mm is within the array, {distance_m * 1e3:.1f} mm from its centre; "
            f"it can be from {MIN_TARGET_DISTANCE_M * 1e3:g} mm on"
        )
    weights, what = _sequence_of_scene(arguments, scene)
    exposure = exposure_at(engine, weights, [ear], scene.frame_s, lag)[0]
    at = f"({position_text(ear)}) mm, {distance_m * 1e3:.0f} mm from the centre"
    yield f"at an ear at {at}; {what}:"
    yield (
        f"  ultrasound: {exposure.maximum_db_spl:.1f} dB SPL at most, "
        f"{exposure.equivalent_db_spl:.1f} dB SPL on average (Leq)"
    )
    yield from textwrap.wrap(GUIDELINE, 98, initial_indent="    ", subsequent_indent="    ")
    switching = switching_level_db_a(engine, weights, ear, scene.frame_s, lag)
    yield f"  audible, by the steps from drive to drive: {_audible_field_level_text(switching)}"
    hum = demodulated_level_db_a(engine, weights, distance_m, scene.frame_s, lag)
    yield (
        f"  audible, demodulated by the air: {_audible_field_level_text(hum)} at most "
        "(Berktay's law, on the axis of the beam)"
    )


def _sequence_of_scene(
    arguments: argparse.Namespace, scene: FieldScene
) -> tuple[ComplexArray, str]:
    """Return the drives that are repeated, and what they are."""
    if scene.is_sequence or not len(scene.targets_m):
        count = len(scene.weights)
        return scene.weights, (
            f"{count} drives of {scene.frame_s * 1e3:g} ms" if count > 1 else "a steady drive"
        )
    name = arguments.modulation.upper()
    what = f"{name} at {arguments.modulation_hz:g} Hz, {arguments.rate_hz:g} frames/s"
    return modulated_field_scene(arguments, scene).weights(scene.model), what


def _audible_field_level_text(level_db_a: float) -> str:
    return f"{level_db_a:.1f} dB(A)" if level_db_a >= 0.0 else "below 0 dB(A)"

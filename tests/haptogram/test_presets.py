"""Presets: real geometries, and figures that others have published or measured."""

import functools
import math

import numpy as np
import pytest

from haptogram.acoustics import check_focus_target
from haptogram.acoustics.model.boards.grids import (
    autd_units,
    sonicsurface,
    sonicsurface_wire_index,
)
from haptogram.errors import ConfigurationError
from haptogram.published import PRESETS, compare_preset, find_preset


@functools.cache
def rows(preset):
    return compare_preset(preset)


def ours(preset, quantity):
    return {row["quantity"]: row["ours"] for row in rows(find_preset(preset))}[quantity]


def test_an_autd_unit_has_249_places_of_its_grid():
    positions = autd_units(1, 1).positions_m
    steps = (positions - positions[0]) / 10.16e-3
    assert steps == pytest.approx(np.rint(steps), abs=1e-9)
    places = {(round(x), round(y)) for x, y, _ in steps}
    everything = {(x, y) for x in range(18) for y in range(14)}
    assert everything - places == {(1, 1), (2, 1), (16, 1)}
    # The grid index of the firmware: elements 19 and 32 follow the holes.
    assert [tuple(np.rint(steps[i, :2]).astype(int)) for i in (0, 17, 18, 19, 31, 32, 248)] == [
        *((0, 0), (17, 0), (0, 1), (3, 1), (15, 1), (17, 1), (17, 13))
    ]


def test_units_lie_edge_to_edge_around_the_origin():
    array = autd_units(2, 2)
    assert array.count == 996
    middles = array.positions_m.reshape(4, 249, 3)
    assert middles[1, 0] - middles[0, 0] == pytest.approx([0.192, 0.0, 0.0])
    assert middles[2, 0] - middles[0, 0] == pytest.approx([0.0, 0.1514, 0.0])
    low, high = array.positions_m.min(axis=0), array.positions_m.max(axis=0)
    assert low + high == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)


def test_sonicsurface_is_a_grid_in_the_order_of_its_wire():
    indices = [sonicsurface_wire_index(row, column) for row in range(16) for column in range(16)]
    assert sorted(indices) == list(range(256))
    # Corners and the first cell, read off the element map of its repository.
    positions = sonicsurface().positions_m * 1e3
    assert positions[0] == pytest.approx([-78.75, -80.75, 0.0])
    assert positions[4] == pytest.approx([-78.75, -70.25, 0.0])
    assert positions[7] == pytest.approx([-68.25, -80.75, 0.0])
    assert positions[64] == pytest.approx([-36.75, -80.75, 0.0])
    assert positions.mean(axis=0) == pytest.approx([0.0, -2.0, 0.0])
    steps = (positions[:, :2] - positions[0, :2]) / 10.5
    assert {tuple(np.rint(step).astype(int)) for step in steps} == {
        (x, y) for x in range(16) for y in range(16)
    }


def test_the_autd_emulator_s_own_pressure_is_met():
    assert ours("autd3", "pressure at a focus 150 mm above") == pytest.approx(4727, rel=2e-3)


def test_the_tactile_display_agrees_with_its_measured_force_and_spot():
    """16 mN and 20 mm: the force follows from the source strength, which is not published."""
    assert ours("tactile-display", "force at the focus") == pytest.approx(18.56, rel=0.01)
    assert ours("tactile-display", "source strength for 16 mN") == pytest.approx(2.88, rel=0.01)
    assert ours("tactile-display", "diameter of the focus") == pytest.approx(20.0, rel=0.1)


def test_the_corrected_spot_equation_meets_the_small_angle_limit():
    assert ours("paper", "w_f at r = 100 mm, equation (9)") == pytest.approx(10.75, abs=0.005)
    assert ours("paper", "side of the array") == pytest.approx(160.0)


def test_phase_steps_cost_what_theory_says():
    for quantity, steps in (("|p| with 8 phase steps", 8), ("|p| with its 32 phase steps", 32)):
        assert ours("sonicsurface", quantity) == pytest.approx(np.sinc(1 / steps), abs=5e-3)


def test_four_foci_share_the_energy_of_one():
    """Without interference each takes half of the pressure; naive superposition cannot beat it."""
    assert 0.15 < ours("multi-point", "weakest of four foci") < 0.5


def test_the_maximum_in_front_of_the_screen_is_within_the_published_range():
    assert 10.0 <= ours("touch-screen", "focus in front of the screen") <= 30.0


@pytest.mark.parametrize("preset", PRESETS, ids=lambda preset: preset.name)
def test_every_preset_can_be_focused_and_names_its_sources(preset):
    model = preset.build()
    check_focus_target(model, preset.focus_m)
    assert preset.source
    assert preset.array_source
    for row in rows(preset):
        assert math.isfinite(row["ours"])
        assert row["source"]
        assert row["published"]


def test_an_unknown_preset_is_refused_with_those_that_are_known():
    with pytest.raises(ConfigurationError, match="known are paper, tactile-display"):
        find_preset("hologram")

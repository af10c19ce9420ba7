"""Layouts of boards against what their own programs sent and assume."""

import cmath
import doctest
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from haptogram.acoustics.model.boards import layout as layouts
from haptogram.acoustics.model.boards.grids import (
    STACK_M,
    interactlab_pin,
    sonicsurface_wire_index,
)
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram_protocol.dialects.table import DIALECTS

DATA = Path(__file__).parents[4] / "data" / "dialects"
EXPECTED = json.loads((DATA / "expected.json").read_text())
ULTRAINO_M = 346.0 / 40e3
# Capture, layout, steps of a period, target of the client, its wavelength, coherence there.
FOCI = [
    ("sonicsurface/focus_0_120_0", "sonicsurface", 32, (0.0, 0.12, 0.0), 8.65e-3, 0.9985),
    ("sonicsurface/focus_20_150_m15", "sonicsurface", 32, (0.02, 0.15, -0.015), 8.65e-3, 0.9983),
    ("sonicsurface/twin_0_150_0_rot45", "sonicsurface", 32, (0.0, 0.15, 0.0), 8.65e-3, 0.0066),
    (
        "ultraino/simplefpga_ss_focus_0_120_0",
        "ultraino-sonicsurface",
        32,
        (0.0, 0.12, 0.0),
        ULTRAINO_M,
        0.9988,
    ),
    ("ultraino/mega_flat8x8_focus", "ultraino-flat8", 10, (0.0, 0.05, 0.0), ULTRAINO_M, 0.9881),
]


def coherence(positions, codes, steps, target, wavelength_m):
    """|sum of exp(-2 pi i (code / N + d / lambda)) / d| over the same without phases."""
    total = best = 0.0
    for position, code in zip(positions, codes, strict=True):
        distance = math.dist(position, target)
        total += cmath.exp(-2j * math.pi * (code / steps + distance / wavelength_m)) / distance
        best += 1 / distance
    return abs(total / best)


@pytest.mark.parametrize(("name", "layout", "steps", "target", "wavelength_m", "wanted"), FOCI)
def test_a_captured_focus_is_one_on_this_array(name, layout, steps, target, wavelength_m, wanted):
    board = LAYOUTS[layout]
    positions = board.clients_m(board.array().positions_m).tolist()
    codes = EXPECTED[name]["codes"]
    found = coherence(positions, codes, steps, target, wavelength_m)
    assert found == pytest.approx(wanted, abs=2e-4)


def test_interactlab_has_the_client_s_order():
    """levitate has the same board with a pitch of 10.47 mm."""
    theirs = np.array(EXPECTED["interactlab/levitate_focus_0_0_100"]["positions_m"])
    ours = LAYOUTS["interactlab"].array().positions_m
    assert np.abs(ours - theirs * 10.5 / 10.47).max() < 1e-9


def test_orders_name_every_channel_once():
    for index in (sonicsurface_wire_index, interactlab_pin):
        assert sorted(index(r, c) for r in range(16) for c in range(16)) == list(range(256))


def test_the_frames_of_sonicsurface_and_ultraino_are_two_millimetres_apart():
    apart = LAYOUTS["sonicsurface"].array().positions_m
    apart = apart - LAYOUTS["ultraino-sonicsurface"].array().positions_m
    assert apart == pytest.approx(np.tile([0.0, -2e-3, 0.0], (256, 1)))


def test_the_upper_board_of_a_stack_looks_down_on_the_lower_one():
    array = LAYOUTS["sonicsurface-stack"].array()
    lower, upper = array.positions_m.reshape(2, 256, 3)
    assert upper - lower * [1.0, -1.0, 1.0] == pytest.approx(np.tile([0.0, 0.0, STACK_M], (256, 1)))
    assert array.normals.reshape(2, 256, 3)[:, 0].tolist() == [[0, 0, 1], [0, 0, -1]]


def test_every_element_of_tinylev_looks_at_its_middle():
    array = LAYOUTS["tinylev"].array()
    assert array.count == 72
    assert np.linalg.norm(array.positions_m, axis=1) == pytest.approx(np.full(72, 0.06))
    assert array.normals * 0.06 == pytest.approx(-array.positions_m)
    gaps = np.linalg.norm(array.positions_m[:, None] - array.positions_m, axis=2)
    assert gaps[gaps > 0].min() > 9.9e-3  # housings of 10 mm do not overlap


@pytest.mark.parametrize("board", LAYOUTS.values(), ids=LAYOUTS)
def test_axes_of_clients_turn_there_and_back(board):
    points = np.array([[0.01, 0.02, 0.12], [-0.03, 0.0, 0.2]])
    assert board.ours_m(board.clients_m(points)) == pytest.approx(points)
    assert np.linalg.det(np.array(board.client_axes)) == pytest.approx(1.0)
    assert board.up == ("+y" if board.client_axes is layouts.Y_UP else "+z")
    assert board.source


def test_every_dialect_has_a_layout():
    for dialect in DIALECTS.values():
        assert LAYOUTS[dialect.layout].array().count % dialect.channels == 0


def test_the_examples_run():
    assert doctest.testmod(layouts) == (0, 4)


# --- the maps of the pages ------------------------------------------------------------------------

PAGES = Path(__file__).parents[5] / "docs" / "boards"
MAP = re.compile(r"<!-- element map: (\S+) -->\n```text\n(\w)\\(\w) (.*?)```", re.DOTALL)
MAPS = {
    name: (up, across, rows)
    for page in sorted(PAGES.glob("*.md"))
    for name, up, across, rows in MAP.findall(page.read_text("utf-8"))
}


@pytest.mark.parametrize("name", MAPS)
def test_the_map_of_a_page_has_every_channel_where_the_layout_has_it(name):
    up, across, text = MAPS[name]
    layout = LAYOUTS[DIALECTS[name].layout]
    places_mm = 1e3 * layout.clients_m(layout.array().positions_m)
    columns, *rows = [line.split() for line in text.strip("\n").split("\n")]
    seen = {}
    for height, *channels in rows:
        for place, channel in zip(columns, channels, strict=True):
            if channel != ".":
                seen[int(channel)] = (float(place), float(height))
    assert sorted(seen) == list(range(len(places_mm)))
    axes = ["xyz".index(across), "xyz".index(up)]
    shown = np.array([seen[channel] for channel in sorted(seen)])
    np.testing.assert_allclose(places_mm[:, axes], shown, atol=1e-6)


def test_every_dialect_has_a_map_or_is_told_from_one():
    others = {"sonicsurface-tactile", "ultraino-fpga", "ultraino-fpga-chained"}  # SonicSurface's
    in_words = {"autd3", "ultraino-mega64", "ultraino-nano8", "ultraino-nano16"}
    assert MAPS.keys() | others | in_words | {"ultraino-fpga-128"} == DIALECTS.keys()
    own, centred = (LAYOUTS[name].array() for name in ("sonicsurface", "ultraino-sonicsurface"))
    np.testing.assert_allclose(own.positions_m - centred.positions_m, [[0, -2e-3, 0]] * 256)


@pytest.mark.parametrize(
    ("name", "channel", "place_mm"),
    [
        ("autd3", 18, (0, 10.16, 0)),
        ("autd3", 32, (172.72, 10.16, 0)),
        ("autd3", 33, (0, 20.32, 0)),
        ("autd3", 248, (172.72, 132.08, 0)),
        ("ultraino-mega64", 0, (-35, 0, 35)),
        ("ultraino-mega64", 7, (35, 0, 35)),
        ("ultraino-mega64", 8, (-35, 0, 25)),
        ("ultraino-nano16", 0, (-15, 0, 15)),
        ("ultraino-nano16", 1, (-15, 0, 5)),
        ("ultraino-nano16", 4, (-5, 0, 15)),
        ("ultraino-nano8", 0, (-15, 0, 5)),
        ("ultraino-nano8", 2, (-5, 0, 5)),
    ],
)
def test_the_channels_that_pages_tell_in_words_are_there(name, channel, place_mm):
    layout = LAYOUTS[DIALECTS[name].layout]
    place_m = layout.clients_m(layout.array().positions_m)[channel]
    np.testing.assert_allclose(1e3 * place_m, place_mm, atol=1e-6)


def test_the_rings_of_a_page_are_those_of_tinylev():
    text = (PAGES / "ultraino.md").read_text("utf-8")
    (table,) = re.findall(r"<!-- rings: ultraino-fpga-128 -->\n(.*?)\n\n", text, re.DOTALL)
    layout = LAYOUTS[DIALECTS["ultraino-fpga-128"].layout]
    places_mm = 1e3 * layout.clients_m(layout.array().positions_m)
    for line in table.splitlines()[2:]:
        channels, radius, heights = line.strip("| ").split(" | ")
        spans = re.findall(r"(\d+) to (\d+)", channels)
        for (first, last), height in zip(spans, heights.split(", "), strict=True):
            ring = places_mm[int(first) : int(last) + 1]
            np.testing.assert_allclose(np.hypot(ring[:, 0], ring[:, 2]), float(radius), atol=0.01)
            np.testing.assert_allclose(ring[:, 1], float(height), atol=0.01)
            assert ring[0, 0] > 0.0 > ring[1, 2]  # from +x on, towards -z

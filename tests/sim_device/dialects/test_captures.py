"""What unmodified clients sent, end to end: bytes, latched codes, the field at the target."""

import re

import numpy as np
import pytest

from dialect_boards import EXPECTED, DialectBoard, capture, dialect_of
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram_protocol.dialects.table import DIALECTS
from sim_device.dialects.table import EMULATIONS

EMULATED = [name for name in EXPECTED if dialect_of(name)[0] in EMULATIONS]
WITH_CODES = [name for name in EMULATED if "codes" in EXPECTED[name]]  # InteractLab has a target
SPEED_M_S = 346.0  # what these clients assume
# A board that does what its client meant, where the usual one does not.
MEANT = {"ultraino/simplefpga_ss_amp50_0_120_0": ("fb=amplitude",)}


def shown(name, *options):
    dialect, usual = dialect_of(name)
    board = DialectBoard(dialect, *usual, *options)
    board.send(capture(name))
    return board


def codes_of(latch):
    """Return a code for each channel as the client counts them: steps is off."""
    pulses = latch.pulses
    return np.where(pulses.widths > 0, pulses.rises, pulses.steps)


def expected_codes(name, latch):
    expected = EXPECTED[name]
    codes = np.array(expected["codes"])
    if "amplitudes" in expected:  # a channel without any is off
        codes = np.where(np.array(expected["amplitudes"]) > 0, codes, latch.pulses.steps)
    return codes[: latch.pulses.count]


def relative_pressure(name, latch, target_mm):
    """Return |p| at a target in the client's axes, relative to what all emitters could give."""
    dialect, _ = dialect_of(name)
    layout = LAYOUTS[DIALECTS[dialect].layout]
    distances = np.linalg.norm(
        layout.array().positions_m - layout.ours_m(np.array(target_mm) * 1e-3), axis=1
    )
    waves = np.exp(2j * np.pi * 40_000 / SPEED_M_S * distances) / distances
    possible = (np.abs(latch.radiated) / distances).sum()
    return abs((latch.radiated * waves).sum()) / possible


@pytest.mark.parametrize("name", WITH_CODES)
def test_latched_codes_are_those_of_the_client(name):
    board = shown(name, *MEANT.get(name, ()))
    assert board.latches[0].cause == "power-up"
    assert codes_of(board.latches[-1]).tolist() == expected_codes(name, board.latches[-1]).tolist()
    assert [latch.number for latch in board.latches] == list(range(len(board.latches)))
    if "commits" in EXPECTED[name]:
        causes = [latch.cause for latch in board.latches[1:]]
        assert causes == ["swap"] * EXPECTED[name]["commits"]


@pytest.mark.parametrize(
    ("name", "target_mm", "coherence"),
    [
        ("sonicsurface/focus_0_120_0", (0, 120, 0), 0.9985),
        ("sonicsurface/focus_20_150_m15", (20, 150, -15), 0.9983),
        ("sonicsurface/twin_0_150_0_rot45", (0, 150, 0), 0.0066),
        ("ultraino/simplefpga_ss_focus_0_120_0", (0, 120, 0), 0.9988),
        ("ultraino/mega_flat8x8_focus", (0, 50, 0), 0.9881),
        ("ultraino/megaanim_flat8x8_focus", (0, 50, 0), 0.9881),
        ("ultraino/simplefpga_ss_amp50_0_120_0", (0, 120, 0), 0.0421),
    ],
)
def test_the_field_is_where_the_client_aimed(name, target_mm, coherence):
    latch = shown(name).latches[-1]
    assert relative_pressure(name, latch, target_mm) == pytest.approx(coherence, abs=1e-4)


def test_amplitudes_fall_through_unless_the_board_takes_them():
    name = "ultraino/simplefpga_ss_amp50_0_120_0"
    torn = shown(name).latches[-1]
    assert not (codes_of(torn) == EXPECTED[name]["codes"]).any()
    assert torn.counted == {"codes_beyond_array": 257, "codes_out_of_range": 1}
    whole = shown(name, "fb=amplitude").latches[-1]
    assert set(whole.pulses.widths.tolist()) == {8}
    assert not whole.counted
    assert relative_pressure(name, whole, (0, 120, 0)) > 0.998


@pytest.mark.parametrize("name", [name for name in EMULATED if re.search("mega", name)])
def test_pulses_are_as_wide_as_the_client_s_amplitudes(name):
    expected = EXPECTED[name]
    amplitudes = np.array(expected.get("amplitudes", [1] * 64))
    latch = shown(name).latches[-1]
    assert latch.pulses.widths.tolist() == np.floor(amplitudes * 5 + 0.5).astype(int).tolist()

"""Faults of single pins: their names where a run is long, and what is lost of their amplitude."""

import tracemalloc

import numpy as np
import pytest

from haptogram.verification.pins.elements.faults import (
    PinDrives,
    PinFaultKind,
    faults_of_pins,
)
from haptogram.verification.pins.elements.levels import LevelsInTime
from haptogram.verification.pins.run_drives import PinRunDrives

FRAMES, ELEMENTS = 20_000, 256


def test_a_wrong_pin_of_a_long_run_is_named_without_the_drives_of_all_elements():
    random = np.random.default_rng(1)
    phases = random.integers(0, 256, (FRAMES, ELEMENTS), dtype=np.uint8)
    run = PinRunDrives(
        np.arange(FRAMES) * 40.0, phases, np.full_like(phases, 255), (3,), np.zeros(FRAMES)
    )
    drives = PinDrives(
        run,
        run.weights_of([200]),  # the wire of another element
        np.arange(-1, FRAMES - 1),
        np.full((FRAMES, 1), 0.02),
        0.01,
        np.zeros(FRAMES),
    )
    tracemalloc.start()
    fault = faults_of_pins(drives, [0], np.ones(FRAMES, np.bool_))[0]
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert (fault.kind, fault.other) == (PinFaultKind.OTHER_ELEMENT, 200)
    assert fault.text == "does what element 200 should"
    assert peak < 8 * FRAMES * ELEMENTS / 2  # all weights are 8 bytes each


@pytest.mark.parametrize(
    ("levels_db", "busy", "text"),
    [
        ([0, -0.4, 0, 0], None, ""),
        ([0, -6, -8, 0], None, "for 50 % of the time: -7.0 dB; capture to_board to know why"),
        ([0, -6, -8, 0], [0, 1, 1, 0], "while bytes arrive: -7.0 dB"),
        ([0, -0.4, 0, 0], [0, 1, 1, 0], ""),
        ([-6, 0, 0, -8], [0, 1, 1, 0], "for 50 % of the time: -7.0 dB"),  # at other times
        ([-6, 0, 0, -6], [0, 1, 1, 1], "for 50 % of the time: -6.0 dB"),  # whether or not
        ([np.nan, 0, 0, -6], [1, 0, 0, 0], "for 33 % of the time: -6.0 dB"),
        ([np.nan] * 4, [0, 1, 1, 0], ""),
    ],
)
def test_a_loss_of_amplitude_is_told_whenever_it_comes(levels_db, busy, text):
    is_busy = None if busy is None else np.array(busy, np.bool_)
    assert LevelsInTime(np.arange(4.0), np.array(levels_db, np.float64), is_busy).text == text

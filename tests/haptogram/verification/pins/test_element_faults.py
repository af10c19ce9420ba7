"""The names of faults cost no more memory where a run is long."""

import tracemalloc

import numpy as np

from haptogram.verification.pins.elements.faults import (
    PinDrives,
    PinFaultKind,
    faults_of_pins,
)
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

"""Verdicts by pins on objects whose frames hardly differ: their place in a capture may not show."""

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel, Drive, Medium, Transducer, TransducerArray
from haptogram.records.frame import Focus, FrameKey, Intended
from haptogram.records.pins import PinPulses, PinRecord
from haptogram.verification import Verdict
from haptogram.verification.pins.joined import verify_captures

PERIOD_S, RATE_HZ, JITTER_S = 25e-6, 12e6, 20e-9
BEFORE, LENGTH, FRAMES = 20, 40, 40  # periods before the run, periods of a frame, frames
MODEL = AcousticModel(TransducerArray.grid(4, 4), Medium.air(20.0), Transducer())


def verdict_of_pins(seed, most, turned=0):
    """Judge 4 pins whose codes change by *most* from frame to frame; one of them may be turned."""
    random = np.random.default_rng(seed)
    first, changes = random.integers(0, 256, 16), random.integers(-most, most + 1, (FRAMES - 1, 16))
    codes = np.cumsum(np.vstack([first, changes]), axis=0) % 256
    foci, full = (Focus((0.0, 0.0, 0.1)),), np.full(16, 255, np.uint8)
    intended = [
        Intended(n, FrameKey(1, 0, 0, n), 1000 * n, foci, Drive(row.astype(np.uint8), full), 8)
        for n, row in enumerate(codes)
    ]
    periods = np.arange(FRAMES * LENGTH)

    def seen(edges):
        off = random.normal(0.0, JITTER_S, len(edges))
        return np.ceil((edges * PERIOD_S + off) * RATE_HZ) / RATE_HZ / PERIOD_S

    pins = {}
    for pin in range(4):
        middles = BEFORE + periods + (codes[periods // LENGTH, pin] + turned * (pin == 2)) / 256
        pins[pin] = PinPulses(f"e{pin}", seen(middles - 0.25), seen(middles + 0.25))
    end = BEFORE + (FRAMES + 1) * LENGTH
    record = PinRecord("capture", pins, end, PERIOD_S, 1.0 / PERIOD_S, RATE_HZ, "carrier")
    (found,) = verify_captures([record], intended, model=MODEL).pins
    return found


@pytest.mark.parametrize("most", [0, 1, 3, 40])
def test_a_right_board_whose_frames_hardly_differ_does_not_fail(most):
    found = [verdict_of_pins(seed, most).verdict for seed in range(5)]
    assert Verdict.FAIL not in found
    assert most in (1, 3) or set(found) == {Verdict.PASS}


@pytest.mark.parametrize("most", [0, 1, 3, 40])
def test_a_wrong_pin_fails_where_its_frames_are_found(most):
    every = [verdict_of_pins(seed, most, turned=10) for seed in range(5)]
    failed = [found for found in every if found.verdict is Verdict.FAIL]
    assert len(failed) == 5 if most in (0, 40) else failed
    for found in failed:
        assert any(text.startswith("element 2 (e2)") for text in found.findings["phases"])

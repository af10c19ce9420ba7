"""The device clock from PINGs is known as well as it says, for crystals of any kind."""

import numpy as np
import pytest

from haptogram.conformance.pins.device_clock import PinDialogueClock

CARRIER_HZ, SECOND = 40_000.0, 40_000.0


def clock_and_marks(seed):
    """Return a device clock that warms up, and PINGs that are answered within 1 us."""
    random = np.random.default_rng(seed)
    length = random.uniform(2.0, 100.0) * SECOND
    ppm, swing_us = random.uniform(-80.0, 80.0), random.uniform(0.0, 4.0) * length / SECOND
    turns, phase = random.uniform(0.1, 2.0), random.uniform(0.0, 6.0)

    def device_us(period):
        bend = swing_us * np.sin(2.0 * np.pi * turns * period / length + phase)
        return 4_290_000_000 + 25.0 * (1.0 + ppm * 1e-6) * period + bend

    arrivals = np.sort(random.uniform(0.0, length, random.integers(20, 400)))
    times = np.floor(device_us(arrivals) + random.uniform(-0.5, 0.5, len(arrivals)))
    marks = [(float(a), int(t) % 2**32) for a, t in zip(arrivals, times, strict=True)]
    return device_us, marks, length


@pytest.mark.parametrize("seed", range(40))
def test_a_clock_is_known_as_well_as_it_says(seed):
    device_us, marks, length = clock_and_marks(seed)
    clock = PinDialogueClock.of(0.0, length, marks, CARRIER_HZ)
    inside = np.linspace(marks[0][0], marks[-1][0], 200)
    for period in inside.tolist():
        t_us = round(float(device_us(period)))
        found = clock.periods(t_us % 2**32, period)
        assert abs(found - period) <= clock.within(period) + 0.04, period
    known = np.array([clock.within(period) for period in inside.tolist()])
    assert np.median(known) < 1.0  # of a period: a latch in time is seen to be so


def test_pongs_that_lie_are_left_out_and_few_pings_are_known_badly():
    marks = [(n * SECOND, 1_000_000 * n) for n in range(40)]
    marks[7] = (7 * SECOND, 7_000_500)
    clock = PinDialogueClock.of(0.0, 40 * SECOND, marks, CARRIER_HZ)
    assert abs(clock.periods(7_000_000, 7 * SECOND) - 7 * SECOND) < 0.1
    assert clock.within(20 * SECOND) < 0.1
    lone = PinDialogueClock.of(0.0, 40 * SECOND, marks[:1], CARRIER_HZ)
    assert lone.within(0.0) < 0.1
    assert lone.within(10 * SECOND) > 10.0  # 200 ppm
    apart = PinDialogueClock.of(0.0, 40 * SECOND, [marks[0], marks[-1]], CARRIER_HZ)
    assert 0.5 < apart.within(20 * SECOND) < 2.0

"""The silencer beside its rule, channel by channel and period by period."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sim_device.dialects.autd3.silencer import Pace, Silencer


class Channel:
    """One value by the rule of the HDL, a period at a time, in whole numbers."""

    def __init__(self, *, round_circle):
        self.round_circle = round_circle
        self.current = self.target = self.change = self.more = 0

    def step(self, target, number, *, is_rate):
        rate = number
        if not is_rate:
            change = abs(target - self.target)
            if self.round_circle and change >= 128:
                change = 256 - change
            self.target = target
            if change:
                self.change = change
                rate, self.more = divmod(256 * change, number)
            else:
                rate = 256 * self.change // number + (self.more > 0)
                self.more = max(0, self.more - 1)
        self.target = target
        gap = 256 * target - self.current
        if self.round_circle and not -32768 <= gap <= 32768:
            gap -= 65536 if gap > 0 else -65536
        self.current += max(-rate, min(rate, gap))
        if self.round_circle:
            self.current %= 65536
        return self.current >> 8


numbers = st.integers(1, 300) | st.integers(1, 65_535)
paces = st.builds(Pace, st.booleans(), numbers, numbers)
codes = st.lists(st.integers(0, 255), min_size=3, max_size=3)
runs = st.lists(st.tuples(codes, codes, st.integers(1, 60), paces), min_size=1, max_size=6)


@given(runs)
def test_any_periods_at_once_are_the_rule_period_by_period(given_runs):
    silencer = Silencer(3)
    phases = [Channel(round_circle=True) for _ in range(3)]
    levels = [Channel(round_circle=False) for _ in range(3)]
    for phase_targets, level_targets, periods, pace in given_runs:
        targets = np.array(phase_targets, np.uint8), np.array(level_targets, np.uint8)
        silencer.move(*targets, periods, pace)
        for _ in range(periods):
            shown = [
                [
                    channel.step(target, number, is_rate=pace.is_rate)
                    for channel, target in zip(channels, of_kind, strict=True)
                ]
                for channels, of_kind, number in (
                    (phases, phase_targets, pace.phase),
                    (levels, level_targets, pace.intensity),
                )
            ]
        assert silencer.phases.tolist() == shown[0]
        assert silencer.intensities.tolist() == shown[1]
    left = silencer.periods_left(pace)
    if left is not None and left < 2000:
        if left:
            silencer.move(*targets, left, pace)
        assert silencer.phases.tolist() == phase_targets
        assert silencer.intensities.tolist() == level_targets
        assert silencer.periods_left(pace) == 0

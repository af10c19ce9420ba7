"""The clock over ports that keep to their baud rate, and over those that do not."""

from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics import AcousticModel
from haptogram.driver.driver import Driver
from virtual_ports import BoardPort

CIRCLE = [(0.01, 0.0, 0.12), (0.0, 0.01, 0.12)] * 160


class Unhurried(BoardPort):
    """A host that is stopped now and then for the times of a script, in us."""

    def __init__(self, stalls_us, **settings):
        super().__init__(model=AcousticModel.default(4, 4), **settings)
        self._stalls = iter(stalls_us)

    def read_available(self, deadline_ns):
        data = super().read_available(deadline_ns)
        self.stall(1000 * next(self._stalls, 0))
        return data


def error_us(port, driver):
    truth_us = port.simulation.device_us(port.simulation.now_ns)
    return abs(driver.clock.to_device_us(port.now_ns()) - truth_us)


@given(st.lists(st.integers(0, 4_000), max_size=300), st.sampled_from([None, 3_000_000, 500_000]))
def test_a_line_without_a_pace_never_breaks_the_stated_error(stalls_us, line_baud):
    """The host reckons with 500 kbaud; the line may be faster, as a pseudo-terminal is."""
    port = Unhurried(stalls_us, baud=line_baud)
    with Driver(port, seed=1, baudrate=500_000) as driver:
        driver.arm()
        for _ in range(2):
            driver.stream(CIRCLE, 1000)
            assert error_us(port, driver) <= driver.clock.uncertainty_at_us(port.now_ns()) + 2
        assert driver.clock.jumps == 0


def test_an_even_line_is_seen_through_to_the_microsecond():
    port = Unhurried([], baud=500_000)
    with Driver(port, seed=1, baudrate=500_000) as driver:
        driver.arm()
        driver.stream(CIRCLE, 1000)
        assert driver.clock.uncertainty_us < 5
        assert error_us(port, driver) <= 5

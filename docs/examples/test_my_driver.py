"""A driver under pytest: the virtual board judges what the driver sent to it."""

import pytest

from haptogram import Driver  # stands for your own driver: any program that opens a serial port

FOCI = [(0.0, 0.0, 0.10), (0.01, 0.0, 0.10), (0.01, 0.01, 0.12)]  # metres


@pytest.mark.haptogram_board(array="8x8", pitch_mm=10)
def test_my_driver(verified_board):
    with Driver(verified_board.port) as driver:
        driver.arm()
        driver.stream(FOCI, rate_hz=100, lead_us=400_000)
    verified_board.expect(FOCI, rounds=1)

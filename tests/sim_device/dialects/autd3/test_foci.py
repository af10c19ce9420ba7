"""Foci against arithmetic of its own: whole numbers, one element at a time."""

import cmath
import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics.model.boards.grids import AUTD3
from sim_device.dialects.autd3.foci import read_autd3_foci

STEP_MM = 0.025
PLACES = [
    (column, row)
    for row in range(14)
    for column in range(18)
    if (column, row) not in [(1, 1), (2, 1), (16, 1)]
]
coordinates = st.integers(-(2**17), 2**17 - 1)
patterns = st.lists(
    st.tuples(coordinates, coordinates, coordinates, st.integers(0, 255)), min_size=1, max_size=8
)


def packed(pattern) -> bytes:
    return b"".join(
        struct.pack(
            "<Q",
            sum((value % 2**18) << 18 * axis for axis, value in enumerate(focus[:3]))
            | focus[3] << 54,
        )
        for focus in pattern
    )


def sine(step: int) -> int:
    return math.floor((math.sin(math.tau * step / 256) + 1) * 127.5 + 0.5)


def phase_of(pattern, column, row, sound_speed) -> int:
    sines = cosines = 0
    for number, (x, y, z, extra) in enumerate(pattern):
        dx, dy = x - math.floor(column * 406.4 + 0.5), y - math.floor(row * 406.4 + 0.5)
        distance = math.isqrt(dx * dx + dy * dy + z * z)
        step = distance * 2**14 // sound_speed + (extra if number else 0)
        sines += sine(step % 256)
        cosines += sine((step + 64) % 256)
    s, c = (total // len(pattern) // 2 - 64 for total in (sines, cosines))
    return round(-math.atan2(s, c) / math.tau * 256) % 256


@given(pattern=patterns, sound_speed=st.integers(300 * 64, 380 * 64))
def test_phases_are_those_of_whole_numbers(pattern, sound_speed) -> None:
    foci = read_autd3_foci(packed(pattern), len(pattern), sound_speed)
    phases, intensities = foci.drive(0)
    assert len(foci) == 1
    assert set(intensities.tolist()) == {pattern[0][3]}
    for element in range(0, 249, 31):
        column, row = PLACES[element]
        assert phases[element] == phase_of(pattern, column, row, sound_speed)


@pytest.mark.parametrize(
    "target_mm", [(86.6, 66.7, 150.0), (20.0, 120.0, 100.0), (0.0, 0.0, 220.0)]
)
def test_one_focus_arrives_in_phase(target_mm) -> None:
    """By the geometry of the layout: the elements of the board are those of its firmware."""
    point = [round(value / STEP_MM) for value in target_mm]
    foci = read_autd3_foci(packed([(*point, 255)]), 1, 340 * 64)
    phases, _ = foci.drive(0)
    distances = np.linalg.norm(AUTD3.array().positions_m - np.array(target_mm) * 1e-3, axis=1)
    total = sum(
        cmath.exp(1j * (math.tau * code / 256 + math.tau * 40e3 / 340 * distance))
        for code, distance in zip(phases, distances, strict=True)
    )
    assert abs(total) / 249 == pytest.approx(1.0, abs=2e-3)


def test_patterns_are_read_in_order() -> None:
    pattern = [(1, 2, 4000, 9), (-5, 6, 4000, 7)]
    foci = read_autd3_foci(packed(pattern + pattern[::-1]), 2, 340 * 64)
    assert len(foci) == 2
    assert foci.drive(0)[1][0] == 9
    assert foci.drive(1)[1][0] == 7


@given(
    st.tuples(
        *(st.integers(low, high) for low, high in ((-400, 8000), (-400, 7000), (1600, 16000)))
    ),
    st.integers(320 * 64, 360 * 64),
)
def test_phases_of_one_focus_are_right_to_half_a_step(place, sound_speed) -> None:
    foci = read_autd3_foci(packed([(*place, 255)]), 1, sound_speed)
    phases, _ = foci.drive(0)
    elements = np.array([(10.16 * column, 10.16 * row, 0.0) for column, row in PLACES])
    wavelength_mm = sound_speed / 64 / 40.0
    distance = np.linalg.norm(STEP_MM * np.array(place) - elements, axis=1)
    error = np.angle(np.exp(2j * np.pi * (phases / 256 + distance / wavelength_mm)))
    spread = np.angle(np.exp(1j * (error - error[0])))
    assert 0.5 < np.ptp(spread) / (2 * np.pi) * foci.steps <= 1.0

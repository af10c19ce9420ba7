"""From foci to phases, as the FPGA of a device computes them.

For each focus the distance to an element in steps of 0.025 mm, rounded down, becomes steps of 1/256
wavelength, rounded down; a table of sines turns these into numbers of 8 bits, which are averaged
over the foci and halved; a table of angles makes the phase, whose sign is that of a delay.

Checked against ``pyautd3_emulator`` 38.0.1: 67 230 phases of 270 patterns of one to eight foci, all
equal. The source of the arithmetic is shinolab/autd3-rs 0067925,
``autd3-firmware-emulator/src/fpga/emulator/stm/foci.rs``; what its tables hold was found by asking.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram_protocol.dialects.autd3.operations import CHANNELS

MAX_FOCI_OF_PATTERN: Final = 8
_COLUMNS, _ROWS = 18, 14
_MISSING: Final = {(1, 1), (2, 1), (16, 1)}
_PITCH: Final = 406.4  # distance of two elements, 10.16 mm, in units of 0.025 mm
_STEPS: Final = 256
_QUARTER: Final = 64
_BITS: Final = 18
_UNIT_M: Final = 0.025e-3
_OFF_GRID: Final = math.hypot(0.4, 0.4)  # of 0.025 mm: where 10.16 mm are no whole number of them
_CARRIER_HZ: Final = 40e3
_TABLE: Final = 255.0  # range of the table of sines

_ELEMENTS: Final = np.array(
    [
        (round(column * _PITCH), round(row * _PITCH), 0)
        for row in range(_ROWS)
        for column in range(_COLUMNS)
        if (column, row) not in _MISSING
    ],
    dtype=np.int64,
)
_SINES: Final = np.rint(
    (np.sin(2.0 * np.pi * np.arange(_STEPS) / _STEPS) + 1.0) / 2.0 * 255.0
).astype(np.int64)
_HALVES: Final = np.arange(_STEPS // 2) - _STEPS // 4
_ANGLES: Final = (
    np.rint(-np.arctan2(_HALVES[:, None], _HALVES[None, :]) / (2.0 * np.pi) * _STEPS) % _STEPS
).astype(np.uint8)  # [sine, cosine]


class Autd3Foci:
    """The foci of a sequence of patterns.

    Parameters
    ----------
    points : (P, F, 3) numpy.ndarray of int64
        Places in 0.025 mm, seen from the first element.
    extras : (P, F) numpy.ndarray of int64
        Of the first focus of a pattern its intensity, of the others their phase offset.
    sound_speed : int
        In 1/64 m/s.
    """

    def __init__(
        self, points: NDArray[np.int64], extras: NDArray[np.int64], sound_speed: int
    ) -> None:
        self._points, self._extras, self._sound_speed = points, extras, sound_speed

    def __len__(self) -> int:
        return len(self._points)

    @property
    def steps(self) -> int:
        """Steps of a period: these phases are exact to half of one, by the arithmetic above.

        Places of elements and distances are rounded to 0.025 mm, phases rounded down, then sine and
        cosine to a half of 127.5/2, and the angle to the nearest step: together 2.3 of 256 steps
        either way at 340 m/s, and 0.6 in the root mean square.
        """
        distance = (0.5 + _OFF_GRID) * _UNIT_M / (self._sound_speed / 64.0 / _CARRIER_HZ)
        table = math.sqrt(0.5) / (_TABLE / 4.0) / math.tau
        return math.floor(0.5 / (distance + 0.5 / _STEPS + table + 0.5 / _STEPS))

    def drive(self, index: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Return the (249,) phases and intensities of pattern *index*."""
        points, extras = self._points[index], self._extras[index]
        gaps = points[:, None, :] - _ELEMENTS
        distances = np.sqrt(np.sum(gaps * gaps, axis=2)).astype(np.int64)
        steps = (distances << 14) // self._sound_speed
        steps[1:] += extras[1:, None]
        sines = _SINES[steps % _STEPS].sum(axis=0) // len(points) >> 1
        cosines = _SINES[(steps + _QUARTER) % _STEPS].sum(axis=0) // len(points) >> 1
        return _ANGLES[sines, cosines], np.full(CHANNELS, extras[0], np.uint8)


def read_autd3_foci(packed: bytes, foci_of_pattern: int, sound_speed: int) -> Autd3Foci:
    """Return the foci of whole patterns as they come in the operation."""
    words = np.frombuffer(packed, "<u8").reshape(-1, foci_of_pattern)
    points = np.stack(
        [_signed_autd3_words(words >> np.uint64(_BITS * axis)) for axis in range(3)], axis=2
    )
    extras = (words >> np.uint64(3 * _BITS)) & np.uint64(0xFF)
    return Autd3Foci(points, extras.astype(np.int64), sound_speed)


def _signed_autd3_words(words: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Return the lowest 18 bits of each word as a signed number."""
    bits = (words & np.uint64((1 << _BITS) - 1)).astype(np.int64)
    return bits - ((bits >> (_BITS - 1)) << _BITS)

"""From the pins of a simulator to the drives that they show."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import ComplexArray
from haptogram.acoustics.model.pulses import PulseDrive

from .process import PERIOD, SAME, count_of_same

STEPS: Final = 4096  # steps of a period: 6 ns of 25 µs
_UNSTEADY: Final = 8  # periods over which pins that do not repeat are averaged
_ALIKE: Final = 0.5 / 64  # largest difference of equal drives; a step of 1/32 period is 0.2
_SILENT: Final = 1e-3
_CODES: Final = 256  # phase codes of a drive
_HEX: Final = b"0123456789abcdefABCDEF"
_COMMON: Final = 0.8


class ShownDrive(NamedTuple):
    """Pulses that the pins show from a time on."""

    t_ns: int
    pulses: PulseDrive


class SimulatedPins:
    """The drives of pins whose changes come period by period.

    A drive is there once two periods are the same; the fundamental is what counts. Pins that go on
    changing are averaged over 8 periods, as a transducer does, which is a narrow resonator: a
    carrier of half the frequency, and one that a busy firmware delays.

    Parameters
    ----------
    count : int
        Pins.
    period_ns : int
        Period of the carrier.

    Attributes
    ----------
    periods : int
        Periods that are over.
    unsteady, halved : int
        Averages so far, and those of pins that have one edge in a period, and one in the next.

    Raises
    ------
    ValueError
        From :meth:`take`, which takes whole lines: one that cannot be read.
    """

    def __init__(self, count: int, period_ns: int) -> None:
        self.count, self.period_ns = count, period_ns
        self._digits = -(-count // 4)
        self._rest = b""
        self.periods = 0
        self._block = b""
        self._is_steady = False
        self._levels = np.zeros(count, np.int8)
        self._weights: ComplexArray = np.full(count, np.inf + 0j)  # of the last period
        self._shown = self._weights
        self._changing: list[ComplexArray] = []
        self._open = 0  # of those, whose levels at the end are not those at the beginning
        self.unsteady = self.halved = 0

    def take(self, text: bytes) -> Iterator[ShownDrive]:
        """Take changes; yield each new drive, which may have begun some periods before."""
        *blocks, self._rest = (self._rest + text).split(PERIOD)
        for block in blocks:
            yield from self._take_period((yield from self._repeat(block)))
        self._rest = yield from self._repeat(self._rest)
        self._words(self._rest)  # a capture takes them down before the period ends

    def _repeat(self, block: bytes) -> Generator[ShownDrive, None, bytes]:
        """Skip lines of *block* that say how many periods equal the last one; return what is left.

        Yields the drives of these periods, while the drive is not yet steady.
        """
        while block.startswith(SAME):
            line, _, block = block.partition(b"\n")
            more = count_of_same(line)
            while more and not self._is_steady:
                yield from self._take_period(self._block)
                more -= 1
            self.periods += more
        return block

    def _take_period(self, block: bytes) -> Iterator[ShownDrive]:
        """Decode a carrier period; yield the drive once it was the same in two periods in turn.

        After 8 periods that differ, their mean drive is yielded instead.
        """
        self.periods += 1
        if self._is_steady and block == self._block:
            return
        self._block, before, levels = block, self._weights, self._levels
        self._weights = self._weights_of(block)
        repeats = np.array_equal(levels, self._levels)  # else its pulses end in another period
        self._is_steady = repeats and bool(np.abs(self._weights - before).max() <= _ALIKE)
        if self._is_steady:
            self._changing, self._open = [], 0
            yield from self._show(self._weights, 2)
            return
        self._changing.append(self._weights)
        self._open += not repeats
        if len(self._changing) == _UNSTEADY:
            mean: ComplexArray = np.mean(self._changing, axis=0)
            self.unsteady, self.halved = self.unsteady + 1, self.halved + (self._open == _UNSTEADY)
            self._changing, self._open = [], 0
            yield from self._show(mean, _UNSTEADY)

    def _show(self, weights: ComplexArray, periods: int) -> Iterator[ShownDrive]:
        """Yield the drive *weights* (C,) of the last *periods*, if it differs from the one before.

        It differs if a weight is off by more than a 128th of full drive.
        """
        if np.abs(weights - self._shown).max() > _ALIKE:
            self._shown = weights
            yield ShownDrive((self.periods - periods) * self.period_ns, _pulses_of(weights))

    def _weights_of(self, block: bytes) -> ComplexArray:
        """Return the complex fundamentals (C,) of the pins in a carrier period.

        *block* has the changes in it; the levels before them are those kept from the last period.
        """
        words = self._words(block)
        if not words:
            return np.zeros(self.count, np.complex128)
        times = np.array([int(word[1]) for word in words])
        levels = self._read_levels([word[2] for word in words])
        edges = np.diff(levels, axis=0, prepend=self._levels[None])
        self._levels = levels[-1]
        turns: ComplexArray = np.exp(1j * (math.tau / self.period_ns) * times)
        # The threads of a matrix product cost 40 times what this takes.
        weights: ComplexArray = np.einsum("t,tc->c", 0.5j * (turns - 1.0), edges)
        return weights

    def _words(self, block: bytes) -> list[list[bytes]]:
        """Return the words of each line of *block*, a carrier period: "P", time in ns, hex levels.

        ValueError if a line is malformed, or its time is before that of the last line or too late.
        """
        words = [line.split() for line in block.splitlines() if line.strip()]
        form, before_ns = (3, b"P", self._digits, b"", True), 0
        for word in words:
            time = word[1] if len(word) > 1 else b""
            levels = word[-1]
            is_one = (len(word), word[0], len(levels), levels.strip(_HEX), time.isdigit()) == form
            if not is_one or not before_ns <= int(time) < self.period_ns:
                raise ValueError(
                    f"{b' '.join(word).decode(errors='replace')!r}; a change is P, a time from "
                    f"{before_ns} to {self.period_ns - 1}, and {self._digits} digits of levels"
                )
            before_ns = int(time)
        return words

    def _read_levels(self, words: list[bytes]) -> NDArray[np.int8]:
        """Return the levels of C pins at M changes, (M, C), from hex numbers *words*."""
        odd = "0" * (self._digits % 2)
        data = bytes.fromhex("".join(odd + word.decode("ascii") for word in words))
        bits = np.unpackbits(np.frombuffer(data, np.uint8).reshape(len(words), -1), axis=1)
        return bits[:, ::-1][:, : self.count].astype(np.int8)


def _pulses_of(weights: ComplexArray) -> PulseDrive:
    """Return pulses with the complex fundamentals *weights* (C,), at most half a period wide.

    If all phases are the same distance from a whole code, they are first shifted onto the codes:
    else a common phase between two codes would be rounded up for some and down for others.
    """
    sizes = np.abs(weights)
    is_on = sizes > _SILENT
    places = np.sum((weights[is_on] / sizes[is_on]) ** _CODES)  # within a code
    fine = np.angle(places) / _CODES if abs(places) > _COMMON * np.sum(is_on) else 0.0
    widths = np.arcsin(np.minimum(sizes, 1.0)) / math.pi * STEPS
    rises = (np.angle(weights) - fine) / math.tau * STEPS - widths / 2.0
    return PulseDrive(
        np.where(is_on, np.rint(rises) % STEPS, 0).astype(np.uint16),
        np.where(is_on, np.maximum(np.rint(widths), 1), 0).astype(np.uint16),
        STEPS,
    )

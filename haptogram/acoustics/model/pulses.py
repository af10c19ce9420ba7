"""Square pulses: what a board without amplitude control switches its transducers with.

A transducer is a narrow resonator, so only the fundamental of its voltage is heard. A pulse that
rises at step r of N and is w steps wide has the fundamental sin(pi w / N) e^{+2 pi j (r + w/2) / N}
with the time factor e^{-j w t}: a later pulse lags, and half a period is full amplitude.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from haptogram.acoustics.arrays import ComplexArray, read_only_array
from haptogram.errors import ConfigurationError
from haptogram.settings.frozen import dataclass, field

MAX_STEPS: Final = 4096
MAX_CHANNELS: Final = 4096


@dataclass(frozen=True, eq=False, slots=True)
class PulseDrive:
    """The pulses of every channel in one period of the carrier.

    Attributes
    ----------
    rises : (C,) numpy.ndarray of uint16
        Step at which the pulse rises, 0 to steps - 1; read-only.
    widths : (C,) numpy.ndarray of uint16
        Steps for which it is high, 0 (off) to steps; read-only.
    steps : int
        Steps in a period.
    levels : mapping of int to bytes
        For a channel that has several pulses in a period: its level, 0 or 1, in each step. Its
        rise and width are those of the first rise and of all high steps.

    Raises
    ------
    ConfigurationError
        Lengths that differ, or a value out of range.

    Examples
    --------
    >>> from haptogram.acoustics.model.pulses import PulseDrive
    >>> PulseDrive([0, 8, 0], [16, 16, 0], 32).weights().round(3).tolist()
    [1j, (-1+0j), 0j]
    """

    rises: NDArray[np.uint16]
    widths: NDArray[np.uint16]
    steps: int
    levels: Mapping[int, bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 2 <= self.steps <= MAX_STEPS:
            raise ConfigurationError(f"steps is {self.steps}, must be 2 to {MAX_STEPS}")
        rises = _as_pulse_steps("rises", self.rises, self.steps - 1)
        widths = _as_pulse_steps("widths", self.widths, self.steps)
        if len(rises) != len(widths):
            raise ConfigurationError(
                f"{len(rises)} rises and {len(widths)} widths, must be as many"
            )
        object.__setattr__(self, "rises", rises)
        object.__setattr__(self, "widths", widths)

    @classmethod
    def off(cls, channels: int, steps: int) -> Self:
        """Return the pulses of *channels* that are all off."""
        nothing = np.zeros(channels, np.uint16)
        return cls(nothing, nothing, steps)

    @classmethod
    def of_levels(cls, levels: NDArray[np.bool_]) -> Self:
        """Return the pulses of (N, C) *levels*: of each channel in each step of the period.

        Examples
        --------
        >>> import numpy as np
        >>> from haptogram.acoustics.model.pulses import PulseDrive
        >>> found = PulseDrive.of_levels(np.array([[1, 0], [0, 0], [0, 0], [1, 0]], dtype=bool))
        >>> found.rises.tolist(), found.widths.tolist()
        ([3, 0], [2, 0])
        """
        starts = levels & ~np.roll(levels, 1, axis=0)
        several = np.flatnonzero(starts.sum(axis=0) > 1)
        others = {int(c): levels[:, c].astype(np.uint8).tobytes() for c in several}
        return cls(starts.argmax(axis=0), levels.sum(axis=0), len(levels), others)

    @property
    def count(self) -> int:
        """Number of channels."""
        return len(self.rises)

    def weights(self) -> ComplexArray:
        """Return the (C,) complex weights A e^{+j phi}; A is 1 for half a period."""
        turn = 2.0 * math.pi / self.steps
        # 0 and not sin(pi) = 1.2e-16 for a channel that is always high: it radiates nothing
        sounding = (self.widths > 0) & (self.widths < self.steps)
        amplitudes = np.where(sounding, np.sin(turn / 2.0 * self.widths), 0.0)
        weights: ComplexArray = amplitudes * np.exp(1j * turn * (self.rises + self.widths / 2.0))
        for channel, levels in self.levels.items():
            high = np.flatnonzero(np.frombuffer(levels, np.uint8))
            weights[channel] = math.sin(turn / 2.0) * np.exp(1j * turn * (high + 0.5)).sum()
        return weights

    def _key(self) -> tuple[object, ...]:
        """Return the values that define equality."""
        levels = tuple(sorted(self.levels.items()))
        return self.steps, self.rises.tobytes(), self.widths.tobytes(), levels

    def __eq__(self, other: object) -> bool:
        return self._key() == other._key() if isinstance(other, PulseDrive) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key())


def _as_pulse_steps(name: str, values: ArrayLike, limit: int) -> NDArray[np.uint16]:
    """Return pulse edges as read-only whole steps; raise ConfigurationError unless 0 to *limit*."""
    array = np.asarray(values)
    if array.ndim != 1 or not 1 <= array.size <= MAX_CHANNELS or array.dtype.kind not in "ui":
        raise ConfigurationError(
            f"{name} is {array.dtype} of shape {array.shape}, "
            f"must be 1 to {MAX_CHANNELS} whole numbers"
        )
    low, high = int(array.min()), int(array.max())
    if low < 0 or high > limit:
        raise ConfigurationError(f"{name} holds {low if low < 0 else high}, must be 0 to {limit}")
    steps = array.astype(np.uint16)
    read_only_array(steps)
    return steps

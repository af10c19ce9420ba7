"""A capture of a logic analyser: the edges of each channel."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram.errors import ConfigurationError

#: Channels of a capture that is read: the elements of an array, and a few signals beside them.
MOST_CHANNELS: Final = 2048
MOST_EDGES: Final = 50_000_000
_NUMBER: Final = "([0-9]{1,9})"
_MOST_SHARES: Final = 16  # steps in the least distance of two edges
_LEAST_STEP: Final = 4.0  # ticks: a finer grid cannot be recognised
_MOST_STEPS: Final = 20_000.0  # most steps of a distance: a longer one is a silence
_LEAST_COUNT: Final = 4.0
_SURE_SHARE: Final = 0.4
_FINER: Final = 10  # times finer, a unit of time
_STRAY: Final = 0.01  # share of the distances that may end at an edge off the grid
_ROUNDING: Final = 1.5  # ticks by which two rounded times may miss their distance


@dataclass(frozen=True, eq=False, slots=True)
class ChannelEdges:
    """The edges of one channel.

    Attributes
    ----------
    times : (E,) numpy.ndarray of int64
        Ticks at which the level changes, ascending.
    first_level : bool
        Level before the first edge.
    undefined : int
        How often the file calls the level undefined (x or z); it counts as unchanged. What comes
        before the first level that is defined does not count.
    defined_from : int
        Tick from which on the level is defined.
    """

    times: NDArray[np.int64]
    first_level: bool
    undefined: int = 0
    defined_from: int = 0

    @property
    def rises(self) -> NDArray[np.int64]:
        """(R,) ticks at which the channel rises."""
        return self.times[int(self.first_level) :: 2]

    def levels_at(self, ticks: NDArray[Any], *, after: bool = False) -> NDArray[np.bool_]:
        """Return the level just before each of *ticks*, or just *after* it."""
        passed = np.searchsorted(self.times, ticks, side="right" if after else "left")
        levels: NDArray[np.bool_] = (passed % 2 == 1) ^ self.first_level
        return levels

    def pulses(
        self, *, active_low: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return begin and end of each whole pulse, in ticks, (P,) both.

        Examples
        --------
        >>> import numpy as np
        >>> rises, falls = ChannelEdges(np.array([5, 10, 15, 30]), True).pulses()
        >>> rises.tolist(), falls.tolist()
        ([10.0], [15.0])
        """
        skipped = int(self.first_level != active_low)  # the end of a pulse that began before
        edges = self.times[skipped:].astype(np.float64)
        edges = edges[: len(edges) // 2 * 2]
        return edges[0::2], edges[1::2]


@dataclass(frozen=True, eq=False)
class Capture:
    """The edges of all channels of a capture.

    Attributes
    ----------
    path : Path
        The file.
    channels : mapping of str to ChannelEdges
        By the name of the channel.
    tick_s : float
        Seconds in a tick.
    end : int
        Tick at which the capture ends; it begins at 0.
    stated_rate_hz : float or None
        Sampling rate that the file states; VCD states none.
    cut : str
        Why the file ends early; empty: it does not.
    notes : tuple of str
        Limits of the capture, in words.
    """

    path: Path
    channels: Mapping[str, ChannelEdges]
    tick_s: float
    end: int
    stated_rate_hz: float | None = None
    cut: str = ""
    notes: tuple[str, ...] = ()

    @property
    def edges(self) -> int:
        """Number of edges of all channels."""
        return sum(len(channel.times) for channel in self.channels.values())

    @property
    def duration_s(self) -> float:
        """Length of the capture in seconds."""
        return self.end * self.tick_s

    @cached_property
    def sample_rate_hz(self) -> float:
        """Sampling rate in hertz: as the file states it, else estimated from the grid of edges."""
        if self.stated_rate_hz is not None:
            return self.stated_rate_hz
        return 1.0 / (estimated_capture_step(self._times()) * self.tick_s)

    def until(self, end: int) -> Capture:
        """Return the part of the capture up to the tick *end*."""
        channels = {
            name: replace(
                edges, times=edges.times[: np.searchsorted(edges.times, end, side="right")]
            )
            for name, edges in self.channels.items()
        }
        return replace(self, channels=channels, end=end)

    def _times(self) -> NDArray[np.int64]:
        """Return the distinct ticks of edges of all channels; of each the first 100 000."""
        some = [channel.times[:100_000] for channel in self.channels.values()]
        return np.unique(np.concatenate(some)) if some else np.zeros(0, np.int64)

    def numbered_channels(self, pattern: str) -> dict[str, int]:
        """Return the channels that *pattern* names, with their numbers in place of its ``{}``."""
        before, after = map(re.escape, pattern.split("{}"))
        found = ((name, re.fullmatch(f"{before}{_NUMBER}{after}", name)) for name in self.channels)
        return {name: int(number[1]) for name, number in found if number}

    def channel(self, name: str) -> ChannelEdges:
        """Return the channel with this name.

        Raises
        ------
        ConfigurationError
            Names the channels that there are.
        """
        try:
            return self.channels[name]
        except KeyError:
            known = list(self.channels)
            shown = ", ".join(known[:16]) + (", ..." if len(known) > 16 else "")
            raise ConfigurationError(
                f"{self.path}: no channel {name!r}; the capture has {shown or 'none'}"
            ) from None


def estimated_capture_step(times: NDArray[np.int64]) -> float:
    """Return the step of the grid that *times* lie on, in their unit; 1 if they lie on none.

    An analyser whose step is no whole number of ticks rounds each time to the next tick, or to ten,
    a hundred, ... of them where its program writes finer ticks than it counts.

    Examples
    --------
    >>> import numpy as np
    >>> samples = np.array([3, 10, 11, 14, 600, 602, 1203])
    >>> round(1e3 / estimated_capture_step(np.round(samples * 1e3 / 24).astype(np.int64)), 1)
    24.0
    """
    whole = np.unique(np.diff(times))
    if not len(whole):
        return 1.0
    if not int(divisor := np.gcd.reduce(whole)) % _FINER:
        finer = _FINER
        while not int(divisor) % (finer * _FINER):
            finer *= _FINER
        return finer * estimated_capture_step(times // finer)
    distances = whole.astype(np.float64)
    if (step := _shared_capture_step(distances, times)) is not None:
        return step
    ordered = np.sort(np.diff(times)).astype(np.float64)
    usual = np.unique(ordered[int(_STRAY * len(ordered)) :])  # a stray edge may be the nearest
    if (step := _shared_capture_step(usual, times)) is not None:
        return step
    if distances[0] >= _MOST_SHARES * _LEAST_STEP:
        # Where all distances are long, they differ by fewer steps than the least of them has.
        apart = np.diff(distances)
        every = np.unique(np.concatenate([apart[apart >= _LEAST_STEP], distances]))
        if (step := _shared_capture_step(every, times)) is not None:
            return step
    return float(divisor)


def _shared_capture_step(distinct: NDArray[np.float64], times: NDArray[np.int64]) -> float | None:
    """Return the sampling step, in ticks, that divides the distances of edges; None if none does.

    A distance is a multiple if it is off by less than 1.5 ticks, and one in a hundred may be none;
    a step has 4 ticks at least. *distinct* are distances in ascending order, *times* the edges.
    """
    for share in range(1, _MOST_SHARES + 1):
        step = _refined_capture_step(distinct, float(distinct[0]) / share)
        every = np.diff(times)
        every = every[every < _MOST_STEPS * step]
        if not len(every):
            break
        step = float(every.sum() / np.rint(every / step).sum())
        if step < _LEAST_STEP:
            break
        off = np.abs(every - np.rint(every / step) * step) >= _ROUNDING
        if np.count_nonzero(off) <= _STRAY * len(every):
            return step
    return None


def _refined_capture_step(distances: NDArray[np.float64], step: float) -> float:
    """Return the step near *step* of which *distances* (ascending) are closest to multiples."""
    # The least distance, and with it the step, is known to a tick: more cannot be counted.
    least = float(distances[0])
    limit = max(_LEAST_COUNT, _SURE_SHARE * least, least / step)
    while limit < 4.0 * distances[-1] / step:
        counts = np.rint(distances / step)
        near = (counts > 0) & (counts <= limit)
        step = float(distances[near].sum() / counts[near].sum())
        limit *= 2.0  # a longer distance fixes the step better, once it can be counted
    return step

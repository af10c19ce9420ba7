"""Latches of a capture: moments at which pulses change, on all channels together.

A channel whose pulse changed between two edges gives a window in which it latched. Windows that
share a moment fit a board that latches all channels at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

_Floats: TypeAlias = NDArray[np.float64]
#: An edge is seen up to one sample late, so the distance of two is wrong by less than one.
SAMPLES_OF_CHANGE: Final = 1.5
#: Median distances from the median, beyond which jitter explains none: five standard deviations.
_MOST_SPREADS: Final = 7.5
#: Periods without a pulse after which a channel counts as silent.
_SILENT_PERIODS: Final = 1.6


@dataclass(frozen=True, slots=True)
class Change:
    """A change of the pulses of one channel.

    Attributes
    ----------
    channel : str
        Its name.
    after, before : float
        Ticks between which it happened.
    """

    channel: str
    after: float
    before: float


@dataclass(frozen=True, slots=True)
class LatchFound:
    """A change of several channels that belong together.

    Attributes
    ----------
    begin, end : float
        Ticks between which all channels changed.
    changes : tuple of Change
        One for each channel that changed: the first, if it changed more than once.
    """

    begin: float
    end: float
    changes: tuple[Change, ...]

    @property
    def skew(self) -> float:
        """Least time in ticks between the first and the last change; 0: all may be one moment."""
        return max(0.0, self.end - self.begin)


def captured_carrier_period(rises: _Floats, sample: float) -> float:
    """Return the period of a carrier in ticks, from the (P,) *rises* of its pulses.

    Distances that differ from the median by more than *sample* ticks, and by more than they
    scatter, have a latch between them.

    Examples
    --------
    >>> import numpy as np
    >>> captured_carrier_period(np.array([0.0, 600, 1200, 1801, 2400, 3000, 3700, 4300]), 1.0)
    600.0
    """
    distances = np.diff(rises)
    if not len(distances):
        return 0.0
    away = np.abs(distances - np.median(distances))
    near = away <= max(SAMPLES_OF_CHANGE * sample, _MOST_SPREADS * float(np.median(away)))
    return float(distances[near].mean())


def captured_changes_of_channel(
    channel: str, rises: _Floats, falls: _Floats, *, period: float, sample: float, end: float
) -> list[Change]:
    """Return every change of the pulses of a channel, from 0 to the tick *end*."""
    if not len(rises):
        return []
    tolerance = SAMPLES_OF_CHANGE * sample
    silent = _SILENT_PERIODS * period
    due = rises[:-1] + period
    late = rises[1:] - due
    moved = np.abs(late) > tolerance
    stopped = rises[1:] - rises[:-1] > silent
    after, before = [falls[:-1][moved]], [np.minimum(rises[1:], due)[moved]]
    after.append(np.maximum(due, rises[1:] - period)[stopped])
    before.append(rises[1:][stopped])
    wider = np.diff(falls - rises)
    bent = (np.abs(wider) > tolerance) & ~moved
    after.append(rises[1:][bent])
    before.append((falls[1:] - np.maximum(wider, 0.0))[bent])
    if rises[0] > silent:
        after.append(rises[:1] - period)
        before.append(rises[:1])
    if end - rises[-1] > silent:
        after.append(falls[-1:])
        before.append(rises[-1:] + period)
    lows, highs = np.concatenate(after), np.concatenate(before)
    order = np.argsort(highs, kind="stable")
    pairs = zip(lows[order].tolist(), highs[order].tolist(), strict=True)
    return [Change(channel, min(low, high), high) for low, high in pairs]


def captured_latches(changes: Mapping[str, Sequence[Change]], *, window: float) -> list[LatchFound]:
    """Return the latches that *changes* by channel make, in order.

    Parameters
    ----------
    window : float
        Ticks: a change belongs to the latch that began so short a time before it.
    """
    every = sorted((c for found in changes.values() for c in found), key=lambda c: c.before)
    groups: list[list[Change]] = []
    for change in every:
        if groups and change.before - groups[-1][0].before <= window:
            groups[-1].append(change)
        else:
            groups.append([change])
    return [_captured_latch_of_changes(group) for group in groups]


def _captured_latch_of_changes(group: list[Change]) -> LatchFound:
    firsts: dict[str, Change] = {}
    for change in group:
        firsts.setdefault(change.channel, change)
    kept = tuple(firsts.values())
    return LatchFound(min(c.before for c in kept), max(c.after for c in kept), kept)

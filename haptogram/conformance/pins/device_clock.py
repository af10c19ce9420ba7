"""The device clock on the clock of the pins, by PING and PONG, and how well it is known.

Two crystals that drift apart bend it: then it is a line from mark to mark, where there are enough.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram_protocol import messages as m

_BITS: Final = 32
_OUTLIER_US: Final = 20.0  # off its neighbours: HG-6.9/2 allows 10
_NEIGHBOURS: Final = 5
_STRAIGHT_US: Final = 5.0  # residual up to which one line is enough
_TICK_US: Final = 1.0  # resolution of the device clock
_MOST_PPM: Final = 200.0  # largest difference of two crystals
_DRIFT_PPM_S: Final = 0.1  # change of the rate of a crystal that warms up
_LEAP_US: Final = 500.0  # jump that shows missing samples of the capture
_AROUND: Final = 3  # marks on both sides that show whether a leap lasts
_KNOTS: Final = 32
_FEWEST_KNOTS: Final = 3  # knots of a line with bends
_MORE_BENT: Final = 2.0  # times as much as at the knots, a clock may be bent between them


@dataclass(frozen=True, eq=False, slots=True)
class PinDialogueClock:
    """The device clock from one reset of the board to the next.

    Attributes
    ----------
    begin, end : float
        Periods of the capture between which it holds.
    at_zero_us, period_us : float
        Device time at period 0 of the capture, and in a period, of the straight line.
    knots, off_us : (K,) numpy.ndarray
        Periods of the capture, and by how much the device time is off that line there; K >= 2.
    bends : (K - 1,) numpy.ndarray
        Change of the rate between two knots, in microseconds a period a period.
    within_us : float
        Largest distance of a mark from the line, bends included.
    rate_within : float
        By how much the rate outside of the knots may be wrong, in microseconds a period.
    """

    begin: float
    end: float
    at_zero_us: float
    period_us: float
    knots: FloatArray
    off_us: FloatArray
    bends: FloatArray
    within_us: float
    rate_within: float

    @classmethod
    def of(
        cls, begin: float, end: float, marks: Sequence[tuple[float, int]], carrier_hz: float
    ) -> PinDialogueClock:
        """Return the clock through *marks*: arrivals in periods, and device times in us."""
        nominal_us = 1e6 / carrier_hz
        drift = _DRIFT_PPM_S / carrier_hz**2
        most = _MOST_PPM * 1e-6 * nominal_us
        arrivals, base, late = _mark_lateness(marks, nominal_us)
        span = float(np.ptp(arrivals))
        rate = _robust_rate(arrivals, late)
        near = _without_outliers(late - rate * arrivals)
        arrivals, late = arrivals[near], late[near]
        if len(arrivals) > 2 and np.ptp(arrivals) > 1.0:
            rate = float(np.polyfit(arrivals, late, 1)[0])
        rest = late - rate * arrivals
        rate_within = 2.0 * max(_TICK_US, float(np.ptp(rest)) / 2.0) / max(span, 1e-9)
        if rate_within > most:
            rate, rest, rate_within = 0.0, late, most
        middle = (float(rest.min()) + float(rest.max())) / 2.0
        within_us = float(np.abs(rest - middle).max())
        knots, off_us = _fit_bent_line(arrivals, rest - middle)
        bends = np.full(len(knots) - 1, drift)
        if within_us > _STRAIGHT_US and len(knots) >= _FEWEST_KNOTS:
            bends = np.maximum(_MORE_BENT * _rate_changes(knots, off_us), drift)
            within_us = float(np.abs(rest - middle - np.interp(arrivals, knots, off_us)).max())
        else:
            off_us = np.zeros(len(knots))
        return cls(
            begin,
            end,
            base + middle,
            nominal_us + rate,
            knots,
            off_us,
            bends,
            max(within_us, _TICK_US),
            min(rate_within, most),
        )

    def device_us(self, period: float) -> float:
        """Return the device time at a period of the capture."""
        return self.at_zero_us + self.period_us * period + self._off_us(period)

    def periods(self, t_us: int, near: float) -> float:
        """Return when the device clock showed *t_us*, modulo 2^32, near a period of the capture."""
        t_us = m.unwrap(t_us, round(self.device_us(near)), _BITS)
        found = near
        for _ in range(3):  # each makes the error ten thousand times less
            found = (t_us - self.at_zero_us - self._off_us(found)) / self.period_us
        return found

    def within(self, period: float) -> float:
        """Return by how many periods a time of the device near this one may be wrong."""
        gap = self._gap(period)
        before, after = self.knots[gap], self.knots[gap + 1]
        error_us = self.bends[gap] / 2.0 * abs((period - before) * (after - period))
        outside = max(self.knots[0] - period, period - self.knots[-1], 0.0)
        if outside:
            error_us += self.rate_within * outside
            error_us = min(error_us, _MOST_PPM * 1e-6 * self.period_us * outside)
        return float(self.within_us + error_us) / self.period_us

    def _gap(self, period: float) -> int:
        """Return k of the gap between knots k and k + 1 of the bent line in which *period* lies.

        Before the first knot or after the last one, it is the nearest gap.
        """
        return min(max(bisect_left(self.knots, period) - 1, 0), len(self.bends) - 1)

    def _off_us(self, period: float) -> float:
        """Return by how many µs the device clock is ahead of a clock of constant rate at *period*.

        *period* is a time in carrier periods of the capture. Below 0, it is behind.
        """
        gap = self._gap(period)
        rate = (self.off_us[gap + 1] - self.off_us[gap]) / (self.knots[gap + 1] - self.knots[gap])
        return float(self.off_us[gap] + rate * (period - self.knots[gap]))


def last_mark_before_lost_samples(
    marks: Sequence[tuple[float, int]], carrier_hz: float
) -> float | None:
    """Return the last of *marks* before the device clock leaps ahead; None: it never does.

    Two crystals drift apart slowly: a lasting leap of the one is time that the capture lacks.
    """
    nominal_us = 1e6 / carrier_hz
    arrivals, _, late = _mark_lateness(marks, nominal_us)
    for place in range(len(arrivals) - 1):
        first, end = max(0, place + 1 - _AROUND), min(len(arrivals), place + 1 + _AROUND)
        drift_us = _MOST_PPM * 1e-6 * nominal_us * float(arrivals[end - 1] - arrivals[first])
        leap = float(np.median(late[place + 1 : end]) - np.median(late[first : place + 1]))
        if min(leap, float(late[place + 1] - late[place])) > _LEAP_US + drift_us:
            return float(arrivals[place])
    return None


def _mark_lateness(
    marks: Sequence[tuple[float, int]], nominal_us: float
) -> tuple[FloatArray, int, FloatArray]:
    """Return arrivals (M,) in periods, the first device time in µs, and deviations (M,) in µs.

    A deviation is the device time since the first one, less *nominal_us* for each period of the
    arrival.
    """
    arrivals = np.array([arrival for arrival, _ in marks])
    times = [marks[0][1]]
    for (before, _), (arrival, t_us) in pairwise(marks):
        times.append(m.unwrap(t_us, times[-1] + round((arrival - before) * nominal_us), _BITS))
    base = times[0]
    return arrivals, base, np.array([t - base for t in times]) - nominal_us * arrivals


def _robust_rate(arrivals: FloatArray, late: FloatArray) -> float:
    """Return the median slope of *late* over *arrivals*, in µs a period.

    It is between marks half the run apart; 0.0 if none of these pairs are more than a period apart.
    """
    half = len(arrivals) // 2
    if not half:
        return 0.0
    spans, rises = arrivals[half:] - arrivals[:-half], late[half:] - late[:-half]
    far = spans > 1.0
    return float(np.median(rises[far] / spans[far])) if far.any() else 0.0


def _without_outliers(rest: FloatArray) -> np.ndarray:
    """Return a mask (M,) of the marks within 20 µs of the median of 5 neighbours.

    All True if there are fewer than 5. *rest* (M,): deviations in µs from a line.
    """
    if len(rest) < _NEIGHBOURS:
        return np.ones(len(rest), np.bool_)
    half = _NEIGHBOURS // 2
    around = np.pad(rest, half, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(around, _NEIGHBOURS)
    near: np.ndarray = np.abs(rest - np.median(windows, axis=1)) <= _OUTLIER_US
    return near


def _fit_bent_line(arrivals: FloatArray, off_us: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return periods (K,) and deviations in µs (K,) at the knots of a bent line.

    The knots are means of *arrivals* and *off_us* in at most 33 equal bins of time; marks in one
    bin alone make two knots, with deviations of 0.
    """
    step = np.ptp(arrivals) / _KNOTS
    bins = np.floor((arrivals - arrivals[0]) / max(step, 1.0))
    starts = np.flatnonzero(np.diff(bins, prepend=-1.0))
    if len(starts) < 2:
        return np.array([arrivals[0], arrivals[-1] + 1.0]), np.zeros(2)
    sizes = np.diff(np.append(starts, len(arrivals)))
    return np.add.reduceat(arrivals, starts) / sizes, np.add.reduceat(off_us, starts) / sizes


def _rate_changes(knots: FloatArray, off_us: FloatArray) -> FloatArray:
    """Return (K - 1,) how much the clock's rate may change in each gap between two knots.

    In µs a period a period, from *off_us* in µs at *knots* in periods (3 or more). It is the larger
    one of the changes of slope at both ends of the gap, as an absolute value.
    """
    rates = np.diff(off_us) / np.diff(knots)
    inner = 2.0 * np.abs(np.diff(rates)) / (knots[2:] - knots[:-2])
    bends: FloatArray = np.maximum(np.append(inner, inner[-1]), np.insert(inner, 0, inner[0]))
    return bends

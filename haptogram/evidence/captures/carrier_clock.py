"""The clock that a capture is counted by: the pulses of its reference, and jumps of the clock."""

from __future__ import annotations

import dataclasses
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.errors import ConfigurationError
from haptogram.records.pins import SAMPLES_OF_8_BITS

from .capture import Capture
from .channel_map import ChannelMap

_Floats: TypeAlias = NDArray[np.float64]
#: Samples of a period that a capture has at least: below, no phase is worth a word.
LEAST_SAMPLES: Final = 32
_LEAST_PULSES: Final = 3
#: An edge is seen up to one sample late, so the distance of two is wrong by less than one.
_SAMPLES: Final = 2.5
_SPREADS: Final = 7.5  # median distances from the usual one: five standard deviations
_MOST_JITTER: Final = 0.05  # largest jitter, in periods, of a carrier that is not drawn out
_LEAST_JITTER: Final = 0.01  # tolerated jitter of a steady carrier, in periods
_UNSTEADY: Final = 4  # distances in a row that are off: a latch makes one
_LONGER: Final = 0.15  # share of a period by which the next one may come early
_BLOCK: Final = 64  # pulses that make one point of a steady clock: their mean has no samples
_MOST_DIVIDER: Final = 3  # largest divider of a carrier with missing pulses
_NEAR: Final = 0.1  # share by which a carrier is that of the map
_AROUND: Final = 8  # pulses on both sides that must agree on the jump: one alone is a disturbance
_LONGEST: Final = 2.5  # periods without a pulse: a longer pause is that of a clock that stops


def checked_capture_period(
    capture: Capture, mapped: ChannelMap, rises: _Floats, sample: float, rate_hz: float
) -> float:
    """Return the period of the carrier in ticks; the reference may leave out every second one.

    Raises
    ------
    ConfigurationError
        A reference without a carrier, or too low a sampling rate.
    """
    settings = mapped.settings
    name = f"{capture.path}: reference {mapped.reference}"
    if len(rises) < _LEAST_PULSES:
        raise ConfigurationError(
            f"{name} has {len(rises)} pulses, must have {_LEAST_PULSES} at least; "
            "name a channel that carries the carrier all the time"
        )
    distance = _usual_captured_distance(np.diff(rises), sample)
    found_hz = 1.0 / (distance * capture.tick_s)
    divider = max(1, min(_MOST_DIVIDER, round(settings.carrier_hz / found_hz)))
    if abs(found_hz * divider / settings.carrier_hz - 1.0) >= _NEAR:
        raise ConfigurationError(
            f"{name} has {found_hz:g} Hz, must have the carrier {settings.carrier_hz:g} Hz "
            "(carrier_hz of the map) within 10 %"
        )
    period = distance / divider
    if period < LEAST_SAMPLES * sample:
        is_estimated = capture.stated_rate_hz is None and settings.sample_rate_hz is None
        moving = [name for name, edges in capture.channels.items() if len(edges.times)]
        if is_estimated and moving == [mapped.reference]:
            raise ConfigurationError(
                f"{name} alone has edges, which tell no sampling rate: check that the board is "
                "armed, and the probes of the pins; or state sample_rate_hz in the map"
            )
        source = ", estimated from its edges (sample_rate_hz of the map),"
        raise ConfigurationError(
            f"{capture.path}: {rate_hz:.6g} samples/s{source if is_estimated else ''} are "
            f"{period / sample:.3g} in a period of the carrier, must be {LEAST_SAMPLES} at least; "
            f"sample at {LEAST_SAMPLES * settings.carrier_hz:g} Hz or more, for 8-bit phases at "
            f"{SAMPLES_OF_8_BITS * settings.carrier_hz:g} Hz"
        )
    return period


def _usual_captured_distance(distances: _Floats, sample: float) -> float:
    """Return the mean distance of edges, in ticks, without those far from the usual one.

    Far is over 5 samples and over 7.5 times the median deviation.
    """
    cells = np.rint(distances / (_SAMPLES * sample))
    values, counts = np.unique(cells, return_counts=True)
    away = np.abs(distances - np.median(distances[cells == values[counts.argmax()]]))
    jitter = float(np.median(away[away <= _MOST_JITTER * distances.mean()]))
    return float(distances[away <= max(2.0 * _SAMPLES * sample, _SPREADS * jitter)].mean())


class CarrierClock:
    """Ticks of an analyser in periods of the carrier.

    Parameters
    ----------
    rises : (P,) numpy.ndarray
        Ticks at which the reference rises.
    period, sample : float
        Ticks of a period, and of a sample.
    is_clock : bool
        Whether no latch moves the reference: then its edges are the clock, wherever it wanders.

    Attributes
    ----------
    period : float
        Mean length of a period in ticks.
    is_steady : bool
        Whether the periods are of one length, but for latches. Those of a board that draws them out
        while it is busy are counted one by one.
    jitter : float
        Root mean square of the distances of the pulses from the usual one, in ticks; a latch of an
        element counts as none.
    shortest, longest : float
        Extremes of these distances, in ticks.
    """

    def __init__(self, rises: _Floats, period: float, sample: float, *, is_clock: bool) -> None:
        self.period = period
        distances = np.diff(rises)
        off = np.abs(distances - np.rint(distances / period) * period)
        far = off > max(_SAMPLES * sample, _LEAST_JITTER * period)
        self.is_steady = not _has_run_of(far, _UNSTEADY)
        self._ticks, self._counts = np.array([rises[0]]), np.zeros(1)
        if is_clock and self.is_steady:
            self._ticks, self._counts = _edge_block_means(rises, period, sample)
            if len(self._ticks) > 1:
                self.period = float(np.ptp(self._ticks) / np.ptp(self._counts))
        elif not self.is_steady:
            steps = np.maximum(np.floor(distances / period + _LONGER), 1.0)
            self._ticks, self._counts = rises, np.concatenate([[0.0], np.cumsum(steps)])
        single = distances[(distances < 1.75 * period) & ~(far & self.is_steady)]
        self.jitter = float(np.sqrt(np.mean((single - period) ** 2))) if len(single) else 0.0
        self.shortest = float(single.min(initial=period))
        self.longest = float(single.max(initial=period))

    def marks(self, tick_s: float) -> tuple[_Floats, _Floats]:
        """Return (K,) periods since the capture began, and when they were, in seconds."""
        return self.periods(self._ticks), self._ticks * tick_s

    def periods(self, ticks: _Floats) -> _Floats:
        """Return times in periods since the capture began."""
        inside = np.interp(ticks, self._ticks, self._counts)
        before = np.minimum(ticks - self._ticks[0], 0.0) / self.period
        after = np.maximum(ticks - self._ticks[-1], 0.0) / self.period
        first = self._ticks[0] / self.period - self._counts[0]
        counted: _Floats = inside + before + after + first
        return counted


def _has_run_of(found: NDArray[np.bool_], length: int) -> bool:
    """Return True if a mask has *length* consecutive True values."""
    sums = np.concatenate([[0], np.cumsum(found)])
    return len(sums) > length and bool((sums[length:] - sums[:-length] == length).any())


def _edge_block_means(rises: _Floats, period: float, sample: float) -> tuple[_Floats, _Floats]:
    """Return ticks and period numbers of the carrier clock, averaged over blocks of pulses.

    A block has up to 64 pulses; a distance off a whole number of periods by 0.1 is left out.
    """
    steps = np.rint(np.diff(rises) / period)
    whole = np.abs(np.diff(rises) - steps * period) < 0.1 * period
    counts = np.concatenate([[0.0], np.cumsum(np.maximum(steps, 0.0))])
    kept = np.concatenate([[True], whole & (steps > 0)])  # no glitch is a pulse of the clock
    ticks, counts = rises[kept] + sample / 2.0, counts[kept]
    block = min(_BLOCK, max(1, len(ticks) // 4))
    starts = np.arange(0, len(ticks), block)
    sizes = np.diff(np.append(starts, len(ticks)))
    return np.add.reduceat(ticks, starts) / sizes, np.add.reduceat(counts, starts) / sizes


def capture_to_first_splice(capture: Capture, rises: _Floats, sample: float) -> Capture:
    """Return *capture* up to where samples are missing; as it is if the clock never jumps.

    The times after a jump are off by an unknown amount.

    Parameters
    ----------
    capture : Capture
        The capture.
    rises : (P,) numpy.ndarray
        Ticks at which the clock of the carrier rises.
    sample : float
        Ticks of a sample.
    """
    at = _first_jump_in_capture(rises, sample)
    if at is None:
        return capture
    why = (
        f"samples are missing at {at * capture.tick_s * 1e3:.3f} ms, where the clock of the "
        "carrier jumps: capture at a lower rate, fewer channels, or with another cable"
    )
    return dataclasses.replace(capture.until(int(at)), cut=why)


def _first_jump_in_capture(rises: _Floats, sample: float) -> float | None:
    """Return the tick of the pulse after which the phase jumps for good; None if never.

    The 8 pulses on both sides must differ by over 2.5 samples, and 1 % of a period.
    """
    steps = np.diff(rises)
    if len(steps) < 2 * _AROUND:
        return None
    period = float(np.median(steps))
    limit = max(_SAMPLES * sample, _LEAST_JITTER * period)
    off = np.abs(steps - np.rint(steps / period) * period) > limit
    for place in np.flatnonzero(off & (steps < _LONGEST * period)).tolist():
        before = rises[max(0, place - _AROUND + 1) : place + 1]
        after = rises[place + 1 : place + 1 + _AROUND]
        if min(len(before), len(after)) < _LEAST_PULSES:
            continue
        phases = [np.exp(2j * np.pi * (times - rises[place]) / period) for times in (before, after)]
        jump = np.angle(np.median(phases[1].real) + 1j * np.median(phases[1].imag)) - np.angle(
            np.median(phases[0].real) + 1j * np.median(phases[0].imag)
        )
        if abs((jump + np.pi) % (2.0 * np.pi) - np.pi) > 2.0 * np.pi * limit / period:
            return float(rises[place])
    return None

"""Drives that a capture shows: phase, duty, period and jitter of each element between latches.

A pulse from angle a to angle b of the carrier has the fundamental (e^{jb} - e^{ja}) / 2j, which is
sin(pi d) at the angle of its centre for the duty d: the weight A e^{+j phi} of
:mod:`haptogram.acoustics.model.pulses`, a later pulse lags.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.errors import ConfigurationError

from .capture import Capture
from .changes import (
    SAMPLES_OF_CHANGE,
    Change,
    LatchFound,
    captured_carrier_period,
    captured_changes_of_channel,
    captured_latches,
)
from .channel_map import ChannelMap
from .splices import capture_to_first_splice

_Floats: TypeAlias = NDArray[np.float64]
_Weights: TypeAlias = NDArray[np.complex128]
_LATCH: Final = "latch pin"
#: Samples of a period that a capture has at least: below, no phase is worth a word.
LEAST_SAMPLES: Final = 32
#: Share of the pulses of a channel that may differ from the one before it.
_MOST_RESTLESS: Final = 0.4
_LEAST_PULSES: Final = 3
#: Length of an interval of which the drive is told.
_LEAST_PERIODS: Final = 2.0


@dataclass(frozen=True, eq=False, slots=True)
class ElementDrives:
    """The pulses of one element in each of L intervals between latches; NaN where it has none.

    Attributes
    ----------
    channel : str
        Channel of the capture.
    element : int
        Element of the array.
    weights : (L,) numpy.ndarray of complex
        A e^{+j phi}, relative to the reference; 0: no pulse.
    duties, periods_s, jitters_s : (L,) numpy.ndarray
        Share of the period that is driven; period; standard deviation of the pulses' centres.
    edges : int
        Edges in the whole capture.
    idle_level : bool or None
        Level of a pin that has no edge, or of one while it is silent; None: it never is.
    """

    channel: str
    element: int
    weights: _Weights
    duties: _Floats
    periods_s: _Floats
    jitters_s: _Floats
    edges: int
    idle_level: bool | None


@dataclass(frozen=True, eq=False)
class CaptureDrives:
    """The drives that a capture shows.

    Attributes
    ----------
    capture : Capture
        The capture.
    period : float
        Period of the carrier in ticks.
    carrier_hz : float
        Carrier that is meant.
    latches : list of LatchFound
        Latches in order; interval 0 is before the first of them.
    bounds : (L + 1,) numpy.ndarray
        Ticks at which the intervals begin, and the end of the capture.
    elements : list of ElementDrives
        In the order of elements.
    reference_element : int or None
        Element that phases are relative to; None: a carrier clock.
    restless : list of str
        Channels whose pulses change all the time, which show no latch.
    """

    capture: Capture
    period: float
    carrier_hz: float
    latches: list[LatchFound]
    bounds: _Floats
    elements: list[ElementDrives]
    reference_element: int | None
    restless: list[str]
    sample_rate_hz: float

    @property
    def samples(self) -> float:
        """Samples in a period of the carrier."""
        return self.period * self.capture.tick_s * self.sample_rate_hz

    @property
    def resolution_rad(self) -> float:
        """The smallest phase error that shows: two edges are known to one sample together."""
        return math.tau / self.samples

    @property
    def drift_ppm(self) -> float:
        """Carrier against the one that is meant, on the analyser's clock."""
        return (1.0 / (self.period * self.capture.tick_s) / self.carrier_hz - 1.0) * 1e6

    @property
    def intervals(self) -> int:
        """Number of intervals between latches."""
        return len(self.bounds) - 1

    def weights(self) -> _Weights:
        """Return the (L, E) weights of all elements."""
        return np.array([element.weights for element in self.elements]).T

    def is_torn(self, latch: LatchFound) -> bool:
        """Return True if not all channels changed within one period."""
        return latch.skew > self.period + 2.0 * self.period / self.samples

    def seconds(self, ticks: float) -> float:
        """Return the time of a tick in seconds from the begin of the capture."""
        return ticks * self.capture.tick_s


def least_capture_rate_hz(carrier_hz: float, phase_bits: int) -> float:
    """Return the sampling rate at which a sample is half a step of *phase_bits*.

    Examples
    --------
    >>> least_capture_rate_hz(40e3, 8) / 1e6
    20.48
    """
    return carrier_hz * 2.0 ** (phase_bits + 1)


def measure_capture(capture: Capture, mapped: ChannelMap) -> CaptureDrives:
    """Return the drives of the mapped channels between latches.

    Raises
    ------
    ConfigurationError
        A channel that is missing, a reference without a carrier, too low a sampling rate.
    """
    settings = mapped.settings
    elements = mapped.joined(capture)
    rate_hz = settings.sample_rate_hz or capture.sample_rate_hz
    sample = 1.0 / (rate_hz * capture.tick_s)
    reference = capture.channel(mapped.reference)
    is_clock = mapped.reference not in elements
    active_low = settings.active_low and not is_clock
    if is_clock:
        capture = capture_to_first_splice(capture, reference.pulses()[0], sample)
        reference = capture.channel(mapped.reference)
    pulses = {
        name: capture.channel(name).pulses(active_low=settings.active_low) for name in elements
    }
    clock = reference.pulses(active_low=active_low)
    period = checked_capture_period(capture, mapped, clock[0], sample, rate_hz)
    scan = _CaptureScan(period, sample, float(capture.end))
    changes, restless = scan.changes(pulses)
    if settings.latch is not None:
        rises, _ = capture.channel(settings.latch).pulses()
        changes[_LATCH] = [Change(_LATCH, t, t) for t in rises.tolist()]
    window = settings.latch_window_us * 1e-6 / capture.tick_s
    latches = captured_latches(changes, window=window)
    bounds = np.array([0.0, *(latch.begin for latch in latches), float(capture.end)])
    settled = np.array([0.0, *(max(latch.end, latch.begin) for latch in latches)]) + period
    intervals = _CaptureIntervals(bounds, settled, period, capture.tick_s, sample)
    turn = intervals.reference(clock)
    rows = [
        intervals.element(capture, name, number, pulses[name], turn)
        for name, number in elements.items()
    ]
    return CaptureDrives(
        capture,
        period,
        settings.carrier_hz,
        latches,
        bounds,
        rows,
        elements.get(mapped.reference),
        restless,
        rate_hz,
    )


def checked_capture_period(
    capture: Capture, mapped: ChannelMap, rises: _Floats, sample: float, rate_hz: float
) -> float:
    """Return the period of the reference in ticks.

    Raises
    ------
    ConfigurationError
        A reference without a carrier, or too low a sampling rate.
    """
    settings = mapped.settings
    period = captured_carrier_period(rises, sample)
    name = f"{capture.path}: reference {mapped.reference}"
    if len(rises) < _LEAST_PULSES:
        raise ConfigurationError(
            f"{name} has {len(rises)} pulses, must have {_LEAST_PULSES} at least; "
            "name a channel that carries the carrier all the time"
        )
    found_hz = 1.0 / (period * capture.tick_s)
    if not 0.9 < found_hz / settings.carrier_hz < 1.1:
        raise ConfigurationError(
            f"{name} has {found_hz:g} Hz, must have the carrier {settings.carrier_hz:g} Hz "
            "(carrier_hz of the map) within 10 %"
        )
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
            f"{least_capture_rate_hz(settings.carrier_hz, 8):g} Hz"
        )
    return period


@dataclass(frozen=True, slots=True)
class _CaptureScan:
    """The search for changes."""

    period: float
    sample: float
    end: float

    def changes(
        self, pulses: Mapping[str, tuple[_Floats, _Floats]]
    ) -> tuple[dict[str, list[Change]], list[str]]:
        """Return the changes by channel, and the channels that change all the time."""
        found: dict[str, list[Change]] = {}
        restless = []
        for name, (rises, falls) in pulses.items():
            changes = captured_changes_of_channel(
                name, rises, falls, period=self.period, sample=self.sample, end=self.end
            )
            if len(changes) > _MOST_RESTLESS * max(len(rises), 10):
                restless.append(name)
            else:
                found[name] = changes
        return found, restless


@dataclass(frozen=True, slots=True)
class _CaptureIntervals:
    """The L intervals between latches, and what is left of each once all channels are settled."""

    bounds: _Floats
    settled: _Floats
    period: float
    tick_s: float
    sample: float

    def reference(self, clock: tuple[_Floats, _Floats]) -> _Weights:
        """Return the (L,) phasor of the reference; 0 where it has no pulse."""
        weights, *_ = self._sums(*clock)
        size = np.nan_to_num(np.abs(weights))
        unit: _Weights = np.divide(weights, size, out=np.zeros_like(weights), where=size > 0)
        return unit

    def element(
        self,
        capture: Capture,
        name: str,
        number: int,
        pulses: tuple[_Floats, _Floats],
        turn: _Weights,
    ) -> ElementDrives:
        """Return the drives that *pulses* make, relative to the phasor *turn*."""
        edges = capture.channel(name)
        weights, duties, periods_s, jitters_s = self._sums(*pulses)
        relative = weights * np.conj(turn)
        relative[(turn == 0) & (weights != 0)] = np.nan
        silent = np.flatnonzero(weights == 0)
        idle = None
        if len(silent):
            begin = self.settled[silent[0]]
            flips = int(np.searchsorted(edges.times, begin))
            idle = edges.first_level ^ bool(flips % 2)
        return ElementDrives(
            name, number, relative, duties, periods_s, jitters_s, len(edges.times), idle
        )

    def _sums(self, rises: _Floats, falls: _Floats) -> tuple[_Weights, _Floats, _Floats, _Floats]:
        count = len(self.settled)
        place = np.searchsorted(self.bounds[1:-1], rises, side="right")
        whole = rises >= self.settled[place]
        whole &= falls <= self.bounds[place + 1] - SAMPLES_OF_CHANGE * self.sample  # not cut short
        rises, falls, place = rises[whole], falls[whole], place[whole]
        turn = math.tau / self.period
        vectors = (np.exp(1j * turn * falls) - np.exp(1j * turn * rises)) / 2j
        sums = np.bincount(place, vectors.real, count) + 1j * np.bincount(
            place, vectors.imag, count
        )
        number = np.bincount(place, minlength=count)
        first, last = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(first, place, rises)
        np.maximum.at(last, place, rises)
        has = number > 0
        spans = np.where(has, last - first, 0.0)
        periods = np.where(has, np.rint(spans / self.period) + 1.0, 1.0)
        short = self.bounds[1:] - self.settled < _LEAST_PERIODS * self.period
        weights = np.where(short, np.nan, sums / periods).astype(np.complex128)
        duties = np.bincount(place, falls - rises, count) / (periods * self.period)
        with np.errstate(invalid="ignore", divide="ignore"):
            periods_s = np.where(number > 1, spans / (periods - 1.0) * self.tick_s, np.nan)
        rest = np.angle(vectors * np.conj(sums[place])) / turn
        squares = np.bincount(place, rest**2, count) / np.maximum(number, 1)
        jitters_s = np.where(has, np.sqrt(squares) * self.tick_s, np.nan)
        return weights, duties, periods_s, jitters_s

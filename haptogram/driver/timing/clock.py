"""The device clock as the host sees it, from pings.

A ping leaves at t1 (host), arrives at t2, its answer leaves at t3 (device), arrives at t4 (host).
With unknown shares of the round trip for the two ways, the offset lies within half of it::

    offset = (t2 + t3) / 2 - (t1 + t4) / 2  +-  ((t4 - t1) - (t3 - t2)) / 2

(RFC 5905 section 8, with the filter of its section 10: the sample of the shortest round trip is the
best one, and loses worth as it ages, at the rate at which the two clocks may part.)
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Final

from haptogram.errors import NoAnswerError
from haptogram.settings.frozen import dataclass
from haptogram_protocol.messages import unwrap

_WIRE_BITS: Final = 32
_WINDOW: Final = 32  # samples kept
_PATIENCE: Final = 3  # samples in a row that contradict all before: then these are the truth
CLOCK_STEPS_US: Final = 2  # rounding of the two device times
_ROUNDING_NS: Final = 1000  # rounding of the device's microseconds and the host's
_HOST_PPM: Final = 50  # how far the host's own clock may be off
_FORGETTING_NS: Final = 20_000_000_000  # a sample that is so old weighs 1/e in the drift
_WANDER_PPM: Final = 1.0  # how far a quartz may change its rate within the window
_PPB: Final = 1_000_000_000


@dataclass(frozen=True, slots=True)
class ClockSample:
    """One exchange.

    Attributes
    ----------
    host_ns : int
        Host time of its middle.
    offset_ns : int
        Device clock minus host clock.
    margin_ns : int
        Largest error of the offset: half the round trip, and the rounding of the clocks.
    """

    host_ns: int
    offset_ns: int
    margin_ns: int


@dataclass(frozen=True, slots=True)
class ClockDrift:
    """Drift of the device clock against the host's, and its largest error, in ppm."""

    ppm: float
    uncertainty_ppm: float


def fit_clock_drift(samples: Sequence[ClockSample]) -> ClockDrift:
    """Return the slope of the offsets, by a decayed regression.

    A least-squares line, each sample weighted by the inverse square of its margin and by
    exp(-age / 20 s).  The slope is sum(c_i o_i) with known c_i, so offsets that are each wrong by
    m_i at most move it by sum(abs(c_i) m_i) at most: that is the uncertainty, a bound and no sigma.
    Less than two moments give nan with an infinite uncertainty.
    """
    origin = samples[-1]
    times = [float(sample.host_ns - origin.host_ns) for sample in samples]
    weights = [
        math.exp(-abs(time) / _FORGETTING_NS) / sample.margin_ns**2
        for time, sample in zip(times, samples, strict=True)
    ]
    total = sum(weights)
    mean = sum(w * t for w, t in zip(weights, times, strict=True)) / total
    spread = sum(w * (t - mean) ** 2 for w, t in zip(weights, times, strict=True))
    if spread == 0.0:
        return ClockDrift(math.nan, math.inf)
    shares = [w * (t - mean) / spread for w, t in zip(weights, times, strict=True)]
    offsets = (sample.offset_ns - origin.offset_ns for sample in samples)
    slope = sum(c * offset for c, offset in zip(shares, offsets, strict=True))
    bound = sum(abs(c) * sample.margin_ns for c, sample in zip(shares, samples, strict=True))
    return ClockDrift(1e6 * slope, 1e6 * bound)


class ClockEstimate:
    """Offset of the device clock from the host's, and how it drifts.

    Parameters
    ----------
    device_ppm : int
        Largest error that the board declares for its clock, parts per million.

    Attributes
    ----------
    rejected : int
        Samples that contradicted the others.
    jumps : int
        How often so many in a row did that the clock must have been set, or its board restarted.
    jump_us : int
        By how much it went forward the last time.
    """

    def __init__(self, device_ppm: int = 50) -> None:
        self.rejected = 0
        self.jumps = 0
        self.jump_us = 0
        self._ppm = float(device_ppm + _HOST_PPM)
        self._samples: deque[ClockSample] = deque(maxlen=_WINDOW)
        self._best: ClockSample | None = None
        self._contradictions = 0
        self._drift = ClockDrift(math.nan, math.inf)
        self._rate_ppb = 0  # drift that is reckoned with
        self._growth_ppm = self._ppm  # of the error, as a sample ages

    def add(
        self,
        t_send_ns: int,
        t_rx_us: int,
        t_tx_us: int,
        t_receive_ns: int,
        *,
        disprove: bool = False,
    ) -> None:
        """Take one exchange.

        Parameters
        ----------
        t_send_ns, t_receive_ns : int
            Host time at which the last byte of the ping left and at which the first byte of the
            answer came: without the time that the bytes themselves take on the line.
        t_rx_us, t_tx_us : int
            Device time of the same two moments, modulo 2^32.
        disprove : bool
            Whether it shows that those before it were taken wrongly: they are forgotten.
        """
        stay_us = (t_tx_us - t_rx_us) & 0xFFFFFFFF
        if t_receive_ns - t_send_ns < (stay_us - CLOCK_STEPS_US) * 1000:
            return  # no stay is longer than the journey that it is part of
        near_us = t_rx_us if self._best is None else self.to_device_us(t_send_ns)
        arrival_us = unwrap(t_rx_us, near_us, _WIRE_BITS)
        host_ns = (t_send_ns + t_receive_ns) // 2
        device_ns = arrival_us * 1000 + stay_us * 500
        trip_ns = max(0, t_receive_ns - t_send_ns - stay_us * 1000)
        if disprove:
            self._samples.clear()
            self._best = None
        self._take(ClockSample(host_ns, device_ns - host_ns, trip_ns // 2 + _ROUNDING_NS))

    def _take(self, sample: ClockSample) -> None:
        """Use a clock sample; ignore one that contradicts the best; restart after 3 in a row."""
        if self._contradicts(sample):
            self.rejected += 1
            self._contradictions += 1
            if self._contradictions < _PATIENCE:
                return
            self._restart(sample)
        self._contradictions = 0
        self._samples.append(sample)
        self._follow_drift()
        self._best = min(self._samples, key=lambda s: self._margin_at(s, sample.host_ns))

    def _contradicts(self, sample: ClockSample) -> bool:
        """Return True if *sample* is further from the best one than drift and uncertainty allow.

        False without a best one.
        """
        best = self._best
        if best is None:
            return False
        age_ns = abs(sample.host_ns - best.host_ns)
        allowed_ns = best.margin_ns + sample.margin_ns + age_ns * self._ppm / 1e6
        return abs(sample.offset_ns - best.offset_ns) > allowed_ns

    def _restart(self, sample: ClockSample) -> None:
        """Forget all samples after a jump of the device clock; count it and note its size."""
        self.jumps += 1
        self.jump_us = (sample.offset_ns - self._offset_ns(sample.host_ns)) // 1000
        self._samples.clear()

    def _follow_drift(self) -> None:
        """Fit the drift; use it where it is known better than by the declared limit (ppm)."""
        self._drift = fit_clock_drift(self._samples)
        growth_ppm = self._drift.uncertainty_ppm + _WANDER_PPM
        known = growth_ppm < self._ppm
        self._growth_ppm = growth_ppm if known else self._ppm
        self._rate_ppb = round(self._drift.ppm * 1000) if known else 0

    def _margin_at(self, sample: ClockSample, host_ns: int) -> float:
        """Return the uncertainty of *sample* in ns at *host_ns*: it grows with its age."""
        return sample.margin_ns + abs(host_ns - sample.host_ns) * self._growth_ppm / 1e6

    def _offset_ns(self, host_ns: int) -> int:
        """Return the device clock minus the host clock, in ns, extrapolated to *host_ns*."""
        best = self._chosen
        return best.offset_ns + (host_ns - best.host_ns) * self._rate_ppb // _PPB

    @property
    def ready(self) -> bool:
        """True if there is an estimate."""
        return self._best is not None

    @property
    def doubtful(self) -> bool:
        """True if the newest sample contradicts the estimate: the next one should come soon."""
        return self._contradictions > 0

    @property
    def offset_us(self) -> float:
        """Device clock minus host clock at the newest exchange, in microseconds."""
        return self._offset_ns(self._newest_ns) / 1000

    @property
    def uncertainty_us(self) -> float:
        """Largest error of the estimate at the newest exchange: at least half a round trip."""
        return self.uncertainty_at_us(self._newest_ns)

    def uncertainty_at_us(self, host_ns: int) -> float:
        """Return the largest error of the estimate at *host_ns*, in microseconds."""
        return self._margin_at(self._chosen, host_ns) / 1000

    @property
    def drift_ppm(self) -> float:
        """Drift of the device clock; nan from less than two exchanges."""
        return self._drift.ppm

    @property
    def drift_uncertainty_ppm(self) -> float:
        """Largest error of :attr:`drift_ppm`; infinite from less than two exchanges."""
        return self._drift.uncertainty_ppm

    def to_device_us(self, host_ns: int) -> int:
        """Return the unwrapped device time at *host_ns*, in microseconds, rounded down."""
        return (host_ns + self._offset_ns(host_ns)) // 1000

    def to_host_ns(self, device_us: int) -> int:
        """Return the host time at the unwrapped device time *device_us*."""
        best = self._chosen
        ahead_ns = device_us * 1000 - best.offset_ns - best.host_ns
        return best.host_ns + ahead_ns - ahead_ns * self._rate_ppb // (_PPB + self._rate_ppb)

    @property
    def _newest_ns(self) -> int:
        """Return the host time of the newest clock sample."""
        return self._samples[-1].host_ns if self._samples else self._chosen.host_ns

    @property
    def _chosen(self) -> ClockSample:
        """Return the clock sample of the least uncertainty; raise NoAnswerError without any.

        The error says that no ping was answered yet.
        """
        if self._best is None:
            raise NoAnswerError("the device clock is not known: no ping was answered yet")
        return self._best


def next_boundary_on_device_clock_us(device_us: int, carrier_hz: int) -> int:
    """Return the first whole carrier period at or after *device_us*, where drives are latched.

    A board counts the periods from its own start.  A host that came after the 32-bit clock wrapped
    cannot know that, and is off by a constant of less than a period.
    """
    period_us = max(1, 1_000_000 // carrier_hz)
    return -(-device_us // period_us) * period_us

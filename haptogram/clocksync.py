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
from dataclasses import dataclass
from typing import Final

from haptogram.errors import NoAnswerError
from haptogram_protocol.messages import unwrap

_WIRE_BITS: Final = 32
_WINDOW: Final = 16  # samples kept
_PATIENCE: Final = 3  # samples in a row that contradict all before: then these are the truth
CLOCK_STEPS_US: Final = 2  # rounding of the two device times
_HOST_PPM: Final = 50  # how far the host's own clock may be off


@dataclass(frozen=True, slots=True)
class _Sample:
    host_ns: int  # middle of the exchange
    offset_ns: int  # device minus host
    margin_ns: int  # half the round trip


class ClockEstimate:
    """Offset of the device clock from the host's.

    Parameters
    ----------
    device_ppm : int
        Largest error that the board declares for its clock, parts per million.

    Attributes
    ----------
    rejected : int
        Samples that contradicted the others.
    """

    def __init__(self, device_ppm: int = 50) -> None:
        self.rejected = 0
        self._ppm = device_ppm + _HOST_PPM
        self._samples: deque[_Sample] = deque(maxlen=_WINDOW)
        self._best: _Sample | None = None
        self._contradictions = 0

    def add(self, t_send_ns: int, t_rx_us: int, t_tx_us: int, t_receive_ns: int) -> None:
        """Take one exchange.

        Parameters
        ----------
        t_send_ns, t_receive_ns : int
            Host time at which the last byte of the ping left and at which the first byte of the
            answer came: without the time that the bytes themselves take on the line.
        t_rx_us, t_tx_us : int
            Device time of the same two moments, modulo 2^32.
        """
        stay_us = (t_tx_us - t_rx_us) & 0xFFFFFFFF
        if t_receive_ns - t_send_ns < (stay_us - CLOCK_STEPS_US) * 1000:
            return  # no stay is longer than the journey that it is part of
        near_us = t_rx_us if self._best is None else self.to_device_us(t_send_ns)
        arrival_us = unwrap(t_rx_us, near_us, _WIRE_BITS)
        host_ns = (t_send_ns + t_receive_ns) // 2
        device_ns = arrival_us * 1000 + stay_us * 500
        trip_ns = max(0, t_receive_ns - t_send_ns - stay_us * 1000)
        # Half a microsecond: the device clock has no finer step.
        self._take(_Sample(host_ns, device_ns - host_ns, trip_ns // 2 + 500))

    def _take(self, sample: _Sample) -> None:
        if self._contradicts(sample):
            self.rejected += 1
            self._contradictions += 1
            if self._contradictions < _PATIENCE:
                return
            self._samples.clear()  # the device clock has jumped
        self._contradictions = 0
        self._samples.append(sample)
        self._best = min(self._samples, key=lambda s: self._margin_at(s, sample.host_ns))

    def _contradicts(self, sample: _Sample) -> bool:
        best = self._best
        if best is None:
            return False
        allowed = self._margin_at(best, sample.host_ns) + sample.margin_ns
        return abs(sample.offset_ns - best.offset_ns) > allowed

    def _margin_at(self, sample: _Sample, host_ns: int) -> int:
        return sample.margin_ns + abs(host_ns - sample.host_ns) * self._ppm // 1_000_000

    @property
    def ready(self) -> bool:
        """Whether there is an estimate."""
        return self._best is not None

    @property
    def offset_us(self) -> float:
        """Device clock minus host clock, in microseconds."""
        return self._chosen.offset_ns / 1000

    @property
    def uncertainty_us(self) -> float:
        """Largest error of the estimate at the newest exchange: at least half a round trip."""
        return self._margin_at(self._chosen, self._samples[-1].host_ns) / 1000

    @property
    def drift_ppm(self) -> float:
        """How much faster the device clock runs, from the samples kept; nan from less than two.

        A least-squares line through the offsets, each weighted by the inverse square of its margin.
        It is reported, not used: every new exchange takes up what has drifted.
        """
        start_ns = self._chosen.host_ns
        weights = [1.0 / sample.margin_ns**2 for sample in self._samples]
        times = [float(sample.host_ns - start_ns) for sample in self._samples]
        offsets = [float(sample.offset_ns - self._chosen.offset_ns) for sample in self._samples]
        total = sum(weights)
        mean_t = sum(w * t for w, t in zip(weights, times, strict=True)) / total
        mean_o = sum(w * o for w, o in zip(weights, offsets, strict=True)) / total
        spread = sum(w * (t - mean_t) ** 2 for w, t in zip(weights, times, strict=True))
        if spread == 0.0:
            return math.nan
        both = zip(weights, times, offsets, strict=True)
        return 1e6 * sum(w * (t - mean_t) * (o - mean_o) for w, t, o in both) / spread

    def to_device_us(self, host_ns: int) -> int:
        """Return the unwrapped device time at *host_ns*, in microseconds, rounded down."""
        return (host_ns + self._chosen.offset_ns) // 1000

    def to_host_ns(self, device_us: int) -> int:
        """Return the host time at the unwrapped device time *device_us*."""
        return device_us * 1000 - self._chosen.offset_ns

    @property
    def _chosen(self) -> _Sample:
        if self._best is None:
            raise NoAnswerError("the device clock is not known: no ping was answered yet")
        return self._best


def next_boundary_us(device_us: int, carrier_hz: int) -> int:
    """Return the first whole carrier period at or after *device_us*, where drives are latched.

    A board counts the periods from its own start.  A host that came after the 32-bit clock wrapped
    cannot know that, and is off by a constant of less than a period.
    """
    period_us = max(1, 1_000_000 // carrier_hz)
    return -(-device_us // period_us) * period_us

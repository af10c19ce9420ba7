"""Retransmission timeout from measured round trips.  RFC 6298; SPEC.md chapter 12."""

from __future__ import annotations

from typing import Final

INITIAL_RTO_US: Final = 250_000  # HG-12.6
MIN_RTO_US: Final = 50_000
MAX_RTO_US: Final = 2_000_000
MAX_ATTEMPTS: Final = 5


class RoundTripTimer:
    """Smoothed round trip and its variation, in integer microseconds (RFC 6298 section 2).

    A request that was sent twice gives no sample (Karn's rule, section 3).

    Attributes
    ----------
    rto_us : int
        Retransmission timeout in microseconds.
    """

    def __init__(self) -> None:
        self.rto_us = INITIAL_RTO_US
        self._smoothed_us: int | None = None
        self._variation_us = 0

    def add_sample(self, rtt_us: int) -> None:
        """Take the round trip of a request that was sent once; end the doubling of the timeout."""
        if self._smoothed_us is None:
            self._smoothed_us, self._variation_us = rtt_us, rtt_us // 2
        else:
            error = rtt_us - self._smoothed_us
            self._variation_us += (abs(error) - self._variation_us) // 4
            self._smoothed_us += error // 8
        rto_us = self._smoothed_us + 4 * self._variation_us
        self.rto_us = min(max(rto_us, MIN_RTO_US), MAX_RTO_US)

    def back_off(self) -> None:
        """Double the timeout after a retransmission (section 5.5)."""
        self.rto_us = min(2 * self.rto_us, MAX_RTO_US)

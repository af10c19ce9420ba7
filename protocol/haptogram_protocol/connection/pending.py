"""Requests of the host that wait for an answer, and their timer.  RFC 6298; SPEC.md HG-12.6."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from ..messages import MessageType

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


@dataclass(slots=True)
class PendingRequest:
    """A request without an answer.

    Attributes
    ----------
    request : MessageType
        Type of the request.
    seq : int
        Its number.
    wire : bytes
        Its frame, to be sent again.
    sent_us : int
        Time at which it was last sent.
    timeout_us : int
        Time from then until its deadline.
    attempts : int
        Number of times it was sent.
    """

    request: MessageType
    seq: int
    wire: bytes
    sent_us: int
    timeout_us: int
    attempts: int = 1

    @property
    def deadline_us(self) -> int:
        """Time at which the request is sent again, or given up."""
        return self.sent_us + self.timeout_us

    @property
    def is_exhausted(self) -> bool:
        """True if the request was sent as often as it may be."""
        return self.attempts >= MAX_ATTEMPTS


class PendingRequests:
    """Every request without an answer, by its number, and the timer that they share."""

    def __init__(self) -> None:
        self._by_seq: dict[int, PendingRequest] = {}
        self._timer = RoundTripTimer()

    def __len__(self) -> int:
        return len(self._by_seq)

    def __iter__(self) -> Iterator[PendingRequest]:
        return iter(self._by_seq.values())

    @property
    def names(self) -> str:
        """Types of the requests, for a message."""
        return " and ".join(sorted({pending.request.name for pending in self}))

    @property
    def next_deadline_us(self) -> int | None:
        """Earliest deadline; None if nothing waits."""
        if not self._by_seq:  # asked for with every frame of a stream
            return None
        return min([pending.deadline_us for pending in self._by_seq.values()])

    def add(self, request: MessageType, seq: int, wire: bytes, now_us: int) -> None:
        """Take note of a request that is sent now."""
        timeout_us = self._timer.rto_us
        if request is MessageType.MUTE:  # not as patient as a bad line has taught the others
            timeout_us = min(timeout_us, INITIAL_RTO_US)
        self._by_seq[seq] = PendingRequest(request, seq, wire, now_us, timeout_us)

    def get(self, seq: int) -> PendingRequest | None:
        """Return the request with this number, None if it does not wait."""
        return self._by_seq.get(seq)

    def due(self, now_us: int) -> list[PendingRequest]:
        """Return the requests whose deadline has passed."""
        return [pending for pending in self._by_seq.values() if pending.deadline_us <= now_us]

    def resend(self, pending: PendingRequest, now_us: int) -> bytes:
        """Return the frame to send again; twice the time is given for its answer."""
        pending.attempts += 1
        pending.sent_us = now_us
        pending.timeout_us = min(2 * pending.timeout_us, MAX_RTO_US)
        if pending.timeout_us > self._timer.rto_us:
            self._timer.back_off()
        return pending.wire

    def answered(self, pending: PendingRequest, now_us: int) -> int | None:
        """Forget a request that is answered now; return the round trip in microseconds.

        None if the request was sent more than once: the answered copy is not known.
        """
        self.forget(pending)
        if pending.attempts > 1:
            return None
        rtt_us = now_us - pending.sent_us
        self._timer.add_sample(rtt_us)
        return rtt_us

    def forget(self, pending: PendingRequest) -> None:
        """Wait for the answer of one request no longer."""
        del self._by_seq[pending.seq]

    def forget_all(self, *, but: MessageType | None = None) -> None:
        """Wait for no answer any longer, except to requests of the type *but*."""
        kept = [pending for pending in self if pending.request is but]
        self._by_seq = {pending.seq: pending for pending in kept}

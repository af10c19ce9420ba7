"""Pings over a link, which keep the estimate of the device clock true."""

from __future__ import annotations

from typing import Final

from haptogram.driver.line.budget import frame_bytes_on_line, line_transmission_ns
from haptogram.driver.line.link import Link
from haptogram.driver.timing.clock import CLOCK_STEPS_US, ClockEstimate
from haptogram_protocol.connection import ReplyReceived
from haptogram_protocol.messages import Ping, Pong

# Not a whole fraction of any usual period, so that the pings meet every phase of the traffic.
PING_PERIOD_NS: Final = 980_000_000
_INITIAL_PINGS: Final = 8
_STALE_US: Final = 200  # growth of the error of the clock in a pause of the host
_DOUBTFUL_NS: Final = 100_000_000  # time until the next PING if the last one contradicts the others
_PONG_BYTES: Final = frame_bytes_on_line(Pong.LAYOUT.size)


class Pinger:
    """Sends pings and feeds their answers to a :class:`ClockEstimate`.

    Parameters
    ----------
    link : Link
    clock : ClockEstimate
    """

    def __init__(self, link: Link, clock: ClockEstimate) -> None:
        self.clock = clock
        self._link = link
        self._due_ns = 0
        self._number = 0
        self._seq: int | None = None
        self._handed_over_ns = 0
        self._left_ns = 0
        self._unpaced = False

    def synchronise(self) -> None:
        """Exchange a few pings, one after the other; see :meth:`Link.request` for the errors."""
        for _ in range(_INITIAL_PINGS):
            self._link.wait_idle(self._link.now_ns() + self._link.timeout_ns)
            self._send()
            self._link.wait_idle(self._link.now_ns() + self._link.timeout_ns)

    def refresh(self) -> None:
        """Exchange a few pings if the clock is known less well than after the last ones."""
        clock = self.clock
        if clock.uncertainty_at_us(self._link.now_ns()) > clock.uncertainty_us + _STALE_US:
            self.synchronise()

    def keep(self, every_ns: int = PING_PERIOD_NS) -> None:
        """Send a ping if it is time and no other request waits; never waits itself.

        Parameters
        ----------
        every_ns : int
            Longest time between two pings, for a board whose lease nothing else renews.
        """
        due_ns = min(self._due_ns, self._handed_over_ns + every_ns)
        if self._link.now_ns() >= due_ns and not self._link.connection.outstanding:
            self._send()

    def _send(self) -> None:
        """Send a PING and schedule the next."""
        self._number += 1
        self._handed_over_ns = self._link.now_ns()
        self._due_ns = self._handed_over_ns + PING_PERIOD_NS
        self._seq = self._link.send(Ping(self._number))
        # Behind what the line was busy with, and after its own bytes.
        self._left_ns = self._link.line.free_ns

    def take(self, event: object) -> None:
        """Take the answer to a ping; one that was sent twice says nothing about time."""
        if not isinstance(event, ReplyReceived) or not isinstance(event.message, Pong):
            return
        reply, pong = event, event.message
        if reply.seq != self._seq or reply.rtt_us is None:
            return
        received_ns = reply.t_rx_us * 1000
        came_ns = received_ns - line_transmission_ns(_PONG_BYTES, self._link.line.baudrate)
        stay_ns = ((pong.t_tx_us - pong.t_rx_us) & 0xFFFFFFFF) * 1000
        faster = came_ns - self._left_ns < stay_ns - CLOCK_STEPS_US * 1000
        if faster or self._unpaced:
            # Once faster than its baud rate, as a pseudo-terminal is: no time is spent on the line,
            # and what was taken off the exchanges before was no such time either.
            disprove, self._unpaced = not self._unpaced, True
            sent_ns, rx_us, tx_us = self._handed_over_ns, pong.t_rx_us, pong.t_tx_us
            self.clock.add(sent_ns, rx_us, tx_us, received_ns, disprove=disprove)
        else:
            self.clock.add(self._left_ns, pong.t_rx_us, pong.t_tx_us, came_ns)
        if self.clock.doubtful:
            self._due_ns = min(self._due_ns, received_ns + _DOUBTFUL_NS)

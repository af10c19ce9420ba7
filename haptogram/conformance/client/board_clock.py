"""The clock of the board under test, as far as its answers tell it."""

from __future__ import annotations

import random
from typing import Final

from haptogram_protocol.messages import HelloReply, Ping, Pong, unwrap

from ..outcome import inconclusive
from .request_client import Exchange
from .wire import Wire

BOOT_US: Final = 2**32 - 10_000_000  # HG-6.9: the device clock at a reset
_SPARE_US: Final = 200  # host's idea of the device clock, in virtual time


class DeviceClock(Exchange):
    """An exchange of frames with a board whose time matters.

    Parameters
    ----------
    wire : Wire
        Open port.
    random_source : random.Random
        Where contents come from.
    booted : bool
        Whether the board has just started, so that its clock is known unwrapped.

    Attributes
    ----------
    identity : HelloReply
        What the board said last.
    """

    identity: HelloReply

    def __init__(self, wire: Wire, random_source: random.Random, *, booted: bool) -> None:
        super().__init__(wire, random_source)
        self.booted = booted
        self._device_us = BOOT_US  # unwrapped, at the last PONG
        # Device clock - clock of the transport: the least and the most that it can be.
        self._behind_us = self._ahead_us = 0

    def set_device_us(self, t_us: int) -> None:
        """Take note of an unwrapped device time, to unwrap the next ones by."""
        self._device_us = t_us

    def device_us(self) -> int:
        """Ask for the device time and return it, unwrapped as far as that is known."""
        sent_us = self.wire.now_us()
        answer = self.ask(Ping(self.random.getrandbits(64)))
        pong = self.reply_in(answer, Pong, Ping.TYPE)
        self._device_us = unwrap(pong.t_rx_us, self._device_us, 32)
        self._ahead_us = self._device_us - sent_us
        done_us = self.wire.line_us(len(answer.piece) + 2)
        left_us = unwrap(pong.t_tx_us, self._device_us, 32)
        self._behind_us = left_us + done_us - self.wire.now_us()
        return self._device_us

    def device_estimate_us(self) -> int:
        """Return the device time by the host's clock and the last PONG, or a little less."""
        return self.wire.now_us() + self._behind_us

    def unwrap(self, t_wire_us: int) -> int:
        """Return a device time from a frame, unwrapped."""
        return unwrap(t_wire_us, self.device_estimate_us(), 32)

    def soon_us(self, *wires: bytes) -> int:
        """Return a multiple of the carrier period by which *wires* are certain to have come."""
        extra_us = self.wire.line_us(sum(map(len, wires)))
        return self.on_carrier(self.device_us() + self.wire.limits.lead_us + 2 * extra_us)

    def on_carrier(self, t_us: int) -> int:
        """Return the first multiple of the carrier period at or after *t_us*."""
        return -(-t_us // self.carrier_us) * self.carrier_us

    @property
    def carrier_us(self) -> int:
        """Carrier period."""
        return 1_000_000 // max(1, self.identity.carrier_hz)

    def until(self, t_device_us: int) -> None:
        """Wait until the device clock has passed *t_device_us*."""
        left_us = t_device_us - self.device_estimate_us()
        self.wire.idle(max(0, left_us) + self.wire.limits.slack_us + _SPARE_US)

    def rest(self, size: int = 0) -> None:
        """Wait until *size* bytes have been sent, and what they hold has been latched."""
        slack_us = self.wire.limits.slack_us
        if slack_us:  # only an answer shows that a board that had to wait has read them
            self.barrier()
        self.wire.idle(self.wire.line_us(size) + 4 * self.carrier_us + slack_us // 10)

    def in_time(self, t_device_us: int) -> None:
        """End the case as INCONCLUSIVE if it is too late for what had to be sent before."""
        exact = not self.wire.limits.slack_us
        offset_us = self._behind_us if exact else self._ahead_us
        if self.wire.now_us() + offset_us >= t_device_us:
            inconclusive("the host was held up and sent its frames too late")

"""The device clock of the board under test, as far as the board's answers tell it."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import Ping, Pong, unwrap

from ..outcome import inconclusive, not_observed
from .request_client import RequestClient

BOOT_US: Final = 2**32 - 10_000_000  # HG-6.9: the device clock at a reset
_TIMES_IN_CARRIER: Final = 3  # in µs
_IN_TIME_US: Final = 20_000  # from the readiness of a frame to its t_apply, at most
_HALF_TURN_US: Final = 1 << 31  # of the 32 bits of a device time
_PASSED_US: Final = 10_000_000  # between the choice of a t_apply and its arrival, at most
_SPARE_US: Final = 200  # error of the host's estimate of the device clock, in virtual time


class ClockClient:
    """Device times: asked for, estimated, unwrapped and waited for.

    Parameters
    ----------
    link : RequestClient
        Asks the board for its time.
    booted : bool
        Whether the board has just started, so that its unwrapped time is known.

    Attributes
    ----------
    carrier_us : int
        Carrier period of the board that answered HELLO last.
    lead_us : int
        Time that this board needs to make any stream frame ready.
    point_time_us : int
        Time that it needs to compute one focal point.
    horizon_us : int
        How far ahead it takes a t_apply.
    """

    def __init__(self, link: RequestClient, *, booted: bool) -> None:
        self.booted = booted
        self.carrier_us = 1
        self.lead_us = self.point_time_us = 0
        self.horizon_us = 1 << 31
        self._link = link
        self._wire = link.wire
        self._device_us = BOOT_US  # unwrapped, at the last PONG
        self._asked_us: int | None = None  # host's clock then
        self._behind_us = 0  # device clock - clock of the transport: the least that this can be

    def set_device_us(self, t_us: int) -> None:
        """Take an unwrapped device time, by which the next ones are unwrapped."""
        self._device_us, self._asked_us = t_us, None

    def note_power_up(self) -> None:
        """Note that the board was switched on when the clock of the transport was 0."""
        self._behind_us = BOOT_US

    def device_us(self) -> int:
        """Ask for the device time and return it, unwrapped as far as that is known."""
        sent_us = self._wire.now_us()
        answer = self._link.ask(Ping(self._link.random.getrandbits(64)))
        pong = self._link.reply_in(answer, Pong, Ping.TYPE)
        passed_us = 0 if self._asked_us is None else sent_us - self._asked_us
        self._device_us = unwrap(pong.t_rx_us, self._device_us + passed_us, 32)
        self._asked_us = sent_us
        done_us = self._wire.line_us(len(answer.piece) + 2)
        left_us = unwrap(pong.t_tx_us, self._device_us, 32)
        self._behind_us = left_us + done_us - self._wire.now_us()
        return self._device_us

    def device_estimate_us(self) -> int:
        """Return the device time by the host's clock and the last PONG, or a little less."""
        return self._wire.now_us() + self._behind_us

    def unwrap(self, t_wire_us: int) -> int:
        """Return a device time from a frame, unwrapped."""
        return unwrap(t_wire_us, self.device_estimate_us(), 32)

    def ahead_us(self, ahead_us: int) -> int:
        """Return the device time in *ahead_us*; NOT-OBSERVED if that is beyond the horizon."""
        self.require_horizon(ahead_us)
        return self.device_us() + ahead_us

    def can_be_in_time(self, ready_us: int) -> bool:
        """Return True if a frame that is ready so long after its arrival may come in time.

        A t_apply behind that lies beyond the horizon (HG-5.7/4) of some boards.
        """
        return ready_us + _IN_TIME_US <= self.horizon_us

    def beyond_us(self, least_us: int) -> int | None:
        """Return the time from now to a t_apply *least_us* beyond the horizon.

        None if there is none: what is later than 2^31 µs ahead has passed (HG-5.7/7).
        """
        ahead_us = self.horizon_us + least_us
        return ahead_us if ahead_us < _HALF_TURN_US - _PASSED_US else None

    def require_horizon(self, ahead_us: int) -> None:
        """End the case as NOT-OBSERVED if the board takes no t_apply so far ahead (HG-5.7/4)."""
        if ahead_us > self.horizon_us:
            not_observed(
                f"the case needs a t_apply {ahead_us} µs ahead; max_horizon_us is {self.horizon_us}"
            )

    def soon_us(self, *wires: bytes, points: int = 0, ahead_us: int = 0) -> int:
        """Return *ahead_us* behind a carrier boundary by which *wires* are certain to be ready.

        So many *points* of frames before the last one are computed first, one after the other.
        NOT-OBSERVED if that time is beyond the horizon.
        """
        extra_us = self._wire.line_us(sum(map(len, wires)))
        ready_us = points * self.point_time_us + self.lead_us
        ready_us += self._wire.limits.lead_us + 2 * extra_us
        self.require_horizon(ready_us + ahead_us)
        return self.on_carrier(self.device_us() + ready_us) + ahead_us

    def require_times_in_carrier(self) -> None:
        """End the case as NOT-OBSERVED if a carrier period has no room for three times."""
        if self.carrier_us < _TIMES_IN_CARRIER:
            not_observed("a carrier period of this board has no room for three times")

    def on_carrier(self, t_us: int) -> int:
        """Return the first multiple of the carrier period at or after *t_us*."""
        return -(-t_us // self.carrier_us) * self.carrier_us

    def wait_until(self, t_device_us: int) -> None:
        """Wait until the device clock has passed *t_device_us*."""
        left_us = t_device_us - self.device_estimate_us()
        self._wire.idle(max(0, left_us) + self._wire.limits.slack_us + _SPARE_US)

    def wait_computed(self, points: int) -> None:
        """Wait until the board has computed so many points, which it has received."""
        self._wire.idle(points * self.point_time_us)

    def wait_latched(self, ready_us: int | None = None) -> None:
        """Wait until the line has brought what was sent, and its frames have been latched.

        The board makes them ready in *ready_us*; None: as long as it may need for any frame.
        """
        slack_us = self._wire.limits.slack_us
        boundary_us = (self.lead_us if ready_us is None else ready_us) + 4 * self.carrier_us
        if not slack_us:
            self._wire.idle(self._wire.backlog_us + boundary_us)
            return
        # Only an answer shows that a board that had to wait has read the bytes, and how late it is.
        latched_us = self.device_us() + boundary_us
        given_up_us = self._wire.now_us() + boundary_us + slack_us // 10
        self._wire.idle(boundary_us)
        while self.device_us() < latched_us and self._wire.now_us() < given_up_us:
            pass

    def require_in_time(self, t_device_us: int, came_us: int | None = None) -> None:
        """End the case as INCONCLUSIVE if the frames that were sent may have come after that.

        They came by *came_us*. None: by now; in wall time the board itself tells when that is, as
        an emulator may be held up too.
        """
        if came_us is None:
            came_us = self.device_us() if self._wire.limits.slack_us else self.device_estimate_us()
        if came_us >= t_device_us:
            self._wire.note_held_up(self._wire.limits.lead_us)
            inconclusive("the host, its line or an emulator was held up: frames came too late")

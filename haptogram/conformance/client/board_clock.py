"""The device clock of the board under test, as far as the board's answers tell it."""

from __future__ import annotations

from typing import Final

from haptogram_protocol import messages as m

from ..outcome import HeldUpError, not_observed, require
from .request_client import NO_TIME_US, RequestClient

BOOT_US: Final = 2**32 - 10_000_000  # HG-6.9: the device clock at a reset
_TIMES_IN_CARRIER: Final = 3  # µs: shortest carrier period that has room for three times
_IN_TIME_US: Final = 20_000  # longest time from the readiness of a frame to its t_apply
_HALF_TURN_US: Final = 1 << 31  # of the 32 bits of a device time
_BEHIND_US: Final = 5000  # frames that a case sends for times behind the first
_PASSED_US: Final = 10_000_000  # longest time between the choice of a t_apply and its arrival
_PING_US: Final = 200_000  # time between two PINGs; HG-7.1/4: a lease is 500 ms at least
_MOST_PINGS: Final = 50
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
    latch_lead_us : int
        Time that this board needs to make a frame without points ready.
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
        self.lead_us = self.latch_lead_us = self.point_time_us = 0
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
        answer = self._link.ask(m.Ping(self._link.random.getrandbits(64)))
        pong = self._link.reply_in(answer, m.Pong, m.Ping.TYPE)
        passed_us = 0 if self._asked_us is None else sent_us - self._asked_us
        self._device_us = m.unwrap(pong.t_rx_us, self._device_us + passed_us, 32)
        self._asked_us = sent_us
        done_us = self._wire.line_us(len(answer.piece) + 2)
        left_us = m.unwrap(pong.t_tx_us, self._device_us, 32)
        self._behind_us = left_us + done_us - self._wire.now_us()
        return self._device_us

    def device_estimate_us(self) -> int:
        """Return the device time by the host's clock and the last PONG, or a little less."""
        return self._wire.now_us() + self._behind_us

    def device_least_us(self) -> int:
        """Return the least that the device clock can show: the estimate less its error."""
        return self.device_estimate_us() - self._wire.limits.slack_us - _SPARE_US

    def unwrap(self, t_wire_us: int) -> int:
        """Return a device time from a frame, unwrapped."""
        return m.unwrap(t_wire_us, self.device_estimate_us(), 32)

    def ahead_us(self, ahead_us: int) -> int:
        """Return the device time in *ahead_us*; NOT-OBSERVED if that is beyond the horizon."""
        self.require_horizon(ahead_us)
        return self._begin_exchange(self.device_us() + ahead_us)

    def ready_us(self, came_us: int, points: int = 0) -> int:
        """Return when a frame of *points* points that came at *came_us* is ready."""
        return came_us + self.latch_lead_us + points * self.point_time_us

    def timer_ms(self, least_ms: int, size: int = 0) -> int:
        """Return *least_ms*, and what the line takes for *size* bytes and the board for a frame."""
        return least_ms + (self._wire.line_us(size) + self.latch_lead_us) // 1000

    def can_be_in_time(self, points: int = 0) -> bool:
        """Return True if a frame of *points* points may come in time.

        The first t_apply for which it is ready lies beyond the horizon (HG-5.7/4) of some boards.
        """
        return self.ready_us(_IN_TIME_US, points) <= self.horizon_us

    def beyond_us(self, least_us: int) -> int | None:
        """Return the time from now to a t_apply *least_us* beyond the horizon.

        None if there is none: what is later than 2^31 µs ahead has passed (HG-5.7/7).
        """
        ahead_us = self.horizon_us + least_us
        return ahead_us if ahead_us < _HALF_TURN_US - _PASSED_US else None

    def require_horizon(self, ahead_us: int) -> None:
        """End the case as NOT-OBSERVED if the board takes no t_apply that far ahead (HG-5.7/4)."""
        if ahead_us > self.horizon_us:
            not_observed(
                f"the case needs a t_apply {ahead_us} µs ahead; max_horizon_us is {self.horizon_us}"
            )

    def soon_us(self, *wires: bytes, points: int = 0, ahead_us: int = 0) -> int:
        """Return *ahead_us* after a carrier boundary by which *wires* are certain to be ready.

        So many *points* of frames before the last one are computed first, one after the other.
        NOT-OBSERVED if a frame due 5 ms behind that time is beyond the horizon.
        """
        extra_us = self._wire.line_us(sum(map(len, wires)))
        ready_us = points * self.point_time_us + self.lead_us
        ready_us += self._wire.limits.lead_us + 2 * extra_us
        self.require_horizon(ready_us + ahead_us + _BEHIND_US)
        now_us = max(self.device_us(), self.device_estimate_us())  # a STATUS may hold up the PONG
        return self._begin_exchange(self.on_carrier(now_us + ready_us)) + ahead_us

    def require_times_in_carrier(self) -> None:
        """End the case as NOT-OBSERVED if a carrier period has no room for three times."""
        if self.carrier_us < _TIMES_IN_CARRIER:
            not_observed("a carrier period of this board has no room for three times")

    def on_carrier(self, t_us: int) -> int:
        """Return the first multiple of the carrier period at or after *t_us*."""
        return -(-t_us // self.carrier_us) * self.carrier_us

    def wait_until(self, t_device_us: int) -> None:
        """Wait until the device clock has passed *t_device_us*.

        What was sent for a time in this exchange has to have come before: else nothing is judged.
        """
        self.end_exchange()
        left_us = max(0, t_device_us - self.device_estimate_us())
        if self._wire.is_virtual:
            self.idle_attended(left_us + _SPARE_US)
            return
        self.idle_attended(left_us)
        while (shown_us := self._link.ask_time()) is not None:
            if (left_us := t_device_us - self.unwrap(shown_us)) < 0:
                return
            self._wire.idle(left_us + 1)
        self._wire.idle(self._wire.limits.slack_us + _SPARE_US)

    def idle_until(self, t_device_us: int) -> None:
        """Wait until a device time, by the host's estimate; go on if it has passed."""
        self._wire.idle(max(0, t_device_us - self.device_estimate_us()))

    def wait_before(self, t_device_us: int) -> None:
        """Wait until shortly before the device clock shows *t_device_us*, however late we wake."""
        left_us = t_device_us - self.device_estimate_us() - self._wire.limits.slack_us
        self._wire.idle(max(0, left_us))

    def wait_computed(self, points: int) -> None:
        """Wait until the board has computed *points* points that it has received."""
        self._wire.idle(points * self.point_time_us)

    def wait_latched(self, points: int | None = None) -> None:
        """Wait until the line has brought what was sent, and its frames have been latched.

        The board computes *points* points for them; None: as many as for any frame.
        """
        self.end_exchange()
        slack_us = self._wire.limits.slack_us
        boundary_us = (self.lead_us if points is None else self.ready_us(0, points)) + (
            4 * self.carrier_us
        )
        if not slack_us:
            self.idle_attended(self._wire.backlog_us + boundary_us)
            return
        # Only an answer shows that a board that had to wait has read the bytes, and how late it is.
        latched_us = self.device_us() + boundary_us
        given_up_us = self._wire.now_us() + boundary_us + slack_us // 10
        self.idle_attended(boundary_us)
        while self.device_us() < latched_us and self._wire.now_us() < given_up_us:
            pass

    def idle_attended(self, duration_us: int) -> None:
        """Wait; a PING now and then keeps the lease, or a playback, of a board that takes long."""
        until_us = self._wire.now_us() + duration_us
        each_us = max(_PING_US, duration_us // _MOST_PINGS)
        while until_us - self._wire.now_us() > each_us:
            self._wire.idle(each_us)
            self.device_us()
        self._wire.idle(until_us - self._wire.now_us())

    # --- held up -------------------------------------------------------------------------------

    def _begin_exchange(self, t_device_us: int) -> int:
        """Begin to note the earliest apply time (t_apply) of the timed frames sent from now on.

        Apply times over a carrier period before *t_device_us* are left out. Returns *t_device_us*.
        """
        self._link.in_time_from_us = t_device_us - self.carrier_us
        self._link.in_time_us = NO_TIME_US
        return t_device_us

    def expect_before(self, t_device_us: int) -> None:
        """Expect what this exchange sends to be ready before that time."""
        self._link.in_time_us = t_device_us

    def end_exchange(self) -> None:
        """End the case, not judged, if a frame of this exchange may have come after its time."""
        due_us = self._link.in_time_us
        self.forget_exchange()
        if due_us < NO_TIME_US:
            self.require_before(due_us - self.latch_lead_us, "frames came too late")

    def forget_exchange(self) -> None:
        """Expect nothing of the frames that were made: the case chooses when they come."""
        self._link.in_time_from_us = self._link.in_time_us = NO_TIME_US

    def require_before(self, t_device_us: int, what: str, at_us: int | None = None) -> None:
        """End the case, not judged, unless *what* is over before that device time.

        It was over at *at_us*. None: now; in wall time the board itself tells when that is, as an
        emulator may be held up too.
        """
        if at_us is None:
            at_us = self.device_estimate_us() if self._wire.is_virtual else self.device_us()
        if at_us >= t_device_us:
            self._wire.note_held_up(self._wire.limits.lead_us)
            late_us = at_us - t_device_us
            raise HeldUpError(f"{what}, by {late_us} µs")
        if at_us > t_device_us - self._wire.limits.lead_us // 2:
            self._wire.note_late()

    def require_frames_in_carrier(self, size: int, part: int = 1) -> None:
        """End the case as NOT-OBSERVED unless *size* bytes come in a *part* of a carrier period."""
        fits = self.is_one_moment(size * part)
        require(fits, "no two frames come within one carrier period of this line")

    def is_one_moment(self, size: int) -> bool:
        """Return True if *size* bytes come within one carrier period, whenever the host wants."""
        return self._wire.is_virtual and self._wire.carries(size, self.carrier_us - 1)

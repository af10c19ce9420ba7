"""The output state of a board: armed by the host, and armed again after a timer muted the board."""

from __future__ import annotations

from typing import Final

from haptogram.driver.configuration import SessionConfiguration
from haptogram.driver.line.link import Link
from haptogram.driver.timing.clock import ClockEstimate
from haptogram.errors import ConfigurationError
from haptogram_protocol import messages
from haptogram_protocol.state import MuteReason, OutputState

_TIMEOUTS: Final = (MuteReason.HOLD_EXPIRED, MuteReason.HOST_SILENT)
_AT_ONCE_US: Final = 2_000  # longest time from a request to the latch of the next frame
_REFRESHES: Final = 4  # within the shorter one of the two timers


class Arming:
    """Keeps the output of one board as the host wants it.

    Parameters
    ----------
    link : Link
    clock : ClockEstimate
        Of the board.
    configuration : SessionConfiguration
        Holds the timers that mute the board.
    """

    def __init__(
        self, link: Link, clock: ClockEstimate, configuration: SessionConfiguration
    ) -> None:
        self._link = link
        self._clock = clock
        self._configuration = configuration
        self._wanted = False  # by the caller: a timeout does not change that

    def arm(self) -> OutputState:
        """Allow output; it stays silent until the first frame is latched."""
        self._wanted = True
        return self._link.request(messages.Arm(), messages.ArmReply).state

    def mute(self) -> OutputState:
        """Switch the output off, ahead of everything that waits."""
        self._wanted = False
        return self._mute()

    def disarm(self) -> OutputState:
        """Switch the output off and forbid it."""
        self._wanted = False
        return self._link.request(messages.Disarm(), messages.DisarmReply).state

    def _mute(self) -> OutputState:
        """Send MUTE; return the output state of the reply."""
        return self._link.mute(messages.MuteReply, self._link.timeout_ns).state

    def rearm_if_timed_out(self, first_us: int) -> None:
        """Arm again a board that a timer muted, or would mute before the next frame is latched.

        Parameters
        ----------
        first_us : int
            Time until the first latch of the frames to come.  A hold that runs out before would
            mute the board under the frames on their way, and all of them would be lost.

        Raises
        ------
        ConfigurationError
            If the board is not armed for any other reason.
        """
        status = self._fresh_status()
        if self._wanted and self._hold_ends_before(first_us, status):
            self._mute()
            self.arm()
        elif self._wanted and status.reason in _TIMEOUTS:
            self.arm()
        elif status.state is not OutputState.ARMED:
            raise ConfigurationError(
                f"the board is {status.state.name} ({status.reason.name}); arm it first"
            )

    @property
    def refresh_ns(self) -> int:
        """Time between two frames that keeps both timers of the board from running out."""
        known = self._configuration.known
        return min(known.hold_ms, known.host_timeout_ms) * 1_000_000 // _REFRESHES

    def _fresh_status(self) -> messages.StatusReply:
        """Return the status; ask again if the host was delayed before it read the reply."""
        for _ in range(_REFRESHES):
            asked_ns = self._link.now_ns()
            status = self._link.request(messages.GetStatus(), messages.StatusReply)
            if self._link.now_ns() - asked_ns < self.refresh_ns:
                break
        return status

    def _hold_ends_before(self, first_us: int, status: messages.StatusReply) -> bool:
        """Return True if the current hold may expire before the first frame latches.

        The first frame may come later than planned: by half of *first_us*, or by some
        milliseconds if it is sent at once.
        """
        if status.state is not OutputState.ARMED or not status.counters.latched:
            return False
        known = self._configuration.known
        now_us = self._clock.to_device_us(self._link.now_ns())
        held_us = now_us - messages.unwrap(status.last_latch_us, now_us, 32)
        hold_us, ramp_us = known.hold_ms * 1000, known.ramp_ms * 1000
        wait_us = first_us + max(first_us // 2, min(_AT_ONCE_US, hold_us // 4))
        return hold_us - wait_us < held_us <= hold_us + ramp_us  # later: armed, nothing latched yet

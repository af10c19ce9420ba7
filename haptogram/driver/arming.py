"""A session that keeps the output state of the board: armed, and again after its timers ran out."""

from __future__ import annotations

from typing import Final

from haptogram.driver.session import Session
from haptogram.errors import ConfigurationError
from haptogram_protocol.messages import Arm, ArmReply, Disarm, DisarmReply, StatusReply, unwrap
from haptogram_protocol.state import MuteReason, OutputState

_PAUSES: Final = (MuteReason.HOLD_EXPIRED, MuteReason.HOST_SILENT)
_AT_ONCE_US: Final = 2_000  # from a question to the latch of what is sent upon the answer
_REFRESHES: Final = 4  # within the shorter one of the two timers


class ArmedSession(Session):
    """A session in which output can be allowed, and stays allowed over pauses of the host.

    Parameters and attributes are those of :class:`haptogram.driver.driver.Driver`.
    """

    _armed = False

    def arm(self) -> OutputState:
        """Allow output; it stays silent until the first frame is latched.

        A board mutes itself when it hears no frame for a while.  What is asked of the driver after
        such a pause arms it again, until :meth:`mute` or :meth:`disarm`.
        """
        self._armed = True
        return self._link.request(Arm(), ArmReply).state

    def mute(self) -> OutputState:
        """Switch the output off, ahead of everything that waits."""
        self._armed = False
        return super().mute()

    def disarm(self) -> OutputState:
        """Switch the output off and forbid it."""
        self._armed = False
        return self._link.request(Disarm(), DisarmReply).state

    def _resume(self, first_us: int) -> None:
        """Arm again a board whose timers muted it, or would, while this host had nothing to send.

        Parameters
        ----------
        first_us : int
            How long until the first latch of what comes.  A hold that runs out before would mute
            the board under the frames on their way, and all of them would be lost.

        Raises
        ------
        ConfigurationError
            If it is not armed for any other reason.
        """
        status = self._fresh_status()
        if self._armed and self._hold_ends_before(first_us, status):
            super().mute()
            self.arm()
        elif self._armed and status.reason in _PAUSES:
            self.arm()
        elif status.state is not OutputState.ARMED:
            raise ConfigurationError(
                f"the board is {status.state.name} ({status.reason.name}); arm it first"
            )

    @property
    def _refresh_ns(self) -> int:
        """How often to be heard of, so that neither of the two timers mutes the board."""
        shorter_ms = min(self._config.hold_ms, self._config.host_timeout_ms)
        return shorter_ms * 1_000_000 // _REFRESHES

    def _fresh_status(self) -> StatusReply:
        """Return the status, asked again if this host was held up before it read the answer."""
        for _ in range(_REFRESHES):
            asked_ns = self._link.now_ns()
            status = self.status()
            if self._link.now_ns() - asked_ns < self._refresh_ns:
                break
        return status

    def _hold_ends_before(self, first_us: int, status: StatusReply) -> bool:
        """Tell whether a drive is held now that may not be any more when the first frame latches.

        That may miss its plan: by half the time until then; at once is a few milliseconds.
        """
        if status.state is not OutputState.ARMED or not status.counters.latched:
            return False
        now_us = self.clock.to_device_us(self._link.now_ns())
        held_us = now_us - unwrap(status.last_latch_us, now_us, 32)
        hold_us, ramp_us = self._config.hold_ms * 1000, self._config.ramp_ms * 1000
        wait_us = first_us + max(first_us // 2, min(_AT_ONCE_US, hold_us // 4))
        return hold_us - wait_us < held_us <= hold_us + ramp_us  # later: armed, nothing latched yet

"""The timers that silence a board, and the ramp that they start.  SPEC.md chapters 6 and 12.

Two timers run while the board is armed: the lease, which the host renews, and the hold, which
every latch renews. The one that runs out first begins the ramp; the ramp is over when both run.
"""

from __future__ import annotations

from typing import Final

from haptogram.settings.frozen import dataclass
from haptogram_protocol.messages import Config
from haptogram_protocol.state import MuteReason

NEVER_US: Final = 1 << 62  # deadline of a timer that does not run
FULL_CODE: Final = 255


@dataclass(frozen=True, slots=True)
class Fade:
    """Amplitudes that a ramp leaves at one moment.

    Attributes
    ----------
    share : float
        Of the amplitude code at the beginning of the ramp, 1 down to 0.
    ceiling : int
        Ceiling at the beginning.
    """

    share: float
    ceiling: int = FULL_CODE


@dataclass(slots=True)
class BoardTimer:
    """A timer that runs out at ``deadline_us``."""

    reason: MuteReason
    deadline_us: int = NEVER_US


@dataclass(slots=True)
class BoardRamp:
    """A straight line from the output at its beginning to silence."""

    begins_us: int
    ends_us: int
    ceiling: int

    def fade(self, t_us: int) -> Fade:
        """Return the fade at a moment."""
        left_us = self.ends_us - t_us
        share = left_us / (self.ends_us - self.begins_us) if left_us > 0 else 0.0
        return Fade(share, self.ceiling)


class BoardTimers:
    """Lease and hold of an armed board.

    Parameters
    ----------
    graded : bool
        Whether the board can set amplitudes; if not, every ramp is a hard mute.
    """

    def __init__(self, *, graded: bool) -> None:
        self._graded = graded
        self._lease = BoardTimer(MuteReason.HOST_SILENT)
        self._hold = BoardTimer(MuteReason.HOLD_EXPIRED)
        self.ramp: BoardRamp | None = None

    def disarm(self) -> None:
        """Stop both timers: the output is off anyway."""
        self._lease.deadline_us = self._hold.deadline_us = NEVER_US
        self.ramp = None

    def renew_lease(self, now_us: int, config: Config, unattended_ms: int | None) -> None:
        """Restart the lease; playback has its own, *unattended_ms*."""
        alone_ms = config.host_timeout_ms if unattended_ms is None else unattended_ms
        reason = MuteReason.HOST_SILENT if unattended_ms is None else MuteReason.UNATTENDED
        self._lease.reason, self._lease.deadline_us = reason, now_us + alone_ms * 1000
        self._end_ramp_if_renewed(now_us)

    def latched(self, now_us: int, config: Config) -> None:
        """Restart the hold: a drive was latched."""
        self._hold.deadline_us = now_us + config.hold_ms * 1000
        self._end_ramp_if_renewed(now_us)

    def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
        """Apply the new length to a hold that has not run out."""
        if now_us < self._hold.deadline_us < NEVER_US:
            self._hold.deadline_us = max(now_us, last_latch_us + config.hold_ms * 1000)

    def first(self) -> BoardTimer:
        """Return the timer that runs out first, or has."""
        lease, hold = self._lease, self._hold
        return lease if lease.deadline_us <= hold.deadline_us else hold

    def begin_ramp(self, config: Config) -> BoardRamp:
        """Begin the ramp of the timer that has run out."""
        begins_us = self.first().deadline_us
        ends_us = begins_us + self._ramp_us(config)
        self.ramp = BoardRamp(begins_us, ends_us, config.amplitude_ceiling)
        return self.ramp

    def fade(self, t_us: int) -> Fade | None:
        """Return the fade by the ramp; None: there is none."""
        return None if self.ramp is None else self.ramp.fade(t_us)

    def _end_ramp_if_renewed(self, now_us: int) -> None:
        """End the ramp if all timers, renewed, expire later than *now_us*."""
        if self.ramp is not None and now_us < self.first().deadline_us:
            self.ramp = None

    def _ramp_us(self, config: Config) -> int:
        """Return the length of the ramp in µs; 0 on a board without amplitudes."""
        return config.ramp_ms * 1000 if self._graded else 0

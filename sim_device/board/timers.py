"""The timers that silence a board, and the ramps that they start.  SPEC.md chapters 6 and 12.

Two timers run while the board is armed: the lease, which the host renews, and the hold, which
every latch renews. Output fades from the deadline of a timer to its end. Everything follows from
the two deadlines, so no state of "a ramp is under way" can disagree with them. A ramp keeps the
ceiling that it began below, and what a lower one has cut off since (HG-6.11/6).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

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
    cut : int
        Least ceiling since then.
    """

    share: float
    ceiling: int = FULL_CODE
    cut: int = FULL_CODE


@dataclass(slots=True)
class BoardTimer:
    """Full output until ``deadline_us``, silence from ``end_us`` on."""

    reason: MuteReason
    deadline_us: int = NEVER_US
    end_us: int = NEVER_US
    ceiling: int = FULL_CODE
    cut: int = FULL_CODE

    def restart(
        self, deadline_us: int, ramp_us: int, ceiling: int, reason: MuteReason | None = None
    ) -> None:
        """Renew the timer; a ramp that it began is undone."""
        self.deadline_us, self.end_us = deadline_us, deadline_us + ramp_us
        self.ceiling = self.cut = ceiling
        self.reason = self.reason if reason is None else reason

    def stop(self) -> None:
        """Run no more."""
        self.deadline_us = self.end_us = NEVER_US

    def fade(self, t_us: int) -> Fade | None:
        """Return the fade by the ramp, a straight line; None: it has not begun."""
        if t_us < self.deadline_us:
            return None
        left_us = self.end_us - t_us
        share = left_us / (self.end_us - self.deadline_us) if left_us > 0 else 0.0
        return Fade(share, self.ceiling, self.cut)


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

    def disarm(self) -> None:
        """Stop both timers: the output is off anyway."""
        self._lease.stop()
        self._hold.stop()

    def renew_lease(self, now_us: int, config: Config, unattended_ms: int | None) -> None:
        """Start the lease anew; playback brings its own, *unattended_ms*."""
        alone_ms = config.host_timeout_ms if unattended_ms is None else unattended_ms
        reason = MuteReason.HOST_SILENT if unattended_ms is None else MuteReason.UNATTENDED
        deadline_us = now_us + alone_ms * 1000
        self._lease.restart(deadline_us, self._ramp_us(config), config.amplitude_ceiling, reason)

    def latched(self, now_us: int, config: Config) -> None:
        """Start the hold anew: a drive was latched."""
        self._restart_hold(now_us + config.hold_ms * 1000, config)

    def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
        """Apply new timers to a hold that has not run out; a ramp that has begun is cut off."""
        deadline_us = self._hold.deadline_us
        if now_us < deadline_us < NEVER_US:
            renewed_us = max(now_us, last_latch_us + config.hold_ms * 1000)
            self._restart_hold(renewed_us, config)
        self._hold.cut = min(self._hold.cut, config.amplitude_ceiling)

    def first_deadline(self) -> BoardTimer:
        """Return the timer that runs out first."""
        lease, hold = self._lease, self._hold
        return lease if lease.deadline_us <= hold.deadline_us else hold

    def first_end(self) -> BoardTimer:
        """Return the timer that silences the output first."""
        lease, hold = self._lease, self._hold
        return lease if lease.end_us <= hold.end_us else hold

    def fades(self, t_us: int) -> tuple[Fade, ...]:
        """Return the fade by each ramp that has begun: the least of them is radiated."""
        found = (self._lease.fade(t_us), self._hold.fade(t_us))
        return tuple(fade for fade in found if fade is not None)

    def _restart_hold(self, deadline_us: int, config: Config) -> None:
        self._hold.restart(deadline_us, self._ramp_us(config), config.amplitude_ceiling)

    def _ramp_us(self, config: Config) -> int:
        return config.ramp_ms * 1000 if self._graded else 0

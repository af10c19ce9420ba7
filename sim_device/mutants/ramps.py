"""Boards whose ramps to silence are wrong, alone or two at once.  SPEC.md HG-6.11."""
# ruff: noqa: SLF001 -- a mutant differs from the healthy board inside

from __future__ import annotations

import dataclasses
import math
from typing import Final

from haptogram.acoustics import Drive
from haptogram.records.frame import Evidence
from haptogram_protocol.messages import Config
from haptogram_protocol.state import MuteReason, OutputInput

from ..board.output import BoardOutput
from ..board.registers import radiated_drive_of_registers
from ..board.timers import NEVER_US, BoardTimer, BoardTimers, Fade
from .mutant import Mutant

# --- One ramp --------------------------------------------------------------------------------


class RampSkipped(BoardTimers):
    """Goes off at once where it should fade."""

    def _ramp_us(self, _: Config) -> int:
        return 0


class RampInEightSteps(BoardTimers):
    """Fades in eight steps, however long the ramp is."""

    def fades(self, t_us: int) -> tuple[Fade, ...]:
        """Return the fades, in eighths."""
        return tuple(
            dataclasses.replace(fade, share=math.ceil(8 * fade.share) / 8)
            for fade in super().fades(t_us)
        )


class CeilingBehindTheRamp(BoardOutput):
    """Fades from the latched amplitude, and cuts at the ceiling what the ramp leaves."""

    def _radiate(self, drive: Drive, t_us: int) -> Drive:
        fades = [Fade(fade.share, cut=fade.cut) for fade in self._timers.fades(t_us)]
        ceiling = self.config.amplitude_ceiling
        return radiated_drive_of_registers(drive, self.correction, ceiling, fades)


# --- What is set during a ramp ---------------------------------------------------------------


class RampFollowsConfig(BoardTimers):
    """Gives a ramp that has begun its new length."""

    def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
        """Give every hold its new ramp."""
        super().reconfigure(now_us, last_latch_us, config)
        if self._hold.deadline_us < NEVER_US:
            self._restart_hold(self._hold.deadline_us, config)


class RampOfTheCeilingSetLast(BoardTimers):
    """Fades below the ceiling in force, whatever it was when the ramp began."""

    def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
        """Let the ramp of the hold begin below the new ceiling."""
        super().reconfigure(now_us, last_latch_us, config)
        self._hold.ceiling = self._hold.cut = config.amplitude_ceiling


class RampOfTheLeastCeiling(BoardTimers):
    """Shrinks the whole line of a ramp to a lower ceiling, where it is to be cut off."""

    def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
        """Let the ramp of the hold begin below the least ceiling."""
        super().reconfigure(now_us, last_latch_us, config)
        self._hold.ceiling = self._hold.cut


class RampCutForgotten(BoardTimers):
    """Gives a ramp back what a lower ceiling had cut off, once there is a higher one."""

    def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
        """Keep the ceiling in force alone."""
        super().reconfigure(now_us, last_latch_us, config)
        self._hold.cut = config.amplitude_ceiling


class RampSlopeOfTheLengthSetLast(BoardTimers):
    """Ends a ramp when it was due, with the slope of the ramp_ms in force."""

    _slope_us = 0

    def latched(self, now_us: int, config: Config) -> None:
        """Start the hold, and note the slope."""
        super().latched(now_us, config)
        self._slope_us = self._ramp_us(config)

    def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
        """Note the new slope."""
        super().reconfigure(now_us, last_latch_us, config)
        self._slope_us = self._ramp_us(config)

    def fades(self, t_us: int) -> tuple[Fade, ...]:
        """Return the fades, that of the hold at the slope that was noted."""
        lease, hold = self._lease.fade(t_us), self._hold.fade(t_us)
        if hold is not None:
            left_us = max(0, self._hold.end_us - t_us)
            share = min(1.0, left_us / max(1, self._slope_us))
            hold = dataclasses.replace(hold, share=share)
        return tuple(fade for fade in (lease, hold) if fade is not None)


# --- Two ramps at once -----------------------------------------------------------------------


class RampReasonOfTheFirst(BoardOutput):
    """Names the timer whose ramp began first, whichever ramp has ended."""

    def _time_out(self) -> None:
        self.counters.timeouts += 1
        reason = self._timers.first_deadline().reason
        self._enter(OutputInput.RAMP_ENDED, reason, requested=False)
        self.silence()


class RampReasonOfTheLease(BoardOutput):
    """Names the timer of the host if that has run out, though the ramp of the hold has ended."""

    def _time_out(self) -> None:
        self.counters.timeouts += 1
        lease = self._timers._lease
        timer = lease if lease.deadline_us <= self.now_us else self._timers._hold
        self._enter(OutputInput.RAMP_ENDED, timer.reason, requested=False)
        self.silence()


class _PairedTimers(BoardTimers):
    def _both_fade(self, now_us: int) -> bool:
        """Return True if the ramps of both timers have begun."""
        return max(self._lease.deadline_us, self._hold.deadline_us) <= now_us


class SecondRampMutesNothing(BoardTimers):
    """Waits for the end of the ramp that began first, however soon the other one ends."""

    def first_end(self) -> BoardTimer:
        """Return the timer that runs out first."""
        return self.first_deadline()


class LaterRampMutes(BoardTimers):
    """Goes on until the later one of two ramps at once has ended."""

    def first_end(self) -> BoardTimer:
        """Return the timer that silences the output first, or both."""
        first = super().first_end()
        second = self._hold if first is self._lease else self._lease
        return second if second.deadline_us <= first.end_us else first


class SecondRampOfTheFirstLength(BoardTimers):
    """Gives the lease, renewed during the ramp of the hold, the ramp_ms of that."""

    def renew_lease(self, now_us: int, config: Config, unattended_ms: int | None) -> None:
        """Start the lease anew."""
        super().renew_lease(now_us, config, unattended_ms)
        if self._hold.deadline_us <= now_us < self._hold.end_us < NEVER_US:
            self._lease.end_us = self._lease.deadline_us
            self._lease.end_us += self._hold.end_us - self._hold.deadline_us


class RampOfLeaseGoesOn(_PairedTimers):
    """Leaves the ramp of the lease as it is when a frame comes while that of the hold runs, too."""

    def renew_lease(self, now_us: int, config: Config, unattended_ms: int | None) -> None:
        """Start the lease anew, unless both fade."""
        if not self._both_fade(now_us):
            super().renew_lease(now_us, config, unattended_ms)


class FrameUndoesBothRamps(_PairedTimers):
    """Ends the ramp of the hold, too, when a frame ends that of the lease."""

    def renew_lease(self, now_us: int, config: Config, unattended_ms: int | None) -> None:
        """Start the lease anew, and the hold if both fade."""
        if self._both_fade(now_us):
            self._restart_hold(now_us + config.hold_ms * 1000, config)
        super().renew_lease(now_us, config, unattended_ms)


class LatchUndoesBothRamps(_PairedTimers):
    """Ends the ramp of the lease, too, when a latch ends that of the hold."""

    def latched(self, now_us: int, config: Config) -> None:
        """Start the hold anew, and the lease if both fade."""
        if self._both_fade(now_us):
            deadline_us = now_us + config.host_timeout_ms * 1000
            self._lease.restart(deadline_us, self._ramp_us(config), config.amplitude_ceiling)
        super().latched(now_us, config)


class TimeoutsOfBothRamps(BoardOutput):
    """Counts every timer that has run out in timeouts, also the one whose ramp has not ended."""

    def _time_out(self) -> None:
        timers = (self._timers._lease, self._timers._hold)
        self.counters.timeouts += sum(t.deadline_us <= self.now_us for t in timers) - 1
        super()._time_out()


class UnattendedRampSaysHostSilent(BoardOutput):
    """Mutes with HOST_SILENT where the unattended time ends in the ramp of the hold."""

    def _time_out(self) -> None:
        lease, hold = self._timers._lease, self._timers._hold
        if hold.deadline_us < lease.deadline_us <= self.now_us:
            lease.reason = MuteReason.HOST_SILENT
        super()._time_out()


_WIRE, _SELF = Evidence.WIRE, Evidence.SELF_REPORTED

MUTANTS: Final = (
    Mutant.of(RampSkipped, "HG-6.11/2", _SELF),
    Mutant.of(RampInEightSteps, "HG-6.11/2", _SELF),
    Mutant.of(CeilingBehindTheRamp, "HG-6.11/2", _SELF),
    Mutant.of(RampFollowsConfig, "HG-7.1/3", _WIRE),
    Mutant.of(RampOfTheCeilingSetLast, "HG-6.11/6", _SELF),
    Mutant.of(RampOfTheLeastCeiling, "HG-6.11/6", _SELF),
    Mutant.of(RampCutForgotten, "HG-6.11/6", _SELF),
    Mutant.of(RampSlopeOfTheLengthSetLast, "HG-6.11/6", _SELF),
    Mutant.of(RampReasonOfTheFirst, "HG-6.11/5", _WIRE),
    Mutant.of(RampReasonOfTheLease, "HG-6.11/5", _WIRE),
    Mutant.of(SecondRampMutesNothing, "HG-6.11/5", _WIRE),
    Mutant.of(LaterRampMutes, "HG-6.11/5", _WIRE),
    Mutant.of(SecondRampOfTheFirstLength, "HG-6.11/5", _WIRE),
    Mutant.of(TimeoutsOfBothRamps, "HG-6.11/5", _SELF),
    Mutant.of(UnattendedRampSaysHostSilent, "HG-6.11/5", _WIRE),
    Mutant.of(RampOfLeaseGoesOn, "HG-6.11/4", _WIRE),
    Mutant.of(FrameUndoesBothRamps, "HG-6.11/4", _WIRE),
    Mutant.of(LatchUndoesBothRamps, "HG-6.11/4", _WIRE),
)

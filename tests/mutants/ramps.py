"""Boards whose ramps to silence are wrong.  SPEC.md HG-6.11."""
# ruff: noqa: SLF001 -- a mutant differs from the healthy board inside

from __future__ import annotations

import dataclasses
import math
from typing import Final

from haptogram.acoustics import Drive
from haptogram.records.frame import Evidence
from haptogram_protocol.messages import Config
from haptogram_protocol.state import MuteReason, OutputInput
from sim_device.board.output import BoardOutput
from sim_device.board.registers import radiated_drive_of_registers
from sim_device.board.timers import BoardRamp, BoardTimers, Fade
from sim_device.mutants import Mutant

# --- One ramp --------------------------------------------------------------------------------


class RampSkipped(BoardTimers):
    """Goes off at once where it should fade."""

    def _ramp_us(self, _: Config) -> int:
        return 0


class RampInEightSteps(BoardTimers):
    """Fades in eight steps, however long the ramp is."""

    def fade(self, t_us: int) -> Fade | None:
        """Return the fade, in eighths."""
        fade = super().fade(t_us)
        return fade and dataclasses.replace(fade, share=math.ceil(8 * fade.share) / 8)


class CeilingBehindTheRamp(BoardOutput):
    """Fades from the latched amplitude, and cuts at the ceiling what the ramp leaves."""

    def _radiate(self, drive: Drive, t_us: int) -> Drive:
        fade, ceiling = self._timers.fade(t_us), self.config.amplitude_ceiling
        return radiated_drive_of_registers(
            drive, self.correction, ceiling, fade and Fade(fade.share)
        )


# --- What is set during a ramp ---------------------------------------------------------------


class RampFollowsConfig(BoardTimers):
    """Gives a ramp that has begun its new length."""

    def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
        """Give the ramp its new end."""
        super().reconfigure(now_us, last_latch_us, config)
        if self.ramp is not None:
            self.ramp.ends_us = self.ramp.begins_us + self._ramp_us(config)


class RampOfTheCeilingSetLast(BoardTimers):
    """Fades below the ceiling in force, whatever it was when the ramp began."""

    def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
        """Let the ramp begin below the new ceiling."""
        super().reconfigure(now_us, last_latch_us, config)
        if self.ramp is not None:
            self.ramp.ceiling = config.amplitude_ceiling


class RampOfTheLeastCeiling(BoardTimers):
    """Shrinks the whole line of a ramp to a lower ceiling, where it is to be cut off."""

    def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
        """Let the ramp begin below the least ceiling."""
        super().reconfigure(now_us, last_latch_us, config)
        if self.ramp is not None:
            self.ramp.ceiling = min(self.ramp.ceiling, config.amplitude_ceiling)


class RampSlopeOfTheLengthSetLast(BoardTimers):
    """Ends a ramp when it was due, with the slope of the ramp_ms in force."""

    _slope_us = 0

    def begin_ramp(self, config: Config) -> BoardRamp:
        """Begin the ramp, and note its slope."""
        self._slope_us = self._ramp_us(config)
        return super().begin_ramp(config)

    def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
        """Note the new slope."""
        super().reconfigure(now_us, last_latch_us, config)
        self._slope_us = self._ramp_us(config)

    def fade(self, t_us: int) -> Fade | None:
        """Return the fade, at the slope that was noted."""
        if self.ramp is None:
            return None
        left_us = max(0, self.ramp.ends_us - t_us)
        return Fade(min(1.0, left_us / max(1, self._slope_us)), self.ramp.ceiling)


# --- Two timers that have run out --------------------------------------------------------------


class RampReasonOfItsBeginning(BoardOutput):
    """Names the timer that began the ramp, though it was renewed since."""

    _reason = MuteReason.NONE

    def _begin_ramp(self) -> None:
        self._reason = self._timers.first().reason
        super()._begin_ramp()

    def _time_out(self) -> None:
        self.counters.timeouts += 1
        self._enter(OutputInput.RAMP_ENDED, self._reason, requested=False)
        self.silence()


class RampReasonOfTheLease(BoardOutput):
    """Names the timer of the host if that has run out, though the hold did before."""

    def _time_out(self) -> None:
        self.counters.timeouts += 1
        lease = self._timers._lease
        timer = lease if lease.deadline_us <= self.now_us else self._timers._hold
        self._enter(OutputInput.RAMP_ENDED, timer.reason, requested=False)
        self.silence()


class _PairedTimers(BoardTimers):
    def _both_are_out(self, now_us: int) -> bool:
        return max(self._lease.deadline_us, self._hold.deadline_us) <= now_us


class FrameEndsRampOfBoth(_PairedTimers):
    """Ends the ramp when a frame renews the lease, though the hold has run out."""

    def renew_lease(self, now_us: int, config: Config, unattended_ms: int | None) -> None:
        """Start the lease anew, and the hold if both are out."""
        if self._both_are_out(now_us):
            self._hold.deadline_us = now_us + config.hold_ms * 1000
        super().renew_lease(now_us, config, unattended_ms)


class LatchEndsRampOfBoth(_PairedTimers):
    """Ends the ramp when a latch renews the hold, though the lease has run out."""

    def latched(self, now_us: int, config: Config) -> None:
        """Start the hold anew, and the lease if both are out."""
        if self._both_are_out(now_us):
            self._lease.deadline_us = now_us + config.host_timeout_ms * 1000
        super().latched(now_us, config)


class TimeoutsOfBothTimers(BoardOutput):
    """Counts every timer that has run out in timeouts, also the one that did not begin the ramp."""

    def _time_out(self) -> None:
        timers = (self._timers._lease, self._timers._hold)
        self.counters.timeouts += sum(t.deadline_us <= self.now_us for t in timers) - 1
        super()._time_out()


_WIRE, _SELF = Evidence.WIRE, Evidence.SELF_REPORTED

MUTANTS: Final = (
    Mutant.of(RampSkipped, "HG-6.11/2", _SELF),
    Mutant.of(RampInEightSteps, "HG-6.11/2", _SELF),
    Mutant.of(CeilingBehindTheRamp, "HG-6.11/2", _SELF),
    Mutant.of(RampFollowsConfig, "HG-7.1/3", _WIRE),
    Mutant.of(RampOfTheCeilingSetLast, "HG-6.11/6", _SELF),
    Mutant.of(RampOfTheLeastCeiling, "HG-6.11/6", _SELF),
    Mutant.of(RampSlopeOfTheLengthSetLast, "HG-6.11/6", _SELF),
    Mutant.of(RampReasonOfItsBeginning, "HG-6.11/4", _WIRE),
    Mutant.of(RampReasonOfTheLease, "HG-6.11/5", _WIRE),
    Mutant.of(TimeoutsOfBothTimers, "HG-6.11/5", _SELF),
    Mutant.of(FrameEndsRampOfBoth, "HG-6.11/4", _WIRE),
    Mutant.of(LatchEndsRampOfBoth, "HG-6.11/4", _WIRE),
)

"""Boards that are not safe, whose clock is wrong, or whose transducers are.  SPEC.md 5, 6."""
# ruff: noqa: SLF001 -- a mutant differs from the healthy board inside

from __future__ import annotations

import bisect
import dataclasses
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from haptogram.acoustics import Drive
from haptogram.records.frame import Evidence
from haptogram_protocol.messages import Config, ErrorCode
from haptogram_protocol.state import MuteReason, OutputState
from sim_device.board.board import Board
from sim_device.board.clock import BoardClock
from sim_device.board.events import StateChange
from sim_device.board.output import BoardOutput
from sim_device.board.refusal import RefusalError
from sim_device.board.registers import radiated_drive_of_registers
from sim_device.board.timers import FULL_CODE, BoardTimers, Fade
from sim_device.dialects.haptogram import VirtualHaptogramDialect
from sim_device.mutants import Mutant

_WRAP: Final = 2**32
_JUMP_EVERY_US: Final = 500_000
_JUMP_US: Final = 2_000


class ArmedAtBoot(Board):
    """Is armed after power-up, and stays so through the first HELLO."""

    _booting = True

    def open_session(self, nonce: int) -> None:
        """Begin a session."""
        super().open_session(nonce)
        if self._booting:
            self._booting = False
            self.output.state, self.output.reason = OutputState.ARMED, MuteReason.NONE


class MuteOfOthersIgnored(Board):
    """Answers MUTE without a session of the host, and does nothing."""

    def mute(self, *, requested: bool = True) -> None:
        """Mute, if the host of the session asks."""
        if requested:
            super().mute(requested=requested)


class MuteKeepsQueue(Board):
    """Leaves frames in the queue when it is muted."""

    def mute(self, *, requested: bool = True) -> None:
        """Mute, and put back what was queued."""
        entries = list(self._queue._entries)
        flushed = self.output.counters.flushed
        super().mute(requested=requested)
        self._queue._entries.extend(entries)
        self.output.counters.flushed = flushed

    def _next_due(self) -> Any:
        return super()._next_due() if self.output.state is OutputState.ARMED else None


class MuteReasonKept(BoardOutput):
    """Keeps the reason of the timer that had muted it when MUTE comes."""

    def mute(self, *, requested: bool = True) -> None:
        """Mute, and remember who was first."""
        state, reason = self.state, self.reason
        super().mute(requested=requested)
        if state is OutputState.MUTED:
            self.reason = reason


class MuteTakesTheFault(BoardOutput):
    """Says in FAULT that MUTE switched it off."""

    def mute(self, *, requested: bool = True) -> None:
        """Mute, and forget the fault."""
        super().mute(requested=requested)
        self.reason = MuteReason.MUTE


class DisarmTakesTheReason(BoardOutput):
    """Says that DISARM switched it off when it was muted before."""

    def disarm(self) -> None:
        """Disarm, and forget who was first."""
        super().disarm()
        self.reason = MuteReason.DISARM


class DisarmIgnored(Board):
    """Answers DISARM and does nothing."""

    def disarm(self) -> None:
        """Do nothing."""


class ArmLeavesFullOutput(BoardOutput):
    """Sounds at once when it is armed again: with the last drive."""

    def arm(self) -> None:
        """Arm, and sound."""
        super().arm()
        self._sounding = self.latched is not None


class SoundsInMuted(BoardOutput):
    """Goes on sounding when MUTE is carried out."""

    def radiated(self, t_us: int) -> Drive:
        """Return the last drive, whatever the state."""
        return self._radiate(self.latched.drive, t_us) if self.latched else self._silence


class SilenceKeepsPhases(BoardOutput):
    """Clears only the amplitudes of what it radiates while its output is off."""

    def radiated(self, t_us: int) -> Drive:
        """Return the drive, in silence with the phase correction."""
        drive = super().radiated(t_us)
        if drive.amplitude_codes.any():
            return drive
        phases = np.frombuffer(self.correction, np.uint8)
        return Drive(phases.copy(), drive.amplitude_codes)


class WatchdogTooSlow(BoardTimers):
    """Misses the host after three times the time that was set."""

    def renew_lease(self, now_us: int, config: Config, unattended_ms: int | None) -> None:
        """Start the lease anew, three times as long."""
        slow = dataclasses.replace(config, host_timeout_ms=3 * config.host_timeout_ms)
        super().renew_lease(now_us, slow, unattended_ms)


class TimeoutsUncounted(BoardOutput):
    """Does not count mutes by a timer."""

    def _time_out(self) -> None:
        counted = self.counters.timeouts
        super()._time_out()
        self.counters.timeouts = counted


class StateChangeUnsaid(VirtualHaptogramDialect):
    """Sends no STATE_CHANGED when a timer mutes it."""

    def collect(self) -> None:
        """Take what the board did, and keep changes of its state to itself."""
        for k, notice in enumerate(self.board.output._new_notices):
            if isinstance(notice, StateChange):
                self.board.output._new_notices[k] = dataclasses.replace(notice, requested=True)
        super().collect()


class FaultRefusesSettings(VirtualHaptogramDialect):
    """Takes no configuration while the hardware reports a fault."""

    def _set_config(self, message: Any, request: Any) -> Any:
        state = self.board.output.state
        if state is OutputState.FAULT:
            raise RefusalError(ErrorCode.BAD_STATE, int(state))
        return super()._set_config(message, request)


class CeilingIgnored(BoardOutput):
    """Radiates amplitudes above the ceiling."""

    def _radiate(self, drive: Drive, t_us: int) -> Drive:
        fade = self._timers.fade(t_us)
        fade = None if fade is None else Fade(fade.share)
        return radiated_drive_of_registers(drive, self.correction, FULL_CODE, fade)


class CorrectionIgnored(BoardOutput):
    """Radiates without the phase correction."""

    def _radiate(self, drive: Drive, t_us: int) -> Drive:
        none, ceiling = bytes(self.settings.count), self.config.amplitude_ceiling
        return radiated_drive_of_registers(drive, none, ceiling, self._timers.fade(t_us))


class ClockLosesTheWrap(VirtualHaptogramDialect):
    """Compares times as plain 32-bit numbers: what lies behind the wrap has long passed."""

    def _unwrap(self, t_wire_us: int | None) -> int | None:
        return None if t_wire_us is None else self.board.output.now_us // _WRAP * _WRAP + t_wire_us


@dataclass(frozen=True, slots=True)
class ClockFast(BoardClock):
    """Its clock is fast by 500 ppm; it says 50 at most."""

    ppm: int = 500


class DeadElement(BoardOutput):
    """Transducer 0 is silent, and the board does not know."""

    def sounded(self, radiated: Drive) -> Drive:
        amplitudes = radiated.amplitude_codes.copy()
        amplitudes[0] = 0
        return Drive(radiated.phase_codes, amplitudes)


class OutputsReversed(BoardOutput):
    """Transducer n is driven by the codes of transducer N - 1 - n."""

    def sounded(self, radiated: Drive) -> Drive:
        return Drive(radiated.phase_codes[::-1].copy(), radiated.amplitude_codes[::-1].copy())


_WIRE, _SELF, _EXTERNAL, _ = Evidence


class WatchdogMissing(BoardOutput):
    """Never misses the host: the lease does not run."""

    def renew_lease(self) -> None:
        """Do nothing."""


class ClockSteps(BoardClock):
    """Its clock jumps ahead by 2 ms every 500 ms."""

    def device_us(self, t_ns: int) -> int:
        """Return the reading of the clock at *t_ns*."""
        return self._with_jumps(super().device_us(t_ns))

    def reached_ns(self, device_us: int) -> int:
        """Return the first time at which it shows *device_us* or more."""
        shown_us = range(self.boot_us, device_us)  # without a jump, and so too late
        place = bisect.bisect_left(shown_us, device_us, key=self._with_jumps)
        return super().reached_ns(min(device_us, self.boot_us + place))

    def _with_jumps(self, steady_us: int) -> int:
        """Add the clock steps to a steady time."""
        jumps = max(0, steady_us - self.boot_us) // _JUMP_EVERY_US
        return steady_us + jumps * _JUMP_US


MUTANTS: Final = (
    Mutant.of(WatchdogMissing, "HG-12.2/1", _WIRE),
    Mutant.of(ClockSteps, "HG-6.9/1", _WIRE),
    Mutant.of(FaultRefusesSettings, "HG-6.2/1", _WIRE),
    Mutant.of(SilenceKeepsPhases, "HG-8.6/4", _SELF),
    Mutant.of(ArmedAtBoot, "HG-6.1/1", _WIRE),
    Mutant.of(MuteOfOthersIgnored, "HG-6.4/1", _WIRE),
    Mutant.of(MuteKeepsQueue, "HG-6.4/2", _SELF),
    Mutant.of(MuteReasonKept, "HG-6.4/4", _SELF),
    Mutant.of(MuteTakesTheFault, "HG-6.2/3", _SELF),
    Mutant.of(DisarmTakesTheReason, "HG-6.2/3", _SELF),
    Mutant.of(DisarmIgnored, "HG-6.2/1", _WIRE),
    Mutant.of(ArmLeavesFullOutput, "HG-6.3/1", _SELF),
    Mutant.of(SoundsInMuted, "HG-6.6/2", _SELF),
    Mutant.of(WatchdogTooSlow, "HG-12.2/1", _WIRE),
    Mutant.of(TimeoutsUncounted, "HG-6.11/5", _SELF),
    Mutant.of(StateChangeUnsaid, "HG-6.8/1", _WIRE),
    Mutant.of(CeilingIgnored, "HG-7.9/2", _SELF),
    Mutant.of(CorrectionIgnored, "HG-7.9/1", _SELF),
    Mutant.of(ClockLosesTheWrap, "HG-3.6/1", _SELF),
    Mutant.of(ClockFast, "HG-6.9/1", _WIRE),
    Mutant.of(DeadElement, "HG-5.3/2", _EXTERNAL),
    Mutant.of(OutputsReversed, "HG-5.8/2", _EXTERNAL),
)

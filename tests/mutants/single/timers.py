"""Boards that are wrong for one timer, length or playback.  SPEC.md 7 to 12."""
# ruff: noqa: SLF001 -- a mutant differs from the healthy board inside

from __future__ import annotations

import dataclasses
from typing import Any, Final

from haptogram.acoustics import Drive
from haptogram.records.frame import Evidence
from haptogram_protocol.messages import (
    Arm,
    Config,
    ErrorCode,
    LatchKey,
    Message,
    TraceDrive,
)
from sim_device.board.board import Board
from sim_device.board.counters import Drop
from sim_device.board.output import BoardOutput
from sim_device.board.playback import BoardPlayback
from sim_device.board.refusal import RefusalError
from sim_device.board.registers import radiated_drive_of_registers
from sim_device.board.stream_queue import StreamFrame
from sim_device.board.timers import NEVER_US, BoardRamp, BoardTimers, Fade
from sim_device.dialects.haptogram import VirtualHaptogramDialect
from sim_device.mutants import Mutant

_MASK_32: Final = 0xFFFFFFFF

# --- Lengths of which too few bits are kept ----------------------------------------------------


def _mutant_timer_ms(length_ms: int, unit_us: int, bits: int) -> int:
    """Return a length in ms of which so many bits of units are left."""
    return ((length_ms * 1000 // unit_us) & ((1 << bits) - 1)) * unit_us // 1000


def _named(part: type[BoardTimers], name: str, doc: str) -> type[BoardTimers]:
    """Return *part* as if this module had defined it under *name*."""
    part.__name__ = part.__qualname__ = name
    part.__doc__ = doc
    return globals().setdefault(name, part)


def _mutant_timer_of_width(field: str, unit_us: int, bits: int) -> type[BoardTimers]:
    """Return timers that keep one length in so many bits of a unit."""

    class OfWidth(BoardTimers):
        def renew_lease(self, now_us: int, config: Config, unattended_ms: int | None) -> None:
            if unattended_ms is not None and field == "unattended_ms":
                unattended_ms = _mutant_timer_ms(unattended_ms, unit_us, bits)
            super().renew_lease(now_us, _narrowed(config), unattended_ms)

        def latched(self, now_us: int, config: Config) -> None:
            super().latched(now_us, _narrowed(config))

        def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
            super().reconfigure(now_us, last_latch_us, _narrowed(config))

        def begin_ramp(self, config: Config) -> BoardRamp:
            return super().begin_ramp(_narrowed(config))

    def _narrowed(config: Config) -> Config:
        if field not in Config.WIRE:
            return config
        lengths: dict[str, Any] = {field: _mutant_timer_ms(getattr(config, field), unit_us, bits)}
        return dataclasses.replace(config, **lengths)

    words = "".join(word.capitalize() for word in field.removesuffix("_ms").split("_"))
    doc = f"Keeps {field} in {bits} bits of {unit_us} µs."
    return _named(OfWidth, f"{words}Of{bits}BitsOf{unit_us}Us", doc)


_WIDTHS: Final = {
    ("hold_ms", "HG-12.3/1"): ((100, 16), (1000, 12), (1, 16)),
    ("host_timeout_ms", "HG-12.2/1"): ((100, 16), (1000, 12), (10, 16)),
    ("ramp_ms", "HG-6.11/2"): ((1000, 8), (1000, 10), (10, 16)),
    ("unattended_ms", "HG-7.6/5"): ((1000, 16), (100, 16), (1000, 15)),
}


def _mutant_ramp_on_counter(unit_us: int) -> type[BoardTimers]:
    """Return timers that measure a ramp by a counter of 16 bits; its end is right."""

    class OnCounter(BoardTimers):
        def fade(self, t_us: int) -> Fade | None:
            fade, ramp = super().fade(t_us), self.ramp
            if fade is None or ramp is None or fade.share <= 0:
                return fade
            passed_us = ((t_us - ramp.begins_us) // unit_us & 0xFFFF) * unit_us
            share = 1 - passed_us / (ramp.ends_us - ramp.begins_us)
            return dataclasses.replace(fade, share=share)

    doc = f"Starts a ramp anew whenever a 16-bit counter of {unit_us} µs wraps in it."
    return _named(OnCounter, f"RampOn16BitCounterOf{unit_us}Us", doc)


# --- Timers ------------------------------------------------------------------------------------


class ArmRenewsHold(BoardOutput):
    """Starts the hold anew with ARM while it is ARMED."""

    def arm(self) -> None:
        """Arm, and start the hold anew."""
        super().arm()
        if self._sounding:
            self._timers.latched(self.now_us, self.config)


class StopRenewsHold(Board):
    """Starts the hold anew when a playback is stopped or ends."""

    def stop(self) -> None:
        """Stop, and start the hold anew."""
        plays = self._playback is not None
        super().stop()
        if plays and self.output._sounding:
            self.output._timers.latched(self.output.now_us, self.output.config)


class LatchRenewsLease(BoardOutput):
    """Starts the lease anew with every latch of the stream."""

    def latch(self, key: LatchKey, drive: Drive, bits: int, **more: Any) -> None:
        """Latch, and start the lease anew."""
        super().latch(key, drive, bits, **more)
        if key.sequence == 0:
            self.renew_lease()


class PlaybackRenewsUnattended(BoardOutput):
    """Starts the unattended time anew with every latch of a playback."""

    def latch(self, key: LatchKey, drive: Drive, bits: int, **more: Any) -> None:
        """Latch, and start the unattended time anew."""
        super().latch(key, drive, bits, **more)
        if key.sequence:
            self.renew_lease()


class HoldOutlivesMute(BoardTimers):
    """Lets the hold run on when the output is switched off."""

    def disarm(self) -> None:
        """Stop the lease alone."""
        self._lease.deadline_us = NEVER_US


class ConfigSparesHold(BoardTimers):
    """Gives a hold that runs no new length."""

    def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
        """Do nothing."""


class ConfigRestartsHold(BoardTimers):
    """Starts a hold that runs anew with SET_CONFIG."""

    def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
        """Let the hold run from now on."""
        super().reconfigure(now_us, max(now_us, last_latch_us), config)


class HoldTakenUpByConfig(BoardTimers):
    """Starts the hold with SET_CONFIG though it was stopped, if its time is not over."""

    _stopped_us = 0

    def disarm(self) -> None:
        """Stop both timers, and remember the hold."""
        self._stopped_us = self._hold.deadline_us
        super().disarm()

    def reconfigure(self, now_us: int, last_latch_us: int, config: Config) -> None:
        """Apply new timers to a hold that was stopped too."""
        if now_us < self._stopped_us < NEVER_US:
            self._hold.deadline_us = self._stopped_us
        super().reconfigure(now_us, last_latch_us, config)


class RequestsRestartStatus(VirtualHaptogramDialect):
    """Starts the status period anew with ARM."""

    def _reply_to(self, message: Message, request: Any) -> Message:
        reply = super()._reply_to(message, request)
        if isinstance(message, Arm):
            self._schedule_status()
        return reply


class CeilingFromNextLatch(BoardOutput):
    """Puts a new ceiling in force with the next latch."""

    _ceiling = 255

    def latch(self, key: LatchKey, drive: Drive, bits: int, **more: Any) -> None:
        """Latch, under the ceiling that is set now."""
        self._ceiling = self.config.amplitude_ceiling
        super().latch(key, drive, bits, **more)

    def _radiate(self, drive: Drive, t_us: int) -> Drive:
        return radiated_drive_of_registers(
            drive, self.correction, self._ceiling, self._timers.fade(t_us)
        )


# --- Playback ----------------------------------------------------------------------------------


class _Due32(BoardPlayback):
    @property
    def due_us(self) -> int:
        return self.start_us + (self.played * self.period_us & _MASK_32)


class _Loops32(BoardPlayback):
    @property
    def is_over(self) -> bool:
        return self.loops > 0 and self.played >= self.loops * len(self.frames) & _MASK_32


class _PlaybackOf(Board):
    _kind: type[BoardPlayback]

    def play(self, sequence: int, **more: Any) -> None:
        super().play(sequence, **more)
        if (healthy := self._playback) is not None:
            values = {f.name: getattr(healthy, f.name) for f in dataclasses.fields(BoardPlayback)}
            self._playback = self._kind(**values)


class PlaybackDueOf32Bits(_PlaybackOf):
    """Computes the time of a frame within a playback in 32 bits."""

    _kind = _Due32


class LoopsOf32Bits(_PlaybackOf):
    """Computes the frames of all loops in 32 bits."""

    _kind = _Loops32


class PlayStartOnOneSide(VirtualHaptogramDialect):
    """Takes the start of PLAY for one before the wrap of the clock, until the clock has wrapped."""

    def _play(self, play: Any, request: Any) -> Message:
        start_us = None if request.immediate else self._unwrap(request.t_wire_us)
        if start_us is not None and start_us >> 32 != self.board.output.now_us >> 32:
            raise RefusalError(ErrorCode.BAD_VALUE, 0)
        return super()._play(play, request)


class WaitingPlaybackHasLease(Board):
    """Lets the lease run on until the start of a playback."""

    def play(self, sequence: int, **more: Any) -> None:
        """Play, and go on with the lease if the start lies ahead."""
        super().play(sequence, **more)
        if self._playback is not None and not self._playback.played:
            self.output.unattended_ms = None
            self.output.renew_lease()

    def _latch_playback(self) -> None:
        super()._latch_playback()
        if self._playback is not None and self._playback.played == 1:
            self.output.unattended_ms = self._playback.unattended_ms
            self.output.renew_lease()


class WaitingPlaybackEndsSilently(Board):
    """Sends no PLAYBACK_ENDED for a playback that ends before its start."""

    def _end_playback(self) -> None:
        waits = self._playback is not None and not self._playback.played
        super()._end_playback()
        if waits:
            self.output._new_notices.pop()


# --- Evidence ----------------------------------------------------------------------------------


class TraceDriveUnderCeiling(VirtualHaptogramDialect):
    """Shows amplitudes under the ceiling in TRACE_DRIVE."""

    def _trace_message(self, latch: Any) -> Message | None:
        message = super()._trace_message(latch)
        if not isinstance(message, TraceDrive):
            return message
        half, ceiling = len(message.data) // 2, self.board.output.config.amplitude_ceiling
        amplitudes = bytes(min(code, ceiling) for code in message.data[half:])
        return dataclasses.replace(message, data=message.data[:half] + amplitudes)


class ArmRestartsDivision(VirtualHaptogramDialect):
    """Begins to count latches for trace_divider anew with ARM."""

    def _reply_to(self, message: Message, request: Any) -> Message:
        if isinstance(message, Arm):
            self._traced = 0
        return super()._reply_to(message, request)


class MarginSumOf32Bits(Board):
    """Adds up arrival margins in 32 bits."""

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        dropped = super()._refuse(frame)
        total_us = self.margins.total_us & _MASK_32
        self.margins.total_us = total_us - (total_us >> 31 << 32)
        return dropped


_WIRE, _SELF, *_ = Evidence

MUTANTS: Final = (
    *(
        Mutant.of(_mutant_timer_of_width(field, unit_us, bits), clause, _WIRE)
        for (field, clause), widths in _WIDTHS.items()
        for unit_us, bits in widths
    ),
    *(Mutant.of(_mutant_ramp_on_counter(unit_us), "HG-6.11/2", _SELF) for unit_us in (1, 4, 8, 16)),
    Mutant.of(ArmRenewsHold, "HG-12.3/1", _WIRE),
    Mutant.of(StopRenewsHold, "HG-12.3/1", _WIRE),
    Mutant.of(LatchRenewsLease, "HG-12.2/1", _WIRE),
    Mutant.of(PlaybackRenewsUnattended, "HG-12.2/1", _WIRE),
    Mutant.of(HoldOutlivesMute, "HG-6.4/2", _SELF),
    Mutant.of(ConfigSparesHold, "HG-7.1/3", _WIRE),
    Mutant.of(ConfigRestartsHold, "HG-7.1/3", _WIRE),
    Mutant.of(HoldTakenUpByConfig, "HG-12.2/2", _WIRE),
    Mutant.of(RequestsRestartStatus, "HG-9.1/1", _WIRE),
    Mutant.of(CeilingFromNextLatch, "HG-7.1/3", _SELF),
    Mutant.of(PlaybackDueOf32Bits, "HG-7.6/4", _SELF),
    Mutant.of(LoopsOf32Bits, "HG-7.6/4", _SELF),
    Mutant.of(PlayStartOnOneSide, "HG-3.6/1", _WIRE),
    Mutant.of(WaitingPlaybackHasLease, "HG-7.6/5", _WIRE),
    Mutant.of(WaitingPlaybackEndsSilently, "HG-7.7/1", _WIRE),
    Mutant.of(TraceDriveUnderCeiling, "HG-8.3/2", _SELF),
    Mutant.of(ArmRestartsDivision, "HG-8.4/1", _SELF),
    Mutant.of(MarginSumOf32Bits, "HG-9.3/1", _SELF),
)

"""Boards that reckon wrongly with the time until a latch.  SPEC.md HG-5.7, HG-8.3."""
# ruff: noqa: SLF001 -- a mutant differs from the healthy board inside

from __future__ import annotations

import dataclasses
from typing import Any, Final

from haptogram.acoustics import Drive
from haptogram.records.frame import Evidence
from sim_device.board.board import Board
from sim_device.board.counters import Drop
from sim_device.board.registers import Content
from sim_device.board.settings import BoardSettings
from sim_device.board.stream_queue import QueueEntry, StreamFrame
from sim_device.dialects.haptogram import VirtualHaptogramDialect
from sim_device.mutants import Mutant

from .replies import LyingMutant

_LEAD_US: Final = 200
_POINT_US: Final = 300


class LeadTooLong(LyingMutant):
    """Advertises a lead that is longer than any host has to expect."""

    def lie(self, _: Any) -> dict[str, Any]:
        """Return a long lead."""
        return {"latch_lead_us": 200_000}


class LatchedBeforeItsLead(LyingMutant):
    """Advertises a lead and latches without it."""

    def lie(self, _: Any) -> dict[str, Any]:
        """Return a lead."""
        return {"latch_lead_us": _LEAD_US}


class _Slow(Board):
    """Needs 200 µs to latch, and 300 µs more for each focal point."""

    def __init__(self, settings: BoardSettings, *parts: Any) -> None:
        slow = dataclasses.replace(settings, latch_lead_us=_LEAD_US, point_time_us=_POINT_US)
        super().__init__(slow, *parts)

    def _lead_us(self, content: Content) -> int:
        """Return the time that the frame needs after its arrival, if it is the only one."""
        return super()._ready_us(content) - max(self.output.now_us, self._computed_us)


class ComputesAllAtOnce(_Slow):
    """Reckons as if it computed every frame from its arrival on, however many there are."""

    def _ready_us(self, content: Content) -> int:
        return self.output.now_us + self._lead_us(content)


class LatenessFromArrival(_Slow):
    """Drops as late only what arrives after its t_apply."""

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        dropped = super()._refuse(frame)
        late_us = 0 if frame.t_apply_us is None else self.output.now_us - frame.t_apply_us
        in_time = dropped is Drop.LATE and late_us <= self.output.config.late_window_us
        return None if in_time else dropped


class MarginFromArrival(_Slow):
    """Reports margins up to the arrival of frames, not up to when they are ready."""

    def _refuse(self, frame: StreamFrame) -> Drop | None:
        ready_us = self._ready_us(frame.content)
        count = self.margins.count
        dropped = super()._refuse(frame)
        if self.margins.count > count:
            self.margins.least_us += ready_us - self.output.now_us
            self.margins.total_us += ready_us - self.output.now_us
        return dropped


class PlaysUnready(_Slow):
    """Takes a PLAY whose first frame cannot be ready at its start."""

    def _check_play(self, start_us: int | None, ready_us: int, unattended_ms: int) -> None:
        super()._check_play(start_us, min(ready_us, self.output.now_us), unattended_ms)


class PlaysFasterThanItComputes(_Slow):
    """Takes a period that is too short to compute the points of a frame."""

    def _check_period(self, period_us: int, content: Content) -> None:
        drive = content if isinstance(content, Drive) else content[:0]
        super()._check_period(period_us, drive)


class ImmediateNotAccepted(Board):
    """Leaves frames that are latched as soon as complete out of `accepted`."""

    def submit(self, frame: StreamFrame) -> Drop | None:
        """Queue a frame."""
        accepted = self.output.counters.accepted
        dropped = super().submit(frame)
        if frame.t_apply_us is None:
            self.output.counters.accepted = accepted
        return dropped


class StatusOfTwoMoments(VirtualHaptogramDialect):
    """Reports how many frames wait as it was at the status before."""

    _queued_before = 0

    def _status(self) -> Any:
        fields = super()._status()
        queued, self._queued_before = self._queued_before, fields[2]
        return (*fields[:2], queued, *fields[3:])


class LateLatchesUnsaid(Board):
    """Takes drives 100 µs after their time and reports the time that was scheduled."""

    _late_us = 100

    def _entry(self, frame: StreamFrame) -> QueueEntry:
        entry = super()._entry(frame)
        return dataclasses.replace(entry, t_latch_us=entry.t_latch_us + self._late_us)

    def _latch_stream(self) -> None:
        super()._latch_stream()
        latch = self.output._new_latches[-1]
        told = dataclasses.replace(latch, t_latch_us=latch.t_latch_us - self._late_us)
        self.output.latched = self.output._new_latches[-1] = told


class StatusOfTheSchedule(VirtualHaptogramDialect):
    """Reports in `last_latch_us` the time for which the last drive was meant."""

    def _stream(self, event: Any) -> None:
        self._meant_us = event.t_apply_us
        super()._stream(event)

    _meant_us: int | None = None

    def _status(self) -> Any:
        fields = super()._status()
        told = fields[5] if self._meant_us is None else self._meant_us
        return (*fields[:5], told, *fields[6:])


class LateByLessIsInTime(Board):
    """Takes a frame for one in time that is late by less than a carrier period."""

    def _entry(self, frame: StreamFrame) -> QueueEntry:
        entry = super()._entry(frame)
        late_us = entry.t_ready_us - entry.t_apply_us
        return dataclasses.replace(entry, late=late_us >= self.settings.carrier_us)


class LateLatchIsNotLast(Board):
    """Keeps in `last_seq` the last frame that was latched in time."""

    def _latch_stream(self) -> None:
        last, late = self.last_stream_index, self.output.counters.late
        super()._latch_stream()
        if self.output.counters.late > late:
            self.last_stream_index = last


class LatchesCountedAhead(VirtualHaptogramDialect):
    """Counts a frame as latched when it is queued."""

    @property
    def counters(self) -> dict[str, int]:
        """Every counter, what waits among the latches."""
        right = super().counters
        return right | {"latched": right["latched"] + self.board.queued}


_WIRE, _SELF = Evidence.WIRE, Evidence.SELF_REPORTED

MUTANTS: Final = (
    Mutant.of(LeadTooLong, "HG-5.7/9", _WIRE),
    Mutant.of(LatchedBeforeItsLead, "HG-5.8/1", _SELF),
    Mutant.of(ComputesAllAtOnce, "HG-5.8/1", _SELF),
    Mutant.of(LatenessFromArrival, "HG-5.7/5", _SELF),
    Mutant.of(MarginFromArrival, "HG-9.3/1", _SELF),
    Mutant.of(PlaysUnready, "HG-7.6/2", _WIRE),
    Mutant.of(PlaysFasterThanItComputes, "HG-7.6/2", _WIRE),
    Mutant.of(ImmediateNotAccepted, "HG-5.7/8", _SELF),
    Mutant.of(StatusOfTwoMoments, "HG-9.1/3", _SELF),
    Mutant.of(LateLatchesUnsaid, "HG-8.3/1", _SELF),
    Mutant.of(StatusOfTheSchedule, "HG-8.3/3", _SELF),
    Mutant.of(LateByLessIsInTime, "HG-5.7/6", _SELF),
    Mutant.of(LateLatchIsNotLast, "HG-9.1/3", _SELF),
    Mutant.of(LatchesCountedAhead, "HG-8.3/3", _SELF),
)

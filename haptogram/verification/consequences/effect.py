"""The effect in space of lost, late and wrong frames: time, distance and pressure.

Over the device time of a run: frame i is what should be radiated from its time to that of the next,
or to the end of its stream.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

from haptogram.settings.frozen import dataclass

from ..frame.verdict import MISSED, FrameStatus, FrameVerdict

_US_PER_MS: Final = 1e3
_ELSEWHERE: Final = (FrameStatus.OFF_TARGET, FrameStatus.WRONG_DRIVE)
_PAUSE: Final = 2  # periods: a stream ended before a gap that is longer; rounding makes none such


@dataclass(frozen=True, slots=True)
class _HeldStretch:
    """A time in which something else was radiated than was intended.

    Pressures are those at the intended point; None where they are not known.
    """

    begin_us: int
    end_us: int
    away_mm: float | None
    radiated_pa: float | None
    intended_pa: float | None

    @property
    def length_us(self) -> int:
        return self.end_us - self.begin_us


@dataclass(frozen=True, slots=True)
class RunConsequences:
    """The effect of faults on the focus, over a whole run.

    Attributes
    ----------
    away_ms : float
        Time in which the focus was not the intended one, or there was none.
    longest_ms : float
        The longest such time without a break.
    silent_ms : float
        Of the whole, the time in silence: before the first latch, or after a latch of silence.
    farthest_mm : float or None
        Largest distance of the focus from where it should have been; None: there was no such focus.
    radiated_pa, intended_pa : float or None
        RMS pressure at the intended points, and as it should have been: averages over that time.
    """

    away_ms: float
    longest_ms: float
    silent_ms: float
    farthest_mm: float | None
    radiated_pa: float | None
    intended_pa: float | None

    @classmethod
    def of(
        cls, frames: Sequence[FrameVerdict], silences: Sequence[int] = ()
    ) -> RunConsequences | None:
        """Return the effect of the faults of *frames*; None: no frame with a time has one.

        Parameters
        ----------
        frames : sequence of FrameVerdict
            In their order.
        silences : sequence of int
            Device times, ascending, at which the output fell silent: the end of a stream.
        """
        stretches = [s for s in _held_stretches(frames, silences) if s.length_us > 0]
        if not stretches:
            return None
        known = [s for s in stretches if s.radiated_pa is not None]
        return cls(
            away_ms=_total_stretch_ms(stretches),
            longest_ms=max(map(_total_stretch_ms, _unbroken_stretches(stretches))),
            silent_ms=_total_stretch_ms([s for s in stretches if s.radiated_pa == 0.0]),
            farthest_mm=max((s.away_mm for s in stretches if s.away_mm is not None), default=None),
            radiated_pa=_mean_over_stretches(known, [s.radiated_pa or 0.0 for s in known]),
            intended_pa=_mean_over_stretches(known, [s.intended_pa or 0.0 for s in known]),
        )

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {
            "away_ms": self.away_ms,
            "longest_ms": self.longest_ms,
            "silent_ms": self.silent_ms,
            "farthest_mm": self.farthest_mm,
            "pressure_rms_pa": {"radiated": self.radiated_pa, "intended": self.intended_pa},
        }

    def __str__(self) -> str:
        """Return it in one line."""
        times = f"{self.away_ms:.1f} ms, {self.longest_ms:.1f} ms at a time"
        parts = [f"not as intended for {times}"]
        if self.farthest_mm is not None:
            parts.append(f"up to {self.farthest_mm:.2f} mm away")
        if self.silent_ms:
            parts.append(f"silent for {self.silent_ms:.1f} ms")
        if self.radiated_pa is not None:
            pressures = f"{self.radiated_pa:.0f} Pa instead of {self.intended_pa:.0f} Pa"
            parts.append(f"{pressures} at the targets meanwhile")
        return ", ".join(parts)


def _held_stretches(
    frames: Sequence[FrameVerdict], silences: Sequence[int]
) -> Iterator[_HeldStretch]:
    """Yield the intervals in which another drive than the intended one was radiated.

    *silences* are the times in µs at which the output was muted; frames without a due time are left
    out.
    """
    due = (frame for frame in frames if frame.status is not FrameStatus.CANCELLED)
    timed = [frame for frame in due if frame.t_apply_us is not None]
    begins = [frame.t_apply_us or 0 for frame in timed]
    for frame, begin_us, end_us in zip(timed, begins, _due_ends(begins, silences), strict=True):
        # One that is not late latches within a carrier period of its time: no time of its own.
        latched_us = max(begin_us, frame.t_latch_us or 0) if frame.late else begin_us
        if frame.status in MISSED:
            yield _stretch_before_latch(frame, begin_us, end_us)
        elif frame.late:
            yield _stretch_before_latch(frame, begin_us, min(latched_us, end_us))
        is_known_by_crc = frame.status is FrameStatus.CORRUPT and not frame.criteria
        if frame.status in _ELSEWHERE or is_known_by_crc:  # its effect is unknown if unseen
            pressures_pa = frame.target_pressure_rms_pa, frame.intended_pressure_rms_pa
            yield _HeldStretch(latched_us, end_us, frame.error_mm, *pressures_pa)


def _due_ends(begins: Sequence[int], silences: Sequence[int]) -> Iterator[int]:
    """Yield until when (µs) each of the frames that begin at the sorted times *begins* was due.

    That is the next begin if it is at most two gaps away, a gap being the time since the begin
    before. Else it is the earliest of: the next begin, one gap later, and the next time of
    *silences* (mute); with none of these, the frame's own begin.
    """
    neighbours = zip([None, *begins], begins, [*begins[1:], None], strict=False)
    for before_us, begin_us, next_us in neighbours:
        period_us = None if before_us is None else begin_us - before_us
        if period_us and next_us is not None and next_us - begin_us <= _PAUSE * period_us:
            yield next_us  # the stream goes on, even if the board mutes itself
            continue
        # The last of a stream is due for as long as the one before it, if nobody ended it sooner.
        quiet_us = next((t_us for t_us in silences if t_us > begin_us), None)
        over_us = None if period_us is None else begin_us + period_us
        yield min((t for t in (next_us, over_us, quiet_us) if t is not None), default=begin_us)


def _stretch_before_latch(frame: FrameVerdict, begin_us: int, end_us: int) -> _HeldStretch:
    """Return the stretch from *begin_us* to *end_us*, in which the drive before *frame* was held.

    It has the miss and pressures of the frame's consequence; they are None where that is None.
    """
    held = frame.consequence
    if held is None:
        return _HeldStretch(begin_us, end_us, None, None, None)
    pressures_pa = held.pressure_rms_pa, held.intended_pressure_rms_pa
    return _HeldStretch(begin_us, end_us, held.focus_error_mm, *pressures_pa)


def _unbroken_stretches(stretches: list[_HeldStretch]) -> Iterator[list[_HeldStretch]]:
    """Yield lists of stretches that follow without a gap; one empty list if there are none."""
    joined: list[_HeldStretch] = []
    for stretch in stretches:
        if joined and stretch.begin_us > joined[-1].end_us:
            yield joined
            joined = []
        joined.append(stretch)
    yield joined


def _total_stretch_ms(stretches: Sequence[_HeldStretch]) -> float:
    return sum(stretch.length_us for stretch in stretches) / _US_PER_MS


def _mean_over_stretches(stretches: list[_HeldStretch], values: list[float]) -> float | None:
    """Return the mean of *values*, one a stretch, weighted by length; None without *stretches*."""
    if not stretches:
        return None
    lengths = [stretch.length_us for stretch in stretches]
    return sum(v * t for v, t in zip(values, lengths, strict=True)) / sum(lengths)

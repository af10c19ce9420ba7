"""The one who lost a frame that was not latched: the board, or the host and its machine.

A frame that left the host in time is the board's, unless the record of its arrival says that the
machine held up the process of a virtual board.  Nothing else is excused.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final

from haptogram.records.frame import Evidence, Intended, Observation
from haptogram.records.losses import BoardLosses

from .consequences.held import DueFrame
from .frame.judge import lost_frame_verdict
from .frame.verdict import Cut, FrameStatus, FrameVerdict

#: Text in every reason of a run that failed because the board lost frames.
LOST_BY_BOARD: Final = "lost by the board"
_NOT_SENT: Final = "the host was held up and did not send it"
_SENT_LATE: Final = "the host was held up and sent it too late"
_SILENT: Final = "the host was held up for longer than its lease, and the board muted itself"
_READ_LATE: Final = "the machine held up the process of the board"
_TIMED_OUT: Final = "a timer had muted the board, because frames before it were held up"
_OWN_CLOCK: Final = (
    "; at a pseudo-terminal or a socket a board that finds frames late and one whose process waits "
    "for a processor look alike: its back door (--backdoor) or a quiet machine tells them apart"
)
_NOTHING_SHOWN: Final = "no latch of the board was seen at all"
_NOT_COUNTED: Final = "the board counted no drop"


class LossJudge:
    """Judges the frames of a run that were not latched, one after the other.

    Parameters
    ----------
    intended, latched : sequences
        The frames, and all latches of each; then the latches of no frame.
    known : BoardLosses or None
        Records of board and back door about them.
    unseen : str or None
        Why latches may be missing.
    cut : Cut or None
        The interruption of the run.
    """

    def __init__(
        self,
        intended: Sequence[Intended],
        latched: Sequence[Sequence[Observation]],
        known: BoardLosses | None,
        unseen: str | None,
        cut: Cut | None,
    ) -> None:
        self._known = BoardLosses() if known is None else known
        self._cut = cut
        is_shown = known is not None or any(
            latch.evidence is not Evidence.WIRE for latches in latched for latch in latches
        )
        self._unseen = _NOTHING_SHOWN if unseen is None and not is_shown else unseen
        numbers = (f.number for f, latches in zip(intended, latched, strict=False) if latches)
        self._after = max(numbers, default=-1)
        self._last_us = -math.inf
        self._first: tuple[DueFrame, FrameStatus] | None = None  # missing since the last latch

    def latched(self, t_latch_us: int) -> None:
        """Take down that a frame was latched."""
        self._last_us, self._first = t_latch_us, None

    def judge(self, wanted: Intended, due: DueFrame) -> FrameVerdict:
        """Return the verdict on a frame that was not latched: lost, held up, cancelled, unseen."""
        missed, cut = lost_frame_verdict(wanted), self._cut
        if cut is not None and cut.cancelled(wanted.t_apply_us):
            return dataclasses.replace(missed, status=FrameStatus.CANCELLED)
        status, fault, note = self._loss(wanted, due)
        if self._first is None:
            self._first = due, status
        is_told = self._known.is_told_in_order and wanted.number < self._after
        why = None if is_told else self._unseen
        if why is None and cut is not None and cut.muted_us is None and wanted.number > self._after:
            why = cut.reason  # who knows whether it was still on the line?
        if why is not None and status is FrameStatus.LOST:
            status, fault, note = FrameStatus.NOT_VERIFIED, "", why
        faults = (fault,) if fault else ()
        return dataclasses.replace(missed, status=status, faults=faults, note=note)

    def _loss(self, wanted: Intended, due: DueFrame) -> tuple[FrameStatus, str, str]:
        """Return status, fault and reason ("" where none) of a frame *wanted* that did not latch.

        *due* is the span of time in which it should have latched.
        """
        known, drop = self._known, self._known.drops.get(wanted.key)
        latest_us, sent_us = wanted.t_latest_us, wanted.t_sent_us
        if latest_us is not None and wanted.is_held_up:
            if sent_us is None:
                return FrameStatus.HELD_UP, _NOT_SENT, ""
            return FrameStatus.HELD_UP, _SENT_LATE, f"by {_loss_ms(sent_us - latest_us)}"
        if sent_us is not None and any(sent_us <= t <= due.latest_us for t in known.mutes_us):
            return FrameStatus.CANCELLED, "", ""
        was_held_up = self._first is not None and self._first[1] is FrameStatus.HELD_UP
        if was_held_up and any(self._first_due_us < t <= due.latest_us for t in known.timeouts_us):
            return FrameStatus.HELD_UP, _TIMED_OUT, ""
        if any(self._last_us < t <= due.latest_us for t in known.neglects_us):
            return FrameStatus.HELD_UP, _SILENT, ""
        in_time = "" if sent_us is None or latest_us is None else _left_in_time(latest_us - sent_us)
        if drop is None:
            return FrameStatus.LOST, "", in_time
        if latest_us is None:
            return FrameStatus.LOST, drop.counter, "it came whole"
        early_us = latest_us - drop.t_received_us
        if early_us < 0 and known.is_machine_in_between:
            late = f"{in_time}, and was read {_loss_ms(-early_us)} too late"
            return FrameStatus.HELD_UP, _READ_LATE, late
        when = "too late" if early_us < 0 else "before it had to"
        return FrameStatus.LOST, drop.counter, f"it came whole, {_loss_ms(abs(early_us))} {when}"

    @property
    def _first_due_us(self) -> float:
        """Return the last latch's time or, if later, the first lost frame's; -inf if neither."""
        return max(self._last_us, -math.inf if self._first is None else self._first[0].earliest_us)


def _loss_ms(time_us: int) -> str:
    """Return a time in µs as text in ms."""
    return f"{time_us / 1e3:.1f} ms"


def _left_in_time(spare_us: int) -> str:
    """Return the text that a frame left the host *spare_us* before it had to be at the board."""
    return f"it left the host {_loss_ms(spare_us)} before it had to be at the board"


def lost_frames_reason(
    frames: Sequence[FrameVerdict], due: int, losses: BoardLosses | None
) -> str | None:
    """Return the number of frames that the board lost, their counters and since when; or None."""
    lost = [frame for frame in frames if frame.status is FrameStatus.LOST]
    if not lost:
        return None
    first, begin_us = lost[0], next((f.t_apply_us for f in frames if f.t_apply_us is not None), 0)
    since = f"since frame {first.number}"
    if first.t_apply_us is not None:
        since += f", {_loss_ms(first.t_apply_us - begin_us)} into the run"
    were = "frame was" if due == 1 else "frames were"
    counted = "" if losses is None else f" ({_counted_drops_text(lost, losses.counters)})"
    # The word of a board alone: nobody knows when its process was given a processor.
    is_late = losses is not None and losses.counters.get("dropped_late")
    own_word = losses is not None and losses.is_machine_in_between and not losses.drops
    doubt = _OWN_CLOCK if own_word and is_late else ""
    return f"{len(lost)} of {due} {were} {LOST_BY_BOARD}, {since}{counted}{doubt}"


def unnamed_losses_reason(
    frames: Sequence[FrameVerdict], due: int, losses: BoardLosses | None
) -> str | None:
    """Return the number of frames that the board's counter of latches lacks; None: of none.

    Not where a timer muted the board after frames that were held up: these are not counted.
    """
    excused = sum(frame.status is FrameStatus.HELD_UP for frame in frames)
    lost = sum(frame.status is FrameStatus.LOST for frame in frames)
    unseen = any(not f.latches and f.status is FrameStatus.NOT_VERIFIED for f in frames)
    if losses is None or losses.latched is None or not unseen or (excused and losses.timeouts_us):
        return None
    missing = due - excused - lost - losses.latched
    if missing <= 0:
        return None
    counted = _counted_drops_text([], losses.counters)
    return (
        f"{missing} of {due} frames were {LOST_BY_BOARD}: its counter latched grew by "
        f"{losses.latched} ({counted}); its evidence does not say which"
    )


def _counted_drops_text(lost: Sequence[FrameVerdict], counters: Mapping[str, int]) -> str:
    """Return the observed drops as text; else the board's counts, or that it counted none."""
    named = Counter(fault for frame in lost for fault in frame.faults)
    found = ", ".join(f"{name} {number}" for name, number in (named or counters).items())
    return found or _NOT_COUNTED

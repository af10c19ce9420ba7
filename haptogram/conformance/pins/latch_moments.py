"""When the pins change in a latch, against its time in the trace and the time of its frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from .findings import PinClauseFindings, duration_by_pins, names_of_pins, time_by_pins
from .latch_pulses import LONGEST, SETTLED, SHORTEST, LatchClausePulses
from .reported_latches import ReportedLatch

_SEARCHED: Final = 8.0  # periods on both sides of a latch in which it is sought
_TORN: Final = 1.25  # a period, and what a pulse that a latch cut may seem to be off
_MISSED: Final = 2.0  # a period, and where its pulse lies in it
_KNOWN: Final = 1.0  # period within which a time must be known to show that a latch is in time
_LEAST_STEP: Final = 0.06  # least difference of drives that pulses show, of full drive


@dataclass(frozen=True)
class LatchMomentClauseJudge:
    """Judges the times of latches by the pins: HG-5.8/1, HG-5.8/2, HG-7.6/4, HG-8.3/1."""

    pulses: LatchClausePulses

    def judge(self, latch: ReportedLatch, before: float, findings: PinClauseFindings) -> None:
        """Judge when the pins change in a latch; *before* is the time of the latch before it."""
        after, first = self._moments(latch, before)
        if after:
            self._judge_moments(latch, after, first, findings)

    def _moments(
        self, latch: ReportedLatch, before: float
    ) -> tuple[dict[int, float], dict[int, float]]:
        """Return the last old and first new pulse, in periods, of each pin that shows the latch.

        By element; *before* is the time of the latch before. Pins whose drive changes by 0.06 of
        the full one or less are left out. Empty if the drive before or after lasted under 3
        periods.
        """
        settled = SETTLED + latch.within
        low = max(before + settled, latch.at - LONGEST)
        high = min(latch.until - settled, latch.at + LONGEST)
        after: dict[int, float] = {}
        first: dict[int, float] = {}
        if latch.at - low < settled + SHORTEST or high - latch.at < settled + SHORTEST:
            return after, first
        least_step = max(_LEAST_STEP, 3 * self.pulses.tolerance)
        reach = min(_SEARCHED + latch.within, latch.at - low, high - latch.at)
        for element in self.pulses.record.pins:
            old = self.pulses.steady(element, low, latch.at - settled)
            new = self.pulses.steady(element, latch.at + settled, high)
            if old is None or new is None or abs(new - old) < least_step:
                continue
            times, near = self.pulses.between(element, latch.at - reach, latch.at + reach)
            is_old = np.abs(near - old) < np.abs(near - new)
            olds, news = times[is_old], times[~is_old]
            if not len(times) or (not len(news) and abs(new) > 0.0):
                continue
            starts = float(news[0]) if len(news) else float(olds[-1]) + 1.0
            after[element] = float(olds[-1]) if len(olds) else starts - 1.0
            first[element] = starts
        return after, first

    def _judge_moments(
        self,
        latch: ReportedLatch,
        after: dict[int, float],
        first: dict[int, float],
        findings: PinClauseFindings,
    ) -> None:
        """Judge when the pins change at a latch, by their last old and first new pulses.

        *after* and *first* have these in periods, by element. All must change within 1.25 periods
        (HG-5.8/2), and at most 2 from the latch's reported time and from the time when it was due.
        """
        record = self.pulses.record
        begin, end = min(first.values()), max(after.values())
        where = time_by_pins(record, latch.at)
        if len(after) > 1:
            torn = ""
            if end - begin > _TORN:
                behind = [element for element in after if after[element] - begin > _TORN]
                torn = (
                    f"{names_of_pins(record, behind)} of {len(after)} pins change "
                    f"{duration_by_pins(record, end - begin)} or more after the first, "
                    f"in the latch {where}"
                )
            findings.add("HG-5.8/2", torn)
        middle = float(np.median([(after[e] + first[e]) / 2.0 for e in after]))
        excess = f"than the trace tells, {where}"
        self._judge_time(findings, "HG-8.3/1", middle - latch.at, latch.within, excess)
        if latch.due is not None:
            excess = f"than the frame of the latch {where} is due"
            self._judge_time(findings, latch.due_clause, middle - latch.due, latch.within, excess)

    def _judge_time(
        self, findings: PinClauseFindings, clause: str, late: float, within: float, than: str
    ) -> None:
        """Add a finding on pins that change *late* periods after the right time (below 0: before).

        Broken if that is over 2 periods and *within*, the possible error of the device clock;
        unclear if over 2 only; else kept or, if the clock is not known to a period, not shown.
        *than* ends the text.
        """
        length = duration_by_pins(self.pulses.record, abs(late))
        side = "later" if late > 0.0 else "earlier"
        text = f"the pins change {length} {side} {than}"
        known = duration_by_pins(self.pulses.record, within)
        if abs(late) > _MISSED + within:
            findings.add(clause, text)
        elif abs(late) > _MISSED:
            findings.doubt(clause, f"{text}; the device clock is known within {known} there")
        elif within <= _KNOWN:
            findings.add(clause, "")
        else:
            findings.missing[clause] = (
                f"the device clock is known within {known} only: more PINGs are needed, or a "
                "capture of the carrier's clock"
            )

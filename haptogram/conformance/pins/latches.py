"""The latches that the board tells of, against the moments and drives that its pins show."""

from __future__ import annotations

import math
from typing import Final

from .dialogue import PinDialogue
from .findings import PinClauseFindings
from .latch_drives import LatchDriveClauseJudge
from .latch_moments import LatchMomentClauseJudge
from .latch_pulses import SETTLED, LatchClausePulses
from .told_latches import latches_of_pin_dialogue

_LATE: Final = 20.0  # periods after a latch until the old drive is gone, where pins latch late


def judge_latch_clauses(dialogue: PinDialogue, findings: PinClauseFindings) -> None:
    """Judge every latch that the board told, one event for each."""
    if not dialogue.clocks:
        for clause in ("HG-5.8/1", "HG-5.8/2", "HG-5.8/5", "HG-8.3/1", "HG-5.2/1", "HG-5.3/1"):
            findings.missing[clause] = "no PING was answered: the device clock is not known"
        return
    told = list(latches_of_pin_dialogue(dialogue))
    pulses = LatchClausePulses(dialogue.record)
    moments, drives = LatchMomentClauseJudge(pulses), LatchDriveClauseJudge(pulses)
    for number, latch in enumerate(told):
        moments.judge(latch, told[number - 1].at if number else -math.inf, findings)
    # Pins that latch at another time than the board tells show an old drive for a while.
    is_late = any(findings.broken.get(clause) for clause in ("HG-5.8/1", "HG-5.8/2", "HG-8.3/1"))
    for latch in told:
        drives.judge(latch, _LATE if is_late else SETTLED, findings)

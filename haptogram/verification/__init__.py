"""The only place that knows targets: joins intended frames with observed latches.

Every verdict is one of physics (criteria S1 to S5, see :mod:`.criteria`), says what evidence it
rests on, and names the smallest miss that it could have shown.  What cannot be seen is not
verified, and never passes.
"""

from .consequences.effect import RunConsequences
from .faults import name_drive_faults
from .frame.drive import judge
from .frame.judge import FrameJudge
from .frame.target import check_frame_tolerance
from .frame.verdict import (
    MISSED,
    Consequence,
    Cut,
    FrameStatus,
    FrameVerdict,
    Verdict,
    verdict_consequence_text,
    verdict_pressure_text,
)
from .losses import LOST_BY_BOARD
from .run import check_run_judgement, verify_run
from .run_verdict import RunVerdict, cut_run_verdict_text, grouped_frame_findings, worst_frame_of
from .tolerance import (
    REAL_BOARD,
    Tolerance,
    Uncertainty,
    VerdictUncertainty,
    tolerance_of,
    tolerance_text,
    uncertainty_of,
)

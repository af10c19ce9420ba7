"""The only place that knows targets: joins what was intended with what was latched.

Every verdict is one of physics (criteria S1 to S5, see :mod:`.criteria`), says what evidence it
rests on, and names the smallest miss that it could have shown.  What cannot be seen is not
verified, and never passes.
"""

from .effect import Effect
from .faults import name_faults
from .judge import Judge
from .run import RunVerdict, verify_run
from .summary import consequence_text, cut_text, pressure_text
from .target import check_tolerance
from .tolerance import (
    REAL_BOARD,
    PlaceUncertainty,
    Tolerance,
    Uncertainty,
    tolerance_of,
    tolerance_text,
    uncertainty_of,
)
from .verdict import Consequence, Cut, FrameStatus, FrameVerdict, Verdict

__all__ = [
    "REAL_BOARD",
    "Consequence",
    "Cut",
    "Effect",
    "FrameStatus",
    "FrameVerdict",
    "Judge",
    "PlaceUncertainty",
    "RunVerdict",
    "Tolerance",
    "Uncertainty",
    "Verdict",
    "check_tolerance",
    "consequence_text",
    "cut_text",
    "name_faults",
    "pressure_text",
    "tolerance_of",
    "tolerance_text",
    "uncertainty_of",
    "verify_run",
]

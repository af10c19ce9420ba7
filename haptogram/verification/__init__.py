"""The only place that knows targets: joins what was intended with what was latched.

Every verdict is one of physics (criteria S1 to S5, see :mod:`.criteria`), says what evidence it
rests on, and names the smallest miss that it could have shown.
"""

from .faults import name_faults
from .judge import Judge
from .run import RunVerdict, verify_run
from .verdict import Consequence, FrameStatus, FrameVerdict, Verdict

__all__ = [
    "Consequence",
    "FrameStatus",
    "FrameVerdict",
    "Judge",
    "RunVerdict",
    "Verdict",
    "name_faults",
    "verify_run",
]

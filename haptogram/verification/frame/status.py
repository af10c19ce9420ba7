"""From the criteria of a frame to its status."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ..faults import UNNAMED
from ..tolerance import Tolerance
from .verdict import FrameStatus


def frame_status_of(
    verdicts: Mapping[str, bool],
    faults: tuple[str, ...],
    *,
    focused: bool,
    tolerance: Tolerance | None = None,
) -> FrameStatus:
    """Return the status of a frame whose drive was seen.

    Parameters
    ----------
    verdicts : mapping of str to bool
        S1 to S5, those that were judged.
    faults : tuple of str
        Faults that the codes prove.
    focused : bool
        Whether the drive has a single focus.
    tolerance : Tolerance, optional
        Beyond a strict one, S1 warns and decides nothing.
    """
    if not is_frame_wrong(verdicts, tolerance):
        return FrameStatus.CORRUPT if faults else FrameStatus.ON_TARGET
    if not faults or (focused and faults == (UNNAMED,)):
        return FrameStatus.OFF_TARGET  # the drive that was sent, in other air; or for another point
    return FrameStatus.WRONG_DRIVE


def is_frame_wrong(verdicts: Mapping[str, bool], tolerance: Tolerance | None = None) -> bool:
    """Return True if a criterion decides against the frame; beyond strictness, S1 decides none."""
    strict = tolerance is None or tolerance.is_strict
    return not all(ok for name, ok in verdicts.items() if strict or name != "S1")


def is_right_frame_status(status: FrameStatus) -> bool:
    """Return True if no fault was found."""
    return status in (FrameStatus.ON_TARGET, FrameStatus.NOT_VERIFIED)


def frame_warning_of(
    verdicts: Mapping[str, bool], error_rad: float | None, limit_rad: float
) -> Iterator[str]:
    """Yield the warnings of S1 for a frame that the tolerance lets pass."""
    if error_rad is not None and not verdicts.get("S1", True):
        yield (
            f"S1 warns: phases are off by {error_rad:.4f} rad (limit {limit_rad:.4f} rad), within "
            "the tolerance of the place"
        )

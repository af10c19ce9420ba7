"""From the criteria of a frame to its status."""

from __future__ import annotations

from collections.abc import Mapping

from ..faults import UNNAMED
from .verdict import FrameStatus


def frame_status_of(
    verdicts: Mapping[str, bool], faults: tuple[str, ...], *, focused: bool
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
    """
    is_placed = "S1" in verdicts or "S2" in verdicts  # else nobody knows where its foci are
    if all(verdicts.values()) and (is_placed or not faults):
        return FrameStatus.CORRUPT if faults else FrameStatus.ON_TARGET
    if not faults or (focused and faults == (UNNAMED,)):
        return FrameStatus.OFF_TARGET  # the drive that was sent, in other air; or for another point
    return FrameStatus.WRONG_DRIVE

"""Defects that have a name, and what shows them."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

_MOST: Final = 6  # most latches whose numbers are named


class Defect(enum.StrEnum):
    """The defects that have a name."""

    STRAY_CHANNELS = "channels without an element driven"
    SILENT = "elements silently off"
    REVERSED = "polarity of elements reversed"
    AMPLITUDES_AS_PHASES = "amplitude frame taken for phases"
    NO_COMMIT = "frame without its commit"
    BYTES_LOST = "bytes lost in the middle of a frame"
    STOPPED = "frame that stops in its middle"
    OTHER_ARRAY = "frames of another array"
    AGAIN = "frame that comes twice"
    NEVER = "expected frame that never came"
    ELEMENTS = "single elements out of step"
    TOGETHER = "a group of elements out of step"
    CARRIER = "half the carrier"
    UPLOAD = "amplitude lost while bytes arrive"
    SIGN = "phases of the opposite sign"
    ORDER = "another order of the elements"
    CHANNELS = "another order of the channels"
    BOARD_PHASE = "boards out of step"
    COORDINATES = "coordinates exchanged"
    UNITS = "another unit of length"
    AXES = "another coordinate frame"
    SPEED = "another speed of sound"


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """A defect, and what shows it.

    Attributes
    ----------
    defect : Defect
        Its name.
    detail : str
        The figures.
    latches : tuple of int
        Numbers of the latches that show it.

    Examples
    --------
    >>> str(Diagnosis(Defect.NO_COMMIT, "1 frame", (3,)))
    'frame without its commit: 1 frame (latch 3)'
    """

    defect: Defect
    detail: str
    latches: tuple[int, ...]

    def __str__(self) -> str:
        """Return name, figures and latches in a line."""
        shown = f" ({watched_latches_text(self.latches)})" if self.latches else ""
        return f"{self.defect}: {self.detail}{shown}"


def watched_latches_text(numbers: Sequence[int]) -> str:
    """Return "latch 3", or "latches 3, 4, ... (12)"."""
    if len(numbers) == 1:
        return f"latch {numbers[0]}"
    shown = ", ".join(map(str, numbers[:_MOST]))
    return f"latches {shown}" + (f", ... ({len(numbers)})" if len(numbers) > _MOST else "")

"""The frames of a scene: what is known of each, as columns."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, Final, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import Drive, NotSingle, Reconstruction, SingleFocus
from haptogram.acoustics.model.drive import REGISTER_BITS
from haptogram.records.frame import Observation
from haptogram.verification import FrameStatus

#: The statuses of a frame without a verdict: its latch was seen, or only the frame on the line.
LATCHED: Final = "latched"
SENT: Final = "sent"
STATUSES: Final = (*map(str, FrameStatus), LATCHED, SENT)
TIMELY, LATE, EARLY = range(3)
_MOST_TEXTS: Final = 500  # most texts in one page; the JSON file has all

Place: TypeAlias = Sequence[float | None] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewerFrame:
    """One frame of a scene; None: not known, or not observable.

    Attributes
    ----------
    number : int
        Number of the frame.
    status : str
        One of :data:`STATUSES`.
    timing : int
        :data:`TIMELY`, :data:`LATE` or :data:`EARLY`.
    due_us, received_us, latched_us : int or None
        Device times: when it was to be latched, was complete at the board, and was latched.
    target_m, found_m : sequence of 3 float or None
        Where the focus was to be, and where it was.
    bound_mm : sequence of 3 float or None
        Largest error of each coordinate that rounding can make.
    across_mm, along_mm : float or None
        Error across and along the beam.
    pressure_pa, force_n : float or None
        RMS pressure at the focus, and force on a disc of 10 mm radius.
    drive : Drive or None
        Radiated drive, if it was seen.
    text : str
        Findings about the frame, in words; empty: none.
    """

    number: int
    status: str = LATCHED
    timing: int = TIMELY
    due_us: int | None = None
    received_us: int | None = None
    latched_us: int | None = None
    target_m: Place = None
    found_m: Place = None
    bound_mm: Place = None
    across_mm: float | None = None
    along_mm: float | None = None
    pressure_pa: float | None = None
    force_n: float | None = None
    drive: Drive | None = None
    text: str = ""

    @property
    def margin_us(self) -> int | None:
        """Time from the arrival of the frame to its due time, or to its latch."""
        end_us = self.latched_us if self.due_us is None else self.due_us
        if end_us is None or self.received_us is None:
            return None
        return end_us - self.received_us

    def observed(self, seen: Observation | None) -> Self:
        """Return the frame with drive and arrival of its latch."""
        if seen is None or seen.output is None:
            return self
        return replace(self, drive=seen.output, received_us=seen.t_received_us)

    @property
    def is_odd(self) -> bool:
        """True if the frame was judged and is not simply on target, in time."""
        return self.status not in (FrameStatus.ON_TARGET, LATCHED, SENT) or self.timing != TIMELY


def judged_viewer_frame(field: Callable[[str], Any], text: str) -> ViewerFrame:
    """Return a frame with a verdict, of a run or of a recording of one.

    Parameters
    ----------
    field : callable
        Returns what the verdict holds under a name, as ``FrameVerdict`` has it.
    text : str
        The verdict in words.
    """
    return ViewerFrame(
        number=field("number"),
        status=str(field("status")),
        timing=LATE if field("late") else EARLY if field("early") else TIMELY,
        due_us=field("t_apply_us"),
        latched_us=field("t_latch_us"),
        target_m=field("target_m"),
        found_m=field("measured_m"),
        bound_mm=field("bound_mm"),
        across_mm=field("lateral_error_mm"),
        along_mm=field("axial_error_mm"),
        pressure_pa=field("pressure_rms_pa"),
        force_n=field("force_n"),
        text=text,
    )


def found_fields_of_viewer(field: Reconstruction | None) -> dict[str, Any]:
    """Return focus, bounds and pressure of a reconstruction, as fields of :class:`ViewerFrame`."""
    if isinstance(field, NotSingle):
        return {"pressure_pa": field.pressure_rms_pa}
    if not isinstance(field, SingleFocus):
        return {}
    return {
        "found_m": field.position_m,
        "bound_mm": [1e3 * bound if math.isfinite(bound) else None for bound in field.bound_m],
        "pressure_pa": field.pressure_rms_pa,
        "force_n": field.force_n,
    }


def odd_frames_of_viewer(frames: Iterable[ViewerFrame]) -> dict[str, str]:
    """Return the findings about the first 500 frames that want attention, by number."""
    odd = ((str(frame.number), frame.text) for frame in frames if frame.is_odd and frame.text)
    return dict(islice(odd, _MOST_TEXTS))


#: Columns of one number a frame: the attribute of the frame, its factor, and the type.
_NUMBERS: Final = {
    "due_us": ("due_us", 1.0, np.float64),
    "latched_us": ("latched_us", 1.0, np.float64),
    "margin_ms": ("margin_us", 1e-3, np.float32),
    "across_mm": ("across_mm", 1.0, np.float32),
    "along_mm": ("along_mm", 1.0, np.float32),
    "pressure_pa": ("pressure_pa", 1.0, np.float32),
    "force_mn": ("force_n", 1e3, np.float32),
}


def frame_columns(frames: Sequence[ViewerFrame], count: int) -> dict[str, NDArray[Any]]:
    """Return the columns of *frames* of an array of *count* elements."""
    numbers = {
        name: (factor * np.array([getattr(f, of) for f in frames], dtype=np.float64)).astype(kind)
        for name, (of, factor, kind) in _NUMBERS.items()
    }
    return {
        "number": np.array([f.number for f in frames], dtype=np.uint32),
        "status": np.array([STATUSES.index(f.status) for f in frames], dtype=np.uint8),
        "timing": np.array([f.timing for f in frames], dtype=np.uint8),
        **numbers,
        "target_mm": _viewer_frame_places(f.target_m for f in frames) * np.float32(1e3),
        "found_mm": _viewer_frame_places(f.found_m for f in frames) * np.float32(1e3),
        "bound_mm": _viewer_frame_places(f.bound_mm for f in frames),
        **view_drive_columns([f.drive for f in frames], count),
    }


def view_drive_columns(drives: Sequence[Drive | None], count: int) -> dict[str, NDArray[np.uint8]]:
    """Return the codes of *drives*, of *count* elements each; None: the drive was not observed.

    Amplitudes that are the same in every drive are said once.
    """
    phases = np.zeros((len(drives), count), dtype=np.uint8)
    amplitudes = np.zeros((len(drives), count), dtype=np.uint8)
    for row, drive in enumerate(drives):
        if drive is not None:
            phases[row] = drive.in_bits(REGISTER_BITS).phase_codes
            amplitudes[row] = drive.amplitude_codes
    seen = np.array([drive is not None for drive in drives], dtype=np.uint8)
    levels = amplitudes[seen == 1]
    if len(levels) and (levels == levels[0]).all():
        amplitudes = levels[:1]
    return {"seen": seen, "phases": phases, "amplitudes": amplitudes}


def _viewer_frame_places(places: Iterable[Place]) -> NDArray[np.float32]:
    """Return (F, 3) places in the unit given, NaN for each that is None."""
    rows = [(None, None, None) if place is None else tuple(place) for place in places]
    return np.array(rows, dtype=np.float64).reshape(-1, 3).astype(np.float32)

"""The scene of a judged run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from haptogram.acoustics import AcousticModel, Drive
from haptogram.verification import FrameStatus, FrameVerdict, RunVerdict

from .frames import EARLY, LATE, TIMELY, ShownFrame
from .scene import Scene

_MOST_TEXTS: Final = 500  # frames with a text of their own; the JSON file has all


def run_scene(run: RunVerdict, model: AcousticModel, drives: Mapping[int, Drive]) -> Scene:
    """Return the scene of *run*.

    Parameters
    ----------
    model : AcousticModel
        Array and air that the drives were radiated in.
    drives : mapping of int to Drive
        Drives that were radiated, by frame number.
    """
    return Scene.of(
        model,
        [_shown(frame, drives.get(frame.number)) for frame in run.frames],
        counters={name.replace("_", " "): count for name, count in run.counts.items() if count},
        texts=dict(_texts(run.frames)),
    )


def _shown(frame: FrameVerdict, drive: Drive | None) -> ShownFrame:
    return ShownFrame(
        number=frame.number,
        status=str(frame.status),
        timing=LATE if frame.late else EARLY if frame.early else TIMELY,
        due_us=frame.t_apply_us,
        latched_us=frame.t_latch_us,
        target_m=frame.target_m,
        found_m=frame.measured_m,
        bound_mm=frame.bound_mm,
        across_mm=frame.lateral_error_mm,
        along_mm=frame.axial_error_mm,
        pressure_pa=frame.pressure_rms_pa,
        force_n=frame.force_n,
        drive=drive,
    )


def _texts(frames: Sequence[FrameVerdict]) -> Iterable[tuple[str, str]]:
    """Yield number and findings of the frames that are not simply on target."""
    odd = (f for f in frames if f.status is not FrameStatus.ON_TARGET or f.late or f.early)
    for _, frame in zip(range(_MOST_TEXTS), odd, strict=False):
        yield str(frame.number), str(frame)

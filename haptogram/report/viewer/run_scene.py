"""The scene of a judged run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Final

from haptogram.acoustics import AcousticModel, Drive
from haptogram.verification import FrameStatus, FrameVerdict, RunVerdict

from .frames import judged_frame
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
        [judged_frame(partial(getattr, frame), drives.get(frame.number)) for frame in run.frames],
        counters={name.replace("_", " "): count for name, count in run.counts.items() if count},
        texts=dict(_texts(run.frames)),
    )


def _texts(frames: Sequence[FrameVerdict]) -> Iterable[tuple[str, str]]:
    """Yield number and findings of the frames that are not simply on target."""
    odd = (f for f in frames if f.status is not FrameStatus.ON_TARGET or f.late or f.early)
    for _, frame in zip(range(_MOST_TEXTS), odd, strict=False):
        yield str(frame.number), str(frame)

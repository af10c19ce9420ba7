"""The scene of a judged run."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from haptogram.acoustics import AcousticModel, Drive
from haptogram.verification import RunVerdict

from .frames import judged_frame
from .scene import Scene


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
        [
            judged_frame(partial(getattr, frame), drives.get(frame.number), str(frame))
            for frame in run.frames
        ],
        counters={name.replace("_", " "): count for name, count in run.counts.items() if count},
    )

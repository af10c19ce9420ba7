"""The scene of a judged run."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from haptogram.acoustics import AcousticModel
from haptogram.records.frame import Observation
from haptogram.verification import RunVerdict

from .frames import judged_viewer_frame
from .scene import ViewerScene


def viewer_scene_of_run(
    run: RunVerdict, model: AcousticModel, observations: Mapping[int, Observation]
) -> ViewerScene:
    """Return the scene of *run*.

    Parameters
    ----------
    model : AcousticModel
        Array and air that the drives were radiated in.
    observations : mapping of int to Observation
        Latches whose drive was observed, by frame number.
    """
    return ViewerScene.of(
        model,
        [
            judged_viewer_frame(partial(getattr, frame), str(frame)).observed(
                observations.get(frame.number)
            )
            for frame in run.frames
        ],
        counters={name.replace("_", " "): count for name, count in run.counts.items() if count},
    )

"""The scene of a recording: its latches, with the verdicts on them if it holds any."""

from __future__ import annotations

from collections import Counter
from itertools import islice
from pathlib import Path
from typing import Final

from haptogram.acoustics import AcousticModel
from haptogram.errors import ConfigurationError
from haptogram.evidence.backdoor import board_model, observation_of
from haptogram.evidence.recordings.channels import VERDICT
from haptogram.evidence.recordings.reader import Recording
from haptogram.records.frame import FrameKey

from .frames import ShownFrame, judged_frame
from .live import LiveScene
from .scene import Scene

_MOST_FRAMES: Final = 20_000  # of one page: 10 MB


def recorded_scene(path: Path) -> tuple[Scene, list[str]]:
    """Return the scene of a recording, and sentences that say what it is.

    Raises
    ------
    ConfigurationError
        A file that is no recording, or one without a record of the board.
    """
    recording = Recording(path)
    board = recording.board
    if board is None:
        raise ConfigurationError(
            f"{path}: the recording has no record of its board, and so no array; a recording of a "
            "virtual board has one"
        )
    frames = _judged_frames(recording)
    if frames:
        scene, lead = _judged_scene(board_model(board), frames, path)
    else:
        live = LiveScene(board, _MOST_FRAMES)
        live.take(record for record in recording.records() if record["kind"] != "board")
        scene, lead = live.whole(), live.lead
    end = [] if recording.is_whole else ["The recording was cut off."]
    return scene, [f"{recording.run.get('command', '')}: {lead[0]}", *end]


def _judged_scene(
    model: AcousticModel, frames: list[ShownFrame], path: Path
) -> tuple[Scene, list[str]]:
    more = f", the first {_MOST_FRAMES} of {path.name}" if len(frames) == _MOST_FRAMES else ""
    scene = Scene.of(model, frames, counters=Counter(frame.status for frame in frames))
    return scene, [f"{model.array.count} transducers, {len(frames)} judged frames{more}."]


def _judged_frames(recording: Recording) -> list[ShownFrame]:
    """Return the first frames that have a verdict, with the drive that was seen of each."""
    judged: dict[FrameKey, ShownFrame] = {}
    for entry in islice(recording.entries((VERDICT,)), _MOST_FRAMES):
        fields = entry.fields
        key = FrameKey(*(fields[name] for name in ("session", "sequence", "loop", "index")))
        judged[key] = judged_frame(fields.__getitem__, fields["text"])
    # A recording has its latches before its verdicts: only those of judged frames are kept.
    for record in recording.records() if judged else ():
        if record["kind"] != "latch":
            continue
        seen = observation_of(record)
        if seen.key in judged:
            judged[seen.key] = judged[seen.key].observed(seen)
    return list(judged.values())

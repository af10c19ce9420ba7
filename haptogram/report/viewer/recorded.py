"""The scene of a recording: its latches, with the verdicts on them if it holds any."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Final

from haptogram.acoustics import AcousticModel, Drive
from haptogram.errors import ConfigurationError
from haptogram.evidence.backdoor import board_model, observation_of
from haptogram.evidence.recordings.channels import VERDICT
from haptogram.evidence.recordings.reader import Recording
from haptogram.records.frame import FrameKey
from haptogram.verification import FrameStatus

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
    frames = list(islice(_judged_frames(recording), _MOST_FRAMES))
    if frames:
        scene, lead = _judged_scene(board_model(board), frames, path)
    else:
        live = LiveScene(board, _MOST_FRAMES)
        live.take(record for record in recording.records() if record["kind"] != "board")
        scene, lead = live.whole(), live.lead
    end = [] if recording.is_whole else ["The recording was cut off."]
    return scene, [f"{recording.run.get('command', '')}: {lead[0]}", *end]


def _judged_scene(
    model: AcousticModel, frames: list[tuple[ShownFrame, str]], path: Path
) -> tuple[Scene, list[str]]:
    counters: dict[str, int] = {}
    for frame, _ in frames:
        counters[frame.status] = counters.get(frame.status, 0) + 1
    texts = {
        str(frame.number): text for frame, text in frames if frame.status != FrameStatus.ON_TARGET
    }
    more = f", the first {_MOST_FRAMES} of {path.name}" if len(frames) == _MOST_FRAMES else ""
    scene = Scene.of(model, [frame for frame, _ in frames], counters=counters, texts=texts)
    return scene, [f"{model.array.count} transducers, {len(frames)} judged frames{more}."]


def _judged_frames(recording: Recording) -> Iterator[tuple[ShownFrame, str]]:
    """Yield the frames of the verdicts, with the drive that was seen, and the text of each."""
    drives: dict[FrameKey, Drive] = {}
    for record in recording.records():
        if record["kind"] == "latch":
            seen = observation_of(record)
            if (drive := seen.radiated or seen.drive) is not None:
                drives[seen.key] = drive
    for entry in recording.entries((VERDICT,)):
        fields = entry.fields
        key = FrameKey(*(fields[name] for name in ("session", "sequence", "loop", "index")))
        yield judged_frame(fields.__getitem__, drives.get(key)), fields["text"]

"""The scene of a recording: its latches, with the verdicts on them if it holds any."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Final

from haptogram.acoustics import AcousticModel, Reconstructor, SingleFocus
from haptogram.errors import ConfigurationError, refusing_other_content
from haptogram.evidence.backdoor import board_model_of_evidence, observation_of_record
from haptogram.evidence.recordings.channels import SUMMARY, VERDICT
from haptogram.evidence.recordings.reader import Recording
from haptogram.evidence.recordings.recorded_run import (
    SentFrame,
    model_of_recorded_answers,
    recorded_sent_frames,
)
from haptogram.records.frame import FrameKey

from .frames import SENT, ViewerFrame, found_fields_of_viewer, judged_viewer_frame
from .live import LiveViewerScene
from .scene import ViewerScene

_MOST_FRAMES: Final = 20_000  # most frames in one page: 10 MB
_MOST_SEARCHES: Final = 20  # most failed searches: each takes a tenth of a second


@dataclass(frozen=True, slots=True)
class RecordedScene:
    """The scene of a recording.

    Attributes
    ----------
    scene : ViewerScene
    lead : list of str
        Sentences that say what was recorded.
    verdict : str
        Verdict of the recorded run; empty: it has none.
    """

    scene: ViewerScene
    lead: list[str]
    verdict: str


def viewer_scene_of_recording(path: Path) -> RecordedScene:
    """Return the scene of a recording.

    Raises
    ------
    ConfigurationError
        A file that is no recording, or one that does not tell the array of the board.
    """
    recording = Recording(path)
    with refusing_other_content(f"{path}: the recording is damaged, or of another program"):
        return _recorded_scene_of(recording)


def _recorded_scene_of(recording: Recording) -> RecordedScene:
    """Return what to show of a recording: its judged frames or, without verdicts, all latches.

    Without a record of the board's output, the drives are those that the host sent.
    """
    path, board = recording.path, recording.board
    judged = _viewer_frames_judged(recording)
    if board is None:
        scene, lead = _sent_scene(recording, judged)
    elif judged:
        scene, lead = _viewer_scene_of(
            board_model_of_evidence(board), list(judged.values()), path, "judged frames"
        )
    else:
        live = LiveViewerScene(board, _MOST_FRAMES)
        live.take(record for record in recording.records() if record["kind"] != "board")
        scene, lead = live.whole(), live.lead
    end = [] if recording.is_whole else ["The recording was cut off."]
    command = recording.run.get("command", "")
    return RecordedScene(
        scene,
        [f"{command}: {lead[0]}", *_versions_in_viewer(recording), *end],
        _verdict_in_viewer(recording),
    )


def _versions_in_viewer(recording: Recording) -> list[str]:
    """Return the sentence that names the programs which wrote the recording; [] if not known."""
    versions = recording.run.get("versions")
    if not isinstance(versions, dict) or not versions:
        return []
    return [f"Recorded with {', '.join(f'{name} {text}' for name, text in versions.items())}."]


def _verdict_in_viewer(recording: Recording) -> str:
    """Return the recorded verdict of the run; "" without one."""
    verdicts = [entry.fields.get("verdict") for entry in recording.entries((SUMMARY,))]
    return str(verdicts[-1] or "") if verdicts else ""


def _viewer_scene_of(
    model: AcousticModel, frames: list[ViewerFrame], path: Path, what: str
) -> tuple[ViewerScene, list[str]]:
    """Return the scene of recorded *frames*, and the line that counts them as *what*.

    It also says if they are only the first 20 000 of the file.
    """
    more = f", the first {_MOST_FRAMES} of {path.name}" if len(frames) == _MOST_FRAMES else ""
    scene = ViewerScene.of(model, frames, counters=Counter(frame.status for frame in frames))
    return scene, [f"{model.array.count} transducers, {len(frames)} {what}{more}."]


def _sent_scene(
    recording: Recording, judged: dict[FrameKey, ViewerFrame]
) -> tuple[ViewerScene, list[str]]:
    """Return the scene, with the sent drives, of a recording without the board's output.

    With it comes a line that counts the frames; they are the *judged* ones, if any.
    ConfigurationError if the recording does not tell the array.
    """
    path = recording.path
    model = model_of_recorded_answers(recording)
    if model is None:
        raise ConfigurationError(
            f"{path}: the recording has neither a record of its board nor an answer that tells its "
            "array, and so no array"
        )
    sent = recorded_sent_frames(recording, model.array.count)
    if judged:
        for frame in sent:
            known = judged.get(frame.key)
            if known is not None and known.latched_us is not None:
                judged[frame.key] = replace(known, drive=frame.drive)
        frames, what = list(judged.values()), "judged frames"
    else:
        frames, what = list(_viewer_frames_sent(model, islice(sent, _MOST_FRAMES))), "frames"
    scene, lead = _viewer_scene_of(model, frames, path, what)
    lead[0] += " Drives are those that the host sent: nobody recorded what was radiated."
    return scene, lead


def _viewer_frames_sent(model: AcousticModel, sent: Iterable[SentFrame]) -> Iterator[ViewerFrame]:
    """Yield *sent* frames for the view, each with the focus found in its own drive.

    Once 20 searches have found no single focus, no more are made.
    """
    reconstructor, searches = Reconstructor(model), _MOST_SEARCHES
    for number, frame in enumerate(sent):
        field = None
        if frame.drive is not None and searches:
            field = reconstructor.reconstruct(frame.drive)
            searches -= not isinstance(field, SingleFocus)
        yield ViewerFrame(
            number=number,
            status=SENT,
            due_us=frame.due_us,
            target_m=frame.focus_m,
            drive=frame.drive,
            **found_fields_of_viewer(field),
        )


def _viewer_frames_judged(recording: Recording) -> dict[FrameKey, ViewerFrame]:
    """Return the first 20 000 frames with a verdict, by key, with their latches where recorded."""
    judged: dict[FrameKey, ViewerFrame] = {}
    for entry in islice(recording.entries((VERDICT,)), _MOST_FRAMES):
        fields = entry.fields
        key = FrameKey(*(fields[name] for name in ("session", "sequence", "loop", "index")))
        judged[key] = judged_viewer_frame(fields.__getitem__, fields["text"])
    # A recording has its latches before its verdicts: only those of judged frames are kept.
    for record in recording.records() if judged else ():
        if record["kind"] != "latch":
            continue
        seen = observation_of_record(record)
        if seen.key in judged:
            judged[seen.key] = judged[seen.key].observed(seen)
    return judged

"""The frames that a run intended, in its recording: what a capture of its pins is judged by."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from haptogram.acoustics import AcousticModel, Drive
from haptogram.errors import ConfigurationError
from haptogram.evidence.backdoor import board_model_of_evidence, drive_of_record
from haptogram.records.frame import Focus, FrameKey, Intended
from haptogram.records.latch import Codes
from haptogram.records.model import model_record_fields

from .channels import INTENDED, MODEL
from .reader import Recording
from .writer import RecordingWriter

#: Errors that missing fields, or fields of another type, raise.
_UNREADABLE: Final = (ConfigurationError, LookupError, TypeError, ValueError)
_COUNT: Final = "intended_frames"  # how many follow array and air


@dataclass(frozen=True, slots=True)
class RecordedRun:
    """The run in a recording.

    Attributes
    ----------
    model : AcousticModel
        Array and air.
    intended : list of Intended
        The frames, in order.
    incomplete : str
        Why frames may be missing; empty: all that the run had are there.
    """

    model: AcousticModel
    intended: list[Intended]
    incomplete: str = ""


def record_intended(
    writer: RecordingWriter, model: AcousticModel, intended: Sequence[Intended]
) -> None:
    """Write array, air and frames of a run; a drive that comes again is written once."""
    fields = {**model_record_fields(model), _COUNT: len(intended)}
    writer.document(MODEL, writer.last_ns, fields)
    firsts: dict[Drive, int] = {}
    for frame in intended:
        first = firsts.setdefault(frame.drive, frame.number)
        is_new = first == frame.number
        drive = Codes.of(frame.drive).as_record() if is_new else {"drive_of": first}
        fields = _intended_fields(frame) | drive
        writer.document(INTENDED, writer.host_ns(frame.t_apply_us), fields)


def recorded_run(recording: Recording) -> RecordedRun:
    """Return array, air and frames of the run in a recording, as far as it goes.

    Raises
    ------
    ConfigurationError
        A recording without them, or one that cannot be read.
    """
    model: AcousticModel | None = None
    count: int | None = None
    frames: list[Intended] = []
    drives: dict[int, Drive] = {}
    for entry in recording.entries((MODEL, INTENDED)):
        fields = entry.fields
        if entry.topic == MODEL:
            model, count = board_model_of_evidence(fields), fields.get(_COUNT)
            continue
        try:
            frame = _intended_from_fields(fields, drives)
        except _UNREADABLE as error:
            why = f"lacks the field {error}" if isinstance(error, KeyError) else error
            number = fields.get("number", f"at {entry.t_ns} ns")
            raise ConfigurationError(
                f"{recording.path}: intended frame {number} cannot be read: {why}"
            ) from error
        frames.append(frame)
    if model is None or not frames:
        what = recording.run.get("command", "another program")
        raise ConfigurationError(
            f"{recording.path}: the recording (of {what}) does not hold the frames that were "
            "intended; haptogram verify --record writes one that does, at the end of its run"
        )
    count_of_model = model.array.count
    for one in frames:
        if one.drive.count != count_of_model:
            raise ConfigurationError(
                f"{recording.path}: intended frame {one.number} is of {one.drive.count} elements; "
                f"the array of the recording has {count_of_model}"
            )
    return RecordedRun(model, frames, _why_recording_incomplete(recording, len(frames), count))


def _why_recording_incomplete(recording: Recording, found: int, count: int | None) -> str:
    """Return why frames may be missing from the recording; "" if it is complete."""
    if count is None:
        return f"{recording.path}: the recording does not say how many frames were intended"
    if found != count:
        why = f": {recording.note.removeprefix(f'{recording.path}: ')}" if recording.note else ""
        return f"{recording.path}: {found} of {count} intended frames are in the recording{why}"
    return recording.note


def _intended_fields(frame: Intended) -> dict[str, Any]:
    """Return the recorded fields of *frame*, except its drive."""
    return {
        **dataclasses.asdict(frame.key),
        "number": frame.number,
        "t_apply_us": frame.t_apply_us,
        "t_latest_us": frame.t_latest_us,
        "t_sent_us": frame.t_sent_us,
        "foci": [focus.as_numbers() for focus in frame.foci],
        "commanded_bits": frame.phase_bits,
        "phase_steps": frame.phase_steps,
        "board_computed": frame.board_computed,
        "solver": frame.solver,
    }


def _intended_from_fields(fields: Mapping[str, Any], drives: dict[int, Drive]) -> Intended:
    """Return a frame, whose drive may be that of an earlier one, and keep its drive.

    Raises
    ------
    ConfigurationError, LookupError, TypeError, ValueError
        Fields that are missing, or none of a frame.
    """
    earlier = fields.get("drive_of")
    if earlier is not None and earlier not in drives:
        raise ConfigurationError(f"its drive is that of frame {earlier}, which the recording lacks")
    drive = drive_of_record(fields) if earlier is None else drives[earlier]
    drives[fields["number"]] = drive
    return Intended(
        number=fields["number"],
        key=FrameKey.from_record(fields),
        t_apply_us=fields["t_apply_us"],
        t_latest_us=fields.get("t_latest_us"),  # an older recording has none
        t_sent_us=fields.get("t_sent_us"),
        foci=tuple(Focus.from_numbers(focus) for focus in fields["foci"]),
        drive=drive,
        phase_bits=fields["commanded_bits"],
        board_computed=fields["board_computed"],
        solver=fields["solver"],
        phase_steps=fields.get("phase_steps"),
    )

"""The frames of a run in its recording: those that were intended, and those that a host sent.

A capture of pins is judged by the intended ones; those that were sent, and the board that answered,
are read from the bytes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from haptogram.acoustics import AcousticModel, Drive, Medium, TransducerArray
from haptogram.driver.identity import array_of_geometry, model_of_identity
from haptogram.errors import ConfigurationError
from haptogram.evidence.backdoor import board_model_of_evidence, drive_of_record
from haptogram.records.frame import Focus, FrameKey, Intended
from haptogram.records.latch import Codes
from haptogram.records.model import model_record_fields
from haptogram_protocol import messages
from haptogram_protocol.annotation.frames import FrameAnnotator
from haptogram_protocol.errors import RemoteProtocolError

from .channels import INTENDED, MODEL, TO_BOARD, TO_HOST
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
    """Return why frames may be missing; "" if all *count* intended ones were *found*.

    None for *count*: the recording does not say how many there were.
    """
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
    """Return a frame from its fields, whose drive may be an earlier one's; keep it in *drives*.

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


# --- Frames that were sent -----------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class SentFrame:
    """One frame of the stream, as the host put it on the line.

    Attributes
    ----------
    key : FrameKey
        Its join key.
    due_us : int or None
        Device time to apply it; None: at once.
    drive : Drive or None
        Drive that it asks for; None: the board computes it from focal points.
    focus_m : tuple of 3 float, or None
        Its first focal point, in metres.
    """

    key: FrameKey
    due_us: int | None
    drive: Drive | None = None
    focus_m: tuple[float, float, float] | None = None


def model_of_recorded_answers(recording: Recording) -> AcousticModel | None:
    """Return array and air of the board that answered; None if no answer tells its array.

    The temperature of the air is that of the recorded command, else 20 C.
    """
    identity, elements = None, dict[int, messages.Element]()
    annotator = FrameAnnotator()
    for entry in recording.entries((TO_HOST,)):
        for piece in annotator.feed(entry.data):
            if isinstance(piece.message, messages.HelloReply) and identity is None:
                identity = piece.message
            elif isinstance(piece.message, messages.GeometryReply):
                reply = piece.message
                elements.update(enumerate(reply.elements, reply.first))
    array = None if identity is None else _reported_array(identity, elements)
    if identity is None or array is None:
        return None
    options = recording.run.get("configuration") or {}
    air = Medium.air(options.get("temperature_c", 20.0), frequency_hz=float(identity.carrier_hz))
    return model_of_identity(array, identity, air)


def _reported_array(
    identity: messages.HelloReply, elements: dict[int, messages.Element]
) -> TransducerArray | None:
    """Return the array, by grid or all *elements*, that has the reported hash; None if none has."""
    found = []
    if identity.grid_nx and identity.grid_ny:
        pitch_m = identity.pitch_um / 1e6
        found.append(TransducerArray.grid(identity.grid_nx, identity.grid_ny, pitch_m=pitch_m))
    if sorted(elements) == list(range(identity.transducers)):
        found.append(array_of_geometry([elements[number] for number in sorted(elements)]))
    return next((array for array in found if array.digest() == identity.geometry_hash), None)


def recorded_sessions(recording: Recording) -> set[int]:
    """Return the nonces of the sessions that the host asked for."""
    annotator = FrameAnnotator()
    return {
        piece.message.nonce
        for entry in recording.entries((TO_BOARD,))
        for piece in annotator.feed(entry.data)
        if isinstance(piece.message, messages.Hello)
    }


def recorded_sent_frames(recording: Recording, count: int) -> Iterator[SentFrame]:
    """Yield the undamaged frames of the stream to an array of *count* elements, in order."""
    annotator = FrameAnnotator()
    newest: dict[int, int] = {}  # unwrapped number by session
    time_us: int | None = None
    for entry in recording.entries((TO_BOARD,)):
        for piece in annotator.feed(entry.data):
            header, message = piece.header, piece.message
            if header is None or message is None or header.type not in messages.STREAM_RANGE:
                continue
            index = messages.unwrap(
                header.seq, newest.get(header.session, messages.FIRST_STREAM_SEQ), 16
            )
            newest[header.session] = index
            due_us = None
            if not header.flags & messages.Flag.IMMEDIATE:
                near_us = header.time_us if time_us is None else time_us
                due_us = time_us = messages.unwrap(header.time_us, near_us, 32)
            yield SentFrame(
                key=FrameKey.of_stream(header.session, index),
                due_us=due_us,
                drive=_frame_drive(message, count),
                focus_m=_frame_focus_m(message),
            )


def _frame_drive(message: messages.Message, count: int) -> Drive | None:
    """Return the drive in a sent frame for *count* elements; None if it has none or is wrong."""
    try:
        codes = messages.drive_codes(message, count)
    except RemoteProtocolError:  # the board refuses it
        return None
    if codes is None or len(codes[0]) != count:
        return None
    phases, amplitudes = (np.frombuffer(part, np.uint8) for part in codes)
    return Drive(phases, amplitudes)


def _frame_focus_m(message: messages.Message) -> tuple[float, float, float] | None:
    """Return the first focus of a POINTS frame in metres; None for other frames."""
    if not isinstance(message, messages.Points):
        return None
    first = message.points[0]
    return first.x_um / 1e6, first.y_um / 1e6, first.z_um / 1e6

"""The frames that a host sent, and the board that answered it, from the bytes of a recording."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from haptogram.acoustics import AcousticModel, Drive, Medium, TransducerArray
from haptogram.driver.identity import array_of_geometry, model_of_identity
from haptogram.records.frame import FrameKey
from haptogram_protocol import messages
from haptogram_protocol.annotation.frames import FrameAnnotator
from haptogram_protocol.errors import RemoteProtocolError

from .channels import TO_BOARD, TO_HOST
from .reader import Recording


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
    """Return the array, by grid or elements, that has the reported hash; None if none has."""
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
    """Return the drive of a sent frame; None if it has none or the board refuses it."""
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

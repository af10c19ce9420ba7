"""The drives that the host asked for: by frames of the stream, and by sequences that it stored."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import AcousticModel, Medium, TransducerArray
from haptogram.acoustics.arrays import ComplexArray
from haptogram.driver.identity import array_of_geometry, model_of_identity
from haptogram.verification.pins.line_frames import LineFrame
from haptogram_protocol import messages as m
from haptogram_protocol.errors import RemoteProtocolError

from ..judge.focusing import weights_of_points
from .dialogue import PinDialogue

#: Clause that says what the pins show, by the message that holds the drive and whether it plays.
DRIVE_CLAUSES: Final = {
    (m.Phases, False): "HG-5.2/1",
    (m.Drives, False): "HG-5.3/1",
    (m.Points, False): "HG-5.4/1",
    (m.Phases, True): "HG-7.6/4",
    (m.Points, True): "HG-5.4/1",
}
_POINT_BYTES: Final = 16
_LARGEST: Final = 1 << 26  # bytes of an upload that is followed
_FAINT: Final = 1.0 / 16.0  # HG-5.4/3: below it the phase of a computed drive is free


@dataclass(frozen=True, eq=False, slots=True)
class ReportedDrive:
    """A drive that the host asked for.

    Attributes
    ----------
    frame : LineFrame
        Frame of the stream, or PLAY.
    message : Message
        PHASES, DRIVES or POINTS, of the stream or of a sequence.
    playing : Play or None
        None: of the stream.
    number : int
        Frames of the playback before it, through all loops.
    """

    frame: LineFrame
    message: m.Message
    playing: m.Play | None = None
    number: int = 0

    @property
    def clause(self) -> str:
        """Clause that says what the pins show."""
        return DRIVE_CLAUSES[type(self.message), self.playing is not None]

    @property
    def path(self) -> str:
        """Message, format and way to the registers."""
        return drive_path(self.message, self.frame.header.flags, is_played=self.playing is not None)

    @property
    def due_us(self) -> int | None:
        """Device time at which it is due; None: as soon as it is ready."""
        header = self.frame.header
        if header.flags & m.Flag.IMMEDIATE:
            return None
        behind_us = 0 if self.playing is None else self.number * self.playing.period_us
        return (header.time_us + behind_us) % 2**32

    def registers(self, model: AcousticModel | None, count: int) -> NDArray[np.uint8] | None:
        """Return the (2, N) phase and amplitude codes; None: the array is not known."""
        if isinstance(self.message, m.Points):
            if model is None:
                return None
            return registers_of_points(weights_of_points(model, self.message.points))
        parts = m.drive_codes(self.message, count)
        return None if parts is None else np.array([np.frombuffer(p, np.uint8) for p in parts])

    def free_phases(self, model: AcousticModel | None, count: int) -> NDArray[np.bool_]:
        """Return the (N,) elements whose phase is free, as they all but cancel (HG-5.4/3)."""
        if not isinstance(self.message, m.Points) or model is None:
            return np.zeros(count, np.bool_)
        free: NDArray[np.bool_] = (
            np.abs(weights_of_points(model, self.message.points)) < _FAINT + 1.0 / 255.0
        )
        return free


def drive_path(message: m.Message, flags: int, *, is_played: bool) -> str:
    """Return message, format and way of a drive to the registers, in words."""
    way = "played" if is_played else "at once" if flags & m.Flag.IMMEDIATE else "at its time"
    return f"{type(message).__name__.upper()}, {way}"


def advertised_drive_paths(identity: m.HelloReply) -> Iterator[tuple[str, str]]:
    """Yield clause and name of every path of a drive that a board advertises."""
    kinds: list[m.Message] = [m.Phases(b"")]
    if identity.features & m.Feature.AMPLITUDE:
        kinds.append(m.Drives(b""))
    if identity.features & m.Feature.POINTS:
        kinds.append(m.Points(()))
    for message, flags in product(kinds, (m.Flag.IMMEDIATE, 0)):
        yield DRIVE_CLAUSES[type(message), False], drive_path(message, flags, is_played=False)
    for feature, message in (
        (m.Feature.SEQUENCE_PHASES, m.Phases(b"")),
        (m.Feature.SEQUENCE_POINTS, m.Points(())),
    ):
        if identity.features & feature:
            yield DRIVE_CLAUSES[type(message), True], drive_path(message, 0, is_played=True)


def registers_of_points(weights: ComplexArray) -> NDArray[np.uint8]:
    """Return the (2, N) codes of weights (N,): HG-5.4/1 and HG-5.4/2."""
    phases = np.floor(np.angle(weights) / (2.0 * np.pi) * 256.0 + 0.5) % 256.0
    amplitudes = np.floor(255.0 * np.minimum(1.0, np.abs(weights)) + 0.5)
    return np.array([phases, amplitudes]).astype(np.uint8)


# --- uploads -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class StoredUpload:
    """An upload that the board took.

    Attributes
    ----------
    since : float
        Arrival of its commit, in periods.
    begin : UploadBegin
        Kind, size and target of the upload.
    data : bytes or None
        Its bytes; None: the analyser did not read them all.
    """

    since: float
    begin: m.UploadBegin
    data: bytes | None


def uploads_of_pin_dialogue(dialogue: PinDialogue) -> list[StoredUpload]:
    """Return the uploads that the board took, in order."""
    found, begin, data = [], None, bytearray()
    for frame in dialogue.to_board:
        message = frame.message
        if isinstance(message, m.UploadBegin) and message.size <= _LARGEST:
            if dialogue.answer(frame, m.MessageType.UPLOAD_BEGIN_REPLY):
                begin, data = message, bytearray(message.size)
        elif isinstance(message, m.UploadChunk):
            if message.offset + len(message.data) <= len(data):
                data[message.offset : message.offset + len(message.data)] = message.data
        elif isinstance(message, m.UploadCommit) and begin is not None:
            is_taken = dialogue.answer(frame, m.MessageType.UPLOAD_COMMIT_REPLY)
            if is_taken and message.target == begin.target:
                is_whole = zlib.crc32(data) == begin.crc
                found.append(StoredUpload(frame.arrival, begin, bytes(data) if is_whole else None))
    return found


# --- the join ------------------------------------------------------------------------------------


class DrivesOfPinDialogue:
    """The drives that the host asked for, by what the board tells of a latch.

    Parameters
    ----------
    dialogue : PinDialogue
        The capture.
    """

    def __init__(self, dialogue: PinDialogue) -> None:
        self._dialogue = dialogue
        self.uploads = uploads_of_pin_dialogue(dialogue)
        self.identity = next((reply for _, reply in dialogue.said(m.HelloReply)), None)
        self.count = 0 if self.identity is None else self.identity.transducers
        self._stream = self._frames_of_stream()
        self._plays = [
            (frame, play)
            for frame, play in dialogue.sent(m.Play)
            if dialogue.answer(frame, m.MessageType.PLAY_REPLY)
        ]
        self._models: dict[int, AcousticModel] = {}

    def of(self, frame: LineFrame, at: float) -> ReportedDrive | None:
        """Return the drive of a latch that *frame* reports; None: it is not known."""
        message = frame.message
        if isinstance(message, m.Trace):
            return self._of_stream(frame.header.session, message.index, message.crc, at)
        if not isinstance(message, m.TracePlayback | m.DriveReply):
            return None
        if message.key.sequence:
            return self._of_playback(message.key, at)
        return self._of_stream(frame.header.session, message.key.index, None, at)

    def model(self, sound_speed_mm_s: int) -> AcousticModel | None:
        """Return the model of the board's array at a speed of sound; None: not known."""
        if self.identity is None or self._array is None:
            return None
        if sound_speed_mm_s not in self._models:
            air = Medium.air(20.0, frequency_hz=float(self.identity.carrier_hz))
            model = model_of_identity(self._array, self.identity, air)
            self._models[sound_speed_mm_s] = model.with_sound_speed(sound_speed_mm_s / 1000.0)
        return self._models[sound_speed_mm_s]

    @cached_property
    def _array(self) -> TransducerArray | None:
        """Return the array that the board describes, by grid or elements; None if by neither.

        By elements it is None, too, if one of them was not captured.
        """
        identity = self.identity
        assert identity is not None  # model() has seen to it
        if identity.grid_nx and identity.grid_ny:
            pitch_m = identity.pitch_um / 1e6
            return TransducerArray.grid(identity.grid_nx, identity.grid_ny, pitch_m=pitch_m)
        shown: dict[int, m.Element] = {}
        for _, reply in self._dialogue.said(m.GeometryReply):
            shown.update(enumerate(reply.elements, reply.first))
        if sorted(shown) != list(range(identity.transducers)):
            return None
        return array_of_geometry([shown[number] for number in sorted(shown)])

    def _frames_of_stream(self) -> dict[tuple[int, int], list[ReportedDrive]]:
        """Return the drives that stream frames carried, by (session, unwrapped frame number)."""
        newest: dict[int, int] = {}
        found: dict[tuple[int, int], list[ReportedDrive]] = {}
        for frame in self._dialogue.to_board:
            header = frame.header
            if header.type not in m.STREAM_RANGE or frame.message is None:
                continue
            index = m.unwrap(header.seq, newest.get(header.session, m.FIRST_STREAM_SEQ), 16)
            newest[header.session] = max(index, newest.get(header.session, index))
            if (type(frame.message), False) in DRIVE_CLAUSES:
                drive = ReportedDrive(frame, frame.message)
                found.setdefault((header.session, index), []).append(drive)
        return found

    def _of_stream(
        self, session: int, index: int, crc: int | None, at: float
    ) -> ReportedDrive | None:
        """Return the drive that a stream frame carried for a latch; None if it is not sure which.

        It is of *session* and frame *index*, and has the CRC-32 *crc* or is the only one. The only
        one is unsure if bytes before the latch at *at* (in carrier periods) were unreadable.
        """
        sent = self._stream.get((session, index), [])
        exact = [one for one in sent if crc is not None and self._crc(one) == crc]
        if exact:
            return exact[-1]
        # A board may tell the CRC-32 of another drive than it was sent; the pins are judged.
        is_alone = len(sent) == 1 and not self._is_doubtful(sent[0].frame.arrival, at)
        return sent[0] if is_alone else None

    def _crc(self, drive: ReportedDrive) -> int | None:
        """Return the CRC-32 of a drive's codes as sent.

        None if the codes are invalid, or were computed by the board from points.
        """
        try:
            parts = m.drive_codes(drive.message, self.count)
        except RemoteProtocolError:
            return None
        return None if parts is None else zlib.crc32(b"".join(parts))

    def _is_doubtful(self, begin: float, end: float) -> bool:
        """Return True if a byte from 1 s before *begin* to *end* (in periods) is unreadable."""
        return self._dialogue.next_unread(begin - self._dialogue.record.carrier_hz) < end

    def _of_playback(self, key: m.LatchKey, at: float) -> ReportedDrive | None:
        """Return the stored drive that a playback latched at *at*, in carrier periods.

        None if the upload or the PLAY of its sequence was not seen, or may be an unreadable one.
        """
        plays = [(f, p) for f, p in self._plays if f.arrival < at and p.sequence == key.sequence]
        stored = [
            one
            for one in self.uploads
            if one.since < at
            and one.begin.kind is not m.UploadKind.CORRECTION
            and one.begin.target == key.sequence
        ]
        if not plays or not stored or stored[-1].data is None:
            return None
        frame, play = plays[-1]
        if self._is_doubtful(stored[-1].since, frame.arrival):
            return None  # another upload, or another PLAY
        begin, data = stored[-1].begin, stored[-1].data
        points = begin.points_per_frame if begin.kind is m.UploadKind.POINTS else 0
        size = points * _POINT_BYTES or self.count
        part = data[key.index * size : (key.index + 1) * size]
        if len(part) < size:
            return None
        message = m.Points.deserialize(part) if points else m.Phases(part)
        return ReportedDrive(frame, message, play, key.loop * (len(data) // size) + key.index)

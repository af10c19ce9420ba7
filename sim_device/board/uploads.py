"""Uploads: announced, sent in chunks, taken whole or not at all.  SPEC.md chapter 7."""

from __future__ import annotations

import functools
import zlib

from haptogram.settings.frozen import dataclass
from haptogram_protocol import messages as m
from haptogram_protocol.rules import UPLOAD_CAPABILITIES

from .refusal import RefusalError
from .registers import Content, full_amplitude_registers
from .settings import BoardSettings


class _BoardUpload:
    """An upload that has begun, and the bytes of it that have come."""

    def __init__(self, begin: m.UploadBegin) -> None:
        self.begin = begin
        self.data = bytearray()

    def store(self, offset: int, chunk: bytes) -> None:
        """Take a piece that begins within what has come or right behind it."""
        self.data[offset : offset + len(chunk)] = chunk


@dataclass(frozen=True, slots=True)
class Upload:
    """An upload that was committed: a sequence of frames, or the codes of a phase correction.

    It keeps the bytes and makes a frame of them when it is due: at 1 kHz that costs nothing, and
    a megabyte of frames is there at once.

    Attributes
    ----------
    begin : UploadBegin
        The announced upload.
    data : bytes
        The received bytes.
    frame_size : int
        Bytes in one frame.
    """

    begin: m.UploadBegin
    data: bytes
    frame_size: int

    def __len__(self) -> int:
        return len(self.data) // self.frame_size

    def __getitem__(self, index: int) -> Content:
        piece = self.data[index * self.frame_size : (index + 1) * self.frame_size]
        if self.begin.kind is m.UploadKind.PHASES:
            return full_amplitude_registers(piece)
        return _points_uploaded_to_board(piece)


class BoardUploads:
    """At most one upload at a time; a new one abandons the old."""

    def __init__(self, settings: BoardSettings) -> None:
        self._settings = settings
        self._pending: _BoardUpload | None = None

    @property
    def target(self) -> int | None:
        """Target of the upload that was announced and neither committed nor abandoned."""
        return None if self._pending is None else self._pending.begin.target

    def abandon(self) -> None:
        """Forget an upload that was not committed."""
        self._pending = None

    def begin(self, begin: m.UploadBegin, room: int) -> None:
        """Make ready for an upload.

        Parameters
        ----------
        begin : UploadBegin
            The announced upload.
        room : int
            Bytes that the board has left to keep it in.

        Raises
        ------
        RefusalError
            UNSUPPORTED, BAD_VALUE, BAD_LENGTH or TOO_LARGE.
        """
        if not UPLOAD_CAPABILITIES[begin.kind] & self._settings.features:
            raise RefusalError(m.ErrorCode.UNSUPPORTED, begin.TYPE)
        self._check_target(begin)
        self._check_size(begin, room)
        self._pending = _BoardUpload(begin)

    def chunk(self, chunk: m.UploadChunk) -> int:
        """Store a piece; return how many bytes are there.

        Raises
        ------
        RefusalError
            BAD_VALUE past the end of the upload, BAD_LENGTH for a chunk too long, INCOMPLETE for
            one after bytes that have not come.
        """
        pending = self._expect()
        if len(chunk.data) > self._settings.max_chunk:
            raise RefusalError(m.ErrorCode.BAD_LENGTH, self._settings.max_chunk)
        if chunk.offset + len(chunk.data) > pending.begin.size:
            raise RefusalError(m.ErrorCode.BAD_VALUE, 0)
        received = len(pending.data)
        if chunk.offset > received:
            raise RefusalError(m.ErrorCode.INCOMPLETE, received)
        pending.store(chunk.offset, chunk.data)
        return len(pending.data)

    def commit(self) -> Upload:
        """Return the uploaded bytes.

        Raises
        ------
        RefusalError
            INCOMPLETE or CRC_MISMATCH.
        """
        pending = self._expect()
        if (received := len(pending.data)) < pending.begin.size:
            raise RefusalError(m.ErrorCode.INCOMPLETE, received)
        crc = zlib.crc32(pending.data)
        if crc != pending.begin.crc:
            raise RefusalError(m.ErrorCode.CRC_MISMATCH, crc)
        return Upload(pending.begin, bytes(pending.data), self._frame_size(pending.begin))

    def _expect(self) -> _BoardUpload:
        """Return the pending upload; the caller has refused requests without one."""
        assert self._pending is not None  # the board refuses it without a `target`
        return self._pending

    def _check_target(self, begin: m.UploadBegin) -> None:
        """Refuse an upload (RefusalError BAD_VALUE) by its points in a frame, or by its target.

        The target is 0 for a correction and another number for a sequence.
        """
        points = begin.points_per_frame
        most = self._settings.max_points if begin.kind is m.UploadKind.POINTS else 0
        if not min(most, 1) <= points <= most:
            raise RefusalError(m.ErrorCode.BAD_VALUE, m.UploadBegin.WIRE["points_per_frame"].offset)
        if (begin.target == 0) != (begin.kind is m.UploadKind.CORRECTION):
            raise RefusalError(m.ErrorCode.BAD_VALUE, m.UploadBegin.WIRE["target"].offset)

    def _check_size(self, begin: m.UploadBegin, room: int) -> None:
        """Refuse an upload's size: RefusalError BAD_LENGTH unless it is 1 or more whole frames.

        TOO_LARGE if above *room*, the free bytes, or another limit. A correction is one frame.
        """
        limits, frame = self._settings, self._frame_size(begin)
        frames, rest = divmod(begin.size, frame)
        if not frames or rest or (begin.kind is m.UploadKind.CORRECTION and frames > 1):
            raise RefusalError(m.ErrorCode.BAD_LENGTH, frame)
        if begin.size > (limit := min(limits.max_upload_bytes, room)):
            raise RefusalError(m.ErrorCode.TOO_LARGE, limit)
        is_sequence = begin.kind is not m.UploadKind.CORRECTION
        if is_sequence and frames > (limit := limits.max_sequence_frames):
            raise RefusalError(m.ErrorCode.TOO_LARGE, limit)

    def _frame_size(self, begin: m.UploadBegin) -> int:
        """Return how many bytes a frame of the upload has: a code a transducer, or its points."""
        if begin.kind is m.UploadKind.POINTS:
            return begin.points_per_frame * m.FocalPoint.LAYOUT.size
        return self._settings.count


@functools.lru_cache(maxsize=1024)
def _points_uploaded_to_board(piece: bytes) -> tuple[m.FocalPoint, ...]:
    """Return the focal points packed in *piece*."""
    size = m.FocalPoint.LAYOUT.size
    return tuple(m.FocalPoint.unpack(piece[i : i + size]) for i in range(0, len(piece), size))

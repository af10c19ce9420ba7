"""Uploads: announced, sent in chunks, taken whole or not at all.  SPEC.md chapter 7."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from typing import Final

from haptogram_protocol.messages import (
    ErrorCode,
    Feature,
    FocalPoint,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    UploadKind,
)

from .drives import Content, full_amplitude
from .refusal import RefusalError
from .settings import BoardSettings

_FEATURE = {
    UploadKind.PHASES: Feature.SEQUENCE_PHASES,
    UploadKind.POINTS: Feature.SEQUENCE_POINTS,
    UploadKind.CORRECTION: Feature.CORRECTION,
}
_MAX_RANGES: Final = 64  # far more than an upload window leaves; bounds the work of one chunk


@dataclass(slots=True)
class _Pending:
    """An upload that has begun: its bytes, and the ranges of them that have come."""

    begin: UploadBegin
    data: bytearray
    ranges: list[tuple[int, int]] = field(default_factory=list)  # sorted, never touching

    def store(self, offset: int, chunk: bytes) -> None:
        self.data[offset : offset + len(chunk)] = chunk
        low, high = offset, offset + len(chunk)
        apart = []
        for start, stop in self.ranges:
            if stop < low or start > high:
                apart.append((start, stop))
            else:
                low, high = min(low, start), max(high, stop)
        self.ranges = sorted([*apart, (low, high)]) if high > low else apart

    @property
    def received(self) -> int:
        """Bytes from the start without a gap."""
        return self.ranges[0][1] if self.ranges and self.ranges[0][0] == 0 else 0


@dataclass(frozen=True, slots=True)
class Upload:
    """An upload that was committed: a sequence of frames, or the codes of a phase correction.

    It keeps the bytes and makes a frame of them when it is due: at 1 kHz that costs nothing, and
    a megabyte of frames is there at once.

    Attributes
    ----------
    begin : UploadBegin
        What was announced.
    data : bytes
        What came.
    frame_size : int
        Bytes in one frame.
    """

    begin: UploadBegin
    data: bytes
    frame_size: int

    def __len__(self) -> int:
        return len(self.data) // self.frame_size

    def __getitem__(self, index: int) -> Content:
        piece = self.data[index * self.frame_size : (index + 1) * self.frame_size]
        if self.begin.kind is UploadKind.PHASES:
            return full_amplitude(piece, 8)
        return _points(piece)


class Uploads:
    """At most one upload at a time; a new one abandons the old."""

    def __init__(self, settings: BoardSettings) -> None:
        self._settings = settings
        self._pending: _Pending | None = None

    def abandon(self) -> None:
        """Forget an upload that was not committed."""
        self._pending = None

    def begin(self, begin: UploadBegin) -> None:
        """Make room.

        Raises
        ------
        RefusalError
            UNSUPPORTED, BAD_VALUE, BAD_LENGTH or TOO_LARGE.
        """
        if not _FEATURE[begin.kind] & self._settings.features:
            raise RefusalError(ErrorCode.UNSUPPORTED, begin.TYPE, f"no {begin.kind.name} uploads")
        self._check_target(begin)
        self._check_size(begin)
        self._pending = _Pending(begin, bytearray(begin.size))

    def chunk(self, chunk: UploadChunk) -> int:
        """Store a piece; return how many bytes from the start are there without a gap.

        Raises
        ------
        RefusalError
            BAD_STATE without an upload, BAD_VALUE past its end, BAD_LENGTH for a chunk too long,
            BUSY when the chunks lie scattered.
        """
        pending = self._expect()
        if len(chunk.data) > self._settings.max_chunk:
            limit = self._settings.max_chunk
            raise RefusalError(ErrorCode.BAD_LENGTH, limit, f"chunk of {len(chunk.data)} bytes")
        if chunk.offset + len(chunk.data) > pending.begin.size:
            end = chunk.offset + len(chunk.data)
            raise RefusalError(
                ErrorCode.BAD_VALUE, 0, f"chunk up to {end} of {pending.begin.size} bytes"
            )
        if len(pending.ranges) > _MAX_RANGES:
            raise RefusalError(ErrorCode.BUSY, 0, f"more than {_MAX_RANGES} gaps")
        pending.store(chunk.offset, chunk.data)
        return pending.received

    def commit(self, commit: UploadCommit) -> Upload:
        """Return what was uploaded.

        Raises
        ------
        RefusalError
            BAD_STATE, BAD_VALUE (another target), INCOMPLETE or CRC_MISMATCH.
        """
        pending = self._expect()
        if commit.target != pending.begin.target:
            text = f"commit of {commit.target}, begun was {pending.begin.target}"
            raise RefusalError(ErrorCode.BAD_VALUE, 0, text)
        if pending.received < pending.begin.size:
            text = f"{pending.received} of {pending.begin.size} bytes without a gap"
            raise RefusalError(ErrorCode.INCOMPLETE, pending.received, text)
        crc = zlib.crc32(pending.data)
        if crc != pending.begin.crc:
            text = f"CRC-32 is {crc:08x}, announced {pending.begin.crc:08x}"
            raise RefusalError(ErrorCode.CRC_MISMATCH, crc, text)
        return Upload(pending.begin, bytes(pending.data), self._frame_size(pending.begin))

    def _expect(self) -> _Pending:
        if self._pending is None:
            raise RefusalError(ErrorCode.BAD_STATE, 0, "no upload has begun")
        return self._pending

    def _check_target(self, begin: UploadBegin) -> None:
        points = begin.points_per_frame
        most = self._settings.max_points if begin.kind is UploadKind.POINTS else 0
        if not min(most, 1) <= points <= most:
            offset = UploadBegin.WIRE["points_per_frame"].offset
            text = f"{points} points in a frame, at most {most}"
            raise RefusalError(ErrorCode.BAD_VALUE, offset, text)
        if (begin.target == 0) != (begin.kind is UploadKind.CORRECTION):
            offset = UploadBegin.WIRE["target"].offset
            text = f"{begin.kind.name} for {begin.target}"
            raise RefusalError(ErrorCode.BAD_VALUE, offset, text)

    def _check_size(self, begin: UploadBegin) -> None:
        limits, frame = self._settings, self._frame_size(begin)
        if begin.size > limits.max_upload_bytes:
            limit = limits.max_upload_bytes
            raise RefusalError(ErrorCode.TOO_LARGE, limit, f"{begin.size} bytes, limit {limit}")
        if begin.size == 0 or begin.size % frame:
            text = f"{begin.size} bytes, not a multiple of {frame}"
            raise RefusalError(ErrorCode.BAD_LENGTH, frame, text)
        frames = begin.size // frame
        limit = 1 if begin.kind is UploadKind.CORRECTION else limits.max_sequence_frames
        if frames > limit:
            raise RefusalError(ErrorCode.TOO_LARGE, limit, f"{frames} frames, limit {limit}")

    def _frame_size(self, begin: UploadBegin) -> int:
        if begin.kind is UploadKind.POINTS:
            return begin.points_per_frame * FocalPoint.LAYOUT.size
        return self._settings.count


def _points(piece: bytes) -> tuple[FocalPoint, ...]:
    size = FocalPoint.LAYOUT.size
    return tuple(FocalPoint.unpack(piece[i : i + size]) for i in range(0, len(piece), size))

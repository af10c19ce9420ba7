"""Uploads and playback on the board's clock.  SPEC.md chapter 7."""

from __future__ import annotations

from ..documented import DocumentedEnum
from ..record import record, tail, wire
from .header import Ack, Message


class UploadKind(DocumentedEnum):
    """Content of an upload.  HG-7.2."""

    PHASES = 1, "sequence, N bytes a frame: 8-bit phases, every amplitude 255"
    POINTS = 2, "sequence, points_per_frame x 16 bytes a frame: focal points"
    CORRECTION = 3, "phase correction, N bytes: 1/256 of a turn each"


@record
class UploadBegin(Message):
    """Announce an upload.  HG-7.2."""

    kind: UploadKind = wire("B", "1 phases, 2 points, 3 phase correction", enum=UploadKind)
    points_per_frame: int = wire("B", "kind 2: focal points in every frame; else 0")
    target: int = wire("H", "sequence id, 1 or more; kind 3: 0")
    size: int = wire("I", "bytes to come")
    crc: int = wire("I", "CRC-32 of these bytes")


@record
class UploadBeginReply(Message):
    """The board is ready for the upload.  HG-7.2."""

    max_chunk: int = wire("H", "bytes of data in one chunk, at most")
    window: int = wire("H", "chunks that may be unanswered at a time")


@record
class UploadChunk(Message):
    """Part of an upload, at an absolute offset: sending it twice does no harm.  HG-7.3."""

    offset: int = wire("I", "where these bytes belong")
    data: bytes = tail("bytes of the upload")


@record
class UploadChunkReply(Message):
    """Progress of the upload.  HG-7.3."""

    received: int = wire("I", "bytes that are there, from the start")


@record
class UploadCommit(Message):
    """Take the upload, whole or not at all.  HG-7.4."""

    target: int = wire("H", "as in UPLOAD_BEGIN")


@record
class UploadCommitReply(Message):
    """The upload is in force.  HG-7.4."""

    frames: int = wire("I", "frames in the sequence; kind 3: number of transducers")


@record
class Play(Message):
    """Play a sequence on the board's clock, from the header's t_apply on.  HG-7.6."""

    sequence: int = wire("H", "sequence id")
    period_us: int = wire("I", "time from one frame to the next, microseconds")
    loops: int = wire("I", "how often; 0: until STOP")
    unattended_ms: int = wire("I", "replaces host_timeout_ms while this plays")


@record
class PlayReply(Ack):
    """Answer to PLAY."""


@record
class Stop(Message):
    """End playback; the last drive is held for ``hold_ms``.  HG-7.7."""


@record
class StopReply(Ack):
    """Answer to STOP."""


@record
class PlaybackEnded(Message):
    """A sequence ended, by itself or by STOP, MUTE, a timer.  HG-7.8."""

    sequence: int = wire("H", "sequence id")
    loops: int = wire("I", "whole passes played")
    frames: int = wire("I", "frames latched")

"""Uploads: a window of chunks under way, then one commit.  SPEC.md chapter 7."""

from __future__ import annotations

import zlib
from typing import Final

from haptogram.driver.frames.frame import Frame
from haptogram.driver.line.link import Link
from haptogram.errors import ConfigurationError, DeviceError, WrongProtocolError
from haptogram.settings.arguments import check_argument_kind
from haptogram.settings.frozen import dataclass
from haptogram_protocol import messages
from haptogram_protocol.rules import UPLOAD_CAPABILITIES

_LARGEST_CHUNK: Final = 2048  # leaves room for header, CRC and stuffing in any frame
_TURN_NS: Final = 100_000_000


@dataclass(frozen=True, slots=True)
class SequenceData:
    """Frames as an upload holds them.

    Attributes
    ----------
    kind : UploadKind
        Kind of the frames.
    points_per_frame : int
        Focal points in every frame; 0 for phases.
    data : bytes
        All frames, one after the other.
    frames : int
        How many.
    """

    kind: messages.UploadKind
    points_per_frame: int
    data: bytes
    frames: int

    @classmethod
    def of(cls, frames: list[Frame]) -> SequenceData:
        """Return *frames* as a sequence.

        Raises
        ------
        ConfigurationError
            If they are not all phases, or all points, or do not hold as many focal points.
        """
        modes = sorted({frame.mode for frame in frames})
        if modes not in (["phases"], ["points"]):
            raise ConfigurationError(
                f"frames of the mode {', '.join(modes)}; sequences hold phases or points, not "
                "drives and not both"
            )
        data = b"".join(frame.message.serialize() for frame in frames)
        counts = {len(f.message.points) for f in frames if isinstance(f.message, messages.Points)}
        if not counts:
            return cls(messages.UploadKind.PHASES, 0, data, len(frames))
        if len(counts) > 1:
            raise ConfigurationError(
                f"frames of {min(counts)} to {max(counts)} foci; those of a sequence have as many"
            )
        return cls(messages.UploadKind.POINTS, counts.pop(), data, len(frames))

    def check(self, identity: messages.HelloReply) -> None:
        """Refuse a sequence that the board cannot hold, before the first byte is sent."""
        _check_upload(identity, self.kind, len(self.data))
        if self.frames > identity.max_sequence_frames:
            raise ConfigurationError(
                f"a sequence of {self.frames} frames; the board holds "
                f"{identity.max_sequence_frames}"
            )


def _check_upload(identity: messages.HelloReply, kind: messages.UploadKind, size: int) -> None:
    """Refuse an upload of *size* bytes that the board does not take, for its kind or its size.

    Raises
    ------
    ConfigurationError
        Naming the value and the limit.
    """
    if not identity.features & UPLOAD_CAPABILITIES[kind]:
        raise ConfigurationError(f"the board takes no uploads of {kind.name.lower()}")
    if size > identity.max_upload_bytes:
        raise ConfigurationError(
            f"an upload of {size} bytes; the board takes {identity.max_upload_bytes}"
        )


def upload_by_driver(
    link: Link,
    kind: messages.UploadKind,
    target: int,
    data: bytes,
    *,
    points_per_frame: int = 0,
) -> messages.UploadCommitReply:
    """Transfer *data*, with as many chunks under way as the board allows, and commit it.

    Raises
    ------
    DeviceError
        The board refused it; what it held before stays.
    """
    begin = messages.UploadBegin(kind, points_per_frame, target, len(data), zlib.crc32(data))
    reply = link.request(begin, messages.UploadBeginReply)
    _send_upload_chunks(link, data, min(reply.max_chunk, _LARGEST_CHUNK))
    return link.request(messages.UploadCommit(target), messages.UploadCommitReply)


def upload_correction(link: Link, identity: messages.HelloReply, codes: bytes) -> None:
    """Set the phase correction of every transducer, in 1/256 turns."""
    check_argument_kind("codes", codes, bytes, "bytes")
    if len(codes) != identity.transducers:
        raise ConfigurationError(
            f"{len(codes)} phase corrections; the board has {identity.transducers} transducers"
        )
    _check_upload(identity, messages.UploadKind.CORRECTION, len(codes))
    upload_by_driver(link, messages.UploadKind.CORRECTION, 0, codes)


def _send_upload_chunks(link: Link, data: bytes, size: int) -> None:
    """Send *data* in chunks of *size* bytes; after a loss, resume at the board's offset.

    Raises WrongProtocolError if the board is not further after a try than before.
    """
    received = 0
    while received < len(data):
        before, received = received, _send_chunks_from(link, data, size, received)
        if received <= before:
            raise WrongProtocolError(f"{link.url}: UPLOAD_CHUNK at {before} adds nothing")


def _send_chunks_from(link: Link, data: bytes, size: int, offset: int) -> int:
    """Send chunks of *size* bytes from *offset* on, until all are answered.

    Returns how many bytes the board has. A chunk lost on the line is repeated by the link; an
    INCOMPLETE from the board ends the sending.
    """
    waiting: list[int] = []
    received = 0
    while offset < len(data) or waiting:
        while offset < len(data) and _may_send_chunk(link, size):
            waiting.append(link.send_chunk(messages.UploadChunk(offset, data[offset:][:size])))
            offset += size
        for seq in [seq for seq in waiting if link.answered(seq)]:
            waiting.remove(seq)
            try:
                reply = link.answer_of(seq, messages.UploadChunkReply)
                received = max(received, reply.received)
            except DeviceError as error:
                if error.code != messages.ErrorCode.INCOMPLETE:
                    raise
                offset = len(data)
        if offset < len(data) or waiting:
            link.turn(_next_chunk_turn_ns(link, size, all_sent=offset >= len(data)))
    return received


def _may_send_chunk(link: Link, size: int) -> bool:
    """Return True if a chunk has room: a free place of the window, at most *size* unsent bytes."""
    unsent = link.line.unsent_bytes(link.now_ns())
    return link.connection.chunks_free > 0 and unsent <= size


def _next_chunk_turn_ns(link: Link, size: int, *, all_sent: bool) -> int:
    """Return the host time of the next look: for answers in 100 ms, or when a chunk has room.

    For answers, if all chunks are sent or the window is full. A chunk has room while at most *size*
    bytes, its own size, are unsent on the line.
    """
    now_ns = link.now_ns()
    if all_sent or link.connection.chunks_free == 0:
        return now_ns + _TURN_NS
    return max(link.line.room_at_ns(size), now_ns + 1)

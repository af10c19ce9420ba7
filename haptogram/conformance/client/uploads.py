"""Uploads, one chunk after the other."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.rules import UPLOADS

from ..outcome import check, not_observed
from .board_client import BoardClient
from .wire import ReceivedByClient

#: Every sequence that cases store, but those of a case that fills the store: a board may have room
#: for few, and none can be deleted.
SEQUENCES: Final = (1, 2, 3, 4, 5, 6, 7, 0x0101, 0x0201, 0x8001)
_LARGEST_CHUNK: Final = 1024


@dataclass(frozen=True, slots=True)
class UploadForm:
    """Form of an upload.

    Attributes
    ----------
    kind : UploadKind
        Content of the frames.
    points : int
        Focal points in a frame; 0: none.
    target : int
        Sequence; 0: the correction.
    frame_bytes : int
        Bytes of a frame.
    """

    kind: m.UploadKind
    points: int
    target: int
    frame_bytes: int

    def most_frames(self, board: BoardClient) -> int:
        """Return the number of frames that one upload takes at most."""
        most = board.identity.max_upload_bytes // self.frame_bytes
        return min(most, board.identity.max_sequence_frames) if self.target else 1

    def request(self, size: int, crc: int = 0) -> m.UploadBegin:
        """Return an UPLOAD_BEGIN of *size* bytes."""
        return m.UploadBegin(self.kind, self.points, self.target, size, crc)

    def begin(self, board: BoardClient, data: bytes) -> m.UploadBeginReply:
        """Announce an upload; see :func:`begin_upload`."""
        return begin_upload(board, self.kind, self.target, data, self.points)

    def upload(self, board: BoardClient, data: bytes) -> None:
        """Upload *data*; see :func:`upload_to_board`."""
        upload_to_board(board, self.kind, self.target, data, self.points)


def upload_forms(
    board: BoardClient, target: int = 1, points: Iterable[int] = (1,)
) -> list[UploadForm]:
    """Return every form of upload that the board takes; UNIMPLEMENTED if it takes none."""
    board.need_any(UPLOADS)
    count, point_bytes = board.identity.transducers, m.FocalPoint.LAYOUT.size
    forms = {
        m.Feature.SEQUENCE_PHASES: [UploadForm(m.UploadKind.PHASES, 0, target, count)],
        m.Feature.CORRECTION: [UploadForm(m.UploadKind.CORRECTION, 0, 0, count)],
        m.Feature.SEQUENCE_POINTS: [
            UploadForm(m.UploadKind.POINTS, number, target, number * point_bytes)
            for number in points
        ],
    }
    return [form for feature, some in forms.items() if board.has(feature) for form in some]


def upload_to_board(
    board: BoardClient, kind: m.UploadKind, target: int, data: bytes, points: int = 0
) -> None:
    """Upload *data* and commit it; FAILED if the board refuses a step."""
    begin_upload(board, kind, target, data, points)
    send_upload_chunks(board, data)
    board.link.call(m.UploadCommit(target), m.UploadCommitReply)
    if kind is m.UploadKind.CORRECTION:
        board.correction = data


def upload_correction(board: BoardClient, codes: bytes | None = None) -> None:
    """Upload a phase correction; None: one that shifts every phase by a random code."""
    if codes is None:
        drawn = board.random.randbytes(board.identity.transducers)
        codes = bytes(1 + code % 255 for code in drawn)
    upload_to_board(board, m.UploadKind.CORRECTION, 0, codes)


def frames_with_room(
    board: BoardClient, kind: m.UploadKind, target: int, wanted: int, size: int
) -> int:
    """Return the number of frames of *size* bytes that find room, *wanted* at most.

    Sequences that are stored already take room, and HG-4.3 limits one upload only.  The board says
    how many bytes are left (HG-7.2/1); NOT-OBSERVED if they hold no frame.
    """
    points = int(kind is m.UploadKind.POINTS)
    begin = upload_request(board, kind, target, max(1, wanted) * size, points)
    answer = board.link.ask(begin)
    if not isinstance(answer.message, m.Error):
        board.link.reply_in(answer, m.UploadBeginReply, m.UploadBegin.TYPE)
        return wanted
    left = board.link.error_in(answer, m.UploadBegin.TYPE, m.ErrorCode.TOO_LARGE).detail
    if left < size:
        not_observed(f"the store has {left} bytes left, and one frame takes {size}")
    return min(left // size, wanted)


def begin_upload(
    board: BoardClient, kind: m.UploadKind, target: int, data: bytes, points: int = 0
) -> m.UploadBeginReply:
    """Announce an upload of *data*; FAILED if the board refuses.

    NOT-OBSERVED if it is more than this board takes in one upload, or has room for by its own word.
    """
    begin = upload_request(board, kind, target, len(data), points, crc=zlib.crc32(data))
    return announce_upload(board, begin)


def begin_any_upload(board: BoardClient, sequence: int) -> None:
    """Announce an upload of a frame for *sequence*, or of a correction if none is stored.

    UNIMPLEMENTED if the board takes neither.
    """
    board.need_any(m.Feature.SEQUENCE_PHASES | m.Feature.CORRECTION)
    form = upload_forms(board, sequence)[0]
    form.begin(board, bytes(form.frame_bytes))


def announce_upload(board: BoardClient, begin: m.UploadBegin) -> m.UploadBeginReply:
    """Send *begin*; NOT-OBSERVED if what is stored leaves less room by the board's own word."""
    answer = board.link.ask(begin)
    require_room_for_upload(begin, answer)
    return board.link.reply_in(answer, m.UploadBeginReply, m.UploadBegin.TYPE)


def require_room_for_upload(begin: m.UploadBegin, answer: ReceivedByClient) -> None:
    """End the case as NOT-OBSERVED if *answer* tells that what is stored leaves less room."""
    if isinstance(answer.message, m.Error) and answer.message.code == m.ErrorCode.TOO_LARGE:
        left = answer.message.detail
        if left < begin.size:
            not_observed(f"this case stores {begin.size} bytes, and the board has room for {left}")


def upload_request(
    board: BoardClient, kind: m.UploadKind, target: int, size: int, points: int = 0, *, crc: int = 0
) -> m.UploadBegin:
    """Return an UPLOAD_BEGIN of *size* bytes; NOT-OBSERVED if the board takes fewer in one."""
    _require_upload_limits(board, kind, size, points)
    return m.UploadBegin(kind, points, target, size, crc)


def _require_upload_limits(board: BoardClient, kind: m.UploadKind, size: int, points: int) -> None:
    """End the case as NOT-OBSERVED if an upload of *size* bytes is beyond those of HELLO_REPLY.

    A sequence (any *kind* but CORRECTION) is limited in frames too, of *points* points each; 0: of
    phases.
    """
    most = board.identity.max_upload_bytes
    if size > most:
        not_observed(f"this case stores {size} bytes, and the board takes {most} in one upload")
    if kind is m.UploadKind.CORRECTION:
        return
    frames = size // (points * m.FocalPoint.LAYOUT.size or board.identity.transducers)
    longest = board.identity.max_sequence_frames
    if frames > longest:
        not_observed(f"this case stores {frames} frames, and a sequence has {longest} at most")


def send_upload_chunks(board: BoardClient, data: bytes) -> None:
    """Send *data* in chunks, each after the reply to the one before."""
    size = max(1, min(board.identity.max_chunk, _LARGEST_CHUNK))
    for start in range(0, len(data), size):
        chunk = m.UploadChunk(start, data[start : start + size])
        received = board.link.call(chunk, m.UploadChunkReply).received
        due = start + len(chunk.data)
        check(received == due, f"UPLOAD_CHUNK_REPLY says {received} bytes, sent were {due}")

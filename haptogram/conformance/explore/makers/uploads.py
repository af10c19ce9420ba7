"""Uploads of a random host: whole ones, in any order, with gaps."""

from __future__ import annotations

from typing import Final

from haptogram_protocol import messages as m

from ..actions import (
    MOST_POINTS,
    REPLACED,
    STORED_FRAMES,
    UPLOADED,
    DialogueAction,
    has_room_in_dialogue,
    upload_in_dialogue,
)
from .conditions import DialogueConditions
from .stream import RandomStream

_LONGEST_CHUNK: Final = 512
_WAYS: Final = (
    *("plain", "plain", "plain", "gap", "mismatch", "target", "odd"),
    *("overlap", "overlap", "again"),
)
_PIECES: Final = 6
_MOST_CHUNKS: Final = 8  # most chunks of an upload
_LONG_BYTES: Final = 70_000  # upload that overflows 16 bits
_ROOM: Final = 8  # uploads of so many bytes fit into the store at least


class RandomUploads(RandomStream):
    """Makes uploads."""

    def __init__(self, conditions: DialogueConditions) -> None:
        super().__init__(conditions)
        self._largest = min(self._identity.max_chunk, _LONGEST_CHUNK)

    def upload(self) -> list[DialogueAction]:
        """Return the requests of an upload; empty if the board has no room for one."""
        kinds = self._kinds()
        if not kinds:
            return []
        pick = self._pick
        kind = pick(kinds)
        target = 0 if kind is m.UploadKind.CORRECTION else pick(UPLOADED)
        points = self._random.randint(1, min(MOST_POINTS, self._identity.max_points))
        data = self._data(kind, points)
        of_frame = points if kind is m.UploadKind.POINTS else 0
        # A line carries few chunks.
        least = max(pick((_LONGEST_CHUNK, _LONGEST_CHUNK, 13)), -(-len(data) // _MOST_CHUNKS))
        chunk = min(self._largest, least)
        steps = upload_in_dialogue(kind, target, data, chunk, points=of_frame)
        begin, *chunks, commit = steps
        how = pick(_WAYS)
        if how == "gap":  # what is missing, and all after it, comes after the refused commit
            missing = self._across(len(chunks))
            steps[1:-1] = [*chunks[:missing], *chunks[missing + 1 :], commit, *chunks[missing:]]
        elif how == "mismatch":  # one byte is put right after the refused commit
            at = self._across(len(data))
            wrong = m.UploadChunk(at, bytes([data[at] ^ 1 << self._across(8)]))
            steps[-1:] = [wrong, commit, m.UploadChunk(at, data[at : at + 1]), commit]
        elif how == "target":
            steps[-1:] = [m.UploadCommit(target + 1), commit]
        elif how == "overlap":  # pieces that lie over each other, and gaps between them
            steps[1:-1] = [*self._pieces(data), commit, *chunks]
        elif how == "again":  # announced once more, and nothing of it has come
            some = self._across(len(chunks) + 1)
            steps = [begin, *chunks[:some], begin, *chunks[some:], commit, *chunks, commit]
        elif how == "odd":
            end = m.UploadChunk(len(data), b"")
            steps[-1:] = [end, pick(chunks), m.UploadChunk(len(data), b"x"), commit, commit]
        return [self.frame(step) for step in steps]

    def long_upload(self) -> list[DialogueAction]:
        """Return the requests of an upload of more than 64 KiB, if there is much more room."""
        identity = self._identity
        frames = min(_LONG_BYTES // self._count + 1, identity.max_sequence_frames)
        data = self._random.randbytes(frames * self._count)
        if _ROOM * len(data) > identity.max_upload_bytes:
            return self.upload()
        steps = upload_in_dialogue(m.UploadKind.PHASES, REPLACED, data, identity.max_chunk)
        return [self.frame(step) for step in steps]

    def _kinds(self) -> list[m.UploadKind]:
        """Return the kinds of upload that the board takes; PHASES three times, to be likelier."""
        has_room = has_room_in_dialogue(self._identity)
        weights = {
            m.UploadKind.PHASES: 3 * bool(self._can & m.Feature.SEQUENCE_PHASES and has_room),
            m.UploadKind.POINTS: bool(self._can & m.Feature.SEQUENCE_POINTS and has_room),
            m.UploadKind.CORRECTION: bool(self._can & m.Feature.CORRECTION),
        }
        return [kind for kind, weight in weights.items() for _ in range(weight)]

    def _data(self, kind: m.UploadKind, points: int) -> bytes:
        """Return random data of *kind*: 1 to 3 frames of codes or *points* points; 1 correction."""
        frames = 1 if kind is m.UploadKind.CORRECTION else self._across(1, STORED_FRAMES + 1)
        if kind is not m.UploadKind.POINTS:
            return self._random.randbytes(frames * self._count)
        return b"".join(self.point().pack() for _ in range(frames * points))

    def _pieces(self, data: bytes) -> list[m.Message]:
        """Return 6 upload chunks of random offset and size from *data*."""
        pieces: list[m.Message] = []
        for _ in range(_PIECES):
            start = self._across(len(data))
            size = self._random.randint(1, min(self._largest, len(data) - start))
            pieces.append(m.UploadChunk(start, data[start : start + size]))
        return pieces

"""Uploads of a random host: whole ones, in any order, with gaps, and single steps."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from typing import Final

from haptogram_protocol.messages import (
    Feature,
    FocalPoint,
    Message,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    UploadKind,
)

from ..actions import (
    MOST_POINTS,
    REPLACED,
    STORED_FRAMES,
    UPLOADED,
    has_room_in_dialogue,
)
from .conditions import DialogueConditions, DialogueMaker
from .stream import MadeAction
from .words import words_of_message

_LONGEST_CHUNK: Final = 512
_WAYS: Final = (
    *("plain", "plain", "plain", "gap", "mismatch", "target", "odd"),
    *("overlap", "overlap", "again"),
)
_PIECES: Final = 6
_LONG_BYTES: Final = 70_000  # more than 16 bits count
_ROOM: Final = 8  # uploads of so many bytes fit into the store at least


class RandomUploads(DialogueMaker):
    """Makes uploads."""

    def __init__(self, conditions: DialogueConditions) -> None:
        super().__init__(conditions)
        self._count = self._identity.transducers
        self._largest = min(self._identity.max_chunk, _LONGEST_CHUNK)

    def _kinds(self) -> list[UploadKind]:
        kinds = []
        has_room = has_room_in_dialogue(self._identity)
        if self._can & Feature.SEQUENCE_PHASES and has_room:
            kinds += [UploadKind.PHASES] * 3
        if self._can & Feature.SEQUENCE_POINTS and has_room:
            kinds.append(UploadKind.POINTS)
        if self._can & Feature.CORRECTION:
            kinds.append(UploadKind.CORRECTION)
        return kinds

    def upload(self) -> list[MadeAction]:
        """Return the requests of an upload; empty if the board has no room for one."""
        kinds = self._kinds()
        if not kinds:
            return []
        pick = self._random.choice
        kind = pick(kinds)
        target = 0 if kind is UploadKind.CORRECTION else pick(UPLOADED)
        points = self._random.randint(1, min(MOST_POINTS, self._identity.max_points))
        data = self._data(kind, points)
        crc = zlib.crc32(data)
        begin = UploadBegin(
            kind, points if kind is UploadKind.POINTS else 0, target, len(data), crc
        )
        commit = UploadCommit(target)
        chunks = self._chunks(data)
        how = pick(_WAYS)
        steps: list[Message] = [begin, *chunks, commit]
        if how == "gap":  # what is missing, and all behind it, comes after the refused commit
            missing = self._random.randrange(len(chunks))
            steps[1:-1] = [*chunks[:missing], *chunks[missing + 1 :], commit, *chunks[missing:]]
        elif how == "mismatch":  # one byte is put right after the refused commit
            at = self._random.randrange(len(data))
            wrong = UploadChunk(at, bytes([data[at] ^ 1 << self._random.randrange(8)]))
            steps[-1:] = [wrong, commit, UploadChunk(at, data[at : at + 1]), commit]
        elif how == "target":
            steps[-1:] = [UploadCommit(target + 1), commit]
        elif how == "overlap":  # pieces that lie over each other, and gaps between them
            steps[1:-1] = [*self._pieces(data), commit, *chunks]
        elif how == "again":  # announced once more, and nothing of it has come
            some = self._random.randrange(len(chunks) + 1)
            steps = [begin, *chunks[:some], begin, *chunks[some:], commit, *chunks, commit]
        elif how == "odd":
            end = UploadChunk(len(data), b"")
            steps[-1:] = [end, pick(chunks), UploadChunk(len(data), b"x"), commit, commit]
        return [self._plain(step, how) for step in steps]

    def long_upload(self) -> list[MadeAction]:
        """Return the requests of an upload of more than 64 KiB, if there is much more room."""
        identity = self._identity
        frames = min(_LONG_BYTES // self._count + 1, identity.max_sequence_frames)
        data = self._random.randbytes(frames * self._count)
        if _ROOM * len(data) > identity.max_upload_bytes:
            return self.upload()
        begin = UploadBegin(UploadKind.PHASES, 0, REPLACED, len(data), zlib.crc32(data))
        edges = range(0, len(data), identity.max_chunk)
        chunks = [UploadChunk(at, data[at : at + identity.max_chunk]) for at in edges]
        return [self._plain(step, "long") for step in (begin, *chunks, UploadCommit(REPLACED))]

    def _data(self, kind: UploadKind, points: int) -> bytes:
        across = self._random.randrange
        frames = 1 if kind is UploadKind.CORRECTION else across(1, STORED_FRAMES + 1)
        if kind is not UploadKind.POINTS:
            return self._random.randbytes(frames * self._count)
        made = (
            FocalPoint(
                across(-40_000, 40_000),
                across(-40_000, 40_000),
                across(80_000, 200_000),
                across(30_000, 65_536),
                across(65_536),
            )
            for _ in range(frames * points)
        )
        return b"".join(point.pack() for point in made)

    def _chunks(self, data: bytes) -> list[Message]:
        """Return *data* in chunks of random lengths."""
        chunks: list[Message] = []
        at = 0
        while at < len(data):
            size = self._random.choice((self._largest, self._largest, self._count, 13))
            size = min(self._largest, size)
            chunks.append(UploadChunk(at, data[at : at + size]))
            at += size
        few = -(-len(data) // self._largest)
        if len(chunks) > few + 2:  # a line carries few of them
            edges = range(0, len(data), self._largest)
            return [UploadChunk(at, data[at : at + self._largest]) for at in edges]
        return chunks

    def _pieces(self, data: bytes) -> list[Message]:
        """Return some chunks from anywhere to anywhere in *data*."""
        pieces: list[Message] = []
        for _ in range(_PIECES):
            start = self._random.randrange(len(data))
            size = self._random.randint(1, min(self._largest, len(data) - start))
            pieces.append(UploadChunk(start, data[start : start + size]))
        return pieces

    def _plain(self, message: Message, how: str) -> MadeAction:
        text = f"{words_of_message(message)} ({how})"
        return message.TYPE.name, text, lambda host: host.request(message)

    def single(self) -> list[Callable[[], Message]]:
        """Return the makers of single steps of uploads, most of which are refused."""
        if not self._can & Feature.SEQUENCE_PHASES:
            return []
        return [self._begin, self._chunk, lambda: UploadCommit(self._random.choice((*UPLOADED, 0)))]

    def _begin(self) -> Message:
        pick = self._random.choice
        data = bytes(2 * self._count)
        size = pick((len(data), len(data), len(data) + 1, 0))
        kind = pick((UploadKind.PHASES, UploadKind.PHASES, UploadKind.CORRECTION))
        return UploadBegin(kind, pick((0, 0, 1)), pick((REPLACED, 1, 0)), size, zlib.crc32(data))

    def _chunk(self) -> Message:
        size = self._random.choice((0, 1, min(self._count, self._largest)))
        return UploadChunk(self._random.choice((0, self._count, 7 * self._count)), bytes(size))

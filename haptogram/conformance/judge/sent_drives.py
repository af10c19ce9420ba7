"""The drives that a host has sent in a run: frames of the stream, and of stored sequences."""

from __future__ import annotations

import contextlib
import zlib
from collections import defaultdict, deque
from typing import Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import DELIMITER, MAX_ENCODED_BYTES

from ..client.wire import decoded_frame

#: Phase codes and amplitude codes of all transducers, in registers of 8 bits.
Codes: TypeAlias = tuple[bytes, bytes]

_KEPT: Final = 4096  # stream frames
_LONGEST_UPLOAD: Final = 1 << 20
_FULL: Final = b"\xff"  # amplitude of a stored phase: HG-5.2/6
_TELLING: Final = 4  # transducers that tell one drive from another
DRIVE_OF: Final = "it is the drive of frame"
#: Key of the free memory: the stored sequences, target and kind of an upload.
_RoomKey: TypeAlias = tuple[frozenset[tuple[int, tuple[int, int]]], int, int]
_ROOM_AS_BEFORE: Final = "and the same sequences are stored: an upload that ended keeps some"
_UPLOADS: Final = (m.UploadBegin.TYPE, m.UploadChunk.TYPE, m.UploadCommit.TYPE)


class SentDrives:
    """Codes of the stream frames and of the stored sequences that a host has sent.

    Frames are decoded when a board tells of a latch: most runs of frames are never asked for.
    """

    def __init__(self) -> None:
        self._pieces: deque[bytes] = deque(maxlen=_KEPT)
        self._begun = b""
        self._codes: dict[tuple[int, int], list[Codes | None]] = {}  # the newest numbers, in turn
        self._begin: m.UploadBegin | None = None
        self._upload = bytearray()
        self._target = 0  # of the last UPLOAD_COMMIT
        self._stored: defaultdict[int, list[bytes]] = defaultdict(list)  # by age; empty: unknown
        self.room = UploadRoom()

    def forget(self) -> None:
        """Forget all frames: another board answers now."""
        self._pieces.clear()
        self._codes.clear()
        self._stored.clear()
        self._begin, self._begun = None, b""
        self.room = UploadRoom()

    def take(self, data: bytes) -> None:
        """Note bytes that are sent."""
        *ended, rest = (self._begun + data).split(DELIMITER)
        self._begun = rest[: MAX_ENCODED_BYTES + 1]
        for piece in ended:
            if piece[1:2] and piece[1] in m.STREAM_RANGE:
                self._pieces.append(piece)
            elif piece[1:2] and piece[1] in _UPLOADS:
                with contextlib.suppress(RemoteProtocolError):
                    header, message = m.parse_body(decoded_frame(piece))
                    self.room.note_sent(header, message)
                    self._note_upload(message)

    def _note_upload(self, message: m.Message) -> None:
        """Copy the bytes of an upload, as if the board took every chunk.

        Whether it did is decided later, by the CRC of the commit.
        """
        if isinstance(message, m.UploadBegin):
            is_kept = message.kind is m.UploadKind.PHASES and message.size <= _LONGEST_UPLOAD
            self._begin = message if is_kept else None
            self._upload = bytearray(message.size if is_kept else 0)
        elif isinstance(message, m.UploadChunk) and self._begin is not None:
            part = slice(message.offset, message.offset + len(message.data))
            if part.stop <= len(self._upload):
                self._upload[part] = message.data
        elif isinstance(message, m.UploadCommit):
            self._target = message.target
            self._stored[self._target].append(b"")  # until the board has answered

    def note_commit(self) -> None:
        """Note that the board has taken an upload: what it stored is known if the CRC is right."""
        begin, data = self._begin, bytes(self._upload)
        is_known = begin and (begin.target, begin.crc) == (self._target, zlib.crc32(data))
        if is_known and self._stored[self._target]:
            self._stored[self._target][-1] = data

    def begin_session(self) -> None:
        """Note that a session begins: its ring tells of no sequence that was replaced before."""
        for versions in self._stored.values():
            del versions[:-1]

    def stored_crcs(self, sequence: int, index: int, transducers: int) -> list[int]:
        """Return the CRC-32 of a frame's drive in each sequence stored under this number.

        Those of this session: an upload may have replaced the sequence. Empty if one is not known.
        """
        versions = self._stored.get(sequence, [])
        part = slice(index * transducers, (index + 1) * transducers)
        frames = [data[part] for data in versions]
        if not all(len(frame) == transducers for frame in frames):
            return []
        return [zlib.crc32(frame + _FULL * transducers) for frame in frames]

    def codes_of(self, session: int, index: int, transducers: int) -> list[Codes]:
        """Return the codes of every frame that was sent with the unwrapped number *index*.

        Empty if there is none, and where the board computes the drive of one of them.
        """
        while self._pieces:
            self._decode(self._pieces.popleft(), transducers)
        found = self._codes.get((session, index & 0xFFFF), [])
        known = [codes for codes in found if codes is not None]
        return known if index >= m.FIRST_STREAM_SEQ and len(known) == len(found) else []

    def other_frame(self, session: int, crc: int, part: slice = slice(None)) -> str:
        """Return in words which frame of the stream has the drive with this CRC-32, if one has.

        With *part*: the drive of these transducers, if they are enough to tell frames apart.
        """
        for (of, index), some in reversed(self._codes.items()):
            for phases, amplitudes in filter(None, some):
                shown = phases[part]
                if len(shown) >= _TELLING and zlib.crc32(shown + amplitudes[part]) == crc:
                    return f": {DRIVE_OF} {index}" + " of a session before" * (of != session)
                if zlib.crc32(phases) == crc:
                    return f": {crc:#010x} is of the phases of frame {index} alone"
        return ""

    def _decode(self, piece: bytes, transducers: int) -> None:
        """Keep the drive codes of a sent stream frame, under its session and sequence number.

        Nothing is kept if its bytes are damaged, or its codes are not of N *transducers*.
        """
        with contextlib.suppress(RemoteProtocolError):
            header, message = m.parse_body(decoded_frame(piece))
            codes = m.drive_codes(message, transducers)
            key = header.session, header.seq
            self._codes[key] = [*self._codes.pop(key, []), codes]  # after those sent before
            if len(self._codes) > _KEPT:
                del self._codes[next(iter(self._codes))]


class UploadRoom:
    """Room for uploads: while the same sequences are stored, an upload finds no less than before.

    Whatever ends an upload, or replaces a sequence, gives back what it took.
    """

    def __init__(self) -> None:
        # Unanswered, by the number of the request.
        self._begins: dict[int, list[m.UploadBegin]] = {}
        self._commits: dict[int, int] = {}
        self._open: m.UploadBegin | None = None
        self._stored: dict[int, tuple[int, int]] = {}  # kind and size by target
        self._taken: dict[_RoomKey, int] = {}  # size of the largest upload that was taken
        self._left: dict[_RoomKey, int] = {}  # most free memory that a refusal reported

    def note_sent(self, header: m.Header, message: m.Message) -> None:
        """Note a request about an upload."""
        if isinstance(message, m.UploadBegin):
            self._begins.setdefault(header.seq, []).append(message)
        elif isinstance(message, m.UploadCommit):
            self._commits[header.seq] = message.target

    def shrunk(self, seq: int, message: m.Message, identity: m.HelloReply) -> str | None:
        """Return in words that there is less room than before; None: the frame tells nothing."""
        if isinstance(message, m.UploadCommitReply):
            self._commit(self._commits.get(seq, 0))
        is_refused = isinstance(message, m.Error) and message.request == m.UploadBegin.TYPE
        if not (is_refused or isinstance(message, m.UploadBeginReply)):
            return None
        sent = self._begins.pop(seq, [])
        if len(set(sent)) != 1:  # two of one number: one of them is refused for that
            self._open = None
            return None
        begin = sent[0]
        key = frozenset(self._stored.items()), begin.target, begin.kind
        if not isinstance(message, m.Error):
            self._open = begin
            self._taken[key] = max(begin.size, self._taken.get(key, 0))
            return ""
        if message.code != m.ErrorCode.TOO_LARGE or begin.size > identity.max_upload_bytes:
            return None
        taken, left = self._taken.get(key, 0), message.detail
        if begin.size <= taken:
            return f"{begin.size} bytes are TOO_LARGE, {taken} were taken before, {_ROOM_AS_BEFORE}"
        if left == identity.max_sequence_frames:
            return None  # a limit in frames
        before = self._left.setdefault(key, left)
        self._left[key] = max(before, left)
        return f"room for {left} bytes, it was {before}, {_ROOM_AS_BEFORE}" if left < before else ""

    def _commit(self, target: int) -> None:
        """Note the size of a stored sequence; forget all sizes if its upload was not seen.

        The *target* 0 is a correction, which is no sequence.
        """
        begin, self._open = self._open, None
        if begin is None or begin.target != target:
            self._taken.clear()
            self._left.clear()
        elif target:
            self._stored[target] = int(begin.kind), begin.size

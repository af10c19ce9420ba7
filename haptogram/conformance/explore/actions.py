"""Actions of a random host: legal and illegal frames, rendered when they are sent."""

from __future__ import annotations

import functools
import random
import zlib
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from haptogram_protocol import messages as m
from haptogram_protocol.framing import FrameDecoder

from ..client.malformed_frames import malformed_frame, malformed_noise, malformed_with_crc
from ..client.wire import CLIENT_COBS, encoded_frame
from .host import DialogueHost

SLOT_US: Final = 40_000
LATE_WINDOWS_US: Final = (0, 30_000, 70_000, 100_000)
#: Sequences that every dialogue finds stored; it uploads others, and never the last one.
STORED_PHASES: Final = 1
STORED_POINTS: Final = 2
REPLACED: Final = 3
UPLOADED: Final = (STORED_PHASES, STORED_POINTS, REPLACED, 4, 5)
ABSENT: Final = 60_000
STORED_FRAMES: Final = 3
POINT_BYTES: Final = 16
MOST_POINTS: Final = 3  # most points in a frame of an upload
#: Damages that only a host in virtual time does: first part of a frame, whose rest comes with the
#: next one; no frame but a fault of the hardware; no frame, so that such a rest comes alone.
PARTS: Final = 6
FAULT: Final = 7
REST: Final = 8
_SILENT: Final = (FAULT, REST)
_SHARED: Final = 3  # every third frame shares a delimiter with the one before
_PIECES: Final = 5  # every fifth slot's bytes come in pieces
_FOREIGN: Final = 0x5555  # session of the request that ends a slot, beside the open one
_FOREIGN_SEQ: Final = 0x2000  # number of its requests: no other request is near it
_LONG_NOISE: Final = 70_000  # bytes: more than 16 bits count


def has_room_in_dialogue(identity: m.HelloReply) -> bool:
    """Return True if a board has room for the sequences of a dialogue, and one more."""
    frame = max(identity.transducers, MOST_POINTS * POINT_BYTES)
    return (len(UPLOADED) + 1) * STORED_FRAMES * frame <= identity.max_upload_bytes


def upload_in_dialogue(
    kind: m.UploadKind, target: int, data: bytes, chunk: int, *, points: int = 0
) -> list[m.Message]:
    """Return the requests of an upload, in chunks of *chunk* bytes."""
    parts = range(0, len(data), chunk)
    return [
        m.UploadBegin(kind, points, target, len(data), zlib.crc32(data)),
        *(m.UploadChunk(at, data[at : at + chunk]) for at in parts),
        m.UploadCommit(target),
    ]


class DialogueAction(NamedTuple):
    """One frame of a random host.

    Attributes
    ----------
    slot : int
        Slot at whose beginning the frame is sent.
    name : str
        By what dialogues tell actions apart, and what is printed before the frame.
    body : callable
        Given the host, returns header and payload.
    damage : int
        0: none; 1: a bit of the frame inverted; 2: cut; 3: noise instead; 4: noise of 70 000 bytes;
        5: a run of up to 14 bytes, with a right CRC or none; :data:`PARTS`, :data:`FAULT`,
        :data:`REST`.
    seed : int
        Of the damage.
    wait_us : int
        Time that passes between the arrival of the frame before, or the beginning of the slot, and
        that of this one; 0 where bytes do not arrive to the microsecond.
    ends_slot : bool
        Whether the frame may be latched right after its arrival.
    """

    slot: int
    name: str
    body: Callable[[DialogueHost], bytes]
    damage: int = 0
    seed: int = 0
    wait_us: int = 0
    ends_slot: bool = False

    def wire(self, host: DialogueHost) -> bytes:
        """Return the bytes on the line."""
        body = self.body(host)
        host.note(body)
        if not self.damage:
            return encoded_frame(body)
        if self.damage in _SILENT:
            return b""
        source = random.Random(self.seed)
        if self.damage == 5:
            return _short_random_run(source, body)
        wire = encoded_frame(body)
        if self.damage == PARTS:
            ends = (1, 2, len(wire) - 1)  # after a delimiter, a code byte, before a delimiter
            cut = source.choice((*ends, *(source.randrange(1, len(wire)) for _ in ends)))
            host.unsent = wire[cut:]
            return wire[:cut]
        if self.damage == 1:
            at = source.randrange(1, len(wire) - 1)
            flipped = wire[at] ^ (1 << source.randrange(8)) or wire[at] ^ 0xFF
            return wire[:at] + bytes([flipped]) + wire[at + 1 :]
        if self.damage == 2:
            return wire[: source.randrange(2, len(wire) - 1)] + b"\x00"
        size = source.choice((3, 40, 300, 4100)) if self.damage == 3 else _LONG_NOISE
        return b"\x00" + malformed_noise(source, size) + b"\x00"


#: Actions of one slot after the other.
ActionSlots = list[list[DialogueAction]]


def _short_random_run(source: random.Random, body: bytes) -> bytes:
    """Return a start of *body*, too short for header and CRC, after up to 7 bare delimiters."""
    data = body[: source.randrange(11)]
    if source.random() < 0.7:
        data = malformed_with_crc(data[:9])
    return b"\x00" * source.choice((0, 0, 1, 2, 3, 7)) + malformed_frame(data)


def frames_of_slot(
    host: DialogueHost, actions: Sequence[DialogueAction], room_bytes: int, *, exact: bool
) -> list[tuple[DialogueAction, bytes]]:
    """Return *actions* with their frames, as many as have room on the line.

    Unless bytes arrive to the microsecond (*exact*), none comes after a frame that is latched as
    it comes: whether it is, or a latch is over by then, depends on microseconds.
    """
    found: list[tuple[DialogueAction, bytes]] = []
    for action in actions:
        unsent = host.take_unsent()
        wire = unsent + action.wire(host)
        room_bytes -= len(wire)
        if room_bytes < 0:
            break
        if found and not action.wait_us and is_mute_on_wire(wire):
            break  # it may overtake what is sent with it: HG-3.8/2
        shares = found and not unsent and wire and action.seed % _SHARED == 0
        found.append((action, wire[1:] if shares else wire))
        if not exact and any(map(host.is_latched_as_it_comes, bodies_of_wire(wire))):
            break
    return found


def end_of_slot(host: DialogueHost) -> bytes:
    """Return a request of another session: its refusal shows that a slot's frames were read.

    It renews no lease, and uses no number up.
    """
    session, seq = host.session ^ _FOREIGN or _FOREIGN, number_at_end_of_slot(host)
    return encoded_frame(m.build_body(m.Ping(seq), flags=0, seq=seq, time_us=0, session=session))


def number_at_end_of_slot(host: DialogueHost) -> int:
    """Return the number of the request that ends a slot."""
    return (host.seq + _FOREIGN_SEQ) & 0xFFFF


def pieces_of_slot(data: bytes) -> list[bytes]:
    """Return *data* whole, or now and then its first bytes one by one and the rest in pieces."""
    if not data:
        return []
    if sum(data) % _PIECES:
        return [data]
    edges = [*range(min(_PIECES, len(data))), *range(_PIECES, len(data), 97), len(data)]
    return [data[a:b] for a, b in pairwise(edges) if a < b]


def is_mute_on_wire(wire: bytes) -> bool:
    """Return True if one of the frames that *wire* ends is a MUTE."""
    return any(body[0] == m.MessageType.MUTE for body in bodies_of_wire(wire))


@functools.lru_cache(maxsize=64)
def bodies_of_wire(wire: bytes) -> tuple[bytes, ...]:
    """Return the bodies of the frames that *wire* ends; some parts ask for the same one by one."""
    return tuple(body for body in FrameDecoder(CLIENT_COBS).feed(wire) if isinstance(body, bytes))

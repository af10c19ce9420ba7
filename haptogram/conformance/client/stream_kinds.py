"""Every kind of stream frame and of request that a board takes: from messages and limits."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final, TypeAlias

from haptogram_protocol import messages as m
from haptogram_protocol.rules import PLAYBACK, READ_CAPABILITIES, UPLOADS

from .board_client import BoardClient
from .playback import play_request

MakeMessage: TypeAlias = Callable[[], m.Message]

_NO_SEQUENCE: Final = 0xEEEE


@dataclass(frozen=True, slots=True)
class StreamKind:
    """One kind of stream frame.

    Attributes
    ----------
    name : str
        Message and format, for reports.
    make : callable
        Returns such a frame with random contents.
    """

    name: str
    make: MakeMessage


def stream_kinds(board: BoardClient) -> list[StreamKind]:
    """Return every message and format of the stream that the board advertises."""
    found = [StreamKind("PHASES", lambda: board.phases(board.random_registers()))]
    if board.has(m.Feature.AMPLITUDE):
        found.append(StreamKind("DRIVES", lambda: _stream_kind_of_drives(board)))
    if board.has(m.Feature.POINTS):
        numbers = sorted({1, board.most_points})
        found += [_stream_kind_of_points(board, number) for number in numbers]
    return found


def points_of_stream_kind(message: m.Message) -> int:
    """Return the number of focal points that the board computes for a stream frame."""
    return len(message.points) if isinstance(message, m.Points) else 0


def _stream_kind_of_drives(board: BoardClient) -> m.Message:
    """Return a DRIVES message of random codes."""
    return m.Drives(board.random.randbytes(2 * board.identity.transducers))


def _stream_kind_of_points(board: BoardClient, number: int) -> StreamKind:
    """Return the stream kind POINTS, whose frames have *number* random points each."""
    return StreamKind(f"POINTS ({number})", partial(random_points_to_send, board, number))


def random_points_to_send(board: BoardClient, number: int = 1) -> m.Points:
    """Return a frame of *number* random focal points."""
    return m.Points(tuple(random_point_to_send(board, number) for _ in range(number)))


def random_point_to_send(board: BoardClient, number: int = 1) -> m.FocalPoint:
    """Return a random focal point off all planes of symmetry, one of *number* in a frame."""

    def away() -> int:
        return board.random.choice((-1, 1)) * board.random.randrange(4_000, 40_000)

    loudest = 40_000 // number
    level = board.random.randrange(loudest // 3, loudest)
    depth_um = board.random.randrange(80_000, 200_000)
    return m.FocalPoint(away(), away(), depth_um, level, board.random.randrange(65_536))


# --- Requests ----------------------------------------------------------------------------------


def request_types_of_host() -> list[type[m.Message]]:
    """Return every message that a host sends."""
    return [kind for number, kind in m.MESSAGES.items() if number < m.STREAM_RANGE.stop * 2]


def valid_requests_to_send(board: BoardClient, sequence: int) -> Iterator[m.Message]:
    """Yield a request of every type but HELLO and MUTE that the board carries out while ARMED.

    They hold in this order: PLAY plays the stored *sequence*, and STOP ends it.
    """
    yield from (m.Arm(), m.Ping(board.random.getrandbits(64)), m.GetStatus(), m.GetConfig())
    yield m.GetGeometry(0, 2)
    if board.has(m.Feature.CONFIG):
        yield m.SetConfig(board.config)
    for kind, feature in READ_CAPABILITIES.items():
        if board.has(feature):
            yield m.ReadDrive(kind, 0, 2)
    if board.has(m.Feature.TRACE_RING):
        yield m.ReadTrace(0, 4)
    if board.has(m.Feature.SEQUENCE_PHASES):
        data = bytes(board.identity.transducers)
        yield m.UploadBegin(m.UploadKind.PHASES, 0, sequence, len(data), zlib.crc32(data))
        yield m.UploadChunk(0, data[: board.identity.max_chunk])
        if len(data) <= board.identity.max_chunk:
            yield m.UploadCommit(sequence)
            yield play_request(board, sequence, loops=0, unattended_ms=2000)
    if board.identity.features & PLAYBACK:
        yield m.Stop()
    yield m.Disarm()


def refused_requests_to_send(board: BoardClient) -> Iterator[m.Message]:
    """Yield requests that pass all checks of the link, but that an ARMED board refuses."""
    count = board.identity.transducers
    yield m.GetGeometry(count, 1)
    if board.has(m.Feature.READ_LATCHED):
        yield m.ReadDrive(m.DriveKind.LATCHED, count, 1)
    if board.identity.features & UPLOADS:
        yield m.UploadBegin(m.UploadKind.PHASES, 0, _NO_SEQUENCE, 0xFFFFFFFF // count * count, 0)
        yield m.UploadCommit(_NO_SEQUENCE)
    if board.identity.features & PLAYBACK:
        yield play_request(board, _NO_SEQUENCE, loops=1, unattended_ms=100)

"""Every path on which a drive reaches the registers: at once, at its time, played."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final, TypeAlias

from haptogram_protocol import messages as m

from .board_client import BoardClient
from .latching import latch_in_time, latch_now
from .playback import let_play, period_to_play, play_now, play_out
from .stream_kinds import StreamKind, random_point_to_send, stream_kinds
from .uploads import upload_to_board

_SEQUENCE: Final = 6
_FRAMES: Final = 3

#: Latches a random drive and returns the message that carried it.
LatchDrive: TypeAlias = Callable[[], m.Message]


@dataclass(frozen=True, slots=True)
class DrivePath:
    """One kind of drive on one path.

    Attributes
    ----------
    name : str
        For reports.
    latch : callable
        Latches a random drive; the board is ARMED.  Returns the message that carried it.
    """

    name: str
    latch: LatchDrive


def drive_paths(board: BoardClient) -> Iterator[DrivePath]:
    """Yield every path of every kind of drive that the board takes; the last goes on playing."""
    board.link.ask(m.Stop())
    for kind in stream_kinds(board):
        for name, latch in (("at once", latch_now), ("at its time", latch_in_time)):
            yield DrivePath(f"{kind.name}, {name}", partial(_stream_frame, board, kind, latch))
    if board.has(m.Feature.SEQUENCE_PHASES):
        yield DrivePath("PHASES, played", partial(_play_phases, board))
    if board.has(m.Feature.SEQUENCE_POINTS):
        for number in sorted({1, board.most_points}):
            name = f"POINTS ({number}), played"
            yield DrivePath(name, partial(_play_points, board, number))
    if board.has(m.Feature.SEQUENCE_PHASES):
        yield DrivePath("PHASES, while they play", partial(_loop_phases, board))
        board.link.ask(m.Stop())


def _stream_frame(
    board: BoardClient, kind: StreamKind, latch: Callable[[BoardClient, m.Message], object]
) -> m.Message:
    """Make a message of *kind*, have *latch*(board, message) latch it, and return it."""
    message = kind.make()
    latch(board, message)
    return message


def _play_phases(board: BoardClient) -> m.Message:
    """Play 3 uploaded frames of random phases to their end; return the last as a message."""
    frames = [board.random.randbytes(board.identity.transducers) for _ in range(_FRAMES)]
    upload_to_board(board, m.UploadKind.PHASES, _SEQUENCE, b"".join(frames))
    _play_to_end(board)
    return m.Phases(frames[-1])


def _loop_phases(board: BoardClient) -> m.Message:
    """Play one frame of phases in a loop; return it as a stream message."""
    frame = board.random.randbytes(board.identity.transducers)
    upload_to_board(board, m.UploadKind.PHASES, _SEQUENCE, frame)
    play_now(board, _SEQUENCE, loops=0)
    let_play(board, 5)
    return m.Phases(frame)


def _play_points(board: BoardClient, number: int) -> m.Message:
    """Play 3 uploaded frames of *number* random points each to their end; return the last."""
    frames = [
        m.Points(tuple(random_point_to_send(board, number) for _ in range(number)))
        for _ in range(_FRAMES)
    ]
    data = b"".join(frame.serialize() for frame in frames)
    upload_to_board(board, m.UploadKind.POINTS, _SEQUENCE, data, number)
    _play_to_end(board, number)
    return frames[-1]


def _play_to_end(board: BoardClient, points: int = 0) -> None:
    """Play the stored sequence to its end; the period suits frames of *points* focal points.

    0 points: the frames hold phases.
    """
    play_out(board, _SEQUENCE, _FRAMES, period_us=period_to_play(board, points))


def registers_asked_for(board: BoardClient, message: m.Message) -> tuple[bytes, bytes] | None:
    """Return the phase and amplitude codes of a message; None where the board computes them."""
    return m.drive_codes(message, board.identity.transducers)

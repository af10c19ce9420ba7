"""A dialogue in which a board sends every kind of message, for cases about its frames."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    Arm,
    Disarm,
    Feature,
    GetConfig,
    GetGeometry,
    GetStatus,
    Mute,
    Ping,
    Play,
    ReadDrive,
    ReadTrace,
    Stop,
    TraceMode,
    UploadKind,
)

from .board_client import BoardClient
from .capabilities import TRACE_MODES, drive_kinds
from .latching import latch_now
from .playback import phases_that_fit
from .uploads import upload_to_board
from .wire import ReceivedByClient

_UNKNOWN_REQUEST: Final = 0x7F
_SEQUENCE: Final = 7
_FRAMES: Final = 4
_PERIOD_US: Final = 1000
_UNATTENDED_MS: Final = 1000


def full_client_dialogue(board: BoardClient) -> list[ReceivedByClient]:
    """Return every piece that the board sends in a dialogue of all requests that it takes.

    The first case that asks holds the dialogue; the others judge the same one, and show its bytes.
    """
    if board.dialogue is None:
        pieces = _hold_client_dialogue(board)
        board.dialogue = pieces, board.wire.recording
    pieces, board.wire.recording = board.dialogue
    return pieces


def _hold_client_dialogue(board: BoardClient) -> list[ReceivedByClient]:
    board.hello()
    since = board.link.mark()
    board.hello(board.link.session)
    _ask_in_client_dialogue(board)
    board.link.ask(Arm())
    for feature, mode in TRACE_MODES:
        if board.has(feature | Feature.CONFIG):
            board.configure(trace_mode=mode, status_period_ms=board.quick_status_ms)
            _stream_in_client_dialogue(board)
    if board.has(Feature.SEQUENCE_PHASES):
        _play_in_client_dialogue(board)
    _be_refused_in_client_dialogue(board)
    _time_out_in_client_dialogue(board)
    board.link.ask(Disarm())
    board.link.ask(Mute())
    return board.wire.received[since:]


def _ask_in_client_dialogue(board: BoardClient) -> None:
    board.link.ask(Ping(0x0102030405060708))
    board.link.ask(GetStatus())
    board.link.ask(GetConfig())
    board.link.ask(GetGeometry(0, 0xFFFF))


def _stream_in_client_dialogue(board: BoardClient) -> None:
    # No zero in the registers, nor in the amplitudes: the longest runs that COBS has to cut.
    latch_now(board, board.flat_phases(0x88))
    latch_now(board, board.phases(board.random_registers()))
    for kind in drive_kinds(board):
        board.link.ask(ReadDrive(kind, 0, 0xFFFF))
    if board.has(Feature.TRACE_RING):
        board.link.ask(ReadTrace(0, 0xFFFF))
    board.wire.idle(1200 * board.quick_status_ms)  # for a STATUS


def _play_in_client_dialogue(board: BoardClient) -> None:
    frames = phases_that_fit(board, _FRAMES)
    data = b"".join(board.random_registers() for _ in range(frames))
    upload_to_board(board, UploadKind.PHASES, _SEQUENCE, data)
    if board.has(Feature.CONFIG | Feature.TRACE):
        board.configure(trace_mode=TraceMode.CRC)
    board.link.ask(Play(_SEQUENCE, _PERIOD_US, 1, _UNATTENDED_MS), flags=0x10)
    board.wire.idle(2 * _FRAMES * _PERIOD_US)
    board.link.ask(Stop())


def _be_refused_in_client_dialogue(board: BoardClient) -> None:
    board.link.ask_raw(_UNKNOWN_REQUEST)
    board.link.ask_raw(GetGeometry.TYPE, b"\x00")
    board.link.ask(Ping(1), session=board.link.session ^ 0x5555)


def _time_out_in_client_dialogue(board: BoardClient) -> None:
    """Let the hold mute the board, so that the board sends STATE_CHANGED."""
    if not board.has(Feature.CONFIG):
        return
    board.configure(hold_ms=20)
    board.link.ask(Arm())
    latch_now(board, board.flat_phases())
    board.wire.idle(40_000)


def undamaged_received_pieces(pieces: list[ReceivedByClient]) -> list[ReceivedByClient]:
    """Return the pieces that are undamaged frames."""
    return [piece for piece in pieces if piece.header is not None]

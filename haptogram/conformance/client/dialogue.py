"""A dialogue in which a board sends every kind of message, for cases about its frames."""

from __future__ import annotations

from typing import Final

from haptogram_protocol import messages as m

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
        board.dialogue = _run_client_dialogue(board), board.wire.recording
    pieces, board.wire.recording = board.dialogue
    return pieces


def _run_client_dialogue(board: BoardClient) -> list[ReceivedByClient]:
    """Exchange messages of all kinds with the board; return the frames that it sent."""
    board.hello()
    since = board.link.mark()
    board.hello(board.link.session)
    _send_read_requests(board)
    board.link.ask(m.Arm())
    for feature, mode in TRACE_MODES:
        if board.has(feature | m.Feature.CONFIG):
            board.configure(trace_mode=mode, status_period_ms=board.quick_status_ms)
            _stream_frames(board, since)
    if board.has(m.Feature.SEQUENCE_PHASES):
        _play_sequence(board)
    _send_refused_requests(board)
    _let_hold_expire(board)
    board.link.ask(m.Disarm())
    board.link.ask(m.Mute())
    return board.wire.received[since:]


def _send_read_requests(board: BoardClient) -> None:
    """Send PING, GET_STATUS, GET_CONFIG and GET_GEOMETRY, which change nothing."""
    board.link.ask(m.Ping(0x0102030405060708))
    board.link.ask(m.GetStatus())
    board.link.ask(m.GetConfig())
    board.link.ask(m.GetGeometry(0, 0xFFFF))


def _stream_frames(board: BoardClient, since: int) -> None:
    """Latch and read back drives, and wait for a STATUS received after the index *since*."""
    # No zero in the registers, nor in the amplitudes: the longest runs that COBS has to cut.
    latch_now(board, board.flat_phases(0x88))
    latch_now(board, board.phases(board.random_registers()))
    for kind in drive_kinds(board):
        board.link.ask(m.ReadDrive(kind, 0, 0xFFFF))
    if board.has(m.Feature.TRACE_RING):
        board.link.ask(m.ReadTrace(0, 0xFFFF))
    board.link.await_event(m.Status, since, 1200 * board.quick_status_ms)


def _play_sequence(board: BoardClient) -> None:
    """Upload a sequence, play it with trace events, and stop it."""
    frames = phases_that_fit(board, _FRAMES)
    data = b"".join(board.random_registers() for _ in range(frames))
    upload_to_board(board, m.UploadKind.PHASES, _SEQUENCE, data)
    if board.has(m.Feature.CONFIG | m.Feature.TRACE):
        board.configure(trace_mode=m.TraceMode.CRC)
    board.link.ask(m.Play(_SEQUENCE, _PERIOD_US, 1, _UNATTENDED_MS), flags=0x10)
    board.wire.idle(2 * _FRAMES * _PERIOD_US)
    board.link.ask(m.Stop())


def _send_refused_requests(board: BoardClient) -> None:
    """Send requests to be refused: an unknown type, a short payload, another session."""
    board.link.ask_raw(_UNKNOWN_REQUEST)
    board.link.ask_raw(m.GetGeometry.TYPE, b"\x00")
    board.link.ask(m.Ping(1), session=board.link.session ^ 0x5555)


def _let_hold_expire(board: BoardClient) -> None:
    """Let the hold of 20 ms expire, for a STATE_CHANGED; nothing if it cannot be configured."""
    if not board.has(m.Feature.CONFIG):
        return
    board.configure(hold_ms=20)
    board.link.ask(m.Arm())
    latch_now(board, board.flat_phases())
    board.wire.idle(40_000)


def undamaged_received_pieces(pieces: list[ReceivedByClient]) -> list[ReceivedByClient]:
    """Return the pieces that are undamaged frames."""
    return [piece for piece in pieces if piece.header is not None]

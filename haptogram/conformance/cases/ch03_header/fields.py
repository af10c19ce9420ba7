"""HG-3.1, HG-3.7: the header of ten bytes, and its session."""

from __future__ import annotations

from haptogram_protocol.annotation.frames import annotated_frame_text
from haptogram_protocol.framing import HEADER_BYTES
from haptogram_protocol.messages import HelloReply, MessageType

from ...case import case, case_about_host
from ...client.board_client import BoardClient
from ...client.dialogue import (
    crc_of_received_piece,
    full_client_dialogue,
    undamaged_received_pieces,
)
from ...outcome import SELF_REPORTED, check


@case("HG-3.1/1")
def frames_begin_with_a_header(board: BoardClient) -> None:
    """every frame of a full dialogue begins with a header of ten bytes"""
    for piece in full_client_dialogue(board):
        _, body = crc_of_received_piece(piece)
        check(
            len(body) >= HEADER_BYTES,
            f"a frame without a header: {annotated_frame_text(piece.piece)}",
        )
        check(
            body[0] >= 0x80,
            f"the board sends a frame of the host: {annotated_frame_text(piece.piece)}",
        )


@case("HG-3.7/1")
def header_carries_the_session(board: BoardClient) -> None:
    """every frame of a full dialogue carries its session; ERROR may carry 0"""
    pieces = undamaged_received_pieces(full_client_dialogue(board))
    greetings = (piece.message for piece in pieces if isinstance(piece.message, HelloReply))
    due = next((greeting.nonce for greeting in greetings), board.link.session)
    for piece in pieces:
        header = piece.header
        assert header is not None  # frames_in
        stale = header.type == MessageType.ERROR and header.session == 0
        check(
            header.session == due or stale,
            f"another session than {due:#06x}: {annotated_frame_text(piece.piece)}",
        )


@case("HG-3.7/2", evidence=SELF_REPORTED)
def drops_headers_of_another_session(board: BoardClient) -> None:
    """a stream frame of another session is counted in stale_session and uses up no number"""
    old = board.link.session
    board.hello()
    board.arm()
    sessions = (old, board.link.session ^ 0x0100, board.link.session ^ 0x0001, 0)
    with board.counting(stale_session=len(sessions), latched=1):
        for session in sessions:
            board.link.stream(board.flat_phases(), seq=board.link.stream_next, session=session)
        board.link.stream(board.flat_phases())
        board.clock.wait_latched()


not_host_session = case_about_host("HG-3.7/3")

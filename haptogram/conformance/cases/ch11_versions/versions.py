"""HG-11.1, HG-11.2, HG-11.3, HG-11.4, HG-11.5: versions, deprecation, reserved numbers."""

from __future__ import annotations

from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.annotation.frames import annotated_frame_text, annotated_type_name

from ...case import Depth, case, case_about_host, case_about_text
from ...client.board_client import BoardClient
from ...client.dialogue import full_client_dialogue, undamaged_received_pieces
from ...outcome import SELF_REPORTED, check, check_equal

OF_TEXT: Final = tuple(map(case_about_text, ("HG-11.2/1", "HG-11.4/1", "HG-11.4/2")))
OF_HOST: Final = tuple(map(case_about_host, ("HG-11.3/1", "HG-11.4/3")))


@case("HG-11.1/1")
def keeps_what_no_version_changes(board: BoardClient) -> None:
    """HELLO of major 0 to 255 and MUTE with a longer payload are understood"""
    for major in {0, 1, 2, 3, 127, 255} - {m.VERSION_MAJOR}:
        hello = m.Hello(major, 99, board.new_nonce(), 0xFFFFFFFF)
        board.link.refused(hello, m.ErrorCode.VERSION, m.VERSION_MAJOR, session=0)
    board.arm()
    answer = board.link.ask_raw(m.Mute.TYPE, b"of another version", flags=0xF0, session=0x7777)
    check(isinstance(answer.message, m.MuteReply), "MUTE of another version is not carried out")
    reply = board.link.ask(board.hello_message(board.new_nonce()), session=0)
    check_equal(reply.body[10], m.VERSION_MAJOR, f"byte 0 of HELLO_REPLY is {reply.body[10]}")


@case("HG-11.2/2", depth=Depth.DEFAULT)
def uses_the_smaller_minor_version(board: BoardClient) -> None:
    """a host of minor version 255 is answered; the board sends messages of its version only"""
    hello = m.Hello(m.VERSION_MAJOR, 255, board.new_nonce())
    reply = board.link.call(hello, m.HelloReply, session=0)
    board.adopt(reply)
    check(reply.minor >= m.VERSION_MINOR, f"HELLO_REPLY says minor {reply.minor}")
    board.hello()
    for piece in undamaged_received_pieces(full_client_dialogue(board)):
        text = (
            f"to a host of {m.VERSION_MAJOR}.{m.VERSION_MINOR}: {annotated_frame_text(piece.piece)}"
        )
        check(piece.reason != "unknown_type", text)


@case("HG-11.5/1")
def advertises_no_reserved_bits(board: BoardClient) -> None:
    """SYNC_IN and COMMIT are not advertised"""
    reserved = m.Feature.SYNC_IN | m.Feature.COMMIT
    found = m.Feature(board.identity.features & int(reserved))
    check(not found, f"{found.name} is reserved in this version")


@case("HG-11.5/2", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def sends_no_reserved_bits(board: BoardClient) -> None:
    """no frame of a full dialogue has a type, flag, code, value or capability outside the tables"""
    known = sum(int(feature) for feature in m.Feature)
    spare = board.identity.features & ~known
    check(not spare, f"capability bits {spare:#x} are in no table")
    for piece in undamaged_received_pieces(full_client_dialogue(board)):
        header = piece.header
        assert header is not None  # frames_in
        check(header.type in m.MESSAGES, f"{annotated_type_name(header.type)} is in no table")
        check(piece.reason != "bad_value", f"{annotated_frame_text(piece.piece)}")
        if isinstance(piece.message, m.Error):
            code = piece.message.code
            check(code in m.ErrorCode._value2member_map_, f"error code {code} is in no table")

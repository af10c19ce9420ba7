"""HG-2.1, HG-2.3: zeros between frames, and frames that are empty."""

from __future__ import annotations

from haptogram_protocol.annotation.frames import annotated_frame_text
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import Ping

from ...case import case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...client.dialogue import full_client_dialogue
from ...outcome import SELF_REPORTED, check, fail


@case("HG-2.1/1")
def sends_both_delimiters(board: BoardClient) -> None:
    """in a full dialogue no two frames share a delimiter"""
    pieces = full_client_dialogue(board)
    shared = [annotated_frame_text(piece.piece) for piece in pieces if piece.shared]
    check(not shared, f"{len(shared)} frames share a zero with the one before: {shared[:1]}")


@case("HG-2.1/2")
def frames_may_share_a_delimiter(board: BoardClient) -> None:
    """a stream frame and a PING that share a zero are both taken"""
    frames = [board.link.stream_wire(board.flat_phases()) for _ in range(3)]
    with board.counting(dropped_state=3, requests=1):
        ping, seq = board.link.request_wire(Ping(1))
        since = board.link.mark()
        board.link.send(*(frame[:-1] for frame in frames), ping)
        board.link.answer_to(Ping.TYPE, seq, since)


@case("HG-2.1/3")
def frames_are_read_behind_junk(board: BoardClient) -> None:
    """a PING is answered right behind noise, halves of frames and runs too long"""
    half = encode_frame(board.link.body(Ping.TYPE, bytes(8), seq=0x4444))[:-6]
    junk = [
        malformed_frames.malformed_noise(board.random, size) for size in (1, 3, 17, 300, 4095, 5000)
    ]
    for before in [b"\xff", b"\x01", half, b"boot: ok\r\n", *junk]:
        ping, seq = board.link.request_wire(Ping(len(before)))
        since = board.link.mark()
        board.link.send(before, ping)  # without a pause: a board that waits for one loses the PING
        if board.link.try_answer(seq, since) is None:
            fail(f"a PING right behind {len(before)} bytes ({before[:8].hex(' ')} ...) is lost")


@case("HG-2.3/1", evidence=SELF_REPORTED)
def ignores_empty_frames(board: BoardClient) -> None:
    """100 zeros in a row move no counter, and the next request is answered"""
    with board.counting(frames=0, requests=0):
        board.link.send(b"\x00" * 100)

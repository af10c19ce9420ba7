"""HG-2.7: the line carries every byte at full rate, and is silent before HELLO."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.annotation.frames import annotated_frame_text
from haptogram_protocol.messages import Phases, Ping, Pong

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.request_client import LONGEST_BURST_BYTES
from ...outcome import SELF_REPORTED, check, check_equal

_LISTEN_US: Final = 300_000
_PING_BYTES: Final = 26  # on the line, at most


@case("HG-2.7/1")
def line_carries_every_byte(board: BoardClient) -> None:
    """all 256 byte values come back from PING as they were sent"""
    for start in range(0, 256, 8):
        echo = int.from_bytes(bytes(range(start, start + 8)), "little")
        got = board.link.call(Ping(echo), Pong).echo
        check_equal(got, echo, f"sent {echo:016x}, came back {got:016x}: the line changes bytes")


@case("HG-2.7/2", evidence=SELF_REPORTED)
def line_takes_a_full_window(board: BoardClient) -> None:
    """stream frames of rx_window bytes, sent without a pause, are all counted"""
    first = board.link.stream_wire(board.flat_phases())
    count = max(1, min(board.identity.rx_window, LONGEST_BURST_BYTES) // len(first))
    frames = [first, *(board.link.stream_wire(board.flat_phases()) for _ in range(count - 1))]
    with board.counting(dropped_state=count, frames=count):
        board.link.send(*frames)
        board.wire.idle_while_sending()


@case("HG-2.7/2-shortest", evidence=SELF_REPORTED)
def line_takes_a_window_of_shortest_frames(board: BoardClient) -> None:
    """the shortest stream frames, rx_window bytes of them without a pause: each is counted"""
    first = board.link.stream_raw(Phases.TYPE, b"")  # of a wrong length: 14 bytes before stuffing
    count = (min(board.identity.rx_window, LONGEST_BURST_BYTES) - _PING_BYTES) // len(first)
    frames = [first, *(board.link.stream_raw(Phases.TYPE, b"") for _ in range(count - 1))]
    since = board.link.mark()
    with board.counting(bad_length=count, frames=count + 1, requests=1, gap=0):
        ping, seq = board.link.request_wire(Ping(1))
        board.wire.send(b"".join([*frames, ping]))
        board.link.answer_to(Ping.TYPE, seq, since)


@case("HG-2.7/3", needs_reset=True, depth=Depth.DEFAULT)
def line_is_silent_before_hello(board: BoardClient) -> None:
    """for 0.3 s after a reset the board sends no frame; boot text is tolerated"""
    board.wire.idle(_LISTEN_US)
    frames = [piece for piece in board.wire.received if piece.header is not None]
    check(
        not frames,
        f"before the first HELLO: {annotated_frame_text(frames[0].piece) if frames else ''}",
    )

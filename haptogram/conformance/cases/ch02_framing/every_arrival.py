"""HG-2.1, HG-2.6: bytes in pieces and with pauses, and long runs."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import Ping, Pong

from ...case import Depth, case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...outcome import SELF_REPORTED, CaseEndedError

_PAUSE_US: Final = 120_000
_BYTE_US: Final = 1_000


@case("HG-2.1/3-pieces")
def reads_frames_cut_at_every_byte(board: BoardClient) -> None:
    """PINGs in two pieces cut at every byte, byte by byte, and with a pause of 120 ms are
    answered
    """
    size = len(board.link.request_wire(Ping(0), seq=0)[0])
    cuts: list[list[int]] = [[at] for at in range(1, size)]
    for at in cuts if board.thorough else cuts[::5]:
        _ask_in_pieces(board, at, _BYTE_US)
    _ask_in_pieces(board, list(range(1, size)), _BYTE_US)
    _ask_in_pieces(board, [size // 2], _PAUSE_US)


def _ask_in_pieces(board: BoardClient, cuts: list[int], pause_us: int) -> None:
    """Send a PING cut at *cuts*, with a pause at each; FAILED if it is not answered."""
    wire, seq = board.link.request_wire(Ping(board.random.getrandbits(64)))
    since = board.link.mark()
    for start, stop in zip([0, *cuts], [*cuts, len(wire)], strict=True):
        board.link.send(wire[start:stop])
        if stop < len(wire):
            board.wire.idle(pause_us)
    try:
        board.link.reply_in(board.link.answer_to(Ping.TYPE, seq, since), Pong, Ping.TYPE)
    except CaseEndedError as error:
        how = f"cut at {cuts[:3]} of {len(wire)} bytes, with pauses of {pause_us} µs"
        raise CaseEndedError(error.behaviour, f"a PING {how}: {error}") from None


@case("HG-2.6/3-lengths", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def longest_frame_lengths_count_once(board: BoardClient) -> None:
    """runs of 65 536 to 200 000 bytes count once in oversize, and in nothing else"""
    for size in (65_536, 65_536 + 4_096, 70_000, 131_072 + 4_097, 200_000):
        board.wire.require_carried(2 * size, board.wire.limits.case_us // 5)
        with board.counting(oversize=1):
            noise = malformed_frames.malformed_noise(board.random, size)
            board.link.send(b"\x00" + noise + b"\x00")
            board.wire.idle_while_sending()
            board.link.barrier()

"""HG-2.2: byte stuffing by COBS."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.annotation.frames import annotated_frame_text
from haptogram_protocol.framing import cobs_encode
from haptogram_protocol.messages import Ping

from ...case import case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...client.dialogue import full_client_dialogue
from ...outcome import SELF_REPORTED, check, fail

_RUNS: Final = (252, 253, 254, 255, 256, 507, 508, 509, 762)


@case("HG-2.2/1")
def frames_are_stuffed_by_cobs(board: BoardClient) -> None:
    """every frame of a full dialogue is stuffed as COBS prescribes"""
    pieces = full_client_dialogue(board)
    broken = [piece for piece in pieces if not piece.unstuffed]
    check(not broken, f"no COBS: {broken[0].piece[:16].hex(' ') if broken else ''} ...")
    odd = [p for p in pieces if p.piece != cobs_encode(p.unstuffed)]
    check(not odd, f"stuffed in another way: {annotated_frame_text(odd[0].piece) if odd else ''}")


@case("HG-2.2/1-runs")
def reads_long_runs_of_stuffed_bytes(board: BoardClient) -> None:
    """frames that end with 252 to 762 bytes without a zero are read, each as it was sent"""
    for run in _RUNS:
        data, seq = malformed_frames.malformed_mute_with_run(board.link, run)
        since = board.link.mark()
        board.link.send(malformed_frames.malformed_frame(data))
        if board.link.try_answer(seq, since) is None:
            fail(f"a frame that ends with {run} bytes without a zero is not read")


@case("HG-2.2/2", evidence=SELF_REPORTED)
def drops_frames_with_wrong_stuffing(board: BoardClient) -> None:
    """a code byte that points past the end is counted in cobs, once; the frame has no effect"""
    good = b"\x01"
    while good.endswith(b"\x01"):  # without this byte it would be COBS, too
        body = board.link.body(Ping.TYPE, bytes(8), seq=board.link.next_seq())
        good = cobs_encode(malformed_frames.malformed_with_crc(body))
    broken = [b"\x05\x01\x02", b"\xff" + b"\x07" * 40, good[:-1], good + b"\x02", b"\x02"]
    with board.counting(cobs=len(broken)):
        board.link.unanswered(
            "a frame that is not COBS", *(b"\x00" + piece + b"\x00" for piece in broken)
        )


@case("HG-2.2/3")
def accepts_a_spare_stuffing_byte(board: BoardClient) -> None:
    """a frame that ends with a full piece and a code byte 01 is read"""
    for run in (malformed_frames.BLOCK, 2 * malformed_frames.BLOCK):
        data, seq = malformed_frames.malformed_mute_with_run(board.link, run)
        encoded = cobs_encode(data)
        since = board.link.mark()
        board.link.send(b"\x00", encoded, b"\x01", b"\x00")
        if board.link.try_answer(seq, since) is None:
            fail(f"a code byte 01 behind a full piece ({run} bytes without a zero) is refused")

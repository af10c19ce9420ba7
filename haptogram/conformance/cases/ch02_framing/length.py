"""HG-2.5, HG-2.6: the shortest and the longest frame."""

from __future__ import annotations

from haptogram_protocol.framing import MAX_ENCODED_BYTES, cobs_encode
from haptogram_protocol.messages import Arm, Ping

from ...case import Depth, case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...client.dialogue import full_client_dialogue
from ...outcome import SELF_REPORTED, check, fail


@case("HG-2.5/1", evidence=SELF_REPORTED)
def drops_frames_of_short_length(board: BoardClient) -> None:
    """1 to 13 bytes, some with a right CRC-32, are counted in short, once each"""
    pieces = [malformed_frames.malformed_noise(board.random, size) for size in range(1, 14)]
    pieces += [malformed_frames.malformed_with_crc(bytes([Ping.TYPE] * size)) for size in range(10)]
    with board.counting(short=len(pieces), frames=0):
        board.link.send(*(malformed_frames.malformed_frame(piece) for piece in pieces))


@case("HG-2.6/1", depth=Depth.DEFAULT)
def frames_keep_the_longest_length(board: BoardClient) -> None:
    """no frame of a full dialogue is longer than 4096 bytes"""
    longest = max((len(piece.piece) for piece in full_client_dialogue(board)), default=0)
    check(longest <= MAX_ENCODED_BYTES, f"{longest} bytes between two delimiters")


@case("HG-2.6/2")
def reads_frames_of_longest_length(board: BoardClient) -> None:
    """frames of 4090 to 4096 bytes between their delimiters are read"""
    for size in (2048, MAX_ENCODED_BYTES - 6, MAX_ENCODED_BYTES - 1, MAX_ENCODED_BYTES):
        encoded, seq = malformed_frames.malformed_mute_of_size(board.link, size)
        since = board.link.mark()
        board.link.send(b"\x00", encoded, b"\x00")
        if board.link.try_answer(seq, since) is None:
            fail(f"a frame of {size} bytes between its delimiters is not read")


@case("HG-2.6/3", evidence=SELF_REPORTED)
def discards_frames_beyond_the_longest_length(board: BoardClient) -> None:
    """runs of 4097 to 20000 bytes are counted in oversize, once; frames inside have no effect"""
    inside = cobs_encode(malformed_frames.malformed_with_crc(board.link.body(Arm.TYPE, seq=0x7000)))
    runs = [
        malformed_frames.malformed_noise(board.random, size) for size in (4097, 5000, 8192, 20_000)
    ]
    with board.counting(oversize=len(runs) + 1):
        for run in [*runs, malformed_frames.malformed_noise(board.random, 4096) + inside]:
            since = board.link.mark()
            board.link.send(b"\x00" + run + b"\x00")
            board.link.barrier()
            extra = board.link.responses(since)[:-1]
            check(not extra, f"a frame inside a run of {len(run)} bytes was answered")

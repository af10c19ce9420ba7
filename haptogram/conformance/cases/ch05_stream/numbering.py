"""HG-5.5, HG-5.6: duplicates, gaps, and numbers that dropped frames use up."""

from __future__ import annotations

from haptogram_protocol.messages import Phases

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...outcome import SELF_REPORTED


@case("HG-5.5/1", evidence=SELF_REPORTED)
def drops_duplicates_of_the_stream(board: BoardClient) -> None:
    """frames 1 to 32 before the expected one are counted in duplicate and not latched"""
    board.arm()
    for _ in range(20):
        latch_now(board)
    behind = (1, 2, 3, 15, 16, 17, 31, 32)
    with board.counting(duplicate=len(behind), latched=1):
        for back in behind:
            board.link.stream(board.flat_phases(), seq=board.link.stream_next - back)
        board.clock.wait_latched(0)
        latch_now(board)


@case("HG-5.5/2", evidence=SELF_REPORTED)
def counts_stream_gaps(board: BoardClient) -> None:
    """frames ahead by 1 to 65 503, as behind a cut of the line, add to gap and are latched at
    once
    """
    board.arm()
    for ahead in (1, 15, 16, 255, 256, 300, 32_767, 32_768, 40_000, 65_503):
        board.link.stream_next += ahead
        with board.counting(gap=ahead, latched=1):
            latch_now(board)


@case("HG-5.6/1", evidence=SELF_REPORTED)
def stream_numbers_are_used_up(board: BoardClient) -> None:
    """frames dropped for type, flags, length, state and time use up their numbers"""
    good = board.flat_phases()
    board.link.stream(good)  # not armed: dropped_state
    board.arm()
    past_us = board.clock.device_us() - 1_000_000
    beyond_us = board.clock.beyond_us(10_000_000)
    dropped = {
        "unknown_type": board.link.stream_raw(0x3B, b""),
        "unsupported": board.link.stream_wire(good, flags=0x40),
        "bad_length": board.link.stream_raw(Phases.TYPE, good.serialize() + b"\x00"),
        "dropped_late": board.link.stream_wire(good, past_us),
    }
    if beyond_us is not None:
        at_us = board.clock.device_us() + beyond_us
        dropped["dropped_future"] = board.link.stream_wire(good, at_us)
    with board.counting(latched=1, **dict.fromkeys(dropped, 1)):
        board.link.send(*dropped.values())
        latch_now(board, good)
    used = range(board.link.stream_next - 1 - len(dropped), board.link.stream_next)
    with board.counting(duplicate=len(used)):
        for seq in used:
            board.link.stream(good, seq=seq)

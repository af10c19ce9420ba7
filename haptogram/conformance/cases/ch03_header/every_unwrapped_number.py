"""HG-3.6: the unwrapped number of a stream frame, and `gap`, across every power of two."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.messages import (
    DriveKind,
    DriveReply,
    Feature,
    Phases,
    ReadDrive,
    TraceMode,
)

from ...case import Case, Depth
from ...client.board_client import BoardClient
from ...client.latching import (
    ask_for_board_latches_if_supported,
    latch_now,
    latches_received_from_board,
)
from ...outcome import SELF_REPORTED, check

_JUMP: Final = 0x7FFF  # the farthest that a number is ahead (HG-5.5/2)
_BATCH: Final = 400  # frames between two readings
_WRAP: Final = 1 << 32


def _go_up_to_unwrapped_number(board: BoardClient, number: int) -> None:
    """Use up numbers, by frames without codes that are a jump apart, until *number* is the next."""
    link = board.link
    while link.stream_next < number:
        wires: list[bytes] = []
        while link.stream_next < number and len(wires) < _BATCH:
            link.stream_next = min(link.stream_next + _JUMP, number - 1)
            wires.append(link.stream_raw(Phases.TYPE, b""))
        link.send(*wires)


def _numbers_told_of_a_latch(
    board: BoardClient, since: int, mode: TraceMode, index: int
) -> dict[str, int]:
    """Return the number of the last latch by every report of it."""
    told = {"last_seq": board.status().last_seq}
    if board.has(Feature.READ_LATCHED):
        shown = board.link.call(ReadDrive(DriveKind.LATCHED, 0, 1), DriveReply)
        told["DRIVE_REPLY"] = shown.key.index
    if mode is not TraceMode.OFF:
        latches = latches_received_from_board(board, since, mode)
        told[f"trace {mode.name}"] = latches[-1].index if latches else -1
    return {name: number for name, number in told.items() if number != index % _WRAP}


def _judge_numbers_across(board: BoardClient, least_bits: int, most_bits: int) -> None:
    """FAILED unless numbers on both sides of each power of two are told whole."""
    mode = ask_for_board_latches_if_supported(board)
    board.arm()
    latch_now(board)
    first, before, sent = board.link.stream_next, board.status().counters, 0
    for bits in range(least_bits, most_bits + 1):
        _go_up_to_unwrapped_number(board, (1 << bits) - 1)
        board.arm_anew()  # or a hold that nothing extends may end before the next latch
        for index in range((1 << bits) - 1, (1 << bits) + 2):
            since = board.link.mark()
            latch_now(board)
            wrong = _numbers_told_of_a_latch(board, since, mode, index)
            check(not wrong, f"the unwrapped number is {index % _WRAP}, told is {wrong}")
        board.wire.forget_received()
        sent += 3
    counted = board.counted_since(before)
    used = counted["bad_length"] + sent
    due = (board.link.stream_next - first - used) % _WRAP
    check(counted["gap"] == due, f"gap grew by {counted['gap']}, due is {due}")


def _numbers_case(variant: str, least_bits: int, most_bits: int, depth: Depth) -> Case:
    def body(board: BoardClient) -> None:
        _judge_numbers_across(board, least_bits, most_bits)

    return Case(
        "HG-3.6/5",
        f"numbers around 2^{least_bits} to 2^{most_bits}, behind jumps of {_JUMP}: told whole",
        body,
        variant,
        evidence=SELF_REPORTED,
        depth=depth,
    )


PRODUCT: Final = (
    _numbers_case("widths", 16, 24, Depth.QUICK),
    _numbers_case("wrap", 25, 32, Depth.FULL),
)

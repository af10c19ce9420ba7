"""HG-9.2: counters start at 0, and no request clears one."""

from __future__ import annotations

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    Counters,
)

from ...case import case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...outcome import SELF_REPORTED, check


@case("HG-9.2/1", needs_reset=True, evidence=SELF_REPORTED)
def counters_begin_at_0(board: BoardClient) -> None:
    """after a reset all counters are 0; a session, MUTE and DISARM clear none"""
    board.hello()
    first = board.status().counters
    heard = first.repeated if board.link.knocks else 0  # a board that booted may have kept HELLOs
    due = {"frames": 2 + heard, "requests": 2, "repeated": heard}
    if board.link.knocks:  # and may have heard one from its middle on
        due |= {name: getattr(first, name) for name in ("crc", "cobs", "short")}
    wrong = {n: v for n, v in _status_counter_values(first).items() if v != due.get(n, 0)}
    check(not wrong, f"after a reset, HELLO and GET_STATUS: {wrong}")
    _check_nothing_clears_counters(board)


@case("HG-9.2/1-kept", evidence=SELF_REPORTED)
def keeps_its_status_counters(board: BoardClient) -> None:
    """a session, MUTE, DISARM and ARM clear no counter"""
    _check_nothing_clears_counters(board)


def _check_nothing_clears_counters(board: BoardClient) -> None:
    board.arm()
    latch_now(board)
    board.link.stream(board.flat_phases(), seq=board.link.stream_next - 1)
    board.link.send(b"\x00\xff\x01\x00\x00\x03\x01\x02\x00", encode_frame(bytes(10))[:-5], b"\x00")
    before = _status_counter_values(board.status().counters)
    board.link.ask_raw(0x42)
    board.arm()
    board.disarm()
    board.hello()
    after = _status_counter_values(board.status().counters)
    less = {name: (before[name], after[name]) for name in before if after[name] < before[name]}
    check(not less, f"counters that went back: {less}")


def _status_counter_values(counters: Counters) -> dict[str, int]:
    return {name: getattr(counters, name) for name in Counters.WIRE}

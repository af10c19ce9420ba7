"""HG-9.2: counters start at 0, go beyond 8 and 16 bits, and no request clears one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

from haptogram_protocol.messages import Counters, Phases

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...client.malformed_frames import malformed_by_counter
from ...outcome import SELF_REPORTED, check

_BLOCK: Final = 256
_LONGEST: Final = 40  # bytes of such a frame on the line


@case("HG-9.2/1", needs_reset=True, evidence=SELF_REPORTED)
def counters_begin_at_0(board: BoardClient) -> None:
    """after a reset all counters are 0; a session, MUTE and DISARM clear none"""
    board.hello()
    first = board.status().counters
    heard = first.repeated if board.link.knocks else 0  # a board that booted may have kept HELLOs
    due = {"frames": 2 + heard, "requests": 2, "repeated": heard}
    if board.link.knocks:  # and may have heard one from its middle on
        due |= {name: getattr(first, name) for name in ("crc", "cobs", "short")}
    values = {name: getattr(first, name) for name in Counters.WIRE}
    wrong = {name: value for name, value in values.items() if value != due.get(name, 0)}
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
    board.link.send(*malformed_by_counter(board.link).values())
    before = board.status().counters
    board.link.ask_raw(0x42)
    board.arm()
    board.disarm()
    board.hello()
    board.check_counters_kept(before, "a session, MUTE, DISARM and ARM")


# --- Beyond 8 and 16 bits ----------------------------------------------------------------------


def _counts_of_junk(board: BoardClient) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Yield counters with a short frame that each counts and no answer tells of."""
    link, used = board.link, board.link.stream_next - 1
    damaged = malformed_by_counter(link)
    damaged["duplicate"] = link.stream_raw(Phases.TYPE, b"", seq=used)
    damaged["stale_session"] = link.stream_raw(Phases.TYPE, b"", seq=used, session=link.session ^ 1)
    for counter in ("crc", "cobs", "short", "duplicate", "stale_session", "unknown_type"):
        yield counter, partial(damaged.__getitem__, counter)
    yield "bad_length", partial(link.stream_raw, Phases.TYPE, b"")
    yield "unsupported", partial(link.stream_raw, Phases.TYPE, b"", flags=0x40)


def _count_much_junk(board: BoardClient, number: int) -> None:
    """FAILED unless each counter grows by *number* with so many frames."""
    board.wire.require_carried(2 * 8 * number * _LONGEST, board.wire.limits.case_us)
    board.link.stream(board.flat_phases())  # the first number is used
    board.link.barrier()
    for counter, make in _counts_of_junk(board):
        with board.counting(**{counter: number}):
            for left in range(number, 0, -_BLOCK):
                board.link.send(*(make() for _ in range(min(left, _BLOCK))))


@case("HG-9.2/1-hundreds", evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def every_counter_of_300(board: BoardClient) -> None:
    """300 frames of each defect that has no answer: each counter grows by 300, beyond 8 bits"""
    _count_much_junk(board, 300)


@case("HG-9.2/1-thousands", evidence=SELF_REPORTED, depth=Depth.FULL)
def every_counter_of_66000(board: BoardClient) -> None:
    """66 000 frames of each defect that has no answer: each counter grows by 66 000"""
    _count_much_junk(board, 66_000)

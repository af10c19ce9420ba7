"""HG-9.2: counters of frames that have no answer, beyond 8 and 16 bits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import Phases, Ping

from ...case import Depth, case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...outcome import SELF_REPORTED

_OVER_8_BITS: Final = 300
_OVER_16_BITS: Final = 66_000
_BLOCK: Final = 256
_LONGEST: Final = 40  # bytes of such a frame on the line


def _counts_of_junk(board: BoardClient) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Yield counters with the shortest frame that each counts and no answer tells of."""
    ping = board.link.body(Ping.TYPE, bytes(8), seq=board.link.seq)
    crc = malformed_frames.malformed_frame(malformed_frames.malformed_with_wrong_crc(ping))
    used = board.link.stream_next - 1
    old = board.link.body(Phases.TYPE, seq=used & 0xFFFF)
    stale = board.link.body(Phases.TYPE, seq=used & 0xFFFF, session=board.link.session ^ 1)
    foreign = board.link.body(0xC1, seq=0)
    yield "crc", lambda: crc
    yield "cobs", lambda: b"\x00\xff\x01\x00"
    yield "short", lambda: b"\x00\x02\x01\x00"
    yield "duplicate", lambda: encode_frame(old)
    yield "stale_session", lambda: encode_frame(stale)
    yield "unknown_type", lambda: encode_frame(foreign)
    yield "bad_length", lambda: board.link.stream_raw(Phases.TYPE, b"")
    yield "unsupported", lambda: board.link.stream_raw(Phases.TYPE, b"", flags=0x40)


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
def counters_hold_hundreds_of_junk_frames(board: BoardClient) -> None:
    """300 frames of each defect that has no answer: each counter grows by 300, beyond 8 bits"""
    _count_much_junk(board, _OVER_8_BITS)


@case("HG-9.2/1-thousands", evidence=SELF_REPORTED, depth=Depth.FULL)
def counters_hold_thousands_of_junk_frames(board: BoardClient) -> None:
    """66 000 frames of each defect that has no answer: each counter grows by 66 000"""
    _count_much_junk(board, _OVER_16_BITS)

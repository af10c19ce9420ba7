"""HG-2.1, HG-2.6, HG-9.2: bytes in pieces and with pauses, long runs, counters of many frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import Phases, Ping, Pong

from ...case import Depth, case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...outcome import SELF_REPORTED, CaseEndedError, not_observed

_PAUSE_US: Final = 120_000
_BYTE_US: Final = 1_000
_OVER_8_BITS: Final = 300
_OVER_16_BITS: Final = 66_000
_BLOCK: Final = 256
_LONGEST: Final = 40  # bytes of such a frame on the line


@case(
    "HG-2.1/3",
    "PINGs in two pieces cut at every byte, byte by byte, and with a pause of 120 ms are answered",
    variant="pieces",
)
def reads_frames_cut_at_every_byte(board: BoardClient) -> None:
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


@case(
    "HG-2.6/3",
    "runs of 65 536 to 200 000 bytes count once in oversize, and in nothing else",
    variant="lengths",
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def longest_frame_lengths_count_once(board: BoardClient) -> None:
    for size in (65_536, 65_536 + 4_096, 70_000, 131_072 + 4_097, 200_000):
        if 2 * board.wire.line_us(size) > board.wire.limits.case_us // 5:
            not_observed(f"{size} bytes take too long on this line")
        with board.counting(oversize=1):
            noise = malformed_frames.malformed_noise(board.random, size)
            board.link.send(b"\x00" + noise + b"\x00")
            board.wire.idle(board.wire.line_us(size))
            board.link.barrier()


# --- Counters ----------------------------------------------------------------------------------


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
    if 2 * board.wire.line_us(8 * number * _LONGEST) > board.wire.limits.case_us:
        not_observed(f"{number} frames of each defect take too long on this line")
    board.link.send(board.link.stream_wire(board.flat_phases()))  # the first number is used
    board.link.barrier()
    for counter, make in _counts_of_junk(board):
        with board.counting(**{counter: number}):
            for left in range(number, 0, -_BLOCK):
                board.link.send(*(make() for _ in range(min(left, _BLOCK))))


@case(
    "HG-9.2/1",
    "300 frames of each defect that has no answer: each counter grows by 300, beyond 8 bits",
    variant="hundreds",
    evidence=SELF_REPORTED,
    depth=Depth.DEFAULT,
)
def counters_hold_hundreds_of_junk_frames(board: BoardClient) -> None:
    _count_much_junk(board, _OVER_8_BITS)


@case(
    "HG-9.2/1",
    "66 000 frames of each defect that has no answer: each counter grows by 66 000",
    variant="thousands",
    evidence=SELF_REPORTED,
    depth=Depth.FULL,
)
def counters_hold_thousands_of_junk_frames(board: BoardClient) -> None:
    _count_much_junk(board, _OVER_16_BITS)

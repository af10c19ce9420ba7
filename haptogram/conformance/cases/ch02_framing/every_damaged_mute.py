"""HG-2.4: bytes that look like MUTE and are none: the output, queue and playback go on.

A board looks for MUTE ahead of other frames (HG-3.8/2): by the same rules as for every frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from haptogram_protocol.framing import MAX_ENCODED_BYTES, cobs_encode, encode_frame
from haptogram_protocol.messages import Feature, Mute, StateChanged, UploadChunk
from haptogram_protocol.state import OutputState

from ...case import case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...client.latching import is_board_silent, latch_now
from ...client.playback import play_now, send_phases_that_fit
from ...judge.timers import judge_within_hold
from ...outcome import SELF_REPORTED

_SEQUENCE: Final = 4
_AHEAD_US: Final = 4_000_000
_LONG: Final = 3000
_FLIPS: Final = (1, 1 << 7, 1 << 8, 1 << 15, 1 << 16, 1 << 31)


def _bytes_like_mute(board: BoardClient) -> Iterator[tuple[str, bytes]]:
    """Yield bytes between delimiters that hold a MUTE, or most of one: what is wrong, the bytes."""
    noise = malformed_frames.malformed_noise(board.random, MAX_ENCODED_BYTES)
    for session in (board.link.session, 0):
        body = board.link.body(Mute.TYPE, seq=board.link.seq + 1, session=session)
        whole = malformed_frames.malformed_with_crc(body)
        mute = cobs_encode(whole)
        for flip in _FLIPS:
            wrong = malformed_frames.malformed_with_wrong_crc(body, flip)
            yield f"the bits {flip:#x} of its CRC inverted", cobs_encode(wrong)
        long = board.link.body(Mute.TYPE, bytes(_LONG), seq=0, session=session)
        wrong = malformed_frames.malformed_with_wrong_crc(long)
        yield f"a payload of {_LONG} bytes and a wrong CRC", cobs_encode(wrong)
        yield "a byte too much", cobs_encode(whole + b"\x01")
        yield "a byte too little", cobs_encode(whole[:-1])
        short = malformed_frames.malformed_with_crc(body[:9])
        yield "a header of 9 bytes", cobs_encode(short)
        yield "its type and a CRC alone", cobs_encode(malformed_frames.malformed_with_crc(body[:1]))
        yield "a code byte past its end", mute + b"\x02"
        yield "its first half alone", mute[: len(mute) // 2]
        yield "its second half alone", mute[len(mute) // 2 :]
        yield "a byte before it", b"\x01" + mute
        yield "junk before it, too long with it", noise + mute
        junk = malformed_frames.malformed_noise(board.random, MAX_ENCODED_BYTES + 100)
        far = board.link.body(Mute.TYPE, junk, seq=0, session=session)
        yield (
            "a payload beyond the longest frame",
            cobs_encode(malformed_frames.malformed_with_crc(far)),
        )
        inside = UploadChunk(0x7FFFFFFF, b"\x00" + whole + b"\x00" + encode_frame(body))
        stale = board.link.body(inside.TYPE, inside.serialize(), seq=0, session=1)
        yield "a chunk around it", encode_frame(stale).strip(b"\x00")


@case("HG-2.4/2-mutes", evidence=SELF_REPORTED)
def damaged_mutes_mute_nothing(board: BoardClient) -> None:
    """bytes that look like MUTE, damaged, too short, too long, within a frame: the output goes
    on
    """
    board.wire.require_carried(2 * MAX_ENCODED_BYTES, _AHEAD_US // 4)
    plays = board.has(Feature.SEQUENCE_PHASES) and board.thorough
    if plays:
        send_phases_that_fit(board, _SEQUENCE, frames=2)
    for _ in board.wire.ways_of_mute():
        for is_played in (False, True) if plays else (False,):
            _judge_damaged_mutes(board, is_played=is_played)


def _judge_damaged_mutes(board: BoardClient, *, is_played: bool) -> None:
    """FAILED if one of the bytes mutes, flushes or ends a playback."""
    board.hello()
    board.arm()
    if is_played:
        play_now(board, _SEQUENCE, loops=0)
        board.clock.wait_latched()
    since, waits_until_us, latched_us = board.link.mark(), 0, board.wire.now_us()
    latch_in_us = min(_AHEAD_US // 2, 500 * board.config.hold_ms)
    for name, piece in _bytes_like_mute(board):
        if not board.wire.carries(len(piece), latch_in_us // 2):
            continue  # a hold that nothing extends may end meanwhile
        if is_played:
            latched_us = board.wire.now_us()
        elif waits_until_us - board.clock.device_estimate_us() < _AHEAD_US - latch_in_us:
            latched_us = board.wire.now_us()
            latch_now(board)  # which flushes the frame that waits
            waits_until_us = board.clock.ahead_us(_AHEAD_US)
            board.link.stream(board.flat_phases(), waits_until_us)
        board.link.send(b"\x00" + piece + b"\x00")
        board.wire.idle_while_sending()
        board.link.barrier()
        found = board.status()
        told = board.link.events(StateChanged, since)
        shows = board.has(Feature.READ_RADIATED)
        for holds, wrong in (
            (found.state is OutputState.ARMED, f"{found.state.name}, {found.reason.name}"),
            (found.queued == (not is_played), f"{found.queued} frames wait"),
            (not shows or not is_board_silent(board), "the output is off"),
            (not told, f"the board tells {told[0][1] if told else ''}"),
        ):
            judge_within_hold(
                board, latched_us, holds, f"a MUTE with {name} is to do nothing: {wrong}"
            )
    board.disarm()

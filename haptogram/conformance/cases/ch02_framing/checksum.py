"""HG-2.4: the CRC-32 of every frame, and bytes that look like MUTE and are none.

A board looks for MUTE ahead of other frames (HG-3.8/2): by the same rules as for every frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from haptogram_protocol.framing import MAX_ENCODED_BYTES, cobs_encode, encode_frame
from haptogram_protocol.messages import (
    Error,
    Feature,
    HelloReply,
    Mute,
    Ping,
    StateChanged,
    UploadChunk,
)
from haptogram_protocol.state import OutputState

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.dialogue import full_client_dialogue
from ...client.introduction import introduce_to_board
from ...client.latching import is_board_silent, latch_now
from ...client.malformed_frames import (
    malformed_checksums,
    malformed_frame,
    malformed_noise,
    malformed_with_crc,
    malformed_with_wrong_crc,
)
from ...client.playback import play_now, send_phases_that_fit
from ...client.wire import ReceivedByClient
from ...judge.timers import LEASE, judge_within_hold
from ...outcome import SELF_REPORTED, check, fail, inconclusive
from ..ch12_timers.every_restart import damaged_pings, judge_no_renewals

_SEQUENCE: Final = 4
_AHEAD_US: Final = 4_000_000
_LONG: Final = 3000
_LEAST: Final = 14  # bytes of a header and a CRC
_DAMAGE: Final = (1, 0x80000000, 0x00010000, 0xFFFFFFFF)
_FLIPS: Final = (1, 1 << 7, 1 << 8, 1 << 15, 1 << 16, 1 << 31)


@case("HG-2.4/1", needs_session=False)
def frames_have_crc32_checksum(board: BoardClient) -> None:
    """HELLO with a CRC-32 is answered by a frame with a CRC-32; another checksum is named"""
    board.link.session = 0
    for _ in range(3):
        reply = introduce_to_board(board)
        if isinstance(reply, HelloReply):
            _check_checksum(board)
            return
        if reply is not None:
            inconclusive(f"HELLO is answered by {reply}, with its CRC-32")
    for piece in filter(_is_framed_greeting, board.wire.received):
        check(piece.reason != "crc", f"frames come, but none with its CRC-32: {piece.fault}")
    hello = board.hello_message(board.new_nonce())
    body = board.link.body(hello.TYPE, hello.serialize(), seq=board.link.next_seq(), session=0)
    for name, data in malformed_checksums(body).items():
        since = board.link.mark()
        board.link.send(malformed_frame(data))
        found = board.wire.wait_for(_is_framed_greeting, since, board.wire.limits.answer_us)
        check(found is None, f"HELLO is answered if it ends with {name} instead of CRC-32")
    inconclusive("no HELLO is answered, with whatever checksum")


def _is_framed_greeting(piece: ReceivedByClient) -> bool:
    """Return True if a piece begins like an answer to HELLO, with any checksum."""
    return piece.unstuffed[:1] in (bytes([HelloReply.TYPE]), bytes([Error.TYPE]))


def _check_checksum(board: BoardClient) -> None:
    board.prepare()
    for piece in full_client_dialogue(board):
        if piece.reason in ("crc", "short"):
            fail(f"a frame without its CRC-32: {piece.fault}")


@case("HG-2.4/2", evidence=SELF_REPORTED)
def drops_frames_of_wrong_checksum(board: BoardClient) -> None:
    """frames with a wrong CRC are counted in crc; they get no answer and use up no number"""
    body = board.link.body(Ping.TYPE, bytes(8), seq=board.link.next_seq())
    others = malformed_checksums(body)
    del others["no checksum"]
    frames = [malformed_with_wrong_crc(body, flip) for flip in _DAMAGE]
    frames += others.values()
    for bit in (0, 13, 77, 100):  # damage in the body instead
        damaged = bytearray(malformed_with_crc(body))
        damaged[bit // 8] ^= 1 << bit % 8
        frames.append(bytes(damaged))
    flat = board.flat_phases()
    stream = board.link.body(flat.TYPE, flat.serialize(), seq=board.link.stream_next)
    frames.append(malformed_with_wrong_crc(stream))
    wires = [malformed_frame(frame) for frame in frames if len(frame) >= _LEAST]
    with board.counting(crc=len(wires), dropped_state=1):
        board.link.unanswered("a frame with a wrong CRC", *wires)
        # Its number is still free: the next frame takes it, without a gap or a duplicate.
        board.link.stream(flat)


@case("HG-2.4/2-lease", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def wrong_checksums_renew_no_lease(board: BoardClient) -> None:
    """frames with a wrong CRC do not keep an ARMED board alive"""
    judge_no_renewals(board, damaged_pings, LEASE)


# --- Bytes that look like MUTE -----------------------------------------------------------------


def _bytes_like_mute(board: BoardClient) -> Iterator[tuple[str, bytes]]:
    """Yield bytes between delimiters that hold a MUTE, or most of one: what is wrong, the bytes."""
    noise = malformed_noise(board.random, MAX_ENCODED_BYTES)
    for session in (board.link.session, 0):
        body = board.link.body(Mute.TYPE, seq=board.link.seq + 1, session=session)
        whole = malformed_with_crc(body)
        mute = cobs_encode(whole)
        for flip in _FLIPS:
            wrong = malformed_with_wrong_crc(body, flip)
            yield f"the bits {flip:#x} of its CRC inverted", cobs_encode(wrong)
        long = board.link.body(Mute.TYPE, bytes(_LONG), seq=0, session=session)
        wrong = malformed_with_wrong_crc(long)
        yield f"a payload of {_LONG} bytes and a wrong CRC", cobs_encode(wrong)
        yield "a byte too much", cobs_encode(whole + b"\x01")
        yield "a byte too little", cobs_encode(whole[:-1])
        yield "a header of 9 bytes", cobs_encode(malformed_with_crc(body[:9]))
        yield "its type and a CRC alone", cobs_encode(malformed_with_crc(body[:1]))
        yield "a code byte past its end", mute + b"\x02"
        yield "its first half alone", mute[: len(mute) // 2]
        yield "its second half alone", mute[len(mute) // 2 :]
        yield "a byte before it", b"\x01" + mute
        yield "junk before it, too long with it", noise + mute
        junk = malformed_noise(board.random, MAX_ENCODED_BYTES + 100)
        far = board.link.body(Mute.TYPE, junk, seq=0, session=session)
        yield "a payload beyond the longest frame", cobs_encode(malformed_with_crc(far))
        inside = UploadChunk(0x7FFFFFFF, b"\x00" + whole + b"\x00" + encode_frame(body))
        stale = board.link.body(inside.TYPE, inside.serialize(), seq=0, session=1)
        yield "a chunk around it", encode_frame(stale).strip(b"\x00")


@case("HG-2.4/2-mutes", evidence=SELF_REPORTED)
def every_damaged_mute_is_none(board: BoardClient) -> None:
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
            judge_within_hold(board, latched_us, holds, f"a MUTE with {name}: {wrong}")
    board.disarm()

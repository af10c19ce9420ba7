"""HG-2.4, HG-4.6, HG-6.3, HG-6.7: what renews no timer: damage, other sessions, HELLO, ARM."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Final

from haptogram_protocol.framing import MAX_ENCODED_BYTES
from haptogram_protocol.messages import Feature, Message, Ping

from ...case import Depth, case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...client.playback import send_phases_that_fit
from ...client.stream_kinds import stream_kinds, valid_requests_to_send
from ...judge.timers import (
    HOLD,
    RAMP,
    TIMED,
    TimerKind,
    judge_unmoved,
    judged_mute_by_timer,
    timer_kinds,
)

_MS: Final = 1000
_LENGTH_MS: Final = 150  # of a timer, and what the frames take on the line
_RAMP_MS: Final = 80
_MOMENTS: Final = (0.4, 0.8, 1.3)  # of the length: the last one in the ramp
_STALE: Final = 0x0F0F

#: Names of frames, and the bytes of each.
Frames = dict[str, list[bytes]]


def _bodies_that_renew_no_lease(board: BoardClient) -> Iterator[tuple[Message, bytes]]:
    """Yield a message of every type of a host, and its body with a fresh number."""
    for kind in stream_kinds(board):
        message, seq = kind.make(), board.link.stream_next
        yield message, board.link.body(message.TYPE, message.serialize(), seq=seq, flags=0x10)
    for message in valid_requests_to_send(board, TIMED):
        seq = board.link.seq + 1
        yield message, board.link.body(message.TYPE, message.serialize(), seq=seq)


def _wrong_crc_renews_no_lease(board: BoardClient) -> Frames:
    return {
        f"{message.TYPE.name} with a wrong CRC": [
            malformed_frames.malformed_frame(malformed_frames.malformed_with_wrong_crc(body, flip))
            for flip in (1, 1 << 31)
        ]
        for message, body in _bodies_that_renew_no_lease(board)
    }


def _defect_renews_no_lease(board: BoardClient) -> Frames:
    ping = board.link.body(Ping.TYPE, bytes(8), seq=board.link.seq + 1)
    long = malformed_frames.malformed_noise(board.random, MAX_ENCODED_BYTES + 100)
    frames = {
        "bytes that are no COBS": [b"\x00\xff\x01\x02\x00"],
        "a short frame": [
            malformed_frames.malformed_frame(malformed_frames.malformed_with_crc(ping[:9]))
        ],
        "nothing between delimiters": [b"\x00\x00\x00\x00"],
        "a run of 4196 bytes": [b"\x00" + long + b"\x00"],
    }
    for message, body in _bodies_that_renew_no_lease(board):
        for session in (board.link.session ^ _STALE, 0):
            other = body[:8] + session.to_bytes(2, "little") + body[10:]
            data = malformed_frames.malformed_frame(malformed_frames.malformed_with_crc(other))
            name = f"{message.TYPE.name} of another session"
            frames.setdefault(name, []).append(data)
    return frames


def _lease_length_ms(board: BoardClient, frames: Frames) -> int:
    """Return the length of a timer within which the line carries *frames* three times."""
    size = sum(len(data) for some in frames.values() for data in some)
    return board.clock.timer_ms(_LENGTH_MS, 5 * size)


def _lease_late_us(
    board: BoardClient,
    timer: TimerKind,
    make: Callable[[BoardClient], Frames],
    names: Sequence[str],
) -> int:
    """Return how late the timer mutes, with the frames of these names sent three times."""
    frames = make(board)
    wires = [data for name in names for data in frames[name]]
    length_ms = _lease_length_ms(board, {name: frames[name] for name in names})
    since = board.link.mark()
    ramp_ms = _RAMP_MS if board.has(Feature.AMPLITUDE) else 0
    start_us = timer.start(board, length_ms, ramp_ms=ramp_ms)
    for moment in _MOMENTS:
        board.clock.idle_until(start_us + round(moment * length_ms * _MS))
        if wires:
            board.link.send(*wires)
    header, _ = judged_mute_by_timer(board, since, 5 * length_ms * _MS, timer.reason)
    return board.clock.unwrap(header.time_us) - start_us - (length_ms + ramp_ms) * _MS


def _judge_lease(board: BoardClient, make: Callable[[BoardClient], Frames]) -> None:
    """FAILED if hold, lease or unattended time end late because of these frames."""
    if board.has(Feature.SEQUENCE_PHASES):
        send_phases_that_fit(board, TIMED, frames=2)
    for timer in timer_kinds(board):
        frames = make(board)
        if timer is not RAMP and _lease_length_ms(board, frames) <= timer.most_ms(board):
            late_us = partial(_lease_late_us, board, timer, make)
            judge_unmoved(timer.name, late_us, list(frames))


@case("HG-2.4/2-timers", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def damaged_frames_renew_no_timer(board: BoardClient) -> None:
    """frames of every type with a wrong CRC renew no hold, lease or unattended time, nor in a
    ramp
    """
    _judge_lease(board, _wrong_crc_renews_no_lease)


@case("HG-6.7/1-others", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def frames_of_other_sessions_renew_no_timer(board: BoardClient) -> None:
    """other damage and frames of another session do not renew hold, lease or unattended time"""
    _judge_lease(board, _defect_renews_no_lease)


@case("HG-4.6/1-timers", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def a_repeated_hello_renews_no_timer(board: BoardClient) -> None:
    """HELLO with the open nonce renews no hold, lease or unattended time, nor in a ramp"""
    _judge_lease(board, _repeated_hello_renews_no_lease)


def _repeated_hello_renews_no_lease(board: BoardClient) -> Frames:
    hello = board.hello_message(board.link.session)
    wires = [board.link.request_wire(hello, session=0)[0] for _ in range(2)]
    return {"HELLO with the open nonce": wires}


@case("HG-6.3/2-hold", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def arm_while_armed_renews_no_hold(board: BoardClient) -> None:
    """ARM while ARMED, before the end of the hold and in its ramp, leaves the hold as it runs"""
    since = board.link.mark()
    ramp_ms = _RAMP_MS if board.has(Feature.AMPLITUDE) else 0
    start_us = HOLD.start(board, _LENGTH_MS, ramp_ms=ramp_ms)
    for moment in _MOMENTS:
        board.clock.idle_until(start_us + round(moment * _LENGTH_MS * _MS))
        if ramp_ms or moment < 1:
            board.arm()
    HOLD.judge(board, since, start_us, _LENGTH_MS + ramp_ms, "the hold, with ARM meanwhile")

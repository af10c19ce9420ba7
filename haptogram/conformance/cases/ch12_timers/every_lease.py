"""HG-2.4, HG-4.6, HG-6.3, HG-6.7: what renews no timer: damage, other sessions, HELLO, ARM."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

from haptogram_protocol.framing import MAX_ENCODED_BYTES
from haptogram_protocol.messages import Feature, Message, Ping
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client import malformed_frames
from ...client.board_client import BoardClient
from ...client.latching import latch_now
from ...client.playback import play_now, send_phases_that_fit
from ...client.stream_kinds import stream_kinds, valid_requests_to_send
from ...judge.timers import EXACT_US, judge_mute_time, judged_mute_by_timer
from ...outcome import check, fail

_MS: Final = 1000
_SEQUENCE: Final = 2
_LENGTH_MS: Final = 150  # of a timer, and what the frames take on the line
_RAMP_MS: Final = 80
_MOMENTS: Final = (0.4, 0.8, 1.3)  # of the length: the last one in the ramp
_STALE: Final = 0x0F0F

#: Names of frames, and the bytes of each.
Frames = dict[str, list[bytes]]


def _bodies_that_renew_no_lease(board: BoardClient) -> Iterator[tuple[Message, bytes]]:
    """Yield a message of every type of a host, and its body with a fresh number."""
    for kind in stream_kinds(board):
        message = kind.make()
        yield (
            message,
            board.link.body(
                message.TYPE, message.serialize(), seq=board.link.stream_next, flags=0x10
            ),
        )
    for message in valid_requests_to_send(board, _SEQUENCE):
        yield (
            message,
            board.link.body(message.TYPE, message.serialize(), seq=board.link.seq + 1),
        )


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


def _start_lease_for_reason(board: BoardClient, reason: MuteReason, length_ms: int) -> int:
    """Start the timer that mutes for *reason*; return the device time at which it began."""
    ramp_ms = _RAMP_MS if board.has(Feature.AMPLITUDE) else 0
    changes: dict[str, Any] = {"ramp_ms": ramp_ms}
    if reason is MuteReason.HOLD_EXPIRED:
        changes["hold_ms"] = length_ms
    elif reason is MuteReason.HOST_SILENT:
        changes["host_timeout_ms"] = length_ms
    board.arm(**changes)
    if reason is MuteReason.UNATTENDED:
        play_now(board, _SEQUENCE, loops=0, unattended_ms=length_ms)
    else:
        latch_now(board)
    start_us = board.clock.device_us()
    if reason is MuteReason.HOLD_EXPIRED:
        start_us = board.last_latch_us()
    return start_us


def _lease_length_ms(board: BoardClient, frames: Frames) -> int:
    """Return the length of a timer within which the line carries *frames* three times."""
    size = sum(len(data) for some in frames.values() for data in some)
    return board.clock.timer_ms(_LENGTH_MS, 5 * size)


def _lease_ran_out_ms(board: BoardClient, reason: MuteReason, frames: Frames) -> float:
    """Return how late the timer mutes, in ms, with *frames* sent three times meanwhile."""
    wires = [data for some in frames.values() for data in some]
    length_ms = _lease_length_ms(board, frames)
    since = board.link.mark()
    start_us = _start_lease_for_reason(board, reason, length_ms)
    for moment in _MOMENTS:
        due_us = start_us + round(moment * length_ms * _MS)
        board.wire.idle(max(0, due_us - board.clock.device_estimate_us()))
        if wires:
            board.link.send(*wires)
    header, _ = judged_mute_by_timer(board, since, 5 * length_ms * _MS, reason)
    took_us = board.clock.unwrap(header.time_us) - start_us
    return took_us / _MS - length_ms - board.config.ramp_ms


def _judge_lease(board: BoardClient, make: Callable[[BoardClient], Frames]) -> None:
    """FAILED if hold, lease or unattended time end late because of these frames."""
    reasons = [MuteReason.HOLD_EXPIRED, MuteReason.HOST_SILENT]
    if board.has(Feature.SEQUENCE_PHASES):
        send_phases_that_fit(board, _SEQUENCE, frames=2)
        if _lease_length_ms(board, make(board)) <= board.identity.max_unattended_ms:
            reasons.append(MuteReason.UNATTENDED)
    for reason in reasons:
        late_ms = _lease_ran_out_ms(board, reason, make(board))
        if abs(late_ms) * _MS <= EXACT_US:
            continue
        for name in make(board):  # which one was it?
            late_ms = _lease_ran_out_ms(board, reason, {name: make(board)[name]})
            check(
                abs(late_ms) * _MS <= EXACT_US,
                f"{name}: the mute, {reason.name}, is late by {late_ms:+.1f} ms; due is 0",
            )
        late_ms = _lease_ran_out_ms(board, reason, {})
        how = "without any frame too" if abs(late_ms) * _MS > EXACT_US else "by several together"
        fail(f"the mute, {reason.name}, is moved by {late_ms:+.1f} ms {how}; due is 0")


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
    reason = MuteReason.HOLD_EXPIRED
    start_us = _start_lease_for_reason(board, reason, _LENGTH_MS)
    for moment in _MOMENTS:
        due_us = start_us + round(moment * _LENGTH_MS * _MS)
        board.wire.idle(max(0, due_us - board.clock.device_estimate_us()))
        if board.config.ramp_ms or moment < 1:
            board.arm()
    header, _ = judged_mute_by_timer(board, since, 5 * _LENGTH_MS * _MS, reason)
    length_ms = _LENGTH_MS + board.config.ramp_ms
    judge_mute_time(board, start_us, header, length_ms, "the hold, with ARM meanwhile")

"""HG-2.1, HG-6.7: a line that pauses within a frame, or within bytes that are none.

No length of time ends a frame: only its closing delimiter does, at which it arrives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Final, TypeAlias

from haptogram_protocol.messages import Feature, Ping, Pong, UploadChunk, UploadKind
from haptogram_protocol.state import MuteReason

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.malformed_frames import (
    malformed_frame,
    malformed_noise,
    malformed_ping,
    malformed_with_crc,
)
from ...client.stream_kinds import StreamKind, stream_kinds
from ...client.uploads import begin_upload
from ...judge.timers import judge_mute_time, judge_status_period, judged_mute_by_timer
from ...outcome import SELF_REPORTED, CaseEndedError, named

_MS: Final = 1000
_PAUSES_MS: Final = (1, 100, 1_500, 10_000, 70_000)
_PAUSES_AT_WALL_MS: Final = (1, 100, 1_500)
_LONG_MS: Final = 1_500
_PLACES: Final = (
    "in the middle",
    "behind the first byte",
    "behind the second byte",
    "before the last byte",
)
_SEQUENCE: Final = 6
_CHUNK: Final = 8
_TOO_LONG: Final = 5_000
_HOLD_MS: Final = 450
_STATUS_MS: Final = 220
_LEASE_MS: Final = 300
_STEP_MS: Final = 20


#: Bytes that the line pauses in, with both delimiters: name, counter that they move by one, maker.
Paused: TypeAlias = tuple[str, str, Callable[[], bytes]]


def _paused_bytes(board: BoardClient) -> Iterator[Paused]:
    """Yield requests, stream frames of every format, and bytes that are no frame."""
    link = board.link
    yield "PING", "requests", lambda: link.request_wire(Ping(7))[0]
    if board.has(Feature.SEQUENCE_PHASES):
        chunk = UploadChunk(0, bytes(range(1, 1 + _CHUNK)))
        yield "UPLOAD_CHUNK", "requests", lambda: link.request_wire(chunk)[0]
    for kind in stream_kinds(board):
        yield kind.name, "dropped_state", partial(_paused_stream_frame, board, kind)
    yield "a wrong CRC", "crc", lambda: malformed_ping(link)
    yield "wrong stuffing", "cobs", lambda: b"\x00\xff\x01\x02\x03\x04\x05\x00"
    yield "a short frame", "short", lambda: malformed_frame(malformed_with_crc(b"too short"))
    noise = malformed_noise(board.random, _TOO_LONG)
    yield "a run that is too long", "oversize", lambda: b"\x00" + noise + b"\x00"


def _paused_stream_frame(board: BoardClient, kind: StreamKind) -> bytes:
    return board.link.stream_wire(kind.make())


@case("HG-2.1/3-pauses", evidence=SELF_REPORTED, depth=Depth.DEFAULT, wall_depth=Depth.FULL)
def pauses_end_no_frame(board: BoardClient) -> None:
    """frames of every kind and junk with a pause within, of 1 ms to 70 s: each taken, counted
    once
    """
    at_wall = not board.wire.is_virtual
    if board.has(Feature.SEQUENCE_PHASES):
        count = board.identity.transducers
        begin_upload(board, UploadKind.PHASES, _SEQUENCE, bytes(_CHUNK * count))
    for pause_ms in _pauses_ms(board):
        for paused in _paused_bytes(board):
            for place in _PLACES[:1] if at_wall and pause_ms >= _LONG_MS else _PLACES:
                _judge_pause(board, paused, place, pause_ms)


def _pauses_ms(board: BoardClient) -> tuple[int, ...]:
    """Return the pauses; without the longest if STATUS that nothing ends would flood the line."""
    if not board.wire.is_virtual:
        return _PAUSES_AT_WALL_MS
    return _PAUSES_MS[:-1] if board.config.status_period_ms else _PAUSES_MS


def _judge_pause(board: BoardClient, paused: Paused, place: str, pause_ms: int) -> None:
    """FAILED unless bytes with a pause in them, and the PING behind them, are each counted once."""
    name, counter, make = paused
    counts = {counter: 1} | {"requests": 1 + (counter == "requests")}
    text = f"with a pause of {pause_ms} ms {place}" if pause_ms else "without a pause"
    try:
        with named(f"{name} {text}"), board.counting(**counts):
            data = make()
            cut = {_PLACES[0]: len(data) // 2, _PLACES[1]: 1, _PLACES[2]: 2}.get(place, -1)
            board.link.send(data[:cut])
            board.wire.idle(pause_ms * _MS)
            board.link.send(data[cut:])
            board.wire.idle_while_sending()
            board.link.barrier()
    except CaseEndedError:
        if pause_ms:
            _judge_pause(board, paused, place, 0)  # is the pause the cause?
        raise


# --- What goes on meanwhile --------------------------------------------------------------------


@case("HG-2.1/3-meanwhile", needs=Feature.CONFIG, evidence=SELF_REPORTED, depth=Depth.DEFAULT)
def everything_goes_on_in_a_pause(board: BoardClient) -> None:
    """in a pause of 1.5 s within a PING frames are latched, STATUS comes, the hold ends, in time"""
    status_ms = max(_STATUS_MS, board.quick_status_ms)
    board.arm(hold_ms=_HOLD_MS, status_period_ms=status_ms)
    payloads = 2 * (board.flat_phases().serialize(),)
    last_us = board.clock.soon_us(*payloads, ahead_us=300 * _MS)
    times = (last_us - 200 * _MS, last_us)
    with board.counting(latched=2, timeouts=1, requests=1):
        board.link.send(*(board.link.stream_wire(board.flat_phases(), t_us) for t_us in times))
        ping, seq = board.link.request_wire(Ping(board.random.getrandbits(64)))
        since, half = board.link.mark(), len(ping) // 2
        board.link.send(ping[:half])
        now_us = board.clock.device_estimate_us()  # a PING would end the pause
        board.clock.require_before(times[0], "the frames and half a PING", now_us)
        board.wire.idle(_LONG_MS * _MS)
        header, _ = judged_mute_by_timer(board, since, 0, MuteReason.HOLD_EXPIRED)
        board.link.send(ping[half:])
        board.link.reply_in(board.link.answer_to(Ping.TYPE, seq, since), Pong, Ping.TYPE)
    on_carrier_us = board.clock.on_carrier(times[1])
    judge_mute_time(board, on_carrier_us, header, _HOLD_MS, "hold_ms in a pause within a PING")
    due = _LONG_MS // status_ms
    judge_status_period(board, since, status_ms, due - 1, f"a pause of {due} within a PING")


@case("HG-6.7/1-pauses", needs=Feature.CONFIG, depth=Depth.DEFAULT)
def bytes_of_a_frame_renew_no_lease(board: BoardClient) -> None:
    """a frame renews the lease when it is complete, not with its first bytes; half a frame never"""
    board.configure(host_timeout_ms=_LEASE_MS)
    for name, late_ms in (("bytes that make no frame yet", None), ("a PING in two parts", 200)):
        since = board.link.mark()
        board.arm()
        start_us = board.clock.device_us()
        ping, seq = board.link.request_wire(Ping(board.random.getrandbits(64)))
        if late_ms is None:
            for byte in ping[:-1]:  # as far as they last until the lease is over
                board.link.send(bytes([byte]))
                board.wire.idle(_STEP_MS * _MS)
        else:
            board.link.send(ping[:-5])
            board.wire.idle(late_ms * _MS)
            board.link.send(ping[-5:])
            answer = board.link.answer_to(Ping.TYPE, seq, since)
            pong = board.link.reply_in(answer, Pong, Ping.TYPE)
            start_us = board.clock.unwrap(pong.t_rx_us)
        header, _ = judged_mute_by_timer(board, since, 2 * _LEASE_MS * _MS, MuteReason.HOST_SILENT)
        judge_mute_time(board, start_us, header, _LEASE_MS, f"the lease, and {name}")
        if late_ms is None:
            board.link.send(ping[-1:])
            board.link.answer_to(Ping.TYPE, seq, since)

"""HG-3.1, HG-3.3, HG-3.4, HG-3.5, HG-3.7, HG-3.9: the header: types, flags, session; counts."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.annotation.words import annotated_type_name
from haptogram_protocol.messages import (
    RESPONSE_OFFSET,
    ErrorCode,
    Feature,
    Flag,
    Hello,
    Message,
    MessageType,
    Mute,
    Phases,
    Ping,
    Play,
    Pong,
    TraceMode,
)
from haptogram_protocol.state import OutputState

from ...case import Depth, case, case_about_host
from ...client.board_client import BoardClient
from ...client.capabilities import requests_that_board_takes
from ...client.dialogue import full_client_dialogue
from ...client.latching import latch_now
from ...client.malformed_frames import malformed_by_counter, malformed_noise
from ...client.playback import send_phases_to_store_if_supported
from ...client.stream_kinds import valid_requests_to_send
from ...judge.line_rules import judge_line_rule
from ...outcome import SELF_REPORTED, check, check_fields
from ..ch05_stream.every_drop import judge_first_drop
from .every_frame_type import judge_foreign_types, judge_unknown_flags, judge_unknown_requests

_SEQUENCE: Final = 5
_JUNK_BYTES: Final = 1 << 20
_JUNK_S: Final = 20
_JUNK_PIECES: Final = 50  # between two PINGs
_NOISE: Final = 500
_STALE: Final = 0x0F0F


@case("HG-3.1/1")
def frames_begin_with_header(board: BoardClient) -> None:
    """every frame of a full dialogue begins with a header of ten bytes"""
    judge_line_rule(full_client_dialogue(board), "HG-3.1/1")


# --- Types -------------------------------------------------------------------------------------


@case("HG-3.3/1")
def replies_have_their_type(board: BoardClient) -> None:
    """each request is answered by its type + 0x40, or by ERROR"""
    kinds: list[type[Message]] = [*requests_that_board_takes(board), Mute]
    for kind in kinds:
        payload = bytes(kind.LAYOUT.size)
        if kind is Hello:
            payload = board.hello_message(board.link.session).serialize()
        got = board.link.ask_raw(kind.TYPE, payload).frame_header.type
        is_right = got in (kind.TYPE + RESPONSE_OFFSET, MessageType.ERROR)
        check(is_right, f"{kind.TYPE.name} is answered by {annotated_type_name(got)}")


@case("HG-3.3/2", evidence=SELF_REPORTED)
def drops_unknown_header_types(board: BoardClient) -> None:
    """stream, response and event frames of unknown types are counted in unknown_type, unanswered"""
    kinds = (0x00, 0x04, 0x3F, 0x80, 0xBE, 0xBF, 0xC0, 0xFF)
    judge_foreign_types(board, kinds, board.link.session)


@case("HG-3.3/3")
def refuses_unknown_header_types(board: BoardClient) -> None:
    """unknown requests are refused with UNSUPPORTED and their type, and counted"""
    judge_unknown_requests(board, (0x50, 0x7E, 0x7F), board.link.session)


not_host_response = case_about_host("HG-3.3/4")


@case("HG-3.4/1")
def refuses_unknown_header_flags(board: BoardClient) -> None:
    """each must-understand flag that is unknown refuses a request, by its bit"""
    judge_unknown_flags(board, (Ping(0),), (0x20, 0x40, 0x80, 0xE0, 0x21))


@case("HG-3.4/1-stream", evidence=SELF_REPORTED)
def drops_unknown_header_flags(board: BoardClient) -> None:
    """each must-understand flag that is unknown drops a stream frame"""
    judge_first_drop(board, "HG-3.4/1")


@case("HG-3.4/2")
def ignores_low_flags(board: BoardClient) -> None:
    """PING with each bit of the low nibble is answered; a stream frame is latched"""
    for flag in (1, 2, 4, 8, 15):
        board.link.call(Ping(flag), Pong, flags=flag)
    board.arm()
    with board.counting(latched=1):
        board.link.stream(board.flat_phases(), flags=Flag.IMMEDIATE | 0x0F)
        board.clock.wait_latched()


@case("HG-3.4/3")
def sends_no_header_flags(board: BoardClient) -> None:
    """no frame of a full dialogue has a flag but LATE, and only traces have LATE"""
    judge_line_rule(full_client_dialogue(board), "HG-3.4/3")


@case("HG-3.4/3-late", needs=Feature.CONFIG)
def every_late_flag(board: BoardClient) -> None:
    """behind a late latch no frame but its trace has LATE: no reply, no refusal, no STATUS"""
    send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    trace = TraceMode.CRC if board.has(Feature.TRACE) else TraceMode.OFF
    period_ms = board.quick_status_ms
    since = board.link.mark()
    board.hello()
    board.arm(trace_mode=trace, late_window_us=100_000, status_period_ms=period_ms)
    board.link.stream(board.flat_phases(), board.late_time_us(5000))
    board.clock.wait_latched()
    board.wire.idle_beyond(1200 * period_ms)
    for message in [*valid_requests_to_send(board, _SEQUENCE), Mute()]:
        board.link.ask_at_once(message)
    judge_line_rule(board.wire.received[since:], "HG-3.4/3")


@case("HG-3.5/1")
def immediate_is_of_play(board: BoardClient) -> None:
    """IMMEDIATE on any request but PLAY is refused with UNSUPPORTED, detail 0x10"""
    flag = Flag.IMMEDIATE
    for kind in requests_that_board_takes(board):
        if kind is not Play:
            payload = bytes(kind.LAYOUT.size)
            board.link.refused_raw(kind.TYPE, payload, ErrorCode.UNSUPPORTED, flag, flags=flag)
    board.arm()
    with board.counting(latched=1):
        latch_now(board)


@case("HG-3.5/2", evidence=SELF_REPORTED)
def immediate_ignores_time(board: BoardClient) -> None:
    """with IMMEDIATE a frame is latched at once, whatever time it carries"""
    board.arm()
    now_us = board.clock.device_us()
    for time_us in (0, 1, now_us - 1_000_000, now_us + 5_000_000, now_us + 2**31, 0xFFFFFFFF):
        with board.counting(latched=1):
            board.link.stream(board.flat_phases(), time_us & 0xFFFFFFFF, flags=Flag.IMMEDIATE)
            board.clock.wait_latched()


@case("HG-3.7/1")
def header_carries_the_session(board: BoardClient) -> None:
    """every frame of a full dialogue carries its session; ERROR may carry 0"""
    judge_line_rule(full_client_dialogue(board), "HG-3.7/1")


@case("HG-3.7/2", evidence=SELF_REPORTED)
def drops_stale_headers(board: BoardClient) -> None:
    """a stream frame of another session is counted in stale_session and uses up no number"""
    old = board.link.session
    board.hello()
    board.arm()
    sessions = (old, board.link.session ^ 0x0100, board.link.session ^ 0x0001, 0)
    with board.counting(stale_session=len(sessions), latched=1):
        for session in sessions:
            board.link.stream(board.flat_phases(), seq=board.link.stream_next, session=session)
        latch_now(board)


not_host_session = case_about_host("HG-3.7/3")


@case("HG-3.9/3", evidence=SELF_REPORTED)
def junk_headers_are_survived(board: BoardClient) -> None:
    """junk of every kind neither restarts the board nor moves a counter back nor disarms it"""
    boot_id, before = board.identity.boot_id, board.status().counters
    board.arm()
    asked_us = board.wire.now_us()
    for _ in range(40):
        size = board.random.randrange(1, 600)
        board.link.send(b"\x00", board.random.randbytes(size), b"\x00")
        board.wire.idle_while_sending()
        if board.wire.now_us() - asked_us > 250 * board.config.host_timeout_ms:
            asked_us = board.wire.now_us()
            board.link.call(Ping(size), Pong)  # junk restarts no lease
    board.check_status("junk", state=OutputState.ARMED)
    board.check_counters_kept(before, "junk")
    check_fields(board.hello(), "junk restarts the board: HELLO_REPLY", boot_id=boot_id)


@case("HG-3.9/4", depth=Depth.DEFAULT)
def junk_leaks_no_memory(board: BoardClient) -> None:
    """1 MiB of junk, or 20 s of it: PINGs are answered, and free_bytes is as before"""
    before = board.status()
    left = min(_JUNK_BYTES, board.wire.baudrate // 10 * _JUNK_S)
    while left > 0:
        junk = [_counted_junk_headers(board) for _ in range(_JUNK_PIECES)]
        board.link.send(*junk)
        board.link.call(Ping(left), Pong)
        left -= sum(map(len, junk))
    board.check_status("junk leaks", free_bytes=before.free_bytes)


def _counted_junk_headers(board: BoardClient) -> bytes:
    """Return junk of every kind: a short frame, no COBS, a wrong CRC, a run without an end."""
    damaged, noise = malformed_by_counter(board.link), malformed_noise(board.random, _NOISE)
    return b"".join((damaged["short"], damaged["cobs"], damaged["crc"], noise, b"\x00"))


@case("HG-3.9/1", evidence=SELF_REPORTED)
def header_defects_count_once(board: BoardClient) -> None:
    """of one frame with each defect every counter grows by 1, and frames by their number"""
    link, good, used = board.link, board.flat_phases(), board.link.stream_next
    wires = {
        "dropped_state": link.stream_wire(good),
        "duplicate": link.stream_wire(good, seq=used),
        "stale_session": link.stream_wire(good, seq=used, session=link.session ^ _STALE),
        "unsupported": link.stream_wire(good, flags=0x40),
        "bad_length": link.stream_raw(Phases.TYPE, good.serialize() + b"\x00"),
        **malformed_by_counter(link),
    }
    with board.counting(frames=6, requests=0, **dict.fromkeys(wires, 1)):
        link.send(*wires.values())
        board.wire.idle_while_sending()


@case("HG-3.9/2", evidence=SELF_REPORTED)
def header_counts_add_up(board: BoardClient) -> None:
    """frames = accepted + requests + repeated + every drop, over 60 frames of all sorts"""
    board.arm()
    good, each = board.flat_phases(), 15
    parts = dict.fromkeys(("accepted", "duplicate", "requests", "unsupported"), each)
    with board.counting(frames=4 * each, latched=None, flushed=None, **parts):
        for number in range(each):
            board.link.stream(good)
            board.link.stream(good, seq=board.link.stream_next - 1)
            board.link.call(Ping(number), Pong)
            board.link.stream(good, flags=Flag.IMMEDIATE | 0x40)

"""HG-3.1, HG-3.2, HG-3.3, HG-3.4, HG-3.5, HG-3.7, HG-3.9:
the header: types, flags, session; fields and their values; counts.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from haptogram_protocol import messages as m
from haptogram_protocol.annotation.frames import annotated_frame_text, annotated_type_name
from haptogram_protocol.rules import UPLOADS
from haptogram_protocol.state import OutputState

from ...case import Depth, case, case_about_host
from ...client import latching, playback, uploads
from ...client.board_client import BoardClient
from ...client.capabilities import drive_kinds, requests_that_board_takes
from ...client.dialogue import full_client_dialogue
from ...client.malformed_frames import ValueByte, malformed_by_counter, malformed_noise, value_bytes
from ...client.stream_kinds import valid_requests_to_send
from ...judge.line_rules import judge_line_rule
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, require
from ..ch05_stream.every_drop import judge_first_drop
from .every_frame_type import judge_foreign_types, judge_unknown_flags, judge_unknown_requests

_SEQUENCE: Final = 5
_JUNK_BYTES: Final = 1 << 20
_JUNK_S: Final = 20
_JUNK_PIECES: Final = 50  # between two PINGs
_NOISE: Final = 500
_STALE: Final = 0x0F0F
_UPLOADED: Final = 9
_ADDRESSES: Final = 8  # at which a frame may begin, modulo the widest field


@case("HG-3.1/1")
def frames_begin_with_header(board: BoardClient) -> None:
    """every frame of a full dialogue begins with a header of ten bytes"""
    judge_line_rule(full_client_dialogue(board), "HG-3.1/1")


# --- Types -------------------------------------------------------------------------------------


@case("HG-3.3/1")
def replies_have_their_type(board: BoardClient) -> None:
    """each request is answered by its type + 0x40, or by ERROR"""
    kinds: list[type[m.Message]] = [*requests_that_board_takes(board), m.Mute]
    for kind in kinds:
        payload = bytes(kind.LAYOUT.size)
        if kind is m.Hello:
            payload = board.hello_message(board.link.session).serialize()
        got = board.link.ask_raw(kind.TYPE, payload).frame_header.type
        is_right = got in (kind.TYPE + m.RESPONSE_OFFSET, m.MessageType.ERROR)
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
    judge_unknown_flags(board, (m.Ping(0),), (0x20, 0x40, 0x80, 0xE0, 0x21))


@case("HG-3.4/1-stream", evidence=SELF_REPORTED)
def drops_unknown_header_flags(board: BoardClient) -> None:
    """each must-understand flag that is unknown drops a stream frame"""
    judge_first_drop(board, "HG-3.4/1")


@case("HG-3.4/2")
def ignores_low_flags(board: BoardClient) -> None:
    """PING with each bit of the low nibble is answered; a stream frame is latched"""
    for flag in (1, 2, 4, 8, 15):
        board.link.ping(flag, flags=flag)
    board.arm()
    with board.counting(latched=1):
        board.link.stream(board.flat_phases(), flags=m.Flag.IMMEDIATE | 0x0F)
        board.clock.wait_latched()


@case("HG-3.4/3")
def sends_no_header_flags(board: BoardClient) -> None:
    """no frame of a full dialogue has a flag but LATE, and only traces have LATE"""
    judge_line_rule(full_client_dialogue(board), "HG-3.4/3")


@case("HG-3.4/3-late", needs=m.Feature.CONFIG)
def every_late_flag(board: BoardClient) -> None:
    """behind a late latch no frame but its trace has LATE: no reply, no refusal, no STATUS"""
    playback.send_phases_to_store_if_supported(board, _SEQUENCE, frames=2)
    trace = m.TraceMode.CRC if board.has(m.Feature.TRACE) else m.TraceMode.OFF
    period_ms = board.quick_status_ms
    since = board.link.mark()
    board.hello()
    board.arm(trace_mode=trace, late_window_us=100_000, status_period_ms=period_ms)
    board.link.stream(board.flat_phases(), board.late_time_us(5000))
    board.clock.wait_latched()
    board.wire.idle_beyond(1200 * period_ms)
    for message in [*valid_requests_to_send(board, _SEQUENCE), m.Mute()]:
        board.link.ask_at_once(message)
    judge_line_rule(board.wire.received[since:], "HG-3.4/3")


@case("HG-3.5/1")
def immediate_is_of_play(board: BoardClient) -> None:
    """IMMEDIATE on any request but PLAY is refused with UNSUPPORTED, detail 0x10"""
    flag = m.Flag.IMMEDIATE
    for kind in requests_that_board_takes(board):
        if kind is not m.Play:
            payload = bytes(kind.LAYOUT.size)
            board.link.refused_raw(kind.TYPE, payload, m.ErrorCode.UNSUPPORTED, flag, flags=flag)
    board.arm()
    with board.counting(latched=1):
        latching.latch_now(board)


@case("HG-3.5/2", evidence=SELF_REPORTED)
def immediate_ignores_time(board: BoardClient) -> None:
    """with IMMEDIATE a frame is latched at once, whatever time it carries"""
    board.arm()
    now_us = board.clock.device_us()
    for time_us in (0, 1, now_us - 1_000_000, now_us + 5_000_000, now_us + 2**31, 0xFFFFFFFF):
        with board.counting(latched=1):
            board.link.stream(board.flat_phases(), time_us & 0xFFFFFFFF, flags=m.Flag.IMMEDIATE)
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
        latching.latch_now(board)


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
            board.link.ping(size)  # junk restarts no lease
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
        board.link.ping(left)
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
        "bad_length": link.stream_raw(m.Phases.TYPE, good.serialize() + b"\x00"),
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
            board.link.ping(number)
            board.link.stream(good, flags=m.Flag.IMMEDIATE | 0x40)


@case("HG-3.2/1")
def values_are_little_endian(board: BoardClient) -> None:
    """numbers of 16, 32 and 64 bits, signed ones too, have their lowest byte first"""
    nonce = 0x1FE2 if board.link.session != 0x1FE2 else 0x1FE3
    check_fields(board.hello(nonce), "HELLO_REPLY", nonce=nonce, clock_hz=1_000_000)
    echo = 0x0123456789ABCDEF
    pong = board.link.ping(echo)
    check_fields(pong, "PONG", echo=echo)
    apart_us = m.signed_difference(pong.t_tx_us, pong.t_rx_us, 32)
    check(0 <= apart_us < 1_000_000, f"t_rx {pong.t_rx_us:#x} and t_tx {pong.t_tx_us:#x} disagree")
    board.link.refused(m.Ping(0), m.ErrorCode.STALE_SESSION, nonce, session=nonce ^ 0x0101)
    _check_counted_values(board)
    _check_geometry_values(board)


def _check_counted_values(board: BoardClient) -> None:
    """FAILED unless the counter *frames* in STATUS grows by 1 from one request to the next."""
    first, second = board.status().counters.frames, board.status().counters.frames
    check((second - first) & 0xFFFFFFFF == 1, f"frames: {first:#x}, one request later {second:#x}")


def _check_geometry_values(board: BoardClient) -> None:
    """FAILED unless each coordinate in GET_GEOMETRY is within 5 m, each normal 1 long (2 %)."""
    reply = board.link.call(m.GetGeometry(0, 0xFFFF), m.GeometryReply)
    far = [e for e in reply.elements if max(abs(e.x_um), abs(e.y_um), abs(e.z_um)) > 5_000_000]
    check(not far, f"a transducer 5 m away: {far[:1]}")
    bent = [e for e in reply.elements if abs(math.hypot(e.nx, e.ny, e.nz) / 32767 - 1) >= 0.02]
    check(not bent, f"a normal that is not of length 1 (32767): {bent[:1]}")
    if board.identity.transducers > 2:
        some = board.link.call(m.GetGeometry(1, 2), m.GeometryReply)
        check_equal((some.first, len(some.elements)), (1, 2), "GET_GEOMETRY of 2 from 1")


@case("HG-3.2/1-pitch")
def pitch_is_little_endian(board: BoardClient) -> None:
    """pitch_um in HELLO_REPLY is not the pitch of the geometry with its bytes reversed"""
    identity = board.identity
    require(identity.grid_nx * identity.grid_ny >= 2, "the array is no grid, or of one transducer")
    first, second = board.read_geometry()[:2]
    apart_um = round(math.hypot(second.x_um - first.x_um, second.y_um - first.y_um))
    turned_um = int.from_bytes(identity.pitch_um.to_bytes(4, "little"), "big")
    text = f"pitch_um is {identity.pitch_um:#010x}, the geometry's is {apart_um:#010x}: big-endian"
    check(identity.pitch_um == apart_um or abs(turned_um - apart_um) > 1, text)


@case("HG-3.2/1-config", needs=m.Feature.CONFIG)
def takes_little_endian_values(board: BoardClient) -> None:
    """a configuration of six different numbers comes back as it was sent"""
    sent = board.configure(
        hold_ms=0x0102, ramp_ms=0x0304, host_timeout_ms=0x0506, status_period_ms=0x0708
    )
    check_equal(board.read_config(), sent, "the configuration in force is not the one sent")


@case("HG-3.2/2")
def text_value_is_filled(board: BoardClient) -> None:
    """the firmware's name is UTF-8 and filled with zeros to 16 bytes"""
    answer = board.link.ask(board.hello_message(board.link.session))
    raw = answer.body[-16:]
    name = raw.rstrip(b"\x00")
    check(b"\x00" not in name, f"{raw!r} has something behind its first zero")
    try:
        name.decode()
    except UnicodeDecodeError as error:
        check(False, f"{raw!r} is no UTF-8: {error}")


@case("HG-3.2/3")
def payloads_have_their_length(board: BoardClient) -> None:
    """every payload of a full dialogue has the length of its type"""
    wrong = [piece for piece in full_client_dialogue(board) if piece.reason == "bad_length"]
    check(not wrong, f"{annotated_frame_text(wrong[0].piece) if wrong else ''}")


@case("HG-3.2/4")
def refuses_wrong_lengths(board: BoardClient) -> None:
    """requests a byte too long or too short are refused; the detail is the right length"""
    kinds = requests_that_board_takes(board)
    _check_wrong_lengths(board, [(kind, right) for kind in kinds for right in _near_lengths(kind)])


def _near_lengths(kind: type[m.Message]) -> set[int]:
    """Return the payload lengths, not negative, one byte below and one above that of *kind*."""
    return {kind.LAYOUT.size - 1, kind.LAYOUT.size + 1} - {-1}


@case("HG-3.2/4-requests", depth=Depth.DEFAULT)
def every_wrong_length(board: BoardClient) -> None:
    """requests of every type and 11 wrong lengths: the detail is the right one, 0 where it
    varies
    """
    wrong: list[tuple[type[m.Message], int]] = []
    for kind in requests_that_board_takes(board):
        right = kind.LAYOUT.size  # some others have its low byte
        sizes = {0, 1, 2 * right, right + 4, *(right + (1 << bits) for bits in range(7, 12))}
        wrong += [(kind, size) for size in sorted(sizes | _near_lengths(kind)) if size != right]
    if board.identity.features & UPLOADS:
        wrong += [(m.UploadChunk, size) for size in range(m.UploadChunk.LAYOUT.size)]
    _check_wrong_lengths(board, wrong)


def _check_wrong_lengths(board: BoardClient, wrong: Sequence[tuple[type[m.Message], int]]) -> None:
    """FAILED unless each request in *wrong* (type, payload bytes) is refused for its length.

    The ERROR has to name the right length, 0 if that varies.
    """
    with board.counting(requests=len(wrong)):
        for kind, size in wrong:
            right = 0 if kind.TAIL else kind.LAYOUT.size
            board.link.refused_raw(kind.TYPE, bytes(size), m.ErrorCode.BAD_LENGTH, right)


@case("HG-3.2/4-stream", evidence=SELF_REPORTED)
def drops_wrong_lengths(board: BoardClient) -> None:
    """stream frames a byte too long or too short are counted in bad_length and not answered"""
    judge_first_drop(board, "HG-3.2/4")


@case("HG-3.2/5")
def refuses_unlisted_values(board: BoardClient) -> None:
    """values that no table has are refused with BAD_VALUE and the field's offset"""
    hello = bytes([m.VERSION_MAJOR, *bytes(7)])
    with board.counting(requests=1):
        board.link.refused_raw(m.Hello.TYPE, hello, m.ErrorCode.BAD_VALUE, 2)
    _judge_unlisted(board, lambda _: (0x77,))


@case("HG-3.2/6")
def reads_unaligned_values(board: BoardClient) -> None:
    """requests, chunks and stream frames that begin at each of 8 addresses are taken"""
    board.arm()
    with board.counting(latched=_ADDRESSES):
        for zeros in range(_ADDRESSES):  # the frame before it ends at another address each time
            echo = 0x0102030405060708 + zeros
            board.link.send(b"\x00" * zeros)
            check_fields(board.link.ping(echo), f"behind {zeros} zeros", echo=echo)
            check_equal(board.read_config(), board.config, f"GET_CONFIG behind {zeros} zeros")
            latching.latch_now(board)


# --- Values of no table ------------------------------------------------------------------------


def _requests_with_values(board: BoardClient) -> Iterator[m.Message]:
    """Yield valid READ_DRIVE, SET_CONFIG and UPLOAD_BEGIN requests that the board supports."""
    yield from (m.ReadDrive(kind, 0, 1) for kind in drive_kinds(board))
    if board.has(m.Feature.CONFIG):
        yield m.SetConfig(board.config)
    if board.identity.features & UPLOADS:
        yield from _uploads_with_values(board)


def _uploads_with_values(board: BoardClient) -> list[m.UploadBegin]:
    """Return an UPLOAD_BEGIN of one frame for each form of upload that the board takes."""
    return [form.request(form.frame_bytes) for form in uploads.upload_forms(board, _UPLOADED)]


@case("HG-3.2/5-bytes", evidence=SELF_REPORTED)
def every_unlisted_value(board: BoardClient) -> None:
    """each value that the table of a request's byte does not name: BAD_VALUE, and the byte's
    offset
    """
    _judge_unlisted(board, lambda byte: byte.wrong_values(thorough=board.thorough))


def _judge_unlisted(board: BoardClient, wrong_values: Callable[[ValueByte], Sequence[int]]) -> None:
    """FAILED unless requests with a wrong value in one byte are refused, naming its offset.

    *wrong_values* returns the wrong values of a byte.
    """
    for message in _requests_with_values(board):
        for byte in value_bytes(type(message)):
            values = wrong_values(byte)
            with board.counting(requests=len(values)):
                for value in values:
                    payload = byte.put(message.serialize(), value)
                    board.link.refused_raw(
                        message.TYPE, payload, m.ErrorCode.BAD_VALUE, byte.offset
                    )


@case("HG-3.2/5-points")
def every_points_per_frame(board: BoardClient) -> None:
    """points_per_frame other than 0 without points, 0 with them, above max_points: BAD_VALUE"""
    offset, unit = m.UploadBegin.WIRE["points_per_frame"].offset, m.FocalPoint.LAYOUT.size
    for begin in _uploads_with_values(board):
        has_points = begin.kind is m.UploadKind.POINTS
        allowed = range(1, board.identity.max_points + 1) if has_points else (0,)
        byte = ValueByte("points_per_frame", offset, allowed)
        for number in byte.wrong_values(thorough=board.thorough):
            size = max(1, number) * unit if has_points else begin.size  # whole frames
            if size <= board.identity.max_upload_bytes:
                wrong = dataclasses.replace(begin, points_per_frame=number, size=size)
                board.link.refused(wrong, m.ErrorCode.BAD_VALUE, offset)

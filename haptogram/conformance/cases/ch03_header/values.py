"""HG-3.2: byte order, text, lengths and values of fields; every value that no table allows."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final

from haptogram_protocol.annotation.frames import annotated_frame_text
from haptogram_protocol.messages import (
    VERSION_MAJOR,
    ErrorCode,
    Feature,
    FocalPoint,
    GeometryReply,
    GetGeometry,
    Hello,
    Message,
    Ping,
    Pong,
    ReadDrive,
    SetConfig,
    UploadBegin,
    UploadChunk,
    UploadKind,
    signed_difference,
)
from haptogram_protocol.rules import UPLOADS

from ...case import Depth, case
from ...client.board_client import BoardClient
from ...client.capabilities import drive_kinds, requests_that_board_takes
from ...client.dialogue import full_client_dialogue
from ...client.latching import latch_now
from ...client.malformed_frames import ValueByte, value_bytes
from ...client.uploads import upload_forms
from ...outcome import SELF_REPORTED, check, check_equal, check_fields, require
from ..ch05_stream.every_drop import judge_first_drop

_TARGET: Final = 9
_ADDRESSES: Final = 8  # at which a frame may begin, modulo the widest field


@case("HG-3.2/1")
def values_are_little_endian(board: BoardClient) -> None:
    """numbers of 16, 32 and 64 bits, signed ones too, have their lowest byte first"""
    nonce = 0x1FE2 if board.link.session != 0x1FE2 else 0x1FE3
    check_fields(board.hello(nonce), "HELLO_REPLY", nonce=nonce, clock_hz=1_000_000)
    echo = 0x0123456789ABCDEF
    pong = board.link.call(Ping(echo), Pong)
    check_fields(pong, "PONG", echo=echo)
    apart_us = signed_difference(pong.t_tx_us, pong.t_rx_us, 32)
    check(0 <= apart_us < 1_000_000, f"t_rx {pong.t_rx_us:#x} and t_tx {pong.t_tx_us:#x} disagree")
    board.link.refused(Ping(0), ErrorCode.STALE_SESSION, nonce, session=nonce ^ 0x0101)
    _check_counted_values(board)
    _check_geometry_values(board)


def _check_counted_values(board: BoardClient) -> None:
    first, second = board.status().counters.frames, board.status().counters.frames
    check((second - first) & 0xFFFFFFFF == 1, f"frames: {first:#x}, one request later {second:#x}")


def _check_geometry_values(board: BoardClient) -> None:
    reply = board.link.call(GetGeometry(0, 0xFFFF), GeometryReply)
    far = [e for e in reply.elements if max(abs(e.x_um), abs(e.y_um), abs(e.z_um)) > 5_000_000]
    check(not far, f"a transducer 5 m away: {far[:1]}")
    bent = [e for e in reply.elements if abs(math.hypot(e.nx, e.ny, e.nz) / 32767 - 1) >= 0.02]
    check(not bent, f"a normal that is not of length 1 (32767): {bent[:1]}")
    if board.identity.transducers > 2:
        some = board.link.call(GetGeometry(1, 2), GeometryReply)
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


@case("HG-3.2/1-config", needs=Feature.CONFIG)
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


def _near_lengths(kind: type[Message]) -> set[int]:
    return {kind.LAYOUT.size - 1, kind.LAYOUT.size + 1} - {-1}


@case("HG-3.2/4-requests", depth=Depth.DEFAULT)
def every_wrong_length(board: BoardClient) -> None:
    """requests of every type and 11 wrong lengths: the detail is the right one, 0 where it
    varies
    """
    wrong: list[tuple[type[Message], int]] = []
    for kind in requests_that_board_takes(board):
        right = kind.LAYOUT.size  # some others have its low byte
        sizes = {0, 1, 2 * right, right + 4, *(right + (1 << bits) for bits in range(7, 12))}
        wrong += [(kind, size) for size in sorted(sizes | _near_lengths(kind)) if size != right]
    if board.identity.features & UPLOADS:
        wrong += [(UploadChunk, size) for size in range(UploadChunk.LAYOUT.size)]
    _check_wrong_lengths(board, wrong)


def _check_wrong_lengths(board: BoardClient, wrong: Sequence[tuple[type[Message], int]]) -> None:
    """FAILED unless requests of these types and lengths are refused with the right length."""
    with board.counting(requests=len(wrong)):
        for kind, size in wrong:
            right = 0 if kind.TAIL else kind.LAYOUT.size
            board.link.refused_raw(kind.TYPE, bytes(size), ErrorCode.BAD_LENGTH, right)


@case("HG-3.2/4-stream", evidence=SELF_REPORTED)
def drops_wrong_lengths(board: BoardClient) -> None:
    """stream frames a byte too long or too short are counted in bad_length and not answered"""
    judge_first_drop(board, "HG-3.2/4")


@case("HG-3.2/5")
def refuses_unlisted_values(board: BoardClient) -> None:
    """values that no table has are refused with BAD_VALUE and the field's offset"""
    hello = bytes([VERSION_MAJOR, *bytes(7)])
    with board.counting(requests=1):
        board.link.refused_raw(Hello.TYPE, hello, ErrorCode.BAD_VALUE, 2)
    _judge_unlisted(board, lambda _: (0x77,))


@case("HG-3.2/6")
def reads_unaligned_values(board: BoardClient) -> None:
    """requests, chunks and stream frames that begin at each of 8 addresses are taken"""
    board.arm()
    with board.counting(latched=_ADDRESSES):
        for zeros in range(_ADDRESSES):  # the frame before it ends at another address each time
            echo = 0x0102030405060708 + zeros
            board.link.send(b"\x00" * zeros)
            check_fields(board.link.call(Ping(echo), Pong), f"behind {zeros} zeros", echo=echo)
            check_equal(board.read_config(), board.config, f"GET_CONFIG behind {zeros} zeros")
            latch_now(board)


# --- Values of no table ------------------------------------------------------------------------


def _requests_with_values(board: BoardClient) -> Iterator[Message]:
    """Yield a request that the board takes of every type, and kind, with such a byte."""
    yield from (ReadDrive(kind, 0, 1) for kind in drive_kinds(board))
    if board.has(Feature.CONFIG):
        yield SetConfig(board.config)
    if board.identity.features & UPLOADS:
        yield from _uploads_with_values(board)


def _uploads_with_values(board: BoardClient) -> list[UploadBegin]:
    return [form.request(form.frame_bytes) for form in upload_forms(board, _TARGET)]


@case("HG-3.2/5-bytes", evidence=SELF_REPORTED)
def every_unlisted_value(board: BoardClient) -> None:
    """each value that the table of a request's byte does not name: BAD_VALUE, and the byte's
    offset
    """
    _judge_unlisted(board, lambda byte: byte.wrong_values(thorough=board.thorough))


def _judge_unlisted(board: BoardClient, wrong_values: Callable[[ValueByte], Sequence[int]]) -> None:
    """FAILED unless a request with a wrong value in one of its bytes is refused, by its offset."""
    for message in _requests_with_values(board):
        for byte in value_bytes(type(message)):
            values = wrong_values(byte)
            with board.counting(requests=len(values)):
                for value in values:
                    payload = byte.put(message.serialize(), value)
                    board.link.refused_raw(message.TYPE, payload, ErrorCode.BAD_VALUE, byte.offset)


@case("HG-3.2/5-points")
def every_points_per_frame(board: BoardClient) -> None:
    """points_per_frame other than 0 without points, 0 with them, above max_points: BAD_VALUE"""
    offset, unit = UploadBegin.WIRE["points_per_frame"].offset, FocalPoint.LAYOUT.size
    for begin in _uploads_with_values(board):
        has_points = begin.kind is UploadKind.POINTS
        allowed = range(1, board.identity.max_points + 1) if has_points else (0,)
        byte = ValueByte("points_per_frame", offset, allowed)
        for number in byte.wrong_values(thorough=board.thorough):
            size = max(1, number) * unit if has_points else begin.size  # whole frames
            if size <= board.identity.max_upload_bytes:
                wrong = dataclasses.replace(begin, points_per_frame=number, size=size)
                board.link.refused(wrong, ErrorCode.BAD_VALUE, offset)

"""HG-3.2: byte order, text, lengths and values of fields."""

from __future__ import annotations

import math
from typing import Final

from haptogram_protocol.annotation.frames import annotated_frame_text
from haptogram_protocol.messages import (
    VERSION_MAJOR,
    ConfigReply,
    Drives,
    ErrorCode,
    Feature,
    GeometryReply,
    GetConfig,
    GetGeometry,
    Hello,
    Phases,
    Ping,
    Points,
    Pong,
    ReadDrive,
    SetConfig,
    UploadBegin,
    signed_difference,
)
from haptogram_protocol.rules import UPLOADS

from ...case import case
from ...client.board_client import BoardClient
from ...client.capabilities import requests_that_board_takes, session_for_request
from ...client.dialogue import full_client_dialogue
from ...client.latching import latch_now
from ...outcome import SELF_REPORTED, check, check_equal, require

_ADDRESSES: Final = 8  # at which a frame may begin, modulo the widest field


@case("HG-3.2/1")
def values_are_little_endian(board: BoardClient) -> None:
    """numbers of 16, 32 and 64 bits, signed ones too, have their lowest byte first"""
    nonce = 0x1FE2 if board.link.session != 0x1FE2 else 0x1FE3
    reply = board.hello(nonce)
    check(reply.nonce == nonce, f"HELLO_REPLY has the nonce {reply.nonce:#06x}, not {nonce:#06x}")
    check(reply.clock_hz == 1_000_000, f"clock_hz is {reply.clock_hz:#x}, not 1000000 = 0xf4240")
    echo = 0x0123456789ABCDEF
    pong = board.link.call(Ping(echo), Pong)
    check(pong.echo == echo, f"PONG has {pong.echo:016x}, sent was {echo:016x}")
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
    bent = [
        e for e in reply.elements if not 0.98 < _length_of_values(e.nx, e.ny, e.nz) / 32767 < 1.02
    ]
    check(not bent, f"a normal that is not of length 1 (32767): {bent[:1]}")
    if board.identity.transducers > 2:
        some = board.link.call(GetGeometry(1, 2), GeometryReply)
        got = (some.first, len(some.elements))
        check_equal(got, (1, 2), f"GET_GEOMETRY of 2 from 1: {got[1]} from {got[0]}")


def _length_of_values(*parts: int) -> float:
    return math.hypot(*parts)


@case("HG-3.2/1-pitch")
def pitch_value_is_little_endian(board: BoardClient) -> None:
    """pitch_um in HELLO_REPLY is not the pitch of the geometry with its bytes reversed"""
    identity = board.identity
    require(identity.grid_nx * identity.grid_ny >= 2, "the array is no grid, or of one transducer")
    first, second = board.read_geometry()[:2]
    apart_um = round(math.hypot(second.x_um - first.x_um, second.y_um - first.y_um))
    turned_um = int.from_bytes(identity.pitch_um.to_bytes(4, "little"), "big")
    check(
        identity.pitch_um == apart_um or abs(turned_um - apart_um) > 1,
        f"pitch_um is {identity.pitch_um:#010x}, the geometry's is {apart_um:#010x}: big-endian",
    )


@case("HG-3.2/1-config", needs=Feature.CONFIG)
def takes_little_endian_values(board: BoardClient) -> None:
    """a configuration of six different numbers comes back as it was sent"""
    sent = board.configure(
        hold_ms=0x0102, ramp_ms=0x0304, host_timeout_ms=0x0506, status_period_ms=0x0708
    )
    got = board.link.call(GetConfig(), ConfigReply).config
    check_equal(got, sent, "the configuration in force is not the one that was sent")


@case("HG-3.2/2")
def text_value_is_filled(board: BoardClient) -> None:
    """the firmware's name is UTF-8 and filled with zeros to 16 bytes"""
    answer = board.link.ask(board.hello_message(board.link.session), session=0)
    raw = answer.body[-16:]
    name = raw.rstrip(b"\x00")
    check(b"\x00" not in name, f"{raw!r} has something behind its first zero")
    try:
        name.decode()
    except UnicodeDecodeError as error:
        check(False, f"{raw!r} is no UTF-8: {error}")


@case("HG-3.2/3")
def payload_types_have_their_length(board: BoardClient) -> None:
    """every payload of a full dialogue has the length of its type"""
    wrong = [piece for piece in full_client_dialogue(board) if piece.reason == "bad_length"]
    check(not wrong, f"{annotated_frame_text(wrong[0].piece) if wrong else ''}")


@case("HG-3.2/4")
def refuses_a_wrong_length_of_type(board: BoardClient) -> None:
    """requests a byte too long or too short are refused; the detail is the right length"""
    kinds = requests_that_board_takes(board)
    wrong = [
        (kind, size) for kind in kinds for size in _wrong_lengths_of_payload_type(kind.LAYOUT.size)
    ]
    with board.counting(requests=len(wrong)):
        for kind, size in wrong:
            right = kind.LAYOUT.size
            session = session_for_request(board, kind)
            board.link.refused_raw(
                kind.TYPE, bytes(size), ErrorCode.BAD_LENGTH, right, session=session
            )


def _wrong_lengths_of_payload_type(right: int) -> tuple[int, ...]:
    return (right + 1,) if right == 0 else (right - 1, right + 1)


@case("HG-3.2/4-stream", evidence=SELF_REPORTED)
def drops_a_wrong_length_of_type(board: BoardClient) -> None:
    """stream frames a byte too long or too short are counted in bad_length and not answered"""
    right = board.flat_phases()
    payloads = [right.serialize() + b"\x00", right.serialize()[:-1], b""]
    bodies = [(Phases.TYPE, payload) for payload in payloads]
    if board.has(Feature.AMPLITUDE):
        bodies += [(Drives.TYPE, bytes(2 * board.identity.transducers - 2))]
    if board.has(Feature.POINTS):
        bodies += [(Points.TYPE, b""), (Points.TYPE, bytes(15)), (Points.TYPE, bytes(17))]
    with board.counting(bad_length=len(bodies)):
        board.link.unanswered(
            "a stream frame of a wrong length",
            *(board.link.stream_raw(kind, payload) for kind, payload in bodies),
        )


@case("HG-3.2/5")
def refuses_values_of_no_table(board: BoardClient) -> None:
    """values that no table has are refused with BAD_VALUE and the field's offset"""
    wrong: list[tuple[int, bytes, int]] = [(Hello.TYPE, bytes([VERSION_MAJOR, *bytes(7)]), 2)]
    if board.has(Feature.READ_LATCHED):
        wrong.append((ReadDrive.TYPE, b"\x07\x00\x00\x01\x00", 0))
    if board.identity.features & UPLOADS:
        wrong.append((UploadBegin.TYPE, b"\x09" + bytes(11), 0))
    if board.has(Feature.CONFIG):
        payload = bytearray(board.config.pack())
        payload[16] = 0x77
        wrong.append((SetConfig.TYPE, bytes(payload), 16))
    with board.counting(requests=len(wrong)):
        for kind, value, offset in wrong:
            session = 0 if kind == Hello.TYPE else board.link.session
            board.link.refused_raw(kind, value, ErrorCode.BAD_VALUE, offset, session=session)


@case("HG-3.2/6")
def reads_values_at_any_address(board: BoardClient) -> None:
    """requests, chunks and stream frames that begin at each of 8 addresses are taken"""
    board.arm()
    with board.counting(latched=_ADDRESSES):
        for zeros in range(_ADDRESSES):  # the frame before it ends at another address each time
            echo = 0x0102030405060708 + zeros
            board.link.send(b"\x00" * zeros)
            check_equal(board.link.call(Ping(echo), Pong).echo, echo, f"PING behind {zeros} zeros")
            shown = board.link.call(GetConfig(), ConfigReply).config
            check_equal(shown, board.config, f"GET_CONFIG behind {zeros} zeros")
            latch_now(board)

"""AUTD3: byte tables typed from the sources of autd3 38 (not captured), refusals and replies."""

import dataclasses
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram_protocol.dialects.autd3.frame import (
    DEVICE_FRAME_BYTES,
    Autd3DeviceFrame,
    Autd3DeviceState,
)
from haptogram_protocol.dialects.autd3.link import MAX_UNANSWERED, Autd3BoardEnd, Autd3HostEnd
from haptogram_protocol.dialects.autd3.messages import (
    Accepted,
    Autd3Refused,
    Autd3States,
    Close,
    Hello,
    Open,
    Pose,
    Read,
    Undecodable,
    Update,
    Write,
)
from haptogram_protocol.dialects.autd3.operations import (
    Clear,
    ErrorCode,
    FirmwareInfo,
    FociStart,
    FociSTM,
    Gain,
    Modulation,
    ModulationStart,
    Nop,
    Silencer,
    SwapSegment,
    Sync,
    Tag,
    Truncated,
    Unsupported,
    autd3_refusal,
)
from haptogram_protocol.errors import LocalProtocolError
from strategies_dialects import device_states
from strategies_protocol import chunkings

HELLO = bytes.fromhex("10 0100") + b"AUTD3REMOTE"
AT_ORIGIN = Pose((0, 0, 0), (1, 0, 0, 0))
POSE = struct.pack("<7f", 0, 0, 0, 1, 0, 0, 0)
ONE = b"\x01" + bytes.fromhex("01000000") + POSE
DRIVES = bytes(range(249)) + bytes(range(249))
FOCUS = bytes.fromhex("0123456789abcdef")

# payload (zeros behind it), operation
OPERATIONS: list[tuple[str, Any]] = [
    ("00", Nop()),
    ("01 00", Clear()),
    ("02 00", Sync()),
    ("03 06", FirmwareInfo(6)),
    ("21 04 0a00 2800", Silencer(False, True, 10, 40)),
    ("21 01 3412 7856", Silencer(True, False, 0x1234, 0x5678)),
    ("30 01 01 00" + DRIVES.hex(), Gain(1, True, DRIVES)),
    ("31 01", SwapSegment(Tag.GAIN_SWAP, 1)),
    (
        "10 0f 03 ff 0a00 ffff 0807060504030201 aabbcc",
        Modulation(
            1, b"\xaa\xbb\xcc", ModulationStart(0xFF, 10, 0xFFFF, 0x0102030405060708), True, True
        ),
    ),
    ("10 02 0201" + "55" * 258, Modulation(0, b"\x55" * 258, None, True, False)),
    (
        "11 01 01 0000000000 0807060504030201",
        SwapSegment(Tag.MODULATION_SWAP, 1, 1, 0x0102030405060708),
    ),
    (
        "42 07 01 01 fe 02 0055 0a00 0100 00000000 0000000000000000" + FOCUS.hex() * 2,
        FociSTM(1, 1, FOCUS * 2, FociStart(0xFE, 2, 0x5500, 10, 1, 0), True, True),
    ),
    ("44 00 f0 0000000000 0000000000000000", SwapSegment(Tag.FOCI_STM_SWAP, 0, 0xF0)),
    *((f"{tag:02x}", Unsupported(tag)) for tag in (0x41, 0x43, 0x60, 0x61, 0x72, 0x90, 0xF0, 0xFF)),
]


def device_frame(payload: bytes, message_id: int = 1, second: int = 0) -> bytes:
    return struct.pack("<BxH", message_id, second) + payload.ljust(622, b"\0")


def opened(devices: int = 1) -> Autd3BoardEnd:
    board = Autd3BoardEnd()
    geometry = b"\x01" + struct.pack("<I", devices) + POSE * devices
    assert board.receive_data(HELLO + geometry) == [Hello(), Open((AT_ORIGIN,) * devices)]
    return board


def frames_of(board: Autd3BoardEnd, *frames: bytes) -> tuple[Autd3DeviceFrame, ...]:
    (operation,) = board.receive_data(b"\x03" + b"".join(frames))
    assert isinstance(operation, Write)
    return operation.frames


def test_the_session_of_a_client_is_these_bytes() -> None:
    clear = device_frame(b"\x01\x00")
    line = HELLO + ONE + b"\x03" + clear + b"\x04" + b"\x02" + ONE[1:] + b"\x05"
    operations = [
        Hello(1),
        Open((AT_ORIGIN,)),
        Write((Autd3DeviceFrame(1, (Clear(),)),)),
        Read(),
        Update((AT_ORIGIN,)),
        Close(),
    ]
    assert Autd3BoardEnd().receive_data(line) == operations
    host = Autd3HostEnd()
    assert b"".join(map(host.send, operations)) == line
    replies = bytes.fromhex("00 00 00 00a1 35 00 00".replace("00a1 35", "00 a135"))
    assert host.receive_data(replies) == [
        *[Accepted()] * 3,
        Autd3States((Autd3DeviceState(5, 3, 0xA1),)),
        *[Accepted()] * 2,
    ]


@pytest.mark.parametrize(("payload", "operation"), OPERATIONS)
def test_a_payload_is_this_operation_and_back(payload: str, operation: Any) -> None:
    frame = device_frame(bytes.fromhex(payload))
    assert frames_of(opened(), frame) == (Autd3DeviceFrame(1, (operation,)),)
    assert Autd3DeviceFrame(1, (operation,)).pack() == frame


def test_what_lies_behind_an_operation_is_left_over() -> None:
    frame = device_frame(bytes.fromhex("01 00") + b"\xaa" * 620)
    assert frames_of(opened(), frame) == (Autd3DeviceFrame(1, (Clear(),)),)


def test_a_frame_holds_two_operations_and_devices_have_their_own() -> None:
    silencer = bytes.fromhex("21 04 0a00 2800")
    gain = bytes.fromhex("30 00 01 00") + DRIVES
    frames = (device_frame(silencer + gain, 7, len(silencer)), device_frame(b"\x01\x00", 7))
    found = frames_of(opened(2), *frames)
    both = (Silencer(False, True, 10, 40), Gain(0, True, DRIVES))
    assert found == (Autd3DeviceFrame(7, both), Autd3DeviceFrame(7, (Clear(),)))
    assert tuple(frame.pack() for frame in found) == frames


def test_later_foci_have_as_many_of_a_pattern_as_the_start_said() -> None:
    board = opened()
    start = bytes.fromhex("42 01 01 00 ff 02 0055 0a00 ffff 00000000 0000000000000000")
    frames_of(board, device_frame(start + FOCUS * 2, 1))
    ignored = start[:5] + b"\x07" + start[6:]
    repeated = frames_of(board, device_frame(ignored + FOCUS * 7, 1))
    assert repeated == (Autd3DeviceFrame(1, (), repeated=True),)
    part = device_frame(bytes.fromhex("42 06 03 00") + FOCUS * 6, 2)
    (frame,) = frames_of(board, part)
    assert frame.operations == (FociSTM(0, 3, FOCUS * 6, None, True, True),)
    assert board.counters == {"frames_repeated": 1}


@pytest.mark.parametrize(
    ("frame", "operations", "counters"),
    [
        (device_frame(b"\x01", 16), (), {"message_ids_out_of_range": 1}),
        (device_frame(b"\x01", 1, 622), (Clear(), Truncated(-1)), {"operations_truncated": 1}),
        (device_frame(b"\x01", 1, 0xFFFF), (Clear(), Truncated(-1)), {"operations_truncated": 1}),
        (
            device_frame(b"\x01" + bytes(130) + b"\x30", 1, 131),
            (Clear(), Truncated(Tag.GAIN)),
            {"operations_truncated": 1},
        ),
        (
            device_frame(b"\x10\x00\xff\xff"),
            (Truncated(Tag.MODULATION),),
            {"operations_truncated": 1},
        ),
        (
            device_frame(bytes.fromhex("42 01 ff 00 ff 08")),
            (Truncated(Tag.FOCI_STM),),
            {"operations_truncated": 1},
        ),
        (
            device_frame(bytes(621) + b"\x03", 1, 621),
            (Nop(), Truncated(3)),
            {"operations_truncated": 1},
        ),
        (device_frame(b"\x60"), (Unsupported(0x60),), {"operations_unsupported": 1}),
    ],
)
def test_a_frame_that_no_device_understands_is_counted(
    frame: bytes, operations: tuple[Any, ...], counters: dict[str, int]
) -> None:
    board = opened()
    assert frames_of(board, frame)[0].operations == operations
    assert board.counters == counters


def test_every_unsupported_operation_has_its_error_code() -> None:
    assert autd3_refusal(Unsupported(0x41)) is ErrorCode.NOT_SUPPORTED_TAG
    assert autd3_refusal(Truncated(0x30)) is ErrorCode.NOT_SUPPORTED_TAG
    assert [autd3_refusal(FirmwareInfo(kind)) for kind in (0, 1, 6, 7)] == [3, 0, 0, 3]
    assert autd3_refusal(Clear()) is ErrorCode.NONE


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"PRI * HTTP/2.0", "the client speaks gRPC over HTTP/2, as autd3 36 and older; served"),
        (b"ARMT\x03", "the client speaks autd3-sdk; served is the link of autd3 38"),
        (b"PRX", "message 50h before the handshake; served is the link of autd3 38"),
        (b"ARMX", "message 41h before the handshake"),
        (ONE, "message 01h before the handshake"),
        (
            bytes.fromhex("10 0200") + b"AUTD3REMOTE",
            "version 2 of the link; served is 1, of autd3 38",
        ),
        (bytes.fromhex("10 0100") + b"AUTD3REMOTF", "does not say AUTD3REMOTE"),
        (HELLO + HELLO, "unknown message 10h"),
        (HELLO + b"\x06", "unknown message 06h"),
        (HELLO + b"\x03", "message 03h before the devices are opened"),
        (HELLO + b"\x02", "message 02h before the devices are opened"),
        (HELLO + ONE + ONE, "the devices are open already"),
        (HELLO + b"\x01" + bytes(4), "0 devices; served are 1 to 64"),
        (HELLO + b"\x01\xff\xff\xff\xff", "4294967295 devices; served are 1 to 64"),
    ],
)
@pytest.mark.parametrize("chunk", [1, 1000])
def test_a_link_that_cannot_go_on_says_why_once(line: bytes, reason: str, chunk: int) -> None:
    board = Autd3BoardEnd()
    chunks = [line[at : at + chunk] for at in range(0, len(line), chunk)]
    found = [operation for part in [*chunks, b"more"] for operation in board.receive_data(part)]
    assert isinstance(found[-1], Undecodable)
    assert reason in found[-1].reason
    assert sum(isinstance(operation, Undecodable) for operation in found) == 1
    assert board.counters["links_undecodable"] == 1
    assert board.counters["bytes_after_end"] >= len(b"more")
    assert not board.pending


def test_bytes_behind_the_close_are_counted() -> None:
    board = opened()
    assert board.receive_data(b"\x05\x04\x04") == [Close()]
    assert board.counters == {"bytes_after_end": 2}


@given(
    asked=st.lists(st.lists(device_states, min_size=2, max_size=2).map(tuple), max_size=6),
    refused=st.sets(st.integers(0, 7)),
    reason=st.text(max_size=40),
    data=st.data(),
)
def test_replies_come_back_from_their_bytes(
    asked: list[Any], refused: set[int], reason: str, data: st.DataObject
) -> None:
    host, board = Autd3HostEnd(), Autd3BoardEnd()
    text = reason.encode("utf-8", "replace").decode()
    host.send(Hello())
    host.send(Open((AT_ORIGIN, AT_ORIGIN)))
    for _ in asked:
        host.send(Read())
    replies: list[Any] = [Accepted(), Accepted(), *map(Autd3States, asked)]
    replies = [Autd3Refused(text) if at in refused else reply for at, reply in enumerate(replies)]
    line = b"".join(map(board.send, replies))
    chunks = data.draw(chunkings(line))
    assert [reply for chunk in chunks for reply in host.receive_data(chunk)] == replies
    assert not host.counters
    assert not host.pending


def test_an_acknowledgement_holds_the_error_above_the_id() -> None:
    assert Autd3DeviceState(0x05, ErrorCode.INVALID_INFO_TYPE, 0xA5).pack() == bytes.fromhex(
        "a5 35"
    )
    assert Autd3DeviceState(0x10, ErrorCode.INVALID_MESSAGE_ID).pack() == bytes.fromhex("00 20")


def test_replies_that_nobody_asked_for_are_counted() -> None:
    host = Autd3HostEnd()
    assert host.receive_data(b"\x00\x00") == []
    host.send(Hello())
    assert host.receive_data(b"\x07\x00") == [Accepted()]
    assert host.counters == {"bytes_unexpected": 3}


def test_the_text_of_a_refusal_is_bounded() -> None:
    host = Autd3HostEnd()
    host.send(Hello())
    (reply,) = host.receive_data(b"\xff" + struct.pack("<I", 2**32 - 1))
    assert isinstance(reply, Autd3Refused)
    assert "4294967295 bytes" in reply.reason
    assert not host.counters
    assert host.receive_data(b"a text that is too long") == []
    assert host.counters == {"bytes_unexpected": 23}  # each byte of it once
    assert len(Autd3BoardEnd().send(Autd3Refused("x" * 10_000))) == 5 + 4096


def test_answers_that_are_due_are_bounded() -> None:
    host = Autd3HostEnd()
    for _ in range(MAX_UNANSWERED):
        host.send(Hello())
    with pytest.raises(LocalProtocolError, match="64 answers are due"):
        host.send(Hello())


GAIN = Gain(0, True, DRIVES)


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (Autd3DeviceFrame(16, (Clear(),)), "message id 16; it is 0 to 15"),
        (Autd3DeviceFrame(1, ()), "0 operations in a frame"),
        (Autd3DeviceFrame(1, (GAIN, GAIN)), "operations of 1004 bytes; 622 fit"),
        (
            Autd3DeviceFrame(1, (dataclasses.replace(GAIN, drives=b""),)),
            "0 bytes of drives, not 498",
        ),
        (Autd3DeviceFrame(1, (Silencer(False, False, -1, 0),)), "Silencer"),
        (Autd3DeviceFrame(1, (Truncated(3),)), "no device of autd3 takes Truncated"),
    ],
)
def test_frames_that_no_device_takes_are_refused(frame: Autd3DeviceFrame, message: str) -> None:
    with pytest.raises(LocalProtocolError, match=message):
        frame.pack()


def test_a_write_has_a_frame_for_each_open_device() -> None:
    host = Autd3HostEnd()
    host.send(Open((AT_ORIGIN,)))
    with pytest.raises(LocalProtocolError, match="0 frames for 1 open devices"):
        host.send(Write(()))
    with pytest.raises(LocalProtocolError, match="65 devices; 1 to 64 are served"):
        host.send(Open((AT_ORIGIN,) * 65))


def test_a_frame_has_626_bytes() -> None:
    assert DEVICE_FRAME_BYTES == len(device_frame(b"")) == 626

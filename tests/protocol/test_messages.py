"""Every message, in both directions: from its declaration, from typed bytes, from any bytes."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram_protocol.annotation.frames import annotated_fields_of, annotated_message_text
from haptogram_protocol.errors import LocalProtocolError, RemoteProtocolError
from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import (
    MESSAGES,
    REQUEST_RANGE,
    RESPONSE_OFFSET,
    ArmReply,
    Config,
    ConfigReply,
    Drives,
    Error,
    Feature,
    Flag,
    FocalPoint,
    Header,
    Hello,
    HelloReply,
    Message,
    MessageType,
    Mute,
    Phases,
    Points,
    SetConfig,
    Trace,
    TraceMode,
    TraceReply,
    build_body,
    drive_codes,
    parse_body,
    signed_difference,
    unwrap,
)
from haptogram_protocol.record import Record, record, repeated, wire
from haptogram_protocol.state import OutputState
from strategies_protocol import headers, messages, records
from wire_oracles import frame_bytewise

# Typed from the byte tables of SPEC.md; the CRC and the stuffing are those of the slow oracle.
# name: message, header fields, body, line
GOLDEN: dict[str, tuple[Message, dict[str, int], str, str]] = {
    "hello": (
        Hello(major=2, minor=0, nonce=0x5EED),
        {"flags": 0, "seq": 0, "time_us": 0, "session": 0},
        "40 00 0000 00000000 0000 | 02 00 ed5e 00000000",
        "00 024001010101010101 01 02 02 03 ed5e 01010105 a6c14ab2 00",
    ),
    "mute without a session": (
        Mute(),
        {"flags": 0, "seq": 7, "time_us": 0, "session": 0},
        "42 00 0700 00000000 0000 |",
        "00 0242 0207 01 01 01 01 01 01 03f2b6 0273 00",
    ),
    "three phases, at once": (
        Phases(bytes.fromhex("8130fc")),
        {"flags": 0x10, "seq": 0xFFF1, "time_us": 0, "session": 0x5EED},
        "01 10 f1ff 00000000 ed5e | 8130fc",
        "00 050110f1ff 01 01 01 0aed5e8130fc cf9fdc07 00",
    ),
    "error": (
        Error(request=MessageType.ARM, code=4, detail=3),
        {"flags": 0, "seq": 4, "time_us": 700, "session": 0x5EED},
        "bf 00 0400 bc020000 ed5e | 41 04 03000000",
        "00 02bf 0204 03bc02 01 06ed5e410403 01 01 057ad49eb7 00",
    ),
    "a late latch": (
        Trace(index=65520, crc=0xDEADBEEF),
        {"flags": 0x01, "seq": 0, "time_us": 15, "session": 0x5EED},
        "c1 01 0000 0f000000 ed5e | f0ff0000 efbeadde",
        "00 03c101 01 020f 01 01 05ed5ef0ff 01 09efbeaddea46d5263 00",
    ),
}
PAYLOADS: dict[str, tuple[Message, str]] = {
    "a focal point": (
        Points((FocalPoint(x_um=-10_000, y_um=0, z_um=150_000, amplitude=65535, phase=16384),)),
        "f0d8ffff 00000000 f0490200 ffff 0040",
    ),
    "configuration": (
        SetConfig(Config(trace_mode=TraceMode.RING)),
        "c800 3200 f401 6400 00000000 b33f0500 03 ff 0100",
    ),
    "drives": (Drives(bytes([10, 20, 255, 128])), "0a14 ff80"),
    "arm reply": (ArmReply(OutputState.ARMED), "01"),
}


def _hex(text: str) -> bytes:
    return bytes.fromhex(text.replace("|", ""))


@pytest.mark.parametrize("name", GOLDEN)
def test_golden_frames_in_both_directions(name: str) -> None:
    message, fields, body, line = GOLDEN[name]
    assert frame_bytewise(_hex(body)) == _hex(line)
    assert build_body(message, **fields) == _hex(body)
    assert encode_frame(_hex(body)) == _hex(line)
    for chunks in ([_hex(line)], [bytes([byte]) for byte in _hex(line)], [_hex(line) + b"\3\0"]):
        decoder = FrameDecoder()
        found = [item for chunk in chunks for item in decoder.feed(chunk)]
        assert parse_body(found[0]) == (Header(type=message.TYPE, **fields), message)


@pytest.mark.parametrize("name", PAYLOADS)
def test_golden_payloads_in_both_directions(name: str) -> None:
    message, payload = PAYLOADS[name]
    assert message.serialize() == _hex(payload)
    assert type(message).deserialize(_hex(payload)) == message


def test_every_type_has_its_message_and_every_request_its_response() -> None:
    assert set(MESSAGES) == set(MessageType)
    requests = [number for number in MESSAGES if number in REQUEST_RANGE]
    assert all(number + RESPONSE_OFFSET in MESSAGES for number in requests)


def test_the_sizes_that_firmware_is_built_on() -> None:
    assert Header.LAYOUT.size == 10
    assert HelloReply.LAYOUT.size == 110
    assert (
        len(
            encode_frame(
                build_body(
                    Phases(b"\1" * 256),
                    flags=0,
                    seq=257,
                    time_us=0x01010101,
                    session=0x0101,
                )
            )
        )
        == 274
    )  # 913 µs at 3 Mbaud


@given(messages, headers)
def test_every_message_comes_back(message: Message, fields: dict[str, int]) -> None:
    body = build_body(message, **fields)
    header, parsed = parse_body(body)
    assert parsed == message
    assert dataclasses.asdict(header) == {"type": message.TYPE, **fields}
    assert parsed.serialize() == body[10:]


def _deserialize(kind: type[Message], payload: bytes) -> Message | RemoteProtocolError:
    try:
        return kind.deserialize(payload)
    except RemoteProtocolError as error:
        return error


@given(st.sampled_from(list(MESSAGES.values())), st.binary(max_size=200))
def test_any_payload_is_a_message_or_the_one_error(kind: type[Message], payload: bytes) -> None:
    message = _deserialize(kind, payload)
    if isinstance(message, RemoteProtocolError):
        assert message.reason in {"bad_length", "bad_value"}
        assert 0 <= message.offset <= len(payload)
    else:
        assert message.serialize() == payload


@given(messages, st.data())
def test_a_wrong_length_is_bad_length(message: Message, data: st.DataObject) -> None:
    kind, payload = type(message), message.serialize()
    unit = kind.TAIL.unit if kind.TAIL else 2**16
    wrong = data.draw(st.integers(0, len(payload) + 3).filter(lambda n: n != len(payload)))
    if (
        kind.TAIL
        and wrong >= kind.LAYOUT.size
        and (wrong - kind.LAYOUT.size) % unit == 0
        and (wrong - kind.LAYOUT.size >= unit * kind.TAIL.least)
    ):
        return  # a shorter or longer tail is a message as good
    with pytest.raises(RemoteProtocolError) as caught:
        kind.deserialize((payload + bytes(3))[:wrong])
    assert caught.value.reason == "bad_length"


ENUMERATED = [
    (kind, name)
    for kind in MESSAGES.values()
    for name, field in kind.WIRE.items()
    if field.enumeration is not None
]


@pytest.mark.parametrize(("kind", "name"), ENUMERATED)
def test_a_value_that_is_none_of_the_allowed_is_bad_value_at_its_offset(
    kind: type[Message], name: str
) -> None:
    offset = kind.WIRE[name].offset
    payload = bytearray(kind.LAYOUT.size)
    for field in kind.WIRE.values():
        if field.enumeration is not None:
            payload[field.offset] = min(field.enumeration)
    payload[offset] = 0xEE
    with pytest.raises(RemoteProtocolError, match=name) as caught:
        kind.deserialize(bytes(payload))
    assert (caught.value.reason, caught.value.offset) == ("bad_value", offset)


def test_the_offset_of_a_value_in_a_nested_record_is_that_in_the_payload() -> None:
    payload = bytearray(SetConfig(Config()).serialize())
    payload[16] = 9  # trace_mode
    with pytest.raises(RemoteProtocolError) as caught:
        SetConfig.deserialize(bytes(payload))
    assert caught.value.offset == 16 == Config.WIRE["trace_mode"].offset
    with pytest.raises(RemoteProtocolError) as caught:
        ConfigReply.deserialize(bytes(4) + payload)
    assert caught.value.offset == 20


@record
class _Inner(Record):
    state: OutputState = wire("B", "output state", enum=OutputState)


@record
class _Outer(Record):
    number: int = wire("H", "any")
    states: tuple[_Inner, ...] = repeated(_Inner, "states")


def test_the_offset_of_a_value_in_a_tail_is_that_in_the_payload() -> None:
    assert _Outer.unpack(b"\1\0\0\3").states == (
        _Inner(OutputState.DISARMED),
        _Inner(OutputState.FAULT),
    )
    with pytest.raises(RemoteProtocolError) as caught:
        _Outer.unpack(b"\1\0\0\3\4\1")
    assert caught.value.offset == 4


@given(records(HelloReply))
def test_text_is_padded_with_zeros(reply: HelloReply) -> None:
    text = reply.firmware.encode()
    assert reply.serialize()[-16:] == text + bytes(16 - len(text))


@pytest.mark.parametrize("firmware", ["x" * 17, "é" * 9, "ends with zero\0"])
@given(reply=records(HelloReply))
def test_text_that_would_not_come_back_is_refused(firmware: str, reply: HelloReply) -> None:
    with pytest.raises(LocalProtocolError, match="firmware"):
        dataclasses.replace(reply, firmware=firmware).serialize()


def test_text_that_is_no_utf8_is_shown_and_written_as_it_came() -> None:
    payload = bytes(HelloReply.LAYOUT.size - 16) + b"a\xff\xfeb" + b"\xc3" * 12
    reply = HelloReply.deserialize(payload)
    assert reply.serialize() == payload
    assert reply.firmware == "a\udcff\udcfeb" + "\udcc3" * 12
    assert annotated_message_text(reply).endswith("firmware a\ufffd\ufffdb" + "\ufffd" * 12)
    assert annotated_fields_of(reply)["firmware"] == "a\ufffd\ufffdb" + "\ufffd" * 12


@pytest.mark.parametrize(
    "message",
    [
        Hello(256, 0, 1, 0),
        Points(()),
        Points((FocalPoint(2**31, 0, 0, 0, 0),)),
        Drives(b"abc"),
        Trace(-1, 0),
    ],
)
def test_a_value_that_does_not_fit_is_the_callers_fault(message: Message) -> None:
    with pytest.raises(LocalProtocolError):
        message.serialize()


def test_an_unknown_type_is_named() -> None:
    with pytest.raises(RemoteProtocolError, match="0x7f") as caught:
        parse_body(b"\x7f" + bytes(9))
    assert caught.value.reason == "unknown_type"


def test_a_trace_reply_may_hold_no_record() -> None:
    assert TraceReply.deserialize(bytes(8)) == TraceReply(0, 0, ())


@pytest.mark.parametrize("message", [Phases(bytes(3)), Drives(bytes(6)), Phases(b"")])
def test_a_wrong_number_of_codes_is_bad_length(message: Message) -> None:
    with pytest.raises(RemoteProtocolError) as caught:
        drive_codes(message, 4)
    assert caught.value.reason == "bad_length"


# --- numbers that wrap (HG-3.6) ----------------------------------------------------------------


@given(st.integers(0, 2**40), st.integers(-(2**15), 2**15 - 1))
def test_signed_difference_sees_over_the_wrap(base: int, ahead: int) -> None:
    assert signed_difference((base + ahead) & 0xFFFF, base & 0xFFFF, 16) == ahead


@given(st.integers(0, 2**48), st.integers(-(2**31), 2**31 - 1))
def test_unwrap_finds_the_nearest(near: int, ahead: int) -> None:
    assert unwrap((near + ahead) & 0xFFFFFFFF, near, 32) == near + ahead


def test_flags_and_capabilities_are_distinct_bits() -> None:
    for kind in (Flag, Feature):
        bits = [int(member) for member in kind]
        assert len({*bits}) == len(bits)
        assert all(bit & (bit - 1) == 0 for bit in bits)

"""CRC-32 and the frame decoder against slow oracles and damage of every kind."""

import gc
import random
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram_protocol.errors import LocalProtocolError, RemoteProtocolError
from haptogram_protocol.framing import (
    HEADER_BYTES,
    MAX_BODY_BYTES,
    MAX_ENCODED_BYTES,
    FrameDecoder,
    decode_frame,
    encode_frame,
)
from strategies_protocol import chunkings, noise
from wire_oracles import crc32_bitwise, frame_bytewise

bodies = st.binary(min_size=HEADER_BYTES, max_size=600)


def _outcomes(found: list[bytes | RemoteProtocolError]) -> list[bytes | str]:
    return [item if isinstance(item, bytes) else item.reason for item in found]


def _feed_all(chunks: list[bytes]) -> list[bytes | str]:
    decoder = FrameDecoder()
    return [item for chunk in chunks for item in _outcomes(decoder.feed(chunk))]


def test_crc_of_the_check_string_is_the_published_one() -> None:
    assert crc32_bitwise(b"123456789") == 0xCBF43926  # HG-2.4/1


@given(st.binary(max_size=300))
def test_crc_agrees_with_the_oracle(data: bytes) -> None:
    assert zlib.crc32(data) == crc32_bitwise(data)


@given(bodies)
def test_a_frame_is_what_the_oracle_makes_of_it_and_comes_back(body: bytes) -> None:
    wire = encode_frame(body)
    assert wire == frame_bytewise(body)
    assert decode_frame(wire[1:-1]) == body
    assert _feed_all([wire]) == [body]


def test_the_longest_body_fits_and_one_byte_more_does_not() -> None:
    body = bytes([1]) * MAX_BODY_BYTES
    wire = encode_frame(body)
    assert len(wire) - 2 <= MAX_ENCODED_BYTES
    assert _feed_all([wire]) == [body]
    with pytest.raises(LocalProtocolError, match=f"{MAX_BODY_BYTES + 1} bytes.*{MAX_BODY_BYTES}"):
        encode_frame(body + b"\1")


@given(bodies, st.data())
def test_one_flipped_bit_never_gives_the_body(body: bytes, data: st.DataObject) -> None:
    encoded = bytearray(encode_frame(body)[1:-1])
    bit = data.draw(st.integers(0, 8 * len(encoded) - 1))
    encoded[bit // 8] ^= 1 << bit % 8
    outcomes = _feed_all([b"\0" + bytes(encoded) + b"\0"])
    assert outcomes  # what is left over is an error, never a frame and never nothing
    assert set(outcomes) <= {"crc", "cobs", "short"}


@given(st.binary(max_size=HEADER_BYTES - 1))
def test_a_frame_without_a_whole_header_is_short(body: bytes) -> None:
    assert _feed_all([encode_frame(body)]) == ["short"]


def test_a_shared_delimiter_is_enough_and_empty_frames_are_nothing() -> None:
    one, two = encode_frame(b"0123456789"), encode_frame(b"9876543210")
    assert _feed_all([one[:-1] + two]) == [b"0123456789", b"9876543210"]  # HG-2.1/2
    assert _feed_all([b"\0\0\0" + one + b"\0\0"]) == [b"0123456789"]  # HG-2.3/1


@given(noise.flatmap(lambda data: st.tuples(st.just(data), chunkings(data))))
def test_any_bytes_in_any_chunks_give_the_same_outcomes(case: tuple[bytes, list[bytes]]) -> None:
    data, chunks = case
    assert _feed_all(chunks) == _feed_all([data])
    assert _feed_all([bytes([byte]) for byte in data]) == _feed_all([data])


@given(st.lists(st.tuples(noise, bodies), max_size=6), noise)
def test_garbage_between_frames_costs_no_frame(
    parts: list[tuple[bytes, bytes]], trailing: bytes
) -> None:
    wire = b"".join(garbage + encode_frame(body) for garbage, body in parts) + trailing
    got = iter(_feed_all([wire]))
    assert all(body in got for _, body in parts)  # in order; HG-2.1/3


@given(bodies, bodies, noise, st.data())
def test_garbage_inside_a_frame_costs_that_frame_only(
    damaged: bytes, whole: bytes, garbage: bytes, data: st.DataObject
) -> None:
    wire = encode_frame(damaged)
    at = data.draw(st.integers(1, len(wire) - 1))
    assert whole in _feed_all([wire[:at] + garbage + wire[at:] + encode_frame(whole)])


def test_the_limit_is_exact() -> None:
    fits, over = b"\1" * MAX_ENCODED_BYTES, b"\1" * (MAX_ENCODED_BYTES + 1)
    assert _feed_all([b"\0" + fits + b"\0"]) == ["crc"]
    assert _feed_all([b"\0" + over + b"\0"]) == ["oversize"]
    assert _feed_all([b"\0" + fits, b"\1", b"\0"]) == ["oversize"]


def test_a_run_without_end_is_counted_once_and_costs_only_itself() -> None:
    decoder = FrameDecoder()
    outcomes = [out for _ in range(50) for out in _outcomes(decoder.feed(b"\7" * 1000))]
    assert outcomes == ["oversize"]  # HG-2.6/3
    assert decoder.buffered == 0
    assert _outcomes(decoder.feed(encode_frame(b"0123456789"))) == [b"0123456789"]


def test_reset_forgets_a_partial_frame_and_a_discarded_run() -> None:
    decoder = FrameDecoder()
    decoder.feed(b"\0\5abc")
    assert decoder.buffered == 4
    decoder.reset()
    assert decoder.buffered == 0
    decoder.feed(b"\7" * (MAX_ENCODED_BYTES + 1))
    decoder.reset()
    frame = encode_frame(b"0123456789")
    assert _outcomes(decoder.feed(frame[1:])) == [b"0123456789"]


def test_memory_stays_bounded_whatever_comes() -> None:
    source = random.Random(1)
    decoder = FrameDecoder()
    chunks = [source.randbytes(3000), b"\7" * 3000, bytes(3000)]
    gc.disable()  # as in a real-time process: damage must not leave cycles behind
    try:
        before = len(gc.get_objects())
        for number in range(60):
            decoder.feed(chunks[number % 3])
            assert decoder.buffered <= MAX_ENCODED_BYTES
        assert len(gc.get_objects()) - before < 20
    finally:
        gc.enable()

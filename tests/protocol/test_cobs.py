"""COBS against the textbook's encoder and decoder, byte by byte; contents of every density."""

import itertools

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from haptogram_protocol.cobs import cobs_decode, cobs_encode
from haptogram_protocol.errors import RemoteProtocolError
from wire_oracles import cobs_decode_bytewise, cobs_encode_bytewise

EDGES = [0, 1, 2, 253, 254, 255, 256, 507, 508, 509, 510, 762, 763]
LONG = [b"\1" * 253, b"\1" * 254, b"\7" * 255, b"\xff" * 508]
ZEROS = bytes(40)  # more than are done one by one

sparse = st.lists(st.sampled_from([b"\0", b"\1", b"\xff", *LONG]), max_size=8).map(b"".join)
# Mostly zeros, with single bytes, runs that double and long runs between them.
pieces = st.sampled_from(
    [b"\0", b"\0\0", b"\0\7", b"\0\1\2", bytes(30), b"\5" * 16, b"\1" * 9, *LONG]
)
dense = st.lists(pieces, min_size=10, max_size=80).map(b"".join)
contents = st.one_of(st.binary(max_size=600), sparse, dense)


def _check(data: bytes) -> None:
    encoded = cobs_encode(data)
    assert encoded == cobs_encode_bytewise(data)
    assert 0 not in encoded
    assert len(encoded) <= len(data) + len(data) // 254 + 1
    assert cobs_decode(encoded) == data
    assert cobs_decode_bytewise(encoded) == data


@pytest.mark.parametrize("length", EDGES)
@pytest.mark.parametrize("byte", [0, 1, 0xFF])
def test_it_agrees_with_the_oracle_at_the_edges(length: int, byte: int) -> None:
    run = bytes([byte]) * length
    for before, after in itertools.product([b"", b"\0", ZEROS, ZEROS + b"\7"], [b"", b"\0", ZEROS]):
        _check(before + run + after)


@pytest.mark.parametrize("gap", [*range(18), 31, 32, 33, 63, 64, 127, 128, 129, 252])
def test_it_agrees_with_the_oracle_at_every_distance_of_zeros(gap: int) -> None:
    _check((b"\0" + b"\7" * gap) * 40)
    _check((b"\7" * gap + b"\0\0\xff") * 20)


@given(contents)
def test_it_agrees_with_the_oracle_and_comes_back(data: bytes) -> None:
    _check(data)


@given(st.one_of(contents, dense.map(cobs_encode).map(lambda encoded: encoded[:-1])))
@example(b"\x00")
@example(b"\x05\x01")
@example(b"\xff" + b"\1" * 254 + b"\1")  # HG-2.2/3: a needless last piece
@example(b"\x02\x07\x00\x01")
@example(b"\x14" + b"\1" * 30 + b"\2")  # a run that begins inside a piece, and an end too soon
@example(b"\1" * 20 + b"\x00")
def test_the_decoder_agrees_with_the_oracle_on_anything(encoded: bytes) -> None:
    expected = cobs_decode_bytewise(encoded)
    if expected is None:
        with pytest.raises(RemoteProtocolError) as caught:
            cobs_decode(encoded)
        assert caught.value.reason == "cobs"
    else:
        assert cobs_decode(encoded) == expected


def test_an_error_says_where_it_is() -> None:
    with pytest.raises(RemoteProtocolError, match="code 5 at byte 2 of 4 points past the end"):
        cobs_decode(b"\2\7\5\1")
    with pytest.raises(RemoteProtocolError, match="code 0 at byte 9 of 11"):
        cobs_decode(b"\1" * 9 + b"\0\1")

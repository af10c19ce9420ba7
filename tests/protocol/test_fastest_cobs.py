"""COBS in C does what COBS in Python does, and those who put connections together take it."""

import sys
from collections.abc import Callable

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import haptogram.driver.driver
import sim_device.assembly
from haptogram.driver.driver import Driver
from haptogram_protocol.cobs import PURE_PYTHON, Cobs, fastest_cobs
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import FrameDecoder, encode_frame
from virtual_ports import BoardPort

EXTENSION = "cobs.cobs._cobs_ext"

runs = st.sampled_from([b"\0", b"\1", b"\2\7", b"\0\7", b"\7" * 253, b"\7" * 254, b"\xff" * 255])
content = st.one_of(st.binary(max_size=600), st.lists(runs, max_size=12).map(b"".join))


@pytest.fixture(scope="module")
def compiled() -> Cobs:
    pytest.importorskip(EXTENSION, reason="the C extension of the package cobs is not installed")
    return fastest_cobs()


def _decoded(cobs: Cobs, encoded: bytes) -> bytes | None:
    try:
        return cobs.decode(encoded)
    except cobs.refusal:
        return None


@given(content)
def test_the_same_bytes_come_out_of_both_encoders(compiled: Cobs, data: bytes) -> None:
    encoded = compiled.encode(data)
    assert encoded == PURE_PYTHON.encode(data)
    assert compiled.decode(encoded) == data


@given(content.map(lambda data: data.replace(b"\0", b"\3")))
@example(b"\5\7")
@example(b"")
def test_both_decoders_give_the_same_bytes_and_refuse_the_same(
    compiled: Cobs, noise: bytes
) -> None:
    assert _decoded(compiled, noise) == _decoded(PURE_PYTHON, noise)


def test_a_damaged_frame_is_told_and_the_next_one_kept(compiled: Cobs) -> None:
    decoder = FrameDecoder(compiled)
    body = b"0123456789"
    damaged, whole = decoder.feed(b"\0\7abc\0" + encode_frame(body, compiled.encode))
    assert isinstance(damaged, RemoteProtocolError)
    assert (damaged.reason, damaged.__traceback__, damaged.__context__) == ("cobs", None, None)
    assert whole == body


def test_python_serves_without_the_extension(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cobs.cobs", None)
    assert fastest_cobs() is PURE_PYTHON


def test_driver_and_board_take_what_is_fastest(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (haptogram.driver.driver, sim_device.assembly):
        used = {"encode": 0, "decode": 0}

        def counted(name: str, used: dict[str, int] = used) -> Callable[[bytes], bytes]:
            def stuffing(data: bytes) -> bytes:
                used[name] += 1
                return getattr(PURE_PYTHON, name)(data)

            return stuffing

        monkeypatch.setattr(
            module, "fastest_cobs", lambda make=counted: Cobs(make("encode"), make("decode"))
        )
        with Driver(BoardPort()):
            pass
        assert min(used.values()) > 0, module.__name__

"""Which wire bytes look like: each dialect's own frames, Haptogram's, gRPC, and none."""

import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dialect_frames import chained_ultraino_frame, mega64_frame, sonicsurface_frame
from haptogram_protocol.dialects.autd3 import messages as link
from haptogram_protocol.dialects.codec import Operation
from haptogram_protocol.dialects.fpga_bytes.operations import (
    Begin,
    ModulationStep,
    Select,
    SetPhases,
    Swap,
)
from haptogram_protocol.dialects.interactlab import QueueFrame
from haptogram_protocol.dialects.looks_like import (
    AUTD3_SDK,
    HTTP2,
    LOOKED_AT_BYTES,
    looks_like_dialect,
)
from haptogram_protocol.dialects.table import DIALECTS
from haptogram_protocol.dialects.ultraino.arduino import operations as nibbles
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import HelloReply, build_body
from wire_export.vectors.samples import vector_sample

CODES = bytes(range(33)) * 7 + bytes(25)
# SimpleFPGA sends SonicSurface's frames, and a stack's frame holds one of a chain.
TWINS = {"sonicsurface", "sonicsurface-tactile", "ultraino-fpga"}
STACK = {"sonicsurface", "ultraino-fpga-chained"}


def pattern(board: int, size: int) -> nibbles.SetPattern:
    return nibbles.SetPattern(board, 0, bytes(range(size)))


# dialect, options, operations
ROWS: list[tuple[str, dict[str, int], list[Operation]]] = [
    ("sonicsurface", {}, sonicsurface_frame(CODES)),
    (
        "sonicsurface",
        {"boards": 2},
        [
            *(Begin(), Select(0), SetPhases((0,), 0, CODES)),
            *(Select(1), SetPhases((1,), 0, CODES), Swap()),
        ],
    ),
    ("sonicsurface-tactile", {}, [ModulationStep(7), *sonicsurface_frame(CODES)]),
    ("ultraino-fpga", {}, sonicsurface_frame(CODES)),
    ("ultraino-fpga-128", {}, sonicsurface_frame(bytes(range(57, 129)))),
    ("ultraino-fpga-chained", {"boards": 3}, chained_ultraino_frame([CODES] * 3)),
    ("ultraino-mega64", {}, mega64_frame([bytes(range(100))])),
    ("ultraino-mega64", {"boards": 4}, mega64_frame([bytes(range(100))] * 4)),
    ("ultraino-nano8", {}, [pattern(0, 24), nibbles.Swap()]),
    ("ultraino-nano16", {}, [pattern(0, 32), nibbles.Swap()]),
    ("interactlab", {}, [QueueFrame(bytes(range(128)) * 2, bytes([64] * 256))]),
    ("autd3", {}, [link.Hello()]),
]


@pytest.mark.parametrize(("name", "options", "operations"), ROWS)
@pytest.mark.parametrize("lead", [b"", b"\x00", b"\x00\x05\x07"])  # the client began before
def test_a_frame_looks_like_its_own_wire(
    name: str, options: dict[str, int], operations: list[Operation], lead: bytes
) -> None:
    host = DIALECTS[name].host(**options)
    found = looks_like_dialect(lead + b"".join(map(host.send, operations)))
    assert name in found
    alike = STACK if "boards" in options else TWINS
    assert set(found) <= (alike if name in alike else {name})


def test_every_dialect_is_recognised() -> None:
    assert {name for name, _, _ in ROWS} == set(DIALECTS)


def test_haptogram_s_own_wire_and_grpc_are_named() -> None:
    header = {"flags": 0, "seq": 1, "time_us": 2, "session": 3}
    own = encode_frame(build_body(vector_sample(HelloReply, "random"), **header))
    assert looks_like_dialect(own) == ("haptogram",)
    assert looks_like_dialect(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n") == (HTTP2,)
    assert looks_like_dialect(b"ARMT\x03") == (AUTD3_SDK,)


@given(st.binary(max_size=2000))
def test_any_bytes_give_names(data: bytes) -> None:
    assert set(looks_like_dialect(data)) <= {*DIALECTS, "haptogram", "http/2"}


def test_noise_text_and_silence_look_like_nothing() -> None:
    source = random.Random(3)
    for _ in range(200):
        assert looks_like_dialect(source.randbytes(LOOKED_AT_BYTES)) == ()
    assert looks_like_dialect(Path(__file__).read_bytes()) == ()
    assert looks_like_dialect(b"") == looks_like_dialect(bytes(LOOKED_AT_BYTES)) == ()
    assert looks_like_dialect(b"\xff" * LOOKED_AT_BYTES) == ()


def test_only_the_first_bytes_count() -> None:
    line = b"".join(map(DIALECTS["sonicsurface"].host().send, sonicsurface_frame(CODES)))
    for gap, found in ((0, True), (LOOKED_AT_BYTES - len(line), True), (LOOKED_AT_BYTES, False)):
        assert bool(looks_like_dialect(bytes(gap) + line)) is found
    assert looks_like_dialect(b"\x00PRI * HTTP/2.0\r\n") == ()


def test_only_the_dialects_in_question_are_named() -> None:
    line = DIALECTS["sonicsurface"].host().send(Begin()) + CODES + b"\xfd"
    assert looks_like_dialect(line, [DIALECTS["sonicsurface"], DIALECTS["autd3"]]) == (
        "sonicsurface",
    )

"""What holds for every wire: any chunks, any bytes, there and back."""

import json
import random
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram_protocol.dialects.codec import BoardEnd, Operation
from haptogram_protocol.dialects.fpga_bytes.operations import SetAmplitudes, SetPhases
from haptogram_protocol.dialects.looks_like import looks_like_dialect
from haptogram_protocol.dialects.table import DIALECTS
from haptogram_protocol.dialects.ultraino.arduino.operations import Forward, SetPattern
from haptogram_protocol.errors import LocalProtocolError
from strategies_dialects import WIRES, Wire, sent
from strategies_protocol import chunkings

DATA = Path(__file__).parents[2] / "data" / "dialects"
every_wire = pytest.mark.parametrize("wire", WIRES, ids=str)


class Unknown(Operation):
    """An operation that no wire has."""


def fed(end: BoardEnd, chunks: list[bytes]) -> tuple[list[Operation], Counter[str], int]:
    found = [operation for chunk in chunks for operation in end.receive_data(chunk)]
    return found, end.counters, end.pending


def mutilated(wire: bytes, source: random.Random) -> bytes:
    """Lose, change and insert a few bytes."""
    mended = bytearray(wire)
    for _ in range(source.randint(0, 6)):
        at = source.randrange(len(mended) + 1)
        mended[at : at + source.randint(0, 2)] = source.randbytes(source.randint(0, 2))
    return bytes(mended)


def test_every_dialect_has_a_row() -> None:
    assert {wire.dialect for wire in WIRES} == set(DIALECTS)
    assert all(name == dialect.name for name, dialect in DIALECTS.items())


@every_wire
@given(data=st.data())
def test_operations_come_back_from_their_bytes(wire: Wire, data: st.DataObject) -> None:
    operations = data.draw(wire.operations)
    host, board = wire.host(), wire.board()
    line = b"".join(host.send(operation) for operation in operations)
    chunks = data.draw(chunkings(line))
    assert sent(fed(board, chunks)[0]) == operations
    assert not board.pending


@pytest.mark.sampled(7)
@every_wire
@given(data=st.data())
def test_damage_gives_the_same_in_any_chunks_and_never_an_error(
    wire: Wire, data: st.DataObject
) -> None:
    operations = data.draw(wire.operations)
    host = wire.host()
    line = b"".join(host.send(operation) for operation in operations)
    source = random.Random(data.draw(st.integers(0, 2**32)))
    line = mutilated(line, source)
    if source.random() < 0.3:
        line = source.randbytes(source.randint(0, 700)) + line
    whole = repr(fed(wire.board(), [line]))  # as text: damage makes NaN, which equals nothing
    assert repr(fed(wire.board(), [line[at : at + 1] for at in range(len(line))])) == whole
    assert repr(fed(wire.board(), data.draw(chunkings(line)))) == whole


@pytest.mark.sampled(7)
@every_wire
@given(data=st.data())
def test_pieces_between_ends_hold_no_end_of_a_message(wire: Wire, data: st.DataObject) -> None:
    """A message is complete with the last byte of a piece, and with no byte before it."""
    host = wire.host()
    line = b"".join(host.send(operation) for operation in data.draw(wire.operations))
    board, at, codes = wire.board(), 0, (SetPhases, SetAmplitudes, SetPattern, Forward)
    while at < len(line):
        end = board.next_frame_end(line, at)
        assert at < end <= len(line)
        early = board.receive_data(line[at : end - 1])
        assert all(isinstance(operation, codes) for operation in early)
        board.receive_data(line[end - 1 : end])
        at = end


@every_wire
@given(chunks=st.lists(st.binary(max_size=300), max_size=20))
def test_any_bytes_are_operations_or_counted(wire: Wire, chunks: list[bytes]) -> None:
    board, host = wire.board(), wire.host()
    for chunk in chunks:
        assert isinstance(board.receive_data(chunk), list)
        assert isinstance(host.receive_data(chunk), list)
        assert board.pending <= wire.pending_limit
        assert host.pending <= wire.pending_limit
    assert all(count > 0 for count in board.counters.values())


@pytest.mark.sampled(7)
@every_wire
def test_noise_is_bounded_however_much_comes(wire: Wire) -> None:
    board, source = wire.board(), random.Random(5)
    kinds = set()
    for byte in range(256):  # constant lines, and a lot of noise
        board.receive_data(bytes([byte]) * 500)
        board.receive_data(source.randbytes(500))
        assert board.pending <= wire.pending_limit
        kinds |= set(board.counters)
    assert 1 <= len(kinds) <= 12


@every_wire
def test_what_a_wire_cannot_say_is_refused_by_name(wire: Wire) -> None:
    with pytest.raises(LocalProtocolError, match="Unknown"):
        wire.host().send(Unknown())
    with pytest.raises(LocalProtocolError, match=wire.dialect.rsplit("-", 1)[0]):
        wire.board().send(object())


@every_wire
def test_an_end_starts_with_nothing(wire: Wire) -> None:
    for end in (wire.board(), wire.host()):
        assert not end.receive_data(b"")
        assert not end.pending
        assert not end.counters


def captures() -> dict[str, bytes]:
    names = json.loads((DATA / "expected.json").read_text())
    return {name: (DATA / f"{name}.bin").read_bytes() for name in names}


@pytest.mark.sampled(60)
@pytest.mark.parametrize("name", captures())
@every_wire
def test_foreign_wires_never_disturb(wire: Wire, name: str) -> None:
    line = captures()[name]
    board = wire.board()
    whole = fed(board, [line])
    assert fed(wire.board(), [line[:100], line[100:]]) == whole


@pytest.mark.parametrize("name", captures())
def test_captures_look_like_what_they_are(name: str) -> None:
    folder, rest = name.split("/")
    line = captures()[name]
    expected = {"simplefpga": "ultraino-fpga", "simplefpga128": "ultraino-fpga-128"}.get(
        rest.split("_")[0],
        {"chainedfpga": "ultraino-fpga-chained", "mega": "ultraino-mega64"}.get(
            rest.split("_")[0].removesuffix("anim"), folder
        ),
    )
    if len(line) > 1:  # a lone FD says nothing
        assert expected in looks_like_dialect(line)
        assert set(looks_like_dialect(line)) <= {expected, "sonicsurface", "ultraino-fpga"}

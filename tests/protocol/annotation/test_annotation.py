"""Any bytes are annotated whole, in any chunks; frames are those that the decoder finds."""

import json
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram_protocol.annotation.frames import (
    Annotated,
    Annotator,
    FrameAnnotator,
    annotated_fields_of,
    annotated_message_text,
)
from haptogram_protocol.annotation.operations import OperationAnnotator
from haptogram_protocol.dialects.table import DIALECTS
from haptogram_protocol.framing import MAX_ENCODED_BYTES, FrameDecoder, encode_frame
from haptogram_protocol.messages import MESSAGES, Error, Header, Message
from strategies_dialects import WIRES, Wire
from strategies_protocol import chunkings, headers, messages, noise

DATA = Path(__file__).parents[2] / "data" / "dialects"


def annotated(annotator: Annotator, chunks: list[bytes]) -> list[Annotated]:
    found = [piece for chunk in chunks for piece in annotator.feed(chunk)]
    return found + list(annotator.end())


@given(messages, headers)
def test_a_frame_has_its_header_and_every_field(message: Message, fields: dict[str, Any]) -> None:
    header = Header(type=message.TYPE, **fields)
    (piece,) = annotated(
        FrameAnnotator(), [b"noise\x00", encode_frame(header.pack() + message.pack())]
    )[1:]
    assert (piece.header, piece.message, piece.fault) == (header, message, "")
    assert piece.name == message.TYPE.name
    assert piece.text.startswith(f"{message.TYPE.name} seq {header.seq} session ")
    assert piece.fields == json.loads(json.dumps(annotated_fields_of(message)))
    assert set(piece.fields) == {*message.WIRE, *([message.TAIL.name] if message.TAIL else [])}


@given(data=st.data())
def test_pieces_are_the_same_in_any_chunks_and_cover_the_stream(data: st.DataObject) -> None:
    stream = data.draw(noise)
    whole = annotated(FrameAnnotator(), [stream])
    assert annotated(FrameAnnotator(), data.draw(chunkings(stream))) == whole
    covered = b"".join(stream[piece.offset : piece.offset + piece.size] for piece in whole)
    assert covered == stream.replace(b"\0", b"")


@given(st.lists(st.one_of(noise, st.binary(min_size=14, max_size=30).map(encode_frame))))
def test_undamaged_frames_are_those_of_the_decoder(parts: list[bytes]) -> None:
    stream = b"".join(parts) + b"\0"
    bodies = sum(isinstance(body, bytes) for body in FrameDecoder().feed(stream))
    found = annotated(FrameAnnotator(), [stream])
    assert sum(piece.header is not None for piece in found) == bodies
    assert all(piece.fault for piece in found if piece.header is None)


def test_a_run_without_a_delimiter_is_told_once_with_its_size_in_bounded_memory() -> None:
    annotator = FrameAnnotator()
    tracemalloc.start()
    found = [piece for _ in range(200) for piece in annotator.feed(b"\x01" * 100_000)]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found == []
    assert peak < 2_000_000
    (piece,) = annotator.feed(b"\0")
    assert (piece.offset, piece.size) == (0, 20_000_000)
    assert f"more than {MAX_ENCODED_BYTES} bytes" in piece.fault


@pytest.mark.parametrize("kind", MESSAGES.values(), ids=lambda kind: kind.__name__)
def test_a_payload_that_cannot_be_read_keeps_its_header(kind: type[Message]) -> None:
    header = Header(type=kind.TYPE, flags=0, seq=7, time_us=1, session=2)
    (piece,) = annotated(FrameAnnotator(), [encode_frame(header.pack() + b"\xff" * 3001)])
    assert piece.header == header
    assert piece.name == kind.TYPE.name
    if piece.message is None:
        assert piece.fault
        assert piece.fields == {"payload": "ff" * 3001}


# --- The wires of other boards -------------------------------------------------------------------


@pytest.mark.sampled(7)
@pytest.mark.parametrize("wire", WIRES, ids=str)
@given(data=st.data())
def test_operations_cover_the_line(wire: Wire, data: st.DataObject) -> None:
    host = wire.host()
    operations = data.draw(wire.operations)
    line = b"".join(host.send(operation) for operation in operations) + data.draw(
        st.binary(max_size=20)
    )
    options = wire.options
    whole = annotated(OperationAnnotator(wire.facts, options=options), [line])
    chunks = data.draw(chunkings(line))
    assert annotated(OperationAnnotator(wire.facts, options=options), chunks) == whole
    assert [piece.offset for piece in whole] == [
        sum(piece.size for piece in whole[:place]) for place in range(len(whole))
    ]
    assert sum(piece.size for piece in whole) == len(line)
    json.dumps([piece.fields for piece in whole])


@pytest.mark.parametrize("name", DIALECTS)
@given(line=st.binary(max_size=600))
def test_noise_on_any_wire_is_told_and_never_an_error(name: str, line: bytes) -> None:
    for from_board in (False, True):
        found = annotated(OperationAnnotator(DIALECTS[name], from_board=from_board), [line])
        assert sum(piece.size for piece in found) == len(line)
        assert all(piece.name or piece.fault for piece in found)


def test_what_a_client_sent_is_its_operations_in_place() -> None:
    line = (DATA / "sonicsurface" / "focus_0_120_0.bin").read_bytes()
    found = annotated(OperationAnnotator(DIALECTS["sonicsurface"]), [line])
    assert [(piece.offset, piece.size, piece.name) for piece in found] == [
        (0, 1, "Begin"),
        (1, 256, "SetPhases"),
        (257, 1, "Swap"),
    ]
    assert found[1].fields["codes"] == line[1:257].hex()
    assert found[1].text.endswith("... (256 bytes)")


def test_a_refusal_is_told_by_names_and_numbers_without_a_name_as_they_are() -> None:
    refused = annotated_message_text(Error(request=0x44, code=6, detail=427))
    assert refused == "request PING, code SEQUENCE_REUSED, detail 0x1ab"
    unknown = annotated_message_text(Error(request=0x3F, code=250, detail=0))
    assert unknown == "request type 0x3f, code 250, detail 0x0"

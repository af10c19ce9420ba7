"""The wire: messages, frames, the decoder of a stream, and a round trip of both connections."""

import dataclasses
import random
import zlib

import pytest
from wire_references import BytewiseDecoder

from haptogram_protocol.cobs import PURE_PYTHON, fastest_cobs
from haptogram_protocol.connection import BoardConnection, HostConnection
from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import (
    MESSAGES,
    VERSION_MAJOR,
    Drives,
    HelloReply,
    Phases,
    Ping,
    Pong,
    build_body,
    parse_body,
)
from wire_export.vectors.samples import vector_sample

HEADER = {"flags": 0, "seq": 4711, "time_us": 123_456_789, "session": 0x5EED}
SECONDS = 0.7  # for each pair
CHUNK = 4096  # bytes, as a pseudo-terminal hands them out
FRAMES = 400
GARBAGE = 0.3  # of the bytes on the line
COBS = {"C": fastest_cobs, "Python": lambda: PURE_PYTHON}


def phases(codes):
    return Phases(bytes(codes))


CONTENTS = {
    "random": phases(random.Random(1).randbytes(256)),
    "plane wave": phases(256),  # every phase zero
    "all equal": phases([77] * 256),
    "muted": Drives(bytes(512)),  # every phase and amplitude zero
    "alternating": phases([0, 77] * 128),
    "zeros in runs of 7": phases(([0] * 7 + [77]) * 32),  # what decoding in Python likes least
}


def cobs_of(implementation):
    cobs = COBS[implementation]()
    if implementation == "C" and cobs is PURE_PYTHON:
        pytest.skip("the package cobs is not installed, or was without a C compiler")
    return cobs


class Pair:
    """Both connections, in step: what one sends the other receives at once."""

    def __init__(self, cobs):
        self.host = HostConnection(nonce=1, cobs=cobs)
        self.board = BoardConnection(cobs=cobs)
        self.host.send_hello(0)
        hello = self.carry_to_board()
        self.board.open_session(1)
        greeting = dataclasses.replace(
            vector_sample(HelloReply, "random"), major=VERSION_MAJOR, nonce=1
        )
        self.board.reply(hello, greeting, 0)
        self.carry_to_host()

    def carry_to_board(self):
        self.board.receive_data(self.host.data_to_send(), 0)
        return self.board.next_event()

    def carry_to_host(self):
        self.host.receive_data(self.board.data_to_send(), 0)
        return self.host.next_event()

    def ping(self):
        self.host.send_request(Ping(7), 0)
        self.board.reply(self.carry_to_board(), Pong(7, 0, 0), 0)
        return self.carry_to_host().message

    def stream(self, message):
        _, wire = self.host.stream_frame(message, t_apply_us=0)
        self.board.receive_data(wire, 0)
        return self.board.next_event().message


@pytest.mark.row("{direction} {message}")
@pytest.mark.parametrize("message", [kind.TYPE.name for kind in MESSAGES.values()])
@pytest.mark.parametrize("direction", ["encode", "decode"])
def test_message(direction, message, measure):
    """From message to line, or from line to message."""
    kind = next(kind for kind in MESSAGES.values() if kind.TYPE.name == message)
    subject = CONTENTS["random"] if kind is Phases else vector_sample(kind, "random")
    cobs = fastest_cobs()
    wire = encode_frame(build_body(subject, **HEADER))
    decoder = FrameDecoder(cobs)

    def encode():
        return encode_frame(build_body(subject, **HEADER), cobs.encode)

    def decode():
        return [parse_body(body)[1] for body in decoder.feed(wire)]

    assert encode() == wire
    assert decode() == [subject]
    measure({"encode": encode, "decode": decode}[direction], bytes=len(wire))


@pytest.mark.row("frame from a body, {content}, COBS in {implementation}")
@pytest.mark.parametrize("content", CONTENTS)
@pytest.mark.parametrize("implementation", COBS)
def test_frame_against_crc32(implementation, content, compare):
    """COBS, CRC-32 and delimiters of a body that is there, against the CRC-32 alone."""
    body = build_body(CONTENTS[content], **HEADER)
    stuff = cobs_of(implementation).encode
    compare(
        0.2 if implementation == "C" else None,
        lambda: encode_frame(body, stuff),
        lambda: zlib.crc32(body),
        repeats=1000,
        reference_repeats=2000,
        seconds=SECONDS,
        bytes=len(body),
    )


@pytest.mark.row("frame from a message, {content}")
@pytest.mark.parametrize("content", CONTENTS)
def test_whole_frame_against_crc32(content, compare):
    """From the message to the line as the driver does it, sequence number and all."""
    message = CONTENTS[content]
    body = build_body(message, **HEADER)
    host = Pair(fastest_cobs()).host
    compare(
        None,
        lambda: host.stream_frame(message, t_apply_us=123_456_789),
        lambda: zlib.crc32(body),
        repeats=500,
        reference_repeats=2000,
        seconds=SECONDS,
        bytes=len(body),
    )


def noisy_line(message):
    """Frames of *message* with garbage between them, in chunks; the garbage has zeros too."""
    source = random.Random(2)
    bodies = [build_body(message, **(HEADER | {"seq": seq})) for seq in range(FRAMES)]
    wires = [encode_frame(body) for body in bodies]
    share = GARBAGE / (1 - GARBAGE)
    line = b"".join(source.randbytes(int(2 * share * len(w) * source.random())) + w for w in wires)
    return bodies, [line[at : at + CHUNK] for at in range(0, len(line), CHUNK)]


@pytest.mark.row("decoder of a stream, {content}, COBS in {implementation}")
@pytest.mark.parametrize("content", CONTENTS)
@pytest.mark.parametrize("implementation", COBS)
def test_stream_decoder_against_byte_by_byte(implementation, content, compare):
    cobs = cobs_of(implementation)
    bodies, chunks = noisy_line(CONTENTS[content])

    def ours():
        decoder = FrameDecoder(cobs)
        return [found for chunk in chunks for found in decoder.feed(chunk)]

    def reference():
        decoder = BytewiseDecoder()
        return [found for chunk in chunks for found in decoder.feed(chunk)]

    found = [out if isinstance(out, bytes) else out.reason for out in ours()]
    assert found == reference()
    compare(
        20.0 if implementation == "C" else None,
        ours,
        reference,
        repeats=10,  # some 10 ms, as the reference takes: both in a warm cache
        seconds=SECONDS,
        bytes=sum(map(len, chunks)),
        frames=len(bodies),
        lost=len(set(bodies) - set(found)),
    )


@pytest.mark.row("PING and PONG through both connections")
def test_round_trip_of_both_connections(measure):
    """PING and PONG: encoded, decoded, judged and answered, with nothing between the two."""
    pair = Pair(fastest_cobs())
    assert pair.ping() == Pong(7, 0, 0)
    measure(pair.ping)


@pytest.mark.row("phase frame through both connections")
def test_stream_frame_through_both_connections(measure):
    pair = Pair(fastest_cobs())
    message = CONTENTS["random"]
    assert pair.stream(message) == message
    measure(lambda: pair.stream(message))

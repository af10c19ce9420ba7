"""Rules of the bytes on the line: each is broken by the bytes that break it, and by no others."""

import zlib

import pytest

from haptogram.conformance.client.wire import ClientWaitLimits, RawFrameClient
from haptogram.conformance.judge.standing_rules import StandingRules
from haptogram.conformance.outcome import RuleFindings
from haptogram_protocol.cobs import cobs_encode
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    Error,
    ErrorCode,
    Header,
    HelloReply,
    LatchKey,
    MessageType,
    Ping,
    Pong,
    StateChanged,
    TraceRecord,
    TraceReply,
)
from haptogram_protocol.state import MuteReason, OutputState

SESSION, OTHER = 7, 9
NOTHING = {name: 0 for name in HelloReply.WIRE if name not in ("state", "firmware")}
MUTED = StateChanged(OutputState.MUTED, MuteReason.MUTE)


class Line:
    """A port that hands out what it was given, one piece for each read."""

    url = "line"

    def __init__(self, *pieces):
        self.pieces, self.t_ns = list(pieces), 0

    def now_ns(self):
        return self.t_ns

    def read_available(self, _):
        self.t_ns += 1_000_000
        return self.pieces.pop(0) if self.pieces else b""

    def write_some(self, data):
        return len(data)

    def close(self):
        pass


def frame(message, seq=0, session=SESSION, flags=0, kind=None, payload=None):
    """Return the bytes of any frame."""
    head = Header(message.TYPE if kind is None else kind, flags, seq, 1000, session)
    return encode_frame(head.pack() + (message.serialize() if payload is None else payload))


def greeting(nonce=SESSION):
    reply = HelloReply(**NOTHING | {"nonce": nonce}, state=OutputState.DISARMED, firmware="one")
    return frame(reply, session=nonce)


def asked(seq, kind=MessageType.PING, session=SESSION):
    """Return the bytes of a request."""
    return frame(Ping(1), seq, session, kind=kind)


PONG = Pong(1, 2, 3)
SENT = asked(0, MessageType.HELLO, 0) + b"".join(asked(seq) for seq in range(1, 9))


def broken(*pieces, is_lossless=True, sent=SENT):
    """Return what rules find in bytes that come behind HELLO_REPLY."""
    found = RuleFindings()
    rules = StandingRules(found, is_lossless=is_lossless)
    line = Line(greeting(), *pieces)
    wire = RawFrameClient(line, ClientWaitLimits.of(1, virtual=True), baudrate=3_000_000)
    wire.on_piece, wire.on_sent = rules.take, rules.take_sent
    wire.send(sent)
    wire.idle(20_000)
    return found.broken


def test_frames_of_a_healthy_board_break_nothing():
    stale = Error(MessageType.PING, ErrorCode.STALE_SESSION, 5)
    early = frame(MUTED, 0), frame(PONG, 1), frame(PONG, 3) + b"\x00\x00" + frame(PONG, 4)
    anew = greeting(OTHER), frame(MUTED, 1), frame(MUTED, 0, OTHER), frame(PONG, 6, OTHER)
    assert broken(*early, frame(stale, 5, 0), *anew, sent=SENT + SENT) == {}


def spare_code():
    """Return a frame whose data end with a full piece, and a code byte for nothing behind it."""
    head = Header(0x84, 0, 1, 0x01010101, 0x0101).pack()
    for filler in range(1, 256):
        line = encode_frame(head + bytes([0]) + bytes([filler]) * 250)
        if line[-256] == 0xFF:
            return line[:-1] + b"\x01\x00"
    raise AssertionError("a CRC in 64 has a zero")


RECORD = TraceRecord(0, LatchKey(0, 0, 1), 1, 1, 2)
PIECES = {
    "HG-2.1/1": [frame(PONG, 1)[:-1] + frame(PONG, 2)],
    "HG-2.4/1": [b"\x00" + cobs_encode(bytes(range(180, 220))) + b"\x00"],
    "HG-3.1/1": [b"\x00" + cobs_encode(bytes([200]) * 9) + b"\x00"],
    "HG-3.2/3": [frame(PONG, 1, payload=bytes(17))],
    "HG-3.4/3": [frame(PONG, 1, flags=1)],
    "HG-3.7/1": [frame(PONG, 1, session=OTHER)],
    "HG-4.11/1": [frame(PONG, 1), frame(PONG, 1)],
    "HG-11.5/2": [frame(Error(MessageType.PING, 99, 0), 1)],
}


@pytest.mark.parametrize("clause", PIECES)
def test_each_rule_is_broken_by_the_bytes_that_break_it(clause):
    assert list(broken(*PIECES[clause])) == [clause]


@pytest.mark.parametrize(
    ("clause", "piece"),
    [
        ("HG-2.2/1", spare_code()),
        ("HG-2.2/1", b"\x00\x09overrun\r\n\x00"),
        ("HG-3.1/1", frame(Ping(1), 1)),
        ("HG-3.7/1", frame(PONG, 1, session=0)),
        ("HG-3.7/1", frame(Error(MessageType.PING, ErrorCode.STALE_SESSION, 5), 1)),
        ("HG-3.7/1", frame(MUTED, 0, session=OTHER)),
        ("HG-4.11/1", frame(PONG, 99)),
        ("HG-4.11/1", frame(Error(MessageType.ARM, ErrorCode.BAD_STATE, 0), 1)),
        ("HG-11.5/2", frame(PONG, 0, kind=0xFE)),
        ("HG-11.5/2", frame(MUTED, 0, payload=b"\x09\x09")),
        ("HG-11.5/2", frame(TraceReply(0, 1, (RECORD,)), 0)),
    ],
)
def test_each_rule_is_broken_in_its_other_ways(clause, piece):
    assert clause in broken(piece)


def test_damage_is_a_boards_where_the_line_does_none():
    for clause in ("HG-2.4/1", "HG-3.1/1"):
        assert broken(*PIECES[clause], is_lossless=False) == {}
    text = b"\x00watchdog: late\r\n\x00"
    assert list(broken(text, is_lossless=False)) == ["HG-2.2/1"]


def test_a_frame_without_an_end_is_too_long():
    head = Header(0x84, 0, 1, 0, SESSION).pack()
    data = head + bytes(5000)
    line = b"\x00" + cobs_encode(data + zlib.crc32(data).to_bytes(4, "little")) + b"\x00"
    assert "HG-2.6/1" in broken(line)

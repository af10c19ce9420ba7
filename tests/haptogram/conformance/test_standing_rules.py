"""Rules that every frame of a run is judged by: each is broken by the frame that breaks it."""

from __future__ import annotations

import dataclasses
import itertools
import zlib

import pytest

from haptogram.conformance.client.wire import ReceivedByClient
from haptogram.conformance.judge.sent_drives import SentDrives
from haptogram.conformance.judge.standing_rules import StandingRules
from haptogram.conformance.outcome import RuleFindings
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    RESPONSE_OFFSET,
    Config,
    ConfigReply,
    Counters,
    DriveKind,
    DriveReply,
    Drives,
    Element,
    Error,
    ErrorCode,
    FocalPoint,
    GeometryReply,
    Header,
    HelloReply,
    LatchKey,
    Message,
    Phases,
    Ping,
    PlaybackEnded,
    Points,
    Pong,
    SetConfigReply,
    StateChanged,
    Status,
    StatusReply,
    Trace,
    TraceDrive,
    TracePlayback,
    TraceRecord,
    TraceReply,
    UploadBegin,
    UploadBeginReply,
    UploadChunk,
    UploadCommit,
    UploadCommitReply,
    UploadKind,
    build_body,
)
from haptogram_protocol.state import MuteReason, OutputState

SESSION = 7
NONE = Counters(**dict.fromkeys(Counters.WIRE, 0))
MARGINS = {"margins": 0, "margin_min_us": 0, "margin_mean_us": 0}
STATUS = StatusReply(
    state=OutputState.DISARMED,
    reason=MuteReason.DISARM,
    queued=0,
    free_bytes=100,
    last_seq=0,
    last_latch_us=0,
    config_crc=5,
    counters=NONE,
    **MARGINS,
)
HELLO = HelloReply(
    **{name: 0 for name in HelloReply.WIRE if name not in ("state", "firmware")}
    | {"nonce": SESSION, "transducers": 2, "carrier_hz": 40_000},
    state=OutputState.DISARMED,
    firmware="one",
)
CONFIG = Config(200, 50, 500, 0, 0, 343_200, 0, 255, 1)
ELEMENT = Element(0, 0, 0, 0, 0, 32_767)


def findings(
    *messages: Message | tuple[Message, dict[str, int]], sent: bytes = b""
) -> dict[str, str]:
    """Return what rules find in frames of one session, a millisecond apart."""
    found = RuleFindings()
    rules = StandingRules(found)
    rules.take_sent(sent)
    events = itertools.count()
    for number, item in enumerate(messages):
        message, header = item if isinstance(item, tuple) else (item, {})
        seq = next(events) if message.TYPE >= 0xC0 else number
        fields = {"type": message.TYPE, "flags": 0, "seq": seq, "session": SESSION} | header
        head = Header(**{"time_us": 1000 * number} | fields)
        if message.TYPE < 0xC0:
            asked = dataclasses.replace(head, type=message.TYPE - RESPONSE_OFFSET)
            rules.take_sent(encode_frame(asked.pack()))
        body = head.pack() + message.serialize()
        piece = encode_frame(body).strip(b"\x00")
        rules.take(ReceivedByClient(1000 * number, piece, False, head, message, body))
    return found.broken


def status(**changes: object) -> StatusReply:
    """Return the status with other values."""
    counters = {name: changes.pop(name) for name in [*changes] if name in Counters.WIRE}
    return dataclasses.replace(STATUS, counters=dataclasses.replace(NONE, **counters), **changes)


CONFIG_REPLY = ConfigReply(5, CONFIG)
GEOMETRY = GeometryReply(2, 0, (ELEMENT, ELEMENT))
TRACE = Trace(65_520, 1)
MUTED = StateChanged(OutputState.MUTED, MuteReason.MUTE)
OTHER = dataclasses.replace(CONFIG, hold_ms=201)


def test_frames_of_a_healthy_board_break_nothing():
    one, event = status(frames=1, requests=1), Status(*dataclasses.astuple(STATUS)[:-1], NONE)
    ring = TraceReply(0, 0, ())
    late = TRACE, {"flags": 1}
    assert findings(HELLO, STATUS, one, one, CONFIG_REPLY, GEOMETRY, ring, late) == {}
    assert findings(HELLO, event, CONFIG_REPLY, SetConfigReply(6, OTHER)) == {}


def test_a_fault_behind_the_end_of_a_playback_in_one_microsecond_breaks_nothing():
    at = {"time_us": 9}
    fault = StateChanged(OutputState.FAULT, MuteReason.FAULT)
    assert findings((PlaybackEnded(1, 1, 1), at), (fault, at)) == {}


def test_a_reply_from_memory_tells_of_earlier():
    assert findings(HELLO, status(frames=1, requests=1), (STATUS, {"time_us": 1})) == {}


def test_a_reply_from_memory_in_the_microsecond_of_its_first_sending_is_the_same_bytes():
    once = {"time_us": 9, "seq": 1}
    later = status(frames=1, requests=1), {"time_us": 9, "seq": 2}
    assert findings(HELLO, (STATUS, once), later, (STATUS, once)) == {}
    again = {"time_us": 9, "seq": 3}
    assert list(findings(HELLO, (STATUS, once), later, (STATUS, again))) == ["HG-9.2/1"]


@pytest.mark.parametrize(
    ("clause", "messages"),
    [
        ("HG-3.1/1", [HELLO, (TRACE, {"time_us": 6_000_000})]),
        ("HG-3.4/3", [HELLO, (MUTED, {"flags": 1})]),
        ("HG-3.6/2", [HELLO, (TRACE, {"seq": 0}), (TRACE, {"seq": 2})]),
        ("HG-3.9/2", [status(frames=1)]),
        ("HG-4.3/1", [HELLO, dataclasses.replace(HELLO, firmware="two")]),
        ("HG-4.11/5", [(PlaybackEnded(1, 1, 1), {"time_us": 9}), (MUTED, {"time_us": 9})]),
        ("HG-5.8/3", [HELLO, (TRACE, {"time_us": 50}), (TRACE, {"time_us": 60})]),
        ("HG-6.2/3", [status(reason=MuteReason.NONE)]),
        ("HG-7.1/3", [SetConfigReply(5, CONFIG), ConfigReply(5, OTHER)]),
        ("HG-7.1/5", [SetConfigReply(5, CONFIG), status(config_crc=6)]),
        ("HG-7.5/1", [HELLO, GEOMETRY, GeometryReply(1, 0, (ELEMENT,))]),
        ("HG-8.5/2", [TraceReply(3, 2, ())]),
        ("HG-9.1/3", [status(queued=1)]),
        ("HG-9.1/3", [status(margin_min_us=1)]),
        ("HG-9.2/1", [status(crc=2), status(crc=1)]),
    ],
)
def test_each_rule_is_broken_by_the_frame_that_breaks_it(clause, messages):
    assert list(findings(*messages)) == [clause]


def sent_frame(message: Message, seq: int = 65_520) -> bytes:
    """Return the bytes of a stream frame of the session."""
    return encode_frame(Header(message.TYPE, 0, seq, 0, SESSION).pack() + message.serialize())


def latches_of(*codes: int) -> list[Message]:
    """Return every message that tells of one latch of these codes: phases, then amplitudes."""
    data, key = bytes(codes), LatchKey(0, 0, 65_520)
    crc = zlib.crc32(data)
    return [
        Trace(65_520, crc),
        TraceDrive(key, data),
        TraceReply(0, 1, (TraceRecord(0, key, 1, crc, 0),)),
        DriveReply(DriveKind.LATCHED, key, 1, 0, data),
        DriveReply(DriveKind.LATCHED, key, 1, 1, data[1::2]),
    ]


def test_a_latch_of_the_codes_that_were_sent_breaks_nothing():
    drives = sent_frame(Drives(bytes([1, 2, 3, 4])))
    assert findings(HELLO, *latches_of(1, 2, 3, 4), sent=drives) == {}
    points = sent_frame(Points((FocalPoint(0, 0, 100_000, 1000, 0),)))
    assert findings(HELLO, *latches_of(9, 9, 9, 9), sent=points) == {}
    assert findings(HELLO, *latches_of(9, 9, 9, 9), sent=sent_frame(Ping(1))) == {}
    of_another = sent_frame(Phases(bytes(2)), seq=5)
    assert findings(HELLO, *latches_of(9, 9, 9, 9), sent=of_another) == {}


@pytest.mark.parametrize("place", range(5))
def test_a_latch_of_codes_that_were_not_sent_is_found_wherever_it_is_told(place):
    drives = sent_frame(Drives(bytes([1, 2, 3, 4])))
    clause = "HG-8.3/2" if place < 3 else "HG-8.6/3"
    wrong = latches_of(1, 2, 3, 5)[place]
    assert list(findings(HELLO, wrong, sent=drives)) == [clause]


def test_of_frames_with_one_number_any_may_be_latched():
    one, two = (Phases(bytes([code, 7])) for code in (1, 2))
    sent = sent_frame(one) + sent_frame(two)
    assert findings(HELLO, latches_of(2, 7, 255, 255)[0], sent=sent) == {}
    assert findings(HELLO, latches_of(3, 7, 255, 255)[0], sent=sent) != {}


def test_of_more_frames_than_are_kept_the_newest_are_known():
    """They are asked for in between: what is forgotten makes room for the next."""
    sent = SentDrives()
    for number in range(5000):
        sent.take(sent_frame(Phases(bytes([number & 0xFF])), number))
        if number % 1000 == 999:
            assert sent.codes_of(SESSION, 65_536 + number, 1)
    known = [number for number in range(5000) if sent.codes_of(SESSION, 65_536 + number, 1)]
    assert known == list(range(5000 - 4096, 5000))


STORED = bytes([5, 6, 7, 8])  # two frames


def uploaded(*chunks: UploadChunk, commits: int = 3) -> bytes:
    """Return the bytes of an upload of :data:`STORED` as the sequence 3."""
    begin = UploadBegin(UploadKind.PHASES, 0, 3, len(STORED), zlib.crc32(STORED))
    return b"".join(map(sent_frame, (begin, *chunks, UploadCommit(commits))))


def played(index: int, *codes: int) -> Message:
    """Return the trace of a frame of the sequence 3."""
    return TracePlayback(LatchKey(3, 0, index), zlib.crc32(bytes([*codes, 255, 255])))


def test_a_played_frame_is_one_that_was_stored():
    whole = UploadChunk(0, STORED)
    taken = HELLO, UploadCommitReply(2)
    assert findings(*taken, played(1, 7, 8), sent=uploaded(whole)) == {}
    assert list(findings(*taken, played(1, 5, 6), sent=uploaded(whole))) == ["HG-7.6/4"]
    parts = UploadChunk(2, STORED[2:]), UploadChunk(0, STORED[:2])
    assert list(findings(*taken, played(0, 7, 8), sent=uploaded(*parts))) == ["HG-7.6/4"]


def test_of_an_upload_that_was_not_taken_as_it_was_sent_nothing_is_known():
    assert findings(HELLO, played(1, 0, 0), sent=uploaded(UploadChunk(0, STORED))) == {}
    wrong = (UploadChunk(0, STORED[:2]),), (UploadChunk(0, bytes(4)),), (UploadChunk(9, b"1"),)
    taken = HELLO, UploadCommitReply(2), played(1, 0, 0)
    assert all(findings(*taken, sent=uploaded(*chunks)) == {} for chunks in wrong)
    assert findings(*taken, sent=uploaded(UploadChunk(0, STORED), commits=4)) == {}


def upload(seq, size):
    """A request to begin an upload of sequence 1, as bytes."""
    begin = UploadBegin(UploadKind.PHASES, 0, 1, size, 0)
    return encode_frame(build_body(begin, flags=0, seq=seq, time_us=0, session=SESSION))


@pytest.mark.parametrize(
    ("answers", "words"),
    [
        ((0, 1000, 1000), ""),
        ((0, 1000, 998), "room for 998 bytes, it was 1000"),
        ((1, 1, 4000), "4000 bytes are TOO_LARGE, 4000 were taken before"),
        ((0, 1000, 1), ""),
    ],
)
def test_room_does_not_shrink_while_the_same_is_stored(answers, words):
    hello = dataclasses.replace(HELLO, max_upload_bytes=4000, max_sequence_frames=9)
    sent = b"".join(upload(seq, 4000) for seq in range(1, 4))
    told = [
        UploadBeginReply(hello.max_chunk, hello.upload_window)
        if room == 1
        else Error(UploadBegin.TYPE, ErrorCode.TOO_LARGE, room or 1000)
        for room in answers
    ]
    assert words in findings(hello, *told, sent=sent).get("HG-7.2/7", "" if not words else "none")


@pytest.mark.parametrize(("late_us", "is_report"), [(9_000, False), (30_000, True)])
def test_an_answer_that_is_late_is_told(late_us, is_report):
    found = RuleFindings()
    rules = StandingRules(found, is_lossless=True)
    rules.begin_board(lambda size: size)
    hello = ReceivedByClient(0, b"", False, message=HELLO, header=Header(0x80, 0, 0, 0, SESSION))
    rules.take(hello)
    ping = build_body(Ping(1), flags=0, seq=5, time_us=0, session=SESSION)
    rules.take_sent(encode_frame(ping), 1_000_000)
    pong, head = Pong(1, 0, 0), Header(Pong.TYPE, 0, 5, 0, SESSION)
    rules.take(ReceivedByClient(1_000_000 + late_us, b"x", False, head, pong))
    assert ("HG-4.11/3" in found.broken) is is_report

"""Each connection alone: any bytes, misuse by the caller, bounds, versions."""

import gc
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram_protocol.connection import (
    HOST_COUNTERS,
    INITIAL_RTO_US,
    INPUT_LIMIT,
    LINK_COUNTERS,
    MAX_RTO_US,
    MIN_RTO_US,
    NEED_DATA,
    BoardConnection,
    FrameDropped,
    HostConnection,
    RequestReceived,
    RequestRefused,
    RoundTripTimer,
    StreamReceived,
)
from haptogram_protocol.errors import LocalProtocolError
from haptogram_protocol.framing import FrameDecoder, encode_frame
from haptogram_protocol.messages import (
    VERSION_MAJOR,
    Arm,
    ArmReply,
    Counters,
    DisarmReply,
    Error,
    ErrorCode,
    GetConfig,
    Header,
    Hello,
    Message,
    MessageType,
    Mute,
    Phases,
    Ping,
    Play,
    Pong,
    SetConfig,
    Status,
    Trace,
    UploadBegin,
    UploadBeginReply,
    UploadChunk,
    UploadKind,
    build_body,
    parse_body,
)
from haptogram_protocol.state import LinkState, OutputState
from link_pair import NONCE, Bench, Link, hello_reply, wire
from strategies_protocol import chunkings, headers, messages, noise

PHASES = Phases(bytes(4))


def _replies(data: bytes) -> list[tuple[Header, Message]]:
    return [parse_body(body) for body in FrameDecoder().feed(data) if isinstance(body, bytes)]


def _opened_board() -> Bench:
    bench = Bench()
    bench.receive(wire(Hello(VERSION_MAJOR, 0, NONCE), seq=0, session=0), 0)
    bench.events.clear()
    bench.carried_out.clear()
    return bench


def _opened_host() -> HostConnection:
    link = Link()
    link.open()
    return link.host


# --- any bytes ---------------------------------------------------------------------------------


@st.composite
def _traffic(draw: st.DrawFn) -> bytes:
    """Frames of every kind, mostly of the open session, with garbage between and damage inside."""
    parts = []
    for _ in range(draw(st.integers(0, 5))):
        fields = draw(headers)
        fields["session"] = draw(st.sampled_from([NONCE, NONCE, NONCE, 0, 1]))
        fields["flags"] &= draw(st.sampled_from([0x0F, 0x1F, 0xFF]))
        frame = bytearray(encode_frame(build_body(draw(messages), **fields)))
        if draw(st.integers(0, 4)) == 0:
            frame[draw(st.integers(0, len(frame) - 1))] ^= draw(st.integers(1, 255))
        parts.append(bytes(frame) + draw(st.one_of(st.just(b""), noise)))
    return b"".join(parts)


def _board_run(chunks: list[bytes]) -> tuple[list[object], bytes, dict[str, int]]:
    bench = _opened_board()
    answers = b"".join(bench.receive(chunk, 5) for chunk in chunks)
    return bench.events, answers, bench.connection.counters


@given(_traffic().flatmap(lambda data: st.tuples(st.just(data), chunkings(data))))
def test_a_board_sees_the_same_in_every_chunking(case: tuple[bytes, list[bytes]]) -> None:
    data, chunks = case
    assert _board_run(chunks) == _board_run([data])


@given(_traffic())
def test_a_board_counts_every_frame_exactly_once(data: bytes) -> None:
    events, _, counters = _board_run([data])
    streamed = sum(isinstance(event, StreamReceived) for event in events)
    ends = ["requests", "repeated", "duplicate", "stale_session", "bad_length", "bad_value"]
    ends += ["unknown_type", "unsupported"]
    assert counters["frames"] == streamed + sum(counters[name] for name in ends)  # HG-3.9/2
    dropped = [event.reason for event in events if isinstance(event, FrameDropped)]
    for name in set(LINK_COUNTERS) - {"frames", "gap", "requests"}:
        assert counters[name] == dropped.count(name)


def _host_run(chunks: list[bytes]) -> tuple[list[object], dict[str, int], LinkState]:
    host = _opened_host()
    host.send_request(Ping(1), 0)
    events: list[object] = []
    for chunk in chunks:
        host.receive_data(chunk, 5)
        while (event := host.next_event()) is not NEED_DATA:
            events.append(event)
    return events, host.counters, host.link_state


@given(_traffic().flatmap(lambda data: st.tuples(st.just(data), chunkings(data))))
def test_a_host_sees_the_same_in_every_chunking(case: tuple[bytes, list[bytes]]) -> None:
    data, chunks = case
    assert _host_run(chunks) == _host_run([data])


@given(noise)
def test_noise_gives_nothing_but_dropped_frames_at_either_end(data: bytes) -> None:
    events, answers, _ = _board_run([data])
    assert answers == b""
    events += _host_run([data])[0]
    assert all(isinstance(event, FrameDropped) for event in events)
    assert {event.reason for event in events} <= {"crc", "cobs", "short", "oversize"}


def test_memory_stays_bounded_however_long_the_noise() -> None:
    source = random.Random(2)
    chunks = [source.randbytes(500), b"\1\0" * 250, b"\7" * 5000, b"\0" * 500]
    chunks.append(wire(Ping(1), seq=1, session=1) * 20)
    bench, host = _opened_board(), _opened_host()
    gc.disable()  # as in a real-time process: nothing may wait for the cycle collector
    try:
        for _ in range(300):  # until the board's output is full, which nobody reads
            _drain(bench.connection, chunks)
        before = len(gc.get_objects())
        for _ in range(20):
            _drain(bench.connection, chunks)
            _drain(host, chunks)
        assert len(gc.get_objects()) - before < 20
    finally:
        gc.enable()
    assert 60_000 < bench.connection.output_bytes <= 65_536


def _drain(connection: BoardConnection | HostConnection, chunks: list[bytes]) -> None:
    for chunk in chunks:
        connection.receive_data(chunk, 0)
        while connection.next_event() is not NEED_DATA:
            pass


@pytest.mark.parametrize("make", [_opened_host, lambda: _opened_board().connection])
def test_who_never_takes_the_events_is_told(make) -> None:
    connection = make()
    connection.receive_data(bytes(INPUT_LIMIT), 0)
    with pytest.raises(LocalProtocolError, match=str(INPUT_LIMIT)):
        connection.receive_data(b"\0", 0)
    assert connection.next_event() is NEED_DATA  # all of it was empty frames
    connection.receive_data(b"\0", 0)


# --- the board's end ---------------------------------------------------------------------------

REFUSED = {
    "unknown request": (b"\x7f\0\1\0" + bytes(4) + b"\xed\x5e", ErrorCode.UNSUPPORTED, 0x7F),
    "must-understand flag": (
        build_body(Arm(), flags=0x80, seq=1, time_us=0, session=NONCE),
        ErrorCode.UNSUPPORTED,
        0x80,
    ),
    "IMMEDIATE where it has no meaning": (
        build_body(Arm(), flags=0x10, seq=1, time_us=0, session=NONCE),
        ErrorCode.UNSUPPORTED,
        0x10,
    ),
    "payload too long": (
        build_body(Ping(1), flags=0, seq=1, time_us=0, session=NONCE) + b"\0",
        ErrorCode.BAD_LENGTH,
        8,
    ),
    "fixed part of a tail too short": (
        build_body(UploadChunk(1, b""), flags=0, seq=1, time_us=0, session=NONCE)[:-1],
        ErrorCode.BAD_LENGTH,
        0,
    ),
    "value out of range": (
        build_body(GetConfig(), flags=0, seq=1, time_us=0, session=NONCE).replace(b"\x46", b"\x47")
        + bytes(16)
        + b"\x09\0\0\0",
        ErrorCode.BAD_VALUE,
        SetConfig.WIRE["config"].record.WIRE["trace_mode"].offset,
    ),
    "stale session": (
        build_body(Arm(), flags=0, seq=1, time_us=0, session=7),
        ErrorCode.STALE_SESSION,
        NONCE,
    ),
    "another major version": (
        build_body(Hello(1, 0, 9, 0), flags=0, seq=0, time_us=0, session=0),
        ErrorCode.VERSION,
        2,
    ),
    "nonce 0": (
        build_body(Hello(VERSION_MAJOR, 0, 0, 0), flags=0, seq=0, time_us=0, session=0),
        ErrorCode.BAD_VALUE,
        2,
    ),
    "a number that was used": (
        build_body(Arm(), flags=0, seq=0, time_us=0, session=NONCE),
        ErrorCode.SEQUENCE_REUSED,
        0,
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_the_link_refuses_by_itself(name: str) -> None:
    body, code, detail = REFUSED[name]
    bench = _opened_board()
    ((header, error),) = _replies(bench.receive(encode_frame(body), 77))
    assert error == Error(request=body[0], code=code, detail=detail)
    assert header.session == (0 if code is ErrorCode.STALE_SESSION else NONCE)
    assert header.seq == int.from_bytes(body[2:4], "little")
    assert header.time_us == 77
    assert bench.carried_out == []
    assert bench.connection.session == NONCE
    # HG-4.9/4: nothing of it is remembered, and its number is free; but for a value.
    bench.receive(wire(Ping(5), seq=1, session=NONCE), 78)
    is_remembered = name == "value out of range"
    assert bench.carried_out == [] if is_remembered else [Ping(5)]
    counters = bench.connection.counters
    assert (counters["requests"], counters["bad_value"], counters["unsupported"]) == (3, 0, 0)


def test_the_same_number_with_other_bytes_is_refused() -> None:
    bench = _opened_board()
    bench.receive(wire(Ping(1), seq=1, session=NONCE), 0)
    ((_, error),) = _replies(bench.receive(wire(Ping(2), seq=1, session=NONCE), 0))
    assert error.code == ErrorCode.SEQUENCE_REUSED
    assert bench.carried_out == [Ping(1)]


def test_a_repeated_request_gets_the_same_bytes() -> None:
    bench = _opened_board()
    ask = wire(Ping(1), seq=1, session=NONCE)
    first, again = bench.receive(ask, 10), bench.receive(ask, 9999)
    assert first == again
    assert bench.carried_out == [Ping(1)]


def test_upload_chunks_and_mute_are_done_every_time_and_forget_nothing() -> None:
    bench = _opened_board()
    arm = wire(Arm(), seq=1, session=NONCE)
    chunk = wire(UploadChunk(0, b"abc"), seq=2, session=NONCE)
    mute = wire(Mute(), seq=3, session=NONCE)
    bench.receive(arm + chunk + chunk + mute + mute + arm, 0)
    assert [type(m) for m in bench.carried_out] == [Arm, UploadChunk, UploadChunk, Mute, Mute]
    assert bench.connection.counters["repeated"] == 1


def test_a_strangers_mute_uses_up_no_number_of_the_session() -> None:
    bench = _opened_board()
    bench.receive(wire(Mute(), seq=30_000, session=0) + wire(Ping(1), seq=1, session=NONCE), 0)
    assert bench.carried_out == [Mute(), Ping(1)]


def test_a_late_copy_of_a_chunk_does_not_make_used_numbers_free() -> None:
    bench = _opened_board()
    chunk = wire(UploadChunk(0, b"abc"), seq=1, session=NONCE)
    bench.receive(chunk + wire(Ping(2), seq=3, session=NONCE) + chunk, 0)
    ((_, error),) = _replies(bench.receive(wire(Ping(3), seq=2, session=NONCE), 0))
    assert error.code == ErrorCode.SEQUENCE_REUSED


def test_play_carries_its_start_time() -> None:
    bench = _opened_board()
    play = Play(1, 1000, 1, 1)
    bench.receive(wire(play, seq=1, session=NONCE, time_us=123), 0)
    bench.receive(wire(play, seq=2, session=NONCE, time_us=5, flags=0x10), 0)
    requests = [event for event in bench.events if isinstance(event, RequestReceived)]
    assert [(event.t_wire_us, event.immediate) for event in requests] == [(123, False), (5, True)]


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (encode_frame(b"\x3f\0\xf0\xff" + bytes(4) + b"\xed\x5e"), "unknown_type"),
        (wire(Pong(1, 2, 3), seq=0, session=NONCE), "unknown_type"),
        (wire(Trace(1, 2), seq=0, session=NONCE), "unknown_type"),
        (wire(PHASES, seq=0xFFF0, session=NONCE, flags=0x20), "unsupported"),
        (encode_frame(b"\2\0\xf0\xff" + bytes(4) + b"\xed\x5e\x08"), "bad_length"),
        (wire(PHASES, seq=0xFFF0, session=1), "stale_session"),
        (wire(PHASES, seq=0xFFEF, session=NONCE), "duplicate"),
    ],
)
def test_what_is_dropped_is_counted_and_not_answered(frame: bytes, reason: str) -> None:
    bench = _opened_board()
    assert bench.receive(frame, 0) == b""
    (event,) = bench.events
    assert (event.reason, bench.connection.counters[reason]) == (reason, 1)


@pytest.mark.parametrize(
    "damaged",
    [
        encode_frame(b"\x3f\0\xf0\xff" + bytes(4) + b"\xed\x5e"),
        wire(PHASES, seq=0xFFF0, session=NONCE, flags=0x20),
        encode_frame(b"\2\0\xf0\xff" + bytes(4) + b"\xed\x5e\x08"),
    ],
)
def test_a_dropped_stream_frame_uses_up_its_number(damaged: bytes) -> None:
    bench = _opened_board()
    bench.receive(damaged + wire(PHASES, seq=0xFFF1, session=NONCE), 0)
    assert bench.streamed == [0xFFF1]
    assert bench.connection.counters["gap"] == 0  # HG-5.6/1


def test_low_flags_that_are_unknown_are_ignored() -> None:
    bench = _opened_board()
    bench.receive(wire(PHASES, seq=0xFFF0, session=NONCE, flags=0x0F), 0)
    assert bench.streamed == [0xFFF0]


def test_no_session_no_events() -> None:
    board = BoardConnection()
    assert not board.send_event(Trace(1, 2), now_us=0)
    board.open_session(NONCE)
    assert board.send_event(Trace(1, 2), now_us=2**32 + 3)
    ((header, _),) = _replies(board.data_to_send())
    assert (header.seq, header.time_us, header.session) == (0, 3, NONCE)


def test_trace_gives_way_before_status_and_status_before_nothing_is_left() -> None:
    board = BoardConnection(output_limit=400)
    board.open_session(NONCE)
    status = Status.deserialize(bytes(Status.LAYOUT.size))
    while board.send_event(Trace(1, 2), now_us=0, droppable=True):
        pass
    assert board.output_bytes <= 200
    assert board.send_event(status, now_us=0)
    assert not board.send_event(status, now_us=0)
    taken = _replies(board.data_to_send())
    assert [header.seq for header, _ in taken] == list(range(len(taken)))  # HG-9.5/1


def test_output_is_taken_by_whole_frames() -> None:
    board = BoardConnection()
    board.open_session(NONCE)
    for number in range(3):
        board.send_event(Trace(number, 0), now_us=0)
    size = board.output_bytes // 3
    assert board.data_to_send(size - 1) == b""
    assert len(board.data_to_send(2 * size + 1)) == 2 * size
    assert len(board.data_to_send()) == size
    assert board.output_bytes == 0


def test_misuse_of_the_boards_end() -> None:
    bench = _opened_board()
    board = bench.connection
    board.receive_data(wire(Arm(), seq=1, session=NONCE), 0)
    request = board.next_event()
    assert isinstance(request, RequestReceived)
    with pytest.raises(LocalProtocolError, match="DISARM_REPLY"):
        board.reply(request, DisarmReply(OutputState.DISARMED), 0)
    with pytest.raises(LocalProtocolError, match="ARM_REPLY is not an event"):
        board.send_event(ArmReply(OutputState.ARMED), now_us=0)
    with pytest.raises(LocalProtocolError, match="no link counter 'latched'"):
        board.count("latched")
    for nonce in (0, 65536):
        with pytest.raises(LocalProtocolError, match=str(nonce)):
            board.open_session(nonce)
    board.receive_data(wire(Hello(VERSION_MAJOR, 0, 9, 0), seq=0, session=0), 0)
    hello = board.next_event()
    with pytest.raises(LocalProtocolError, match="nonce 9"):
        board.reply(hello, hello_reply(9), 0)  # without open_session


def test_counters_wrap_and_bear_the_names_of_the_status() -> None:
    board = BoardConnection()
    board.count("bad_value", 2**32 + 5)
    assert board.counters["bad_value"] == 5
    assert set(LINK_COUNTERS) | set(HOST_COUNTERS) <= set(Counters.WIRE)


# --- the host's end ----------------------------------------------------------------------------


def test_misuse_of_the_hosts_end() -> None:
    for nonce in (0, 65536):
        with pytest.raises(LocalProtocolError, match=str(nonce)):
            HostConnection(nonce=nonce)
    host = HostConnection(nonce=NONCE)
    with pytest.raises(LocalProtocolError, match=r"REQUEST_SENT.*CLOSED"):
        host.send_request(Arm(), 0)
    with pytest.raises(LocalProtocolError, match=r"STREAM_SENT.*CLOSED"):
        host.stream_frame(PHASES, t_apply_us=0)
    with pytest.raises(LocalProtocolError, match=r"REQUEST_SENT.*CLOSED"):
        host.send_chunk(UploadChunk(0, b""), 0)
    host = _opened_host()
    for message in (
        Hello(VERSION_MAJOR, 0, 1, 0),
        Mute(),
        UploadChunk(0, b""),
        PHASES,
        Pong(1, 2, 3),
    ):
        with pytest.raises(LocalProtocolError, match=message.TYPE.name):
            host.send_request(message, 0)
    with pytest.raises(LocalProtocolError, match="ARM takes no time"):
        host.send_request(Arm(), 0, immediate=True)
    host.send_request(Ping(1), 0)
    with pytest.raises(LocalProtocolError, match="ARM while PING waits"):
        host.send_request(Arm(), 0)
    with pytest.raises(LocalProtocolError, match="UPLOAD_CHUNK while PING waits"):
        host.send_chunk(UploadChunk(0, b""), 0)


def test_the_window_of_chunks_is_kept() -> None:
    host = _opened_host()
    host.send_chunk(UploadChunk(0, b"a"), 0)
    with pytest.raises(LocalProtocolError, match="the window is 1"):
        host.send_chunk(UploadChunk(1, b"b"), 0)
    with pytest.raises(LocalProtocolError, match="ARM while UPLOAD_CHUNK waits"):
        host.send_request(Arm(), 0)


def test_a_window_of_zero_is_taken_as_one() -> None:
    link = Link()
    link.open()
    seq = link.host.send_request(_upload_begin(), 0)
    link.host.receive_data(wire(UploadBeginReply(16, 0), seq=seq, session=NONCE), 1)
    link.collect()
    assert link.host.chunks_free == 1


def _upload_begin() -> Message:
    return UploadBegin(UploadKind.PHASES, 0, 1, 16, 0)


def test_play_may_name_a_start_or_none() -> None:
    host = _opened_host()
    host.send_request(Play(1, 1000, 1, 1), 0, t_apply_us=2**32 + 9)
    ((header, _),) = _replies(host.data_to_send())
    assert (header.flags, header.time_us) == (0, 9)
    host = _opened_host()
    host.send_request(Play(1, 1000, 1, 1), 0, immediate=True, t_apply_us=5)
    ((header, _),) = _replies(host.data_to_send())
    assert (header.flags, header.time_us) == (0x10, 0)


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (wire(ArmReply(OutputState.ARMED), seq=1, session=NONCE), "duplicate"),  # asked was PING
        (wire(Pong(1, 2, 3), seq=2, session=NONCE), "duplicate"),
        (wire(Error(MessageType.ARM, 1, 0), seq=1, session=NONCE), "duplicate"),
        (wire(Pong(1, 2, 3), seq=1, session=NONCE + 1), "stale_session"),
        (wire(Error(MessageType.PING, 1, 0), seq=1, session=NONCE + 1), "stale_session"),
        (wire(Trace(1, 2), seq=0, session=NONCE + 1), "stale_session"),
        (wire(Pong(1, 2, 3), seq=1, session=NONCE, flags=0x80), "unsupported"),
        (wire(Ping(1), seq=1, session=NONCE), "unknown_type"),  # its own echo
        (wire(PHASES, seq=1, session=NONCE), "unknown_type"),
        (encode_frame(b"\xff" + bytes(9)), "unknown_type"),
        (encode_frame(b"\x84" + bytes(9)), "bad_length"),
    ],
)
def test_what_the_host_ignores(frame: bytes, reason: str) -> None:
    events, counters, state = _host_run([frame])
    assert [event.reason for event in events] == [reason]
    assert counters[reason] == 1
    assert state is LinkState.OPEN


def test_bytes_without_frames_tell_a_wrong_protocol() -> None:
    host = HostConnection(nonce=NONCE)
    host.receive_data(b"Hello, I am a printer\r\n\0", 0)
    assert isinstance(host.next_event(), FrameDropped)
    assert (host.bytes_received, host.frames_received) == (24, 0)


def _greeted(**changes: int) -> tuple[HostConnection, object]:
    host = HostConnection(nonce=NONCE)
    host.send_hello(0)
    host.receive_data(wire(hello_reply(NONCE, **changes), seq=0, session=NONCE), 1)
    return host, host.next_event()


def test_differences_that_do_no_harm_are_warnings() -> None:
    host, _ = _greeted(minor=3)
    assert host.link_state is LinkState.OPEN
    assert host.warnings == ["board speaks version 2.3, host 2.0: both use 2.0"]


def test_another_major_version_is_refused_by_either_end() -> None:
    host, event = _greeted(major=1)
    assert isinstance(event, RequestRefused)
    assert (event.error.code, event.error.detail) == (ErrorCode.VERSION, 1)
    assert host.link_state is LinkState.FAILED
    assert host.identity is None
    host.send_hello(5)
    host.receive_data(wire(Error(MessageType.HELLO, ErrorCode.VERSION, 3), seq=1, session=0), 6)
    assert host.next_event().error.detail == 3
    assert host.link_state is LinkState.FAILED


def test_a_reply_to_another_hosts_greeting_is_not_for_this_one() -> None:
    host = HostConnection(nonce=NONCE)
    host.send_hello(0)
    host.receive_data(wire(hello_reply(NONCE + 1), seq=0, session=NONCE + 1), 1)
    assert host.next_event().reason == "stale_session"
    assert host.link_state is LinkState.GREETING


def test_a_refused_mute_while_greeting_leaves_the_greeting_alone() -> None:
    host = HostConnection(nonce=NONCE)
    host.send_hello(0)
    seq = host.send_mute(0)
    host.receive_data(wire(Error(MessageType.MUTE, 12, 0), seq=seq, session=0), 1)
    assert isinstance(host.next_event(), RequestRefused)
    assert host.link_state is LinkState.GREETING


def test_closing_the_port_forgets_everything_that_waits() -> None:
    host = _opened_host()
    host.send_request(Ping(1), 0)
    host.receive_data(wire(Pong(1, 2, 3), seq=1, session=NONCE) + b"\5half a frame", 0)
    host.port_closed()
    assert host.link_state is LinkState.CLOSED
    assert host.next_deadline_us() is None
    assert (host.data_to_send(), host.next_event()) == (b"", NEED_DATA)


def test_a_mute_does_not_wait_for_a_backed_off_timer() -> None:
    link = Link(latency_us=700_000)  # slower than the first timeout, so nothing is measured
    link.host.send_hello(0)
    link.wait_idle()
    link.to_board = lambda _: []
    for number in range(2):
        link.request(Ping(number))  # the timeout is now at its longest
    link.host.send_request(Ping(9), link.now_us)
    assert link.host.next_deadline_us() == link.now_us + MAX_RTO_US
    link.host.send_mute(link.now_us)
    assert link.host.next_deadline_us() == link.now_us + INITIAL_RTO_US


def test_a_mute_names_the_session_only_if_there_is_one() -> None:
    host = HostConnection(nonce=NONCE)
    host.send_mute(0)
    opened = _opened_host()
    opened.send_mute(0)
    sent = [_replies(each.data_to_send())[0][0].session for each in (host, opened)]
    assert sent == [0, NONCE]  # HG-3.7/1


def test_nothing_is_sent_again_before_its_time() -> None:
    host = HostConnection(nonce=NONCE)
    host.send_hello(10)
    first = host.data_to_send()
    host.advance_to(10 + INITIAL_RTO_US - 1)
    assert host.data_to_send() == b""
    host.advance_to(10 + INITIAL_RTO_US)
    assert host.data_to_send() == first
    assert host.next_deadline_us() == 10 + 3 * INITIAL_RTO_US


# --- the timer (RFC 6298) ----------------------------------------------------------------------


def test_the_first_round_trip_gives_three_of_itself() -> None:
    timer = RoundTripTimer()
    timer.add_sample(100_000)
    assert timer.rto_us == 300_000  # SRTT = R, RTTVAR = R / 2, RTO = SRTT + 4 RTTVAR


def test_the_second_round_trip_counts_for_an_eighth_and_a_quarter() -> None:
    timer = RoundTripTimer()
    timer.add_sample(100_000)
    timer.add_sample(180_000)
    # RTTVAR = 3/4 50 ms + 1/4 |100 ms - 180 ms|, SRTT = 7/8 100 ms + 1/8 180 ms
    assert timer.rto_us == 110_000 + 4 * 57_500


def test_equal_round_trips_bring_the_timeout_down_to_them() -> None:
    timer = RoundTripTimer()
    for _ in range(60):
        timer.add_sample(200_000)
    assert timer.rto_us == pytest.approx(200_000, rel=0.01)


@given(st.lists(st.one_of(st.integers(0, 10_000_000), st.none()), max_size=60))
def test_the_timeout_stays_in_its_bounds(samples: list[int | None]) -> None:
    timer = RoundTripTimer()
    for sample in samples:
        before_us = timer.rto_us
        if sample is None:
            timer.back_off()
            assert timer.rto_us == min(2 * before_us, MAX_RTO_US)
        else:
            timer.add_sample(sample)
        assert MIN_RTO_US <= timer.rto_us <= MAX_RTO_US

"""Host and board end to end: what is lost, repeated or stale, and what becomes of it."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram_protocol.connection import (
    EventReceived,
    FrameDropped,
    HostConnection,
    ReplyReceived,
    RequestRefused,
    RequestTimedOut,
    StreamReceived,
)
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    VERSION_MAJOR,
    Arm,
    ArmReply,
    Disarm,
    ErrorCode,
    GetStatus,
    Hello,
    HelloReply,
    MessageType,
    Mute,
    MuteReply,
    Phases,
    Ping,
    Pong,
    Trace,
    UploadBegin,
    UploadChunk,
    UploadCommit,
    build_body,
)
from haptogram_protocol.state import LinkState, OutputState
from link_pair import BOARD_AHEAD_US, NONCE, Bench, Link, losing, wire

PHASES = Phases(bytes(4))


@pytest.fixture
def link() -> Link:
    opened = Link()
    opened.open()
    return opened


def test_greeting_opens_the_link() -> None:
    link = Link()
    assert link.host.send_hello(0) == 0
    assert link.host.link_state is LinkState.GREETING
    link.wait_idle()
    assert link.host.link_state is LinkState.OPEN
    assert link.host.identity == link.events[0].message
    assert link.host.warnings == []
    assert link.bench.connection.session == NONCE
    assert link.events[0].rtt_us == 2000
    assert link.events[0].t_device_us == (BOARD_AHEAD_US + 1000) & 0xFFFFFFFF


def test_a_lost_greeting_is_sent_again_and_a_lost_reply_opens_one_session() -> None:
    for loss in ({"to_board": losing(0)}, {"to_host": losing(0)}):
        link = Link(**loss)
        link.host.send_hello(0)
        link.wait_idle()
        assert link.host.link_state is LinkState.OPEN
        assert link.bench.carried_out == [Hello(VERSION_MAJOR, 0, NONCE)]


def test_the_same_nonce_again_has_no_side_effect_and_the_first_state(link: Link) -> None:
    assert link.request(Arm()).message == ArmReply(OutputState.ARMED)
    done = list(link.bench.carried_out)
    link.host.send_hello(link.now_us)
    link.wait_idle()
    assert link.events[-1].message.state is OutputState.DISARMED  # HG-4.6/1
    assert link.bench.carried_out == done
    assert link.bench.state is OutputState.ARMED
    assert isinstance(link.request(Ping(1)), ReplyReceived)


def test_a_new_nonce_mutes_and_starts_the_sequences_anew(link: Link) -> None:
    link.request(Arm())
    for _ in range(3):
        link.exchange(link.host.stream_frame(PHASES, t_apply_us=5)[1])
    link.host = HostConnection(nonce=NONCE + 1)
    link.open()
    assert link.bench.state is OutputState.DISARMED
    link.request(Arm())
    index, frame = link.host.stream_frame(PHASES, t_apply_us=None)
    link.exchange(frame)
    assert index == link.bench.streamed[-1] == 0xFFF0
    assert link.bench.connection.counters["gap"] == 0


def test_a_lost_reply_is_given_again_and_the_request_is_done_once(link: Link) -> None:
    link.to_host = losing(0, 1)
    reply = link.request(Arm())
    assert reply.message == ArmReply(OutputState.ARMED)
    assert reply.rtt_us is None  # Karn: sent three times, so nobody knows
    assert link.bench.carried_out.count(Arm()) == 1
    assert link.bench.connection.counters["repeated"] == 2


@given(st.lists(st.booleans(), max_size=40), st.lists(st.booleans(), max_size=40))
def test_whatever_is_lost_or_repeated_each_request_is_done_at_most_once(
    up: list[bool], down: list[bool]
) -> None:
    def line(fates: list[bool]):
        losses = itertools.chain(fates, itertools.repeat(False))
        return lambda chunk: [] if next(losses) else [chunk, chunk]

    link = Link(to_board=line(up), to_host=line(down))
    link.host.send_hello(0)
    link.wait_idle()
    if link.host.link_state is not LinkState.OPEN:
        assert link.events == [RequestTimedOut(MessageType.HELLO, 0, 5)]
        return
    for number in range(4):
        link.events.clear()
        link.host.send_request(Ping(number), link.now_us)
        link.wait_idle()
        ends = [e for e in link.events if isinstance(e, ReplyReceived | RequestTimedOut)]
        assert len(ends) == 1
        assert link.bench.carried_out.count(Ping(number)) <= 1
        if isinstance(ends[0], ReplyReceived):
            assert ends[0].message.echo == number
            assert link.bench.carried_out.count(Ping(number)) == 1


def test_a_silent_board_times_out_after_five_attempts() -> None:
    link = Link(to_board=lambda _: [])
    link.host.send_hello(0)
    link.wait_idle()
    assert link.events == [RequestTimedOut(MessageType.HELLO, 0, 5)]
    assert link.host.link_state is LinkState.FAILED
    assert link.now_us == 250_000 + 500_000 + 1_000_000 + 2_000_000 + 2_000_000
    link.to_board = lambda chunk: [chunk]
    link.open()
    assert link.host.link_state is LinkState.OPEN


def test_a_request_that_times_out_leaves_the_link_open(link: Link) -> None:
    link.to_board = lambda _: []
    assert link.request(Arm()) == RequestTimedOut(MessageType.ARM, 1, 5)
    link.to_board = lambda chunk: [chunk]
    assert isinstance(link.request(Ping(1)), ReplyReceived)


def test_a_refusal_names_the_request_and_is_remembered(link: Link) -> None:
    link.to_host = losing(0)
    refused = link.request(GetStatus())
    assert isinstance(refused, RequestRefused)
    assert (refused.request, refused.error.code) == (MessageType.GET_STATUS, ErrorCode.BUSY)
    assert link.bench.carried_out.count(GetStatus()) == 1
    assert link.host.link_state is LinkState.OPEN


def test_after_a_reset_of_the_board_the_session_is_stale(link: Link) -> None:
    link.bench = Bench()
    refused = link.request(Arm())
    assert (refused.error.code, refused.error.detail) == (ErrorCode.STALE_SESSION, 0)
    assert link.bench.carried_out == []
    assert link.bench.state is OutputState.DISARMED


def test_another_hosts_session_is_stale_but_its_mute_is_obeyed(link: Link) -> None:
    link.request(Arm())
    stranger = Link(host=HostConnection(nonce=1), bench=link.bench, now_us=link.now_us)
    stranger.exchange(wire(Disarm(), seq=1, session=1))
    assert link.bench.state is OutputState.ARMED
    assert link.bench.connection.counters["stale_session"] == 0  # a request: ERROR tells of it
    stranger.exchange(wire(PHASES, seq=0xFFF0, session=1))
    assert link.bench.connection.counters["stale_session"] == 1
    stranger.host.send_mute(stranger.now_us)  # no session of its own: 0
    stranger.wait_idle()
    assert link.bench.state is OutputState.MUTED
    assert stranger.events[-1].message == MuteReply(OutputState.MUTED)
    assert isinstance(link.request(Ping(3)), ReplyReceived)


def test_a_strangers_mute_does_not_make_an_old_arm_new(link: Link) -> None:
    arm = wire(Arm(), seq=1, session=NONCE)
    link.exchange(arm)
    link.exchange(wire(Mute(), seq=0, session=0))
    link.exchange(arm)  # a late copy
    assert link.bench.state is OutputState.MUTED
    assert link.bench.carried_out.count(Arm()) == 1


def test_a_late_copy_of_arm_does_not_undo_disarm(link: Link) -> None:
    arm = wire(Arm(), seq=1, session=NONCE)
    link.exchange(arm + wire(Disarm(), seq=2, session=NONCE) + arm)
    assert link.bench.state is OutputState.DISARMED  # HG-4.9/3
    assert link.bench.carried_out[-1] == Disarm()


@pytest.mark.parametrize("flags", [0, 0xFF])
@pytest.mark.parametrize("session", [0, 1, NONCE])
@pytest.mark.parametrize("trailing", [b"", b"from a later minor version"])
def test_mute_is_obeyed_whatever_it_looks_like(
    link: Link, flags: int, session: int, trailing: bytes
) -> None:
    link.request(Arm())
    body = build_body(Mute(), flags=flags, seq=1, time_us=9, session=session) + trailing
    link.exchange(encode_frame(body))
    assert link.bench.state is OutputState.MUTED


def test_mute_without_a_session_is_obeyed_at_power_up() -> None:
    link = Link()
    link.host.send_mute(0)
    link.wait_idle()
    assert link.events[-1].message == MuteReply(OutputState.MUTED)
    assert link.host.link_state is LinkState.CLOSED


def test_mute_overtakes_a_request_that_waits(link: Link) -> None:
    link.to_board = losing(0)
    link.host.send_request(Arm(), link.now_us)
    link.exchange()
    seq = link.host.send_mute(link.now_us)
    assert link.host.outstanding == 1
    link.wait_idle()
    assert link.events[-1].seq == seq
    assert Arm() not in link.bench.carried_out


def test_mute_beside_a_greeting_lets_both_be_answered() -> None:
    link = Link()
    link.host.send_hello(0)
    link.host.send_mute(0)
    link.wait_idle()
    assert [event.request for event in link.events] == [MessageType.HELLO, MessageType.MUTE]
    assert link.host.link_state is LinkState.OPEN


def test_an_unanswered_mute_on_a_closed_link_times_out() -> None:
    link = Link(to_board=lambda _: [])
    link.host.send_mute(0)
    link.wait_idle()
    assert link.events == [RequestTimedOut(MessageType.MUTE, 0, 5)]
    assert link.host.link_state is LinkState.CLOSED


def test_the_stream_crosses_the_wrap_and_counts_gaps_and_duplicates(link: Link) -> None:
    frames = [link.host.stream_frame(PHASES, t_apply_us=n) for n in range(40)]
    assert [index for index, _ in frames] == list(range(0xFFF0, 0xFFF0 + 40))
    for number, (_, frame) in enumerate(frames):
        if number in (8, 20, 21):
            continue  # lost
        link.exchange(frame)
        if number in (10, 30):
            link.exchange(frame)  # twice
    link.exchange(frames[8][1])  # 32 before the one expected (HG-5.5/1)
    assert link.bench.streamed == [i for i, _ in frames if i - 0xFFF0 not in (8, 20, 21)]
    counters = link.bench.connection.counters
    assert (counters["gap"], counters["duplicate"]) == (3, 3)


def test_frames_that_are_skipped_count_as_those_that_came(link: Link) -> None:
    came, skipped = link, Link()
    skipped.open()
    board = skipped.bench.connection
    for number in range(40):
        frames = [one.host.stream_frame(PHASES, t_apply_us=number)[1] for one in (came, skipped)]
        if number == 30:
            continue  # lost
        came.exchange(frames[0])
        if 5 <= number < 25:
            board.skip_stream(1)
        else:
            skipped.exchange(frames[1])
        assert board.next_stream_index == came.bench.connection.next_stream_index
    assert board.counters == came.bench.connection.counters
    assert board.counters["gap"] == 1


def test_the_stream_survives_two_wraps(link: Link) -> None:
    step = 65_504  # the longest cut that is no copy: 65 503 frames are missing (HG-5.5/2)
    for number in range(2 * step + 1):
        index, frame = link.host.stream_frame(PHASES, t_apply_us=None)
        if number % step == 0:
            link.exchange(frame)
    assert link.bench.streamed == [0xFFF0, 0xFFF0 + step, 0xFFF0 + 2 * step]
    assert index == 0xFFF0 + 2 * step


def test_an_upload_goes_by_the_window_and_survives_losses(link: Link) -> None:
    data = bytes(range(1, 161))
    link.request(UploadBegin(1, 0, 1, len(data), 0))
    link.to_board, link.to_host = losing(0, 3), losing(2)
    waiting = [UploadChunk(at, data[at : at + 16]) for at in range(0, len(data), 16)]
    assert link.host.chunks_free == 4
    while waiting:
        while waiting and link.host.chunks_free:
            link.host.send_chunk(waiting.pop(0), link.now_us)
        link.wait_idle()
    link.request(UploadCommit(1))
    assert link.bench.upload == data
    answered = [e for e in link.events if isinstance(e, ReplyReceived)]
    assert sum(e.request is MessageType.UPLOAD_CHUNK for e in answered) == 10


def test_events_show_their_gaps(link: Link) -> None:
    board = link.bench.connection
    sent = []
    for number in range(6):
        assert board.send_event(Trace(number, 0), now_us=BOARD_AHEAD_US + number, flags=1)
        sent.append(board.data_to_send())
    for frame in (sent[0], sent[1], sent[4], sent[1], sent[5]):
        link.host.receive_data(frame, 7)
    link.collect()
    received = [e for e in link.events if isinstance(e, EventReceived)]
    assert [(e.message.index, e.gap, e.header.flags) for e in received] == [
        (0, 0, 1),
        (1, 0, 1),
        (4, 2, 1),
        (5, 0, 1),
    ]
    assert [e.reason for e in link.events if isinstance(e, FrameDropped)] == ["duplicate"]
    assert link.host.counters["gap"] == 2


@given(st.binary(max_size=60), st.binary(max_size=60))
def test_garbage_around_frames_costs_neither_side_a_frame(before: bytes, after: bytes) -> None:
    link = Link(
        to_board=lambda chunk: [before + chunk + after],
        to_host=lambda chunk: [before + chunk + after],
    )
    link.open()
    assert link.host.link_state is LinkState.OPEN
    answer = link.request(Ping(2**64 - 1))
    replies = [e for e in link.events if isinstance(e, ReplyReceived)]
    assert isinstance(answer, ReplyReceived | FrameDropped)
    assert [e.message.echo for e in replies if isinstance(e.message, Pong)] == [2**64 - 1]
    assert replies[0].rtt_us == 2000  # at the first attempt


def test_the_lease_is_renewed_by_every_frame_of_the_session_and_by_no_other(link: Link) -> None:
    header = {"flags": 0, "seq": 9, "time_us": 0}
    unknown = encode_frame(b"\x3f" + build_body(PHASES, session=NONCE, **header)[1:])
    bad_crc = bytearray(wire(Ping(1), seq=50, session=NONCE))
    bad_crc[-2] ^= 1
    cases = [
        (wire(PHASES, seq=0xFFF0, session=NONCE), True),
        (wire(PHASES, seq=0xFFF0, session=NONCE, flags=0x80), True),  # a duplicate, too
        (unknown, True),
        (wire(Ping(1), seq=1, session=NONCE), True),
        (wire(Ping(1), seq=1, session=NONCE), True),  # repeated
        (wire(Pong(1, 2, 3), seq=1, session=NONCE), True),  # nonsense, but of the session
        (wire(PHASES, seq=0xFFF1, session=NONCE + 1), False),
        (wire(Ping(1), seq=1, session=0), False),
        (wire(Mute(), seq=1, session=0), False),
        (wire(Hello(VERSION_MAJOR, 0, NONCE), seq=1, session=NONCE), False),  # repeated
        (wire(Hello(VERSION_MAJOR, 0, 0), seq=1, session=NONCE), False),  # refused
        (bytes(bad_crc), False),
    ]
    for frame, renews in cases:
        link.bench.events.clear()
        link.exchange(frame)
        assert [event.renews_lease for event in link.bench.events] == [renews]


def test_the_board_sees_stream_frames_as_they_were_sent(link: Link) -> None:
    index, frame = link.host.stream_frame(PHASES, t_apply_us=2**32 + 7)
    link.exchange(frame)
    index2, frame = link.host.stream_frame(PHASES, t_apply_us=None)
    link.exchange(frame)
    t_us = link.now_us + 1000 + BOARD_AHEAD_US
    assert link.bench.events[-2:] == [
        StreamReceived(PHASES, index, 7, NONCE, t_us, True),
        StreamReceived(PHASES, index2, None, NONCE, t_us, True),
    ]


def test_a_greeting_and_what_follows_it_may_come_in_one_chunk() -> None:
    bench = Bench()
    answer = bench.receive(
        wire(Hello(VERSION_MAJOR, 0, NONCE), seq=0, session=0)
        + wire(Arm(), seq=1, session=NONCE)
        + wire(PHASES, seq=0xFFF0, session=NONCE, flags=0x10),
        0,
    )
    assert bench.state is OutputState.ARMED
    assert bench.streamed == [0xFFF0]
    host = HostConnection(nonce=NONCE)
    host.send_hello(0)
    host.receive_data(answer, 1)
    assert isinstance(host.next_event().message, HelloReply)

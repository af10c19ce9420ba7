"""Host and board with a line between them that does anything to the bytes: what holds all the time.

The model knows what was sent, numbered, and nothing of how either end works.  Virtual time.
"""

from collections import deque

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from haptogram_protocol.connection import (
    INPUT_LIMIT,
    MAX_ATTEMPTS,
    MAX_RTO_US,
    NEED_DATA,
    OUTPUT_LIMIT,
    EventReceived,
    FrameDropped,
    HostConnection,
    ReplyReceived,
    RequestReceived,
    RequestRefused,
    RequestTimedOut,
    StreamReceived,
)
from haptogram_protocol.messages import (
    FIRST_STREAM_SEQ,
    Disarm,
    Phases,
    Ping,
    Pong,
    Trace,
)
from haptogram_protocol.state import LinkState
from link_pair import BOARD_AHEAD_US, Bench

LATENCY_US = 1000
# HG-12.6: sent five times, each after the timeout before it, which doubles from 2 s at the most.
GIVEN_UP_US = MAX_ATTEMPTS * MAX_RTO_US

place = st.floats(0.0, 1.0, exclude_max=True)
harm = st.one_of(
    st.tuples(st.just("drop"), place),
    st.tuples(st.just("flip"), place),
    st.tuples(st.just("duplicate"), place),
    st.tuples(st.just("truncate"), place),
    st.tuples(st.just("slice"), place),
    st.tuples(st.just("delay"), place),
    st.tuples(st.just("insert"), st.binary(min_size=1, max_size=8)),
    st.tuples(st.just("lose"), place),
)
few_harms = st.lists(harm, max_size=2)


class Pipe:
    """One direction: chunks in order, each with when it comes; the next one may be harmed."""

    def __init__(self):
        self.chunks = deque()
        self.harms = deque()
        self.harmed = 0
        self.cut = False

    def send(self, data, now_us):
        if not data or self.cut:
            self.harmed += self.cut
            return
        pieces = self._harm(data, *self.harms.popleft()) if self.harms else [(0, data)]
        for delay_us, piece in pieces:
            last_us = self.chunks[-1][0] if self.chunks else 0
            self.chunks.append((max(last_us, now_us + LATENCY_US + delay_us), piece))

    def _harm(self, data, kind, how):
        self.harmed += 1
        if kind == "insert":
            return [(0, how + data)]
        at = int(how * len(data))
        return {
            "drop": [(0, data[:at] + data[at + 1 :])],
            "flip": [(0, data[:at] + bytes([data[at] ^ (1 + at % 255)]) + data[at + 1 :])],
            "duplicate": [(0, data), (0, data)],
            "truncate": [(0, data[:at])],
            "slice": [(0, data[:at]), (500, data[at:])],
            "delay": [(int(how * 400_000), data)],
            "lose": [],
        }[kind]

    def receive(self, now_us):
        while self.chunks and self.chunks[0][0] <= now_us:
            yield self.chunks.popleft()


class AnyLine(RuleBasedStateMachine):
    """A host that asks and streams, a board that answers and reports, a line that harms."""

    def __init__(self):
        super().__init__()
        self.now_us = 0
        self.bench = Bench()
        self.down, self.up = Pipe(), Pipe()
        self.nonce = 0
        self.board_taken, self.host_taken = {}, {}  # per session: what came through, in order
        self.asked, self.answered = {}, set()  # echo of each ping by seq; those that have an end
        self.received = 0
        self.open_session()

    # --- the host ------------------------------------------------------------------------------

    @rule(down=few_harms, up=few_harms)
    def open_session(self, down=(), up=()):
        """Also a reconnection: the bytes of the session before are still on the line."""
        self.down.harms.extend(down)
        self.up.harms.extend(up)
        self.nonce += 1
        self.host = HostConnection(nonce=self.nonce)
        self.streamed, self.traced = {}, {}  # what was sent in this session, by number
        self.asked, self.answered = {}, set()
        self.hello = self.host.send_hello(self.now_us)
        self.asked_us = self.now_us
        self.push()
        self.run_until(self.now_us + 2 * LATENCY_US)

    @precondition(lambda self: self.is_open)
    @rule(data=st.binary(min_size=4, max_size=8), harms=few_harms)
    def stream(self, data, harms=()):
        self.down.harms.extend(harms)
        message = Phases(data)
        index, wire = self.host.stream_frame(message, t_apply_us=len(self.streamed))
        assert index == FIRST_STREAM_SEQ + len(self.streamed)
        self.streamed[index] = message
        self.down.send(wire, self.now_us)

    @precondition(lambda self: self.is_open and not self.host.outstanding)
    @rule(down=few_harms, up=few_harms)
    def ask(self, down=(), up=()):
        self.down.harms.extend(down)
        self.up.harms.extend(up)
        echo = 1 + len(self.asked)
        self.send(Ping(echo), echo)

    @precondition(lambda self: self.is_open and not self.host.outstanding)
    @rule()
    def disarm(self):
        self.send(Disarm(), None)

    def send(self, message, echo):
        self.asked[self.host.send_request(message, self.now_us)] = echo
        self.asked_us = self.now_us
        self.push()

    # --- the board -----------------------------------------------------------------------------

    @precondition(lambda self: self.is_open and self.bench.connection.session == self.nonce)
    @rule(crc=st.integers(0, 2**32 - 1), harms=few_harms)
    def report(self, crc, harms=()):
        self.up.harms.extend(harms)
        number = len(self.traced)
        assert self.bench.connection.send_event(Trace(number, crc), now_us=self.device_us)
        self.traced[number] = crc
        self.up.send(self.bench.connection.data_to_send(), self.now_us)

    # --- the line ------------------------------------------------------------------------------

    @rule(us=st.one_of(st.integers(0, 300_000), st.just(GIVEN_UP_US)))
    def cut(self, us):
        self.down.cut = self.up.cut = True
        self.run_until(self.now_us + us)
        self.down.cut = self.up.cut = False

    @rule(us=st.one_of(st.integers(0, 3000), st.integers(0, 3_000_000)))
    def wait(self, us):
        self.run_until(self.now_us + us)

    @rule()
    def faults_stop(self):
        """In order again: one delimiter after the last fault, and every request has its end."""
        self.down.harms.clear()
        self.up.harms.clear()
        self.run_until(self.now_us + GIVEN_UP_US)
        assert not self.host.outstanding  # HG-12.6: bounded
        if not self.is_open:  # its HELLO was given up
            self.open_session()
            assert self.is_open
        before = len(self.host_taken.get(self.nonce, ()))
        self.stream(b"calm")
        index = FIRST_STREAM_SEQ + len(self.streamed) - 1
        self.report(before)
        self.ask()
        seq = max(self.asked)
        self.run_until(self.now_us + 3 * LATENCY_US)
        # HG-2.1/3: the very next frame of each direction is taken.
        assert self.board_taken[self.nonce][-1] == index
        assert self.host_taken[self.nonce][-1] == len(self.traced) - 1
        assert seq in self.answered

    # --- time ----------------------------------------------------------------------------------

    @property
    def is_open(self):
        return self.host.link_state is LinkState.OPEN

    @property
    def device_us(self):
        return self.now_us + BOARD_AHEAD_US

    def push(self):
        self.down.send(self.host.data_to_send(), self.now_us)

    def run_until(self, end_us):
        while (next_us := self.next_us()) is not None and next_us <= end_us:
            self.now_us = max(self.now_us, next_us)
            for _, data in self.down.receive(self.now_us):
                self.to_board(data)
            for _, data in self.up.receive(self.now_us):
                self.host.receive_data(data, self.now_us)
                self.received += len(data)
            self.host.advance_to(self.now_us)
            self.take_events()
            self.push()
        self.now_us = end_us

    def next_us(self):
        times = [pipe.chunks[0][0] for pipe in (self.down, self.up) if pipe.chunks]
        due_us = self.host.next_deadline_us()
        return min([*times, *([] if due_us is None else [due_us])], default=None)

    def to_board(self, data):
        before = len(self.bench.events)
        answer = self.bench.receive(data, self.device_us)
        for event in self.bench.events[before:]:
            if isinstance(event, StreamReceived):
                self.take_stream(event)
        self.up.send(answer, self.now_us)

    # --- what may come through -----------------------------------------------------------------

    def take_stream(self, event):
        """What is taken was sent, as it is, in order, and once."""
        taken = self.board_taken.setdefault(event.session, [])
        assert not taken or event.index > taken[-1]
        taken.append(event.index)
        if event.session == self.nonce:
            assert event.message == self.streamed[event.index]
            assert event.t_apply_us == event.index - FIRST_STREAM_SEQ

    def take_events(self):
        while (event := self.host.next_event()) is not NEED_DATA:
            if isinstance(event, EventReceived):
                self.take_trace(event)
            elif isinstance(event, ReplyReceived):
                self.take_reply(event)
            elif isinstance(event, RequestTimedOut):
                assert event.attempts == MAX_ATTEMPTS
                self.end_of(event.seq)
            else:
                assert isinstance(event, FrameDropped)
                assert not isinstance(event, RequestRefused)

    def take_trace(self, event):
        taken = self.host_taken.setdefault(event.header.session, [])
        assert event.header.session == self.nonce
        assert event.message == Trace(event.header.seq, self.traced[event.header.seq])
        assert event.gap == event.header.seq - (taken[-1] if taken else -1) - 1
        taken.append(event.header.seq)

    def take_reply(self, event):
        if isinstance(event.message, Pong):
            assert event.message.echo == self.asked[event.seq]
        self.end_of(event.seq)

    def end_of(self, seq):
        assert seq == self.hello or seq in self.asked
        assert seq not in self.answered
        self.answered.add(seq)

    # --- what holds after every step -----------------------------------------------------------

    @invariant()
    def nothing_was_carried_out_that_was_not_asked(self):
        """Every request at most once; only a HELLO or MUTE may be of another session."""
        requests = [e for e in self.bench.events if isinstance(e, RequestReceived)]
        names = [(e.session, e.seq) for e in requests if not e.new_session]
        assert len(names) == len(set(names))
        for event in requests:
            if not event.new_session and event.session == self.nonce:
                echo = self.asked[event.seq]
                assert event.message == (Disarm() if echo is None else Ping(echo))

    @invariant()
    def counters_add_up(self):
        counters, events = self.bench.connection.counters, self.bench.events
        dropped = [event.reason for event in events if isinstance(event, FrameDropped)]
        for reason in ("crc", "cobs", "short", "duplicate", "stale_session", "repeated"):
            assert counters[reason] == dropped.count(reason)
        taken = sum(isinstance(event, StreamReceived | RequestReceived) for event in events)
        undamaged = sum(reason not in ("crc", "cobs", "short", "oversize") for reason in dropped)
        assert counters["frames"] == taken + undamaged
        assert counters["requests"] == len(self.bench.carried_out)
        missing = sum(
            taken[-1] - FIRST_STREAM_SEQ + 1 - len(taken) for taken in self.board_taken.values()
        )
        assert counters["gap"] == missing

    @invariant()
    def an_undamaged_line_loses_nothing(self):
        if not (self.down.harmed or self.up.harmed):
            assert sum(self.host.counters[name] for name in ("crc", "cobs", "short", "gap")) == 0
            board = self.bench.connection.counters
            assert sum(board[name] for name in ("crc", "cobs", "short", "oversize", "gap")) == 0

    @invariant()
    def buffers_are_bounded(self):
        assert self.bench.connection.output_bytes <= OUTPUT_LIMIT
        assert self.host.outstanding <= 1
        assert self.host.bytes_received <= INPUT_LIMIT

    @invariant()
    def nothing_waits_for_ever(self):
        assert not self.host.outstanding or self.now_us <= self.asked_us + GIVEN_UP_US
        due_us = self.host.next_deadline_us()
        assert (due_us is not None) == bool(self.host.outstanding)
        assert due_us is None or due_us <= self.now_us + MAX_RTO_US


AnyLine.TestCase.settings = settings(stateful_step_count=30)
test_any_line = AnyLine.TestCase

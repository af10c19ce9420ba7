"""Both connections and a line between them that can lose, repeat and garble, in virtual time."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field

from haptogram_protocol.connection import (
    NEED_DATA,
    BoardConnection,
    HostConnection,
    RequestReceived,
    StreamReceived,
)
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import (
    VERSION_MAJOR,
    Arm,
    ArmReply,
    Disarm,
    DisarmReply,
    ErrorCode,
    Hello,
    HelloReply,
    Message,
    Mute,
    MuteReply,
    Ping,
    Pong,
    UploadBegin,
    UploadBeginReply,
    UploadChunk,
    UploadChunkReply,
    UploadCommit,
    UploadCommitReply,
    build_body,
)
from haptogram_protocol.state import OutputInput, OutputState, next_output_state

NONCE = 0x5EED
BOARD_AHEAD_US = 2**32 - 10_000_000  # the device clock is not the host's


def hello_reply(nonce: int, **changes: int | str) -> HelloReply:
    """A HELLO_REPLY in which only what the link needs is set."""
    fields: dict[str, int | str] = dict.fromkeys(HelloReply.WIRE, 0)
    fields |= {"major": VERSION_MAJOR, "nonce": nonce, "firmware": "test"}
    fields |= {"state": OutputState.DISARMED}
    return HelloReply(**(fields | changes))


def wire(message: Message, *, seq: int, session: int, flags: int = 0, time_us: int = 0) -> bytes:
    """One frame, as a peer would send it."""
    body = build_body(message, flags=flags, seq=seq, time_us=time_us, session=session)
    return encode_frame(body)


@dataclass
class Bench:
    """A board's end with just enough of a board behind it to see what is carried out."""

    connection: BoardConnection = field(default_factory=lambda: BoardConnection())
    state: OutputState = OutputState.DISARMED
    carried_out: list[Message] = field(default_factory=list)
    streamed: list[int] = field(default_factory=list)
    events: list[object] = field(default_factory=list)
    upload: bytearray = field(default_factory=bytearray)

    def receive(self, data: bytes, now_us: int) -> bytes:
        """Take bytes, do what they ask for, return what the board sends."""
        self.connection.receive_data(data, now_us)
        while (event := self.connection.next_event()) is not NEED_DATA:
            self.events.append(event)
            if isinstance(event, StreamReceived):
                self.streamed.append(event.index)
            elif isinstance(event, RequestReceived):
                self.carried_out.append(event.message)
                self._answer(event, now_us)
        return self.connection.data_to_send()

    def _answer(self, request: RequestReceived, now_us: int) -> None:
        message = request.message
        if isinstance(message, Hello):
            self._move(OutputInput.NEW_SESSION)
            self.connection.open_session(message.nonce)
        reply = self._reply(message, request.t_rx_us, now_us)
        if reply is None:
            self.connection.refuse(request, ErrorCode.BUSY, 5, now_us)
        else:
            self.connection.reply(request, reply, now_us)

    def _reply(self, message: Message, t_rx_us: int, now_us: int) -> Message | None:
        match message:
            case Hello():
                return hello_reply(message.nonce, state=self.state)
            case Arm():
                return ArmReply(self._move(OutputInput.ARM))
            case Mute():
                return MuteReply(self._move(OutputInput.MUTE))
            case Disarm():
                return DisarmReply(self._move(OutputInput.DISARM))
            case Ping():
                return Pong(message.echo, t_rx_us & 0xFFFFFFFF, now_us & 0xFFFFFFFF)
            case UploadBegin():
                self.upload = bytearray(message.size)
                return UploadBeginReply(max_chunk=16, window=4)
            case UploadChunk():
                self.upload[message.offset : message.offset + len(message.data)] = message.data
                return UploadChunkReply(0)
            case UploadCommit():
                return UploadCommitReply(1)
        return None

    def _move(self, event: OutputInput) -> OutputState:
        self.state = next_output_state(self.state, event)
        return self.state


Fate = Callable[[bytes], list[bytes]]


def intact(chunk: bytes) -> list[bytes]:
    """A line that does nothing to what it carries."""
    return [chunk]


@dataclass
class Link:
    """Host, line and board; time goes from one event to the next."""

    host: HostConnection = field(default_factory=lambda: HostConnection(nonce=NONCE))
    bench: Bench = field(default_factory=Bench)
    to_board: Fate = intact
    to_host: Fate = intact
    latency_us: int = 1000
    now_us: int = 0
    events: list[object] = field(default_factory=list)

    def exchange(self, data: bytes = b"") -> None:
        """Carry what waits, and *data* behind it, to the board and its answers back."""
        for chunk in self.to_board(self.host.data_to_send() + data):
            device_us = self.now_us + self.latency_us + BOARD_AHEAD_US
            answer = self.bench.receive(chunk, device_us)
            for back in self.to_host(answer) if answer else []:
                self.host.receive_data(back, self.now_us + 2 * self.latency_us)
        self.collect()

    def collect(self) -> None:
        """Take the host's events."""
        while (event := self.host.next_event()) is not NEED_DATA:
            self.events.append(event)

    def wait_idle(self) -> None:
        """Let time pass until the host waits for nothing."""
        self.exchange()
        for _ in range(100):
            deadline_us = self.host.next_deadline_us()
            if deadline_us is None:
                self.collect()
                return
            self.now_us = max(self.now_us, deadline_us)
            self.host.advance_to(self.now_us)
            self.exchange()
        raise AssertionError("the host waits for ever")

    def open(self) -> None:
        """Greet, and forget the events of it."""
        self.host.send_hello(self.now_us)
        self.wait_idle()
        self.events.clear()

    def request(self, message: Message) -> object:
        """Send a request, wait for what becomes of it and return the last event."""
        self.host.send_request(message, self.now_us)
        self.wait_idle()
        return self.events[-1]


def losing(*numbers: int) -> Fate:
    """A line that loses these of the chunks that it carries, counted from 0."""
    count = itertools.count()
    return lambda chunk: [] if next(count) in numbers else [chunk]

"""A small host that asks and waits, over any pyserial port: enough to exercise a board."""

import time
from collections.abc import Callable

import pytest
import serial

import sim_device
from haptogram_protocol.connection import (
    NEED_DATA,
    EventReceived,
    HostConnection,
    ReplyReceived,
    RequestRefused,
)
from haptogram_protocol.messages import Arm, Config, Phases, SetConfig, unwrap

PATIENCE_NS = 20_000_000_000


class SmallHost:
    """Stop and wait; events are kept."""

    def __init__(self, port, nonce=0x5EED):
        self.port = port
        self.events = []
        self.frames = 0
        self.now_ns = getattr(port, "now_ns", time.monotonic_ns)
        self.link = HostConnection(nonce=nonce)

    def now_us(self):
        return self.now_ns() // 1000

    def greet(self):
        self.link.send_hello(self.now_us())
        return self.wait()

    def ask(self, message, **how):
        self.link.send_request(message, self.now_us(), **how)
        return self.wait()

    def wait(self):
        """Return the reply, or the refusal, to what was just sent."""
        deadline_ns = self.now_ns() + PATIENCE_NS
        while self.now_ns() < deadline_ns:
            self.port.write(self.link.data_to_send())
            answers = [e for e in self.listen() if isinstance(e, ReplyReceived | RequestRefused)]
            if answers:
                return answers[0]
            self.link.advance_to(self.now_us())
        raise TimeoutError("no answer")

    def listen(self):
        self.link.receive_data(self.port.read(self.port.in_waiting or 1), self.now_us())
        found = []
        while (event := self.link.next_event()) is not NEED_DATA:
            found.append(event)
        self.events += [e for e in found if isinstance(e, EventReceived)]
        return found

    def arm(self, **config):
        reply = self.greet()
        self.ask(SetConfig(Config(**config)))
        self.ask(Arm())
        return unwrap(reply.t_device_us, sim_device.BoardSettings().boot_us, 32)

    def stream(self, codes, t_apply_us=None):
        frame = Phases(codes)
        index, wire = self.link.stream_frame(frame, t_apply_us=t_apply_us)
        self.port.write(wire)
        return index, wire


@pytest.fixture
def open_host():
    """Open a URL or a device, with a small host behind it."""
    sim_device.register_url_handler()
    ports = []

    def open_port(url: str, nonce: int = 0x5EED) -> SmallHost:
        port = serial.serial_for_url(url, timeout=0.05)
        ports.append(port)
        return SmallHost(port, nonce)

    yield open_port
    for port in ports:
        port.close()


HostFactory = Callable[..., SmallHost]

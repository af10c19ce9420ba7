"""Boards, and things that are no boards, for tests of the suite."""

import contextlib

import serial

import sim_device
from haptogram.conformance.cases import all_cases, select
from haptogram.conformance.run.access import VirtualAccess
from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner
from haptogram.driver.line.port import PyserialTransport
from haptogram.errors import LinkLostError
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import DELIMITER, MAX_ENCODED_BYTES, FrameDecoder, decode_frame
from haptogram_protocol.messages import REQUEST_RANGE, RESPONSE_RANGE, Mute

BAUD = 3_000_000


def virtual(*, baud=BAUD, wrap=lambda transport: transport, **options):
    """A board in virtual time that starts anew with every opening of its port."""
    sim_device.register_url_handler()
    query = "&".join(f"{name}={value}" for name, value in options.items())

    ports = []

    def start(number):
        url = f"haptogram://?clock=virtual&baud={baud}&seed={number}&{query}"
        ports[:] = [serial.serial_for_url(url, timeout=0)]
        return wrap(PyserialTransport(ports[0], url))

    def raise_fault():
        ports[0].raise_hardware_fault()

    return VirtualAccess(
        "haptogram://test", start, baudrate=baud, virtual=True, raise_fault=raise_fault
    )


def run(access, *clauses, **options):
    def progress(_, __, case):
        WindowWatch.case = case

    runner = SuiteRunner(access, SuiteOptions(**options), progress)
    return runner.run(list(select(all_cases(), clauses)))


class Wrapped:
    """A transport in front of another one: passes everything on."""

    def __init__(self, inner):
        self.inner = inner
        self.url = inner.url

    def now_ns(self):
        return self.inner.now_ns()

    def read_available(self, deadline_ns):
        return self.inner.read_available(deadline_ns)

    def write_some(self, data):
        return self.inner.write_some(data)

    def close(self):
        self.inner.close()


class WindowWatch(Wrapped):
    """Notes how many bytes of frames the board had to hold at most, by the case that sent them.

    A board has processed what was sent before a request that it has answered, other than MUTE,
    which overtakes, and what was sent 50 ms ago (HG-2.7/2, HG-4.11/3).  A run that is longer than
    any frame is discarded as it comes.
    """

    case = "HELLO"

    def __init__(self, inner, most):
        super().__init__(inner)
        self.most = most
        self.sent = []
        self.begun = b""
        self.decoder = FrameDecoder()

    def write_some(self, data):
        count = super().write_some(data)
        *ended, self.begun = (self.begun + data[:count]).split(DELIMITER)
        pieces = [piece for piece in ended if piece and len(piece) <= MAX_ENCODED_BYTES]
        self.sent += [(self.now_ns(), piece) for piece in pieces]
        old_ns = self.now_ns() - 50_000_000
        self.sent = [(t_ns, piece) for t_ns, piece in self.sent if t_ns > old_ns]
        held = sum(len(piece) + 2 for _, piece in self.sent)
        self.most[WindowWatch.case] = max(self.most.get(WindowWatch.case, 0), held)
        return count

    def read_available(self, deadline_ns):
        data = super().read_available(deadline_ns)
        for body in self.decoder.feed(data):
            if isinstance(body, bytes) and body[0] in RESPONSE_RANGE:
                self.forget_before(body[2:4])
        return data

    def forget_before(self, seq):
        for place, (_, piece) in enumerate(self.sent):
            with contextlib.suppress(RemoteProtocolError):
                body = decode_frame(piece)
                if body[0] in REQUEST_RANGE and body[0] != Mute.TYPE and body[2:4] == seq:
                    del self.sent[: place + 1]
                    return


class Dying(Wrapped):
    """A board whose port fails after so many writes: the cable was pulled, or *error*."""

    def __init__(self, inner, writes, error=None):
        super().__init__(inner)
        self.writes = writes
        self.error = error or LinkLostError("the cable was pulled")

    def write_some(self, data):
        self.writes -= 1
        if self.writes < 0:
            raise self.error
        return super().write_some(data)


class Port:
    """No board: what ``say`` returns comes for each write, and at every look ``babble``."""

    url = "port://test"

    def __init__(self, say=lambda _: b"", babble=b""):
        self.say, self.babble = say, babble
        self.t_ns = 0
        self.waiting = b""

    def now_ns(self):
        return self.t_ns

    def read_available(self, deadline_ns):
        data, self.waiting = self.waiting + self.babble, b""
        if data:
            return data
        self.t_ns = max(self.t_ns, deadline_ns)
        return b""

    def write_some(self, data):
        self.waiting += self.say(data)
        return len(data)

    def close(self):
        pass


def port(**behaviour):
    access = VirtualAccess("port://test", lambda _: Port(**behaviour), baudrate=BAUD, virtual=True)
    access.can_reset = access.boots = False
    return access

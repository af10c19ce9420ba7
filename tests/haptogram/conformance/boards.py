"""Boards, and things that are no boards, for tests of the suite."""

import serial

import sim_device
from haptogram.conformance.cases import all_cases, select
from haptogram.conformance.run.access import VirtualAccess
from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner
from haptogram.driver.line.port import PyserialTransport
from haptogram.errors import LinkLostError

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
    return SuiteRunner(access, SuiteOptions(**options)).run(list(select(all_cases(), clauses)))


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

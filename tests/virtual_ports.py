"""Ports of boards in virtual time, healthy and not, for tests of the host."""

from collections import deque

from haptogram.errors import LinkLostError
from haptogram.settings.line import LineSettings
from sim_device.assembly import HEALTHY
from sim_device.backdoor.pin_capture import BackdoorPinCapture
from sim_device.board.settings import BoardSettings
from sim_device.simulation import Simulation

BAUD = 3_000_000


class BoardPort:
    """A transport with a board at its far end: no wall clock, time passes in blocking reads.

    ``tamper`` sees every chunk that the host writes and says what goes on the line instead.
    """

    url = "virtual://board"

    def __init__(
        self, *, baud=BAUD, tamper=None, faults=None, capture=None, parts=HEALTHY, **settings
    ):
        board = BoardSettings(line=LineSettings(baud=baud), **settings)
        self.pins = None if capture is None else BackdoorPinCapture(capture.capture, capture, board)
        recorders = [self] if self.pins is None else [self, self.pins]
        self.simulation = Simulation(board, *recorders, faults=faults, probe=self.pins, parts=parts)
        self.board = self.simulation.dialect.board
        self.latches = []
        self.notices = []
        self.written = []
        self.closed = False
        self.lost = False  # the cable was pulled
        self.deaf = False  # takes no more bytes
        self._tamper = tamper or (lambda data: data)

    def latch(self, latch):
        self.latches.append(latch)

    def notice(self, notice):
        self.notices.append(notice)

    def now_ns(self):
        return self.simulation.now_ns

    def read_available(self, deadline_ns):
        self._check()
        simulation = self.simulation
        while not simulation.host_waiting and simulation.now_ns < deadline_ns:
            next_ns = simulation.next_event_ns()
            simulation.advance_to(deadline_ns if next_ns is None else min(next_ns, deadline_ns))
        return simulation.host_read()

    def write_some(self, data):
        self._check()
        if self.deaf:
            return 0
        self.written.append(data)
        self.simulation.host_write(self._tamper(data), self.now_ns())
        return len(data)

    def close(self):
        self.closed = True

    def stall(self, duration_ns):
        """Let the host do nothing for a while."""
        self.simulation.advance_to(self.now_ns() + duration_ns)

    def _check(self):
        if self.lost or self.closed:
            raise LinkLostError(f"{self.url}: the port is gone")


class ScriptedPort:
    """A transport that answers what a script says: one entry per write, then silence."""

    url = "scripted://port"

    def __init__(self, *answers):
        self._answers = deque(answers)
        self._ready = b""
        self._t_ns = 0
        self.closed = False

    def now_ns(self):
        return self._t_ns

    def read_available(self, deadline_ns):
        if self._ready:
            data, self._ready = self._ready, b""
            return data
        self._t_ns = max(self._t_ns, deadline_ns)
        return b""

    def write_some(self, data):
        answer = self._answers.popleft() if self._answers else b""
        self._ready += answer(data) if callable(answer) else answer
        return len(data)

    def close(self):
        self.closed = True

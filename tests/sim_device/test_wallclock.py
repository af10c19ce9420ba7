"""A board on the wall clock: what is left behind when it ends, and descriptors of any number."""

import ctypes
import operator
import os
import select
import signal
import subprocess
import sys
import textwrap
import threading
import time
from functools import partial
from pathlib import Path

import pytest

from dialect_boards import DATA, DialectBoard
from haptogram.machine.waiter import DescriptorWaiter
from haptogram_protocol.dialects.autd3.frame import Autd3DeviceFrame
from haptogram_protocol.dialects.autd3.link import Autd3HostEnd
from haptogram_protocol.dialects.autd3.messages import Hello, Open, Pose, Write
from haptogram_protocol.dialects.autd3.operations import (
    FociStart,
    FociSTM,
    Modulation,
    ModulationStart,
    Silencer,
    SwapSegment,
    Tag,
    TransitionMode,
)
from process_limits import HIGH, only_high_descriptors
from sim_device import wallclock
from sim_device.board.settings import board_settings
from sim_device.line.port import BoardPort, PortLostError
from sim_device.line.pty_port import PtyPort
from sim_device.log import BoardCountLog
from sim_device.simulation import Simulation
from sim_device.wallclock import Heartbeat

pytestmark = pytest.mark.pty
ROOT = Path(__file__).resolve().parents[2]
ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class End(BoardPort):
    """A port that ends a board in one way, on its second turn."""

    def __init__(self, act):
        super().__init__(-1, "end of a test")
        self.act, self.turns = act, 0

    @property
    def due_ns(self):
        return 0  # at once

    def reading(self):
        return []

    def read(self, _):
        self.turns += 1
        if self.turns > 1:
            self.act()
        return b""

    def write(self, data):
        pass


def heartbeat_on(port):
    return Heartbeat(Simulation(board_settings(array="2x2")), port)


def handlers():
    return [signal.getsignal(number) for number in ENDINGS]


@pytest.fixture
def own_handlers():
    """Handlers of the test, to be found again; what they heard."""
    heard, before = [], handlers()
    for number in ENDINGS:
        signal.signal(number, lambda got, _: heard.append(got))
    yield heard
    for number, handler in zip(ENDINGS, before, strict=True):
        signal.signal(number, handler)


def lose():
    raise PortLostError("the cable was pulled")


def stumble():
    raise ZeroDivisionError


def ended(act):
    """Run a board until *act* ends it."""
    heartbeat = heartbeat_on(End(lambda: act(heartbeat)))
    with heartbeat.stopped_by_signals():
        heartbeat.run()


WAYS = {
    "return": (lambda board: board.stop(), None),
    "a signal": (lambda _: os.kill(os.getpid(), signal.SIGTERM), None),
    "a lost port": (lambda _: lose(), PortLostError),
    "an error": (lambda _: stumble(), ZeroDivisionError),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("is_nested", [False, True])
def test_the_handlers_are_those_from_before_however_it_ends(own_handlers, way, is_nested):
    act, error = WAYS[way]
    before = handlers()

    def end(board):
        if is_nested:
            inside = handlers()
            with pytest.raises(PortLostError):
                ended(lambda _: lose())
            assert handlers() == inside
        act(board)

    if error is None:
        ended(end)
    else:
        with pytest.raises(error):
            ended(end)
    assert handlers() == before
    assert not own_handlers


@pytest.mark.parametrize("number", ENDINGS)
def test_a_signal_right_before_the_wait_ends_it(own_handlers, monkeypatch, number):
    """Python calls a handler between two instructions: never between the last one and select."""
    woken, kill = [], ctypes.CDLL(None).kill  # that of os looks for signals

    class LateWaiter(DescriptorWaiter):
        def wait(self, reading, writing=(), *_):
            steps = [
                partial(kill, os.getpid(), number),
                partial(select.select, reading, writing, [], 30),
            ]
            woken.append(list(map(operator.call, steps))[-1][0])  # one instruction of Python
            return set(woken[-1])

    monkeypatch.setattr(wallclock, "DescriptorWaiter", LateWaiter)
    monkeypatch.setattr(End, "due_ns", None)
    heartbeat = heartbeat_on(End(lambda: None))
    with heartbeat.stopped_by_signals():
        heartbeat.run()
    assert len(woken) == 1
    assert woken[0]
    assert not own_handlers


def test_a_signal_that_others_handle_ends_one_wait_alone(monkeypatch):
    waits, handled = [], []

    class SignalledWaiter(DescriptorWaiter):
        def wait(self, reading, writing=(), *_):
            if not waits:
                signal.raise_signal(signal.SIGUSR1)
            waits.append(super().wait(reading, writing, 0.0))
            if len(waits) == 2:
                heartbeat.stop()
            return waits[-1]

    monkeypatch.setattr(wallclock, "DescriptorWaiter", SignalledWaiter)
    monkeypatch.setattr(End, "due_ns", None)
    before = signal.signal(signal.SIGUSR1, lambda *_: handled.append(1))
    try:
        heartbeat = heartbeat_on(End(lambda: None))
        with heartbeat.stopped_by_signals():
            heartbeat.run()
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert handled == [1]
    assert [len(ready) for ready in waits] == [1, 0]


def test_a_signal_after_the_end_writes_into_nothing(own_handlers):
    heartbeat = heartbeat_on(End(lose))
    with heartbeat.stopped_by_signals():
        with pytest.raises(PortLostError):
            heartbeat.run()
        pipes = [os.pipe() for _ in range(8)]  # the lowest numbers: those that were its own
        os.kill(os.getpid(), signal.SIGTERM)
        heartbeat.stop()
    os.kill(os.getpid(), signal.SIGTERM)
    assert own_handlers == [signal.SIGTERM]
    for reading, writing in pipes:
        os.set_blocking(reading, False)
        with pytest.raises(BlockingIOError):
            os.read(reading, 1)
        os.close(reading)
        os.close(writing)


@pytest.fixture
def high_descriptors():
    with only_high_descriptors():
        yield


@pytest.mark.usefixtures("high_descriptors")
def test_a_board_runs_on_descriptors_above_1024(tmp_path):
    port = PtyPort(tmp_path / "board")
    assert port.reading()[0] > HIGH
    host = os.open(tmp_path / "board", os.O_RDWR | os.O_NOCTTY)
    os.write(host, b"\x00\x01\x00")
    heartbeat = heartbeat_on(port)
    read, seen = port.read, []

    def reading(limit):
        seen.append(read(limit))
        if seen[-1]:
            heartbeat.stop()
        return seen[-1]

    port.read = reading
    try:
        heartbeat.run()
    finally:
        port.close()
        os.close(host)
    assert b"".join(seen) == b"\x00\x01\x00"


# --- what is due in some centuries ----------------------------------------------------------------

AT_TIME, NEVER = TransitionMode.SYSTEM_TIME, 2**64 - 1
ONCE = ModulationStart(AT_TIME, 10, 3, NEVER)
LATER = ModulationStart(TransitionMode.LATER, 10, 3, 0)
FOCI = FociStart(AT_TIME, 1, 340 * 64, 40, 3, NEVER)


class Awake(End):
    """A port that can always be read, and ends the board on its second turn."""

    due_ns = None

    def __init__(self, act):
        super().__init__(act)
        self.pipe, write_end = os.pipe()
        os.close(write_end)

    def reading(self):
        return [self.pipe]


@pytest.mark.parametrize(
    "operations",
    [
        (Modulation(1, b"\xff\xff", ONCE, True, True),),
        (FociSTM(1, 1, bytes(16), FOCI, True, True),),
        (
            Modulation(1, b"\xff\xff", LATER, True, False),
            SwapSegment(Tag.MODULATION_SWAP, 1, AT_TIME, NEVER),
        ),
    ],
    ids=lambda operations: type(operations[-1]).__name__,
)
def test_a_board_waits_for_a_time_that_never_comes(operations, monkeypatch):
    board, client = DialectBoard("autd3"), Autd3HostEnd()
    data = b"".join(map(client.send, (Hello(), Open((Pose((0, 0, 0), (1, 0, 0, 0)),)))))
    loose = Silencer(True, False, 0xFFFF, 0xFFFF)
    for number, operation in enumerate((loose, *operations)):
        data += client.send(Write((Autd3DeviceFrame(number, (operation,)),)))
    board.send(data)
    board.pass_us(2_000_000)
    assert not board.simulation.dialect.counters
    assert board.simulation.next_event_ns() > 10**18
    port = Awake(lambda: heartbeat.stop())
    heartbeat = Heartbeat(board.simulation, port)
    monkeypatch.setattr(heartbeat, "_start_ns", time.monotonic_ns() - board.simulation.now_ns)
    try:
        heartbeat.run()
    finally:
        os.close(port.pipe)
    assert port.turns == 2


# --- descriptors that have run out ----------------------------------------------------------------

SHORT = """
import logging, os, resource, socket, sys, threading
from sim_device.wallclock import Heartbeat
from sim_device.board.settings import board_settings
from sim_device.line.tcp_port import TcpPort
from sim_device.simulation import Simulation

logging.basicConfig(format="%(message)s", stream=sys.stdout)
port = TcpPort("127.0.0.1", 0)
heartbeat = Heartbeat(Simulation(board_settings(array="2x2")), port)
turns, turn = [0], heartbeat._turn

def counted():
    turns[0] += 1
    turn()

heartbeat._turn = counted
client = socket.create_connection(port._server.getsockname())
limit = resource.getrlimit(resource.RLIMIT_NOFILE)
resource.setrlimit(resource.RLIMIT_NOFILE, (3, limit[1]))  # none is left

def later():
    short = turns[0], port._doorman.refused, port._client is None
    resource.setrlimit(resource.RLIMIT_NOFILE, limit)
    threading.Timer(0.5, lambda: (print("short", *short, "after", port._client is not None),
                                  heartbeat.stop())).start()

threading.Timer(1.5, later).start()
heartbeat.run()
port.close()
client.close()
"""


class ClientThatEnds(BoardCountLog):
    """Sends its bytes and ends, after the board has looked at its port and before it sleeps."""

    def __init__(self, link, alive, data):
        super().__init__(1)
        self.link, self.alive, self.data = link, alive, data

    def is_due(self, _):
        if self.data:
            client = os.open(self.link, os.O_RDWR | os.O_NOCTTY)
            os.write(client, self.data)
            os.close(client)
            os.close(self.alive)
            self.data = b""
        return False


def test_the_bytes_and_the_end_of_a_client_may_come_in_one_turn(tmp_path):
    link = tmp_path / "board"
    alive, its_end = os.pipe()
    port = PtyPort(str(link))
    board = DialectBoard("sonicsurface")
    data = (DATA / "sonicsurface" / "focus_20_150_m15.bin").read_bytes()
    heartbeat = Heartbeat(board.simulation, port, counts=ClientThatEnds(link, its_end, data))
    heartbeat.stop_after(alive)
    guard = threading.Timer(20, heartbeat.stop)  # a board that sleeps for ever fails, and ends
    guard.start()
    heartbeat.run()
    was_in_time = guard.is_alive()
    guard.cancel()
    port.close()
    os.close(alive)
    assert was_in_time
    assert not board.simulation.host_unsent
    assert len(board.latches) == 1 + 1  # that of power-up, and the client's


def test_a_client_waits_without_spinning_while_descriptors_have_run_out():
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(SHORT)],
        env=os.environ | {"PYTHONPATH": f"{ROOT}:{ROOT / 'protocol'}"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=True,
    )
    lines = done.stdout.splitlines()
    (told,) = [line.split() for line in lines if line.startswith("short")]
    turns, refused = int(told[1]), int(told[2])
    assert told[3:] == ["True", "after", "True"]
    assert 2 <= refused <= 9  # tried again every 0.2 s for 1.5 s
    assert turns <= 4 * refused + 4
    assert sum("no client can be taken in: too many open files" in line for line in lines) == 1
    assert sum("clients are taken in again" in line for line in lines) == 1

"""The driver and a board in another process, on real bytes over a pseudo-terminal.

No test here asserts a time: a shared machine may stop either side at any point.  What must hold
whatever happens is that nothing wrong is latched, everything missing is named, and the output
ends silent.
"""

import os
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest
import serial

from haptogram.driver.driver import Driver
from haptogram.driver.line.port import open_transport
from haptogram.errors import (
    HaptogramError,
    LinkError,
    LinkLostError,
    PortBusyError,
    WrongProtocolError,
)
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram_protocol.messages import TraceMode
from haptogram_protocol.state import MuteReason, OutputState

pytestmark = [pytest.mark.pty, pytest.mark.realtime]

ANGLE = np.linspace(0.0, 6.0, 300)
CIRCLE = np.column_stack((0.03 * np.cos(ANGLE), 0.03 * np.sin(ANGLE), np.full(300, 0.12)))


@pytest.fixture(scope="module")
def board():
    with VirtualBoard("8x8", reconstruct=False, clock="wall") as board:
        yield board


@pytest.fixture
def own_board():
    """A board of one test, which kills it or reads its counters."""
    with VirtualBoard("8x8", reconstruct=False, clock="wall") as board:
        yield board


def joined(board, driver):
    """Return (intended, observation) of every frame that was latched."""
    board.wait_idle(driver.intended)
    seen = {observation.key: observation for observation in board.observations(driver.session)}
    assert set(seen) <= {intended.key for intended in driver.intended}
    return [(i, seen[i.key]) for i in driver.intended if i.key in seen]


def assert_nothing_wrong_was_latched(pairs):
    for intended, observation in pairs:
        assert observation.drive == intended.drive
        if intended.t_apply_us is not None:
            assert 0 <= (observation.t_latch_us - intended.t_apply_us) % 2**32 < 25


@pytest.mark.sampled(1)
@pytest.mark.parametrize("mode", ["phases", "points"])
def test_a_stream_latches_what_was_intended_and_names_the_rest(own_board, mode):
    with Driver(own_board.url, trace=TraceMode.CRC) as driver:
        driver.arm()
        report = driver.stream(CIRCLE, 500, mode=mode)
        counters = report.status.counters
    pairs = joined(own_board, driver)
    assert_nothing_wrong_was_latched(pairs)
    lost = counters.dropped_late + counters.dropped_state + len(report.skipped)
    assert len(pairs) + lost == report.frames == 300
    assert len(pairs) == counters.latched > 0
    traced = {o.key: o.drive_crc for o in driver.observations}
    assert len(traced) + counters.trace_dropped == counters.latched
    assert all(traced[i.key] == i.drive.digest() for i, _ in pairs if i.key in traced)


def test_a_board_killed_in_mid_stream_is_a_lost_link_and_keeps_what_was_sent(own_board):
    def kill(done, _):
        if done == 100:
            own_board.kill()

    driver = Driver(own_board.url)
    driver.arm()
    with pytest.raises(LinkLostError) as caught, driver:
        driver.stream(np.tile(CIRCLE, (10, 1)), 500, progress=kill)
    assert "\n" not in str(caught.value)
    assert "did not confirm that it is mute" in caught.value.__notes__[0]
    assert 100 <= len(driver.intended) < 3000
    assert_nothing_wrong_was_latched(joined(own_board, driver))


CLIENT = """
    import sys
    import numpy as np
    from haptogram.driver.driver import Driver
    with Driver(sys.argv[1], nonce=4711) as driver:
        driver.arm()
        report = lambda done, total: print(done, flush=True)
        driver.stream(np.tile((0.0, 0.0, 0.15), (20_000, 1)), 200, progress=report)
"""


def client(board):
    """Start a program that streams, and wait until it does."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(CLIENT), board.url],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment,
    )
    assert process.stdout.readline()
    return process


def test_a_client_killed_in_mid_stream_leaves_a_board_that_mutes_itself_and_serves_the_next(board):
    process = client(board)
    process.kill()
    process.communicate()
    while (last := [r for r in board.records() if "state" in r][-1])["state"] == "ARMED":
        board.wait_for(10**9, timeout_s=0.05)
    assert (last["state"], last["reason"]) in {("MUTED", "HOLD_EXPIRED"), ("MUTED", "HOST_SILENT")}
    with Driver(board.url) as driver:
        assert driver.status().state is OutputState.MUTED
        driver.arm()
        driver.focus((0.0, 0.01, 0.15))
        assert driver.read_drive().key.session == driver.session
    assert_nothing_wrong_was_latched(joined(board, driver))


def test_an_interrupted_client_mutes_the_board_itself(board):
    process = client(board)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate()
    assert b"KeyboardInterrupt" in said
    with Driver(board.url) as driver:
        assert driver.status().reason is MuteReason.MUTE


def test_a_port_held_by_another_program_is_busy_and_its_stream_undisturbed(board):
    process = client(board)
    with pytest.raises(PortBusyError, match="another program holds this port"):
        Driver(board.url)
    assert process.poll() is None
    assert process.stdout.readline()
    process.terminate()
    process.communicate()


@pytest.mark.nightly
def test_garbage_before_and_between_frames_costs_no_frame_but_those_it_hits(own_board):
    with serial.Serial(own_board.url, exclusive=True) as port:
        port.write(np.random.default_rng(1).bytes(5000))

    class Noisy:
        """The driver's port, with noise between the frames."""

        def __init__(self, transport):
            self._transport = transport
            self._random = np.random.default_rng(2)
            self._rest = b""
            self.url = transport.url
            self.now_ns, self.close = transport.now_ns, transport.close
            self.read_available = transport.read_available

        def write_some(self, data):
            noise = self._random.bytes(30) + b"\0" * self._random.integers(2)
            self._transport.write_some(noise)
            return self._transport.write_some(data)

    with Driver(Noisy(open_transport(own_board.url))) as driver:
        driver.arm()
        report = driver.stream(CIRCLE, 500)
    pairs = joined(own_board, driver)
    assert_nothing_wrong_was_latched(pairs)
    counters = report.status.counters
    lost = counters.dropped_late + counters.dropped_state + len(report.skipped)
    assert len(pairs) + lost == 300
    assert counters.crc + counters.cobs + counters.short > 100


def test_a_shell_on_the_port_is_the_wrong_protocol():
    master, slave = os.openpty()
    path = os.ttyname(slave)
    program = "import os, sys, time\nwhile True:\n os.write(1, b'login: ')\n time.sleep(0.05)"
    other = subprocess.Popen([sys.executable, "-c", program], stdout=master)
    try:
        with pytest.raises(WrongProtocolError, match="but no Haptogram frame"):
            Driver(path, timeout_s=1.0)
    finally:
        other.kill()
        other.wait()
        os.close(master)
        os.close(slave)


def test_every_failure_is_one_line(own_board):
    own_board.kill()
    for url in (own_board.url, "/dev/no-such-port", "socket://127.0.0.1:1"):
        with pytest.raises((LinkError, HaptogramError)) as caught:
            Driver(url, timeout_s=0.2)
        assert "\n" not in str(caught.value)
        assert url in str(caught.value)

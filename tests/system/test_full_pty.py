"""A loop at 10 kHz on a pseudo-terminal whose both directions are full.

No test here asserts a time; a loop that hangs is stopped by the timeout of the runner.
"""

import contextlib
import os
import signal
import threading
import tty

import pytest

from haptogram.driver.driver import Driver
from haptogram.driver.line.link import Link
from haptogram.driver.line.port import open_transport
from haptogram.driver.timing.realtime import PeriodicLoop
from haptogram.errors import LinkError, LinkLostError
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram_protocol import HostConnection

pytestmark = [pytest.mark.pty, pytest.mark.realtime]

PERIOD_NS = 100_000
WIRE = b"\0" + b"\x55" * 274 + b"\0"
TICKS = 3000


@pytest.fixture
def ends():
    """The board's end of a pseudo-terminal, raw and non-blocking, and the name of the host's."""
    board, host = os.openpty()
    for fd in (board, host):
        tty.setraw(fd)
    os.set_blocking(board, False)
    yield board, os.ttyname(host)
    os.close(board)
    os.close(host)


def fill(fd):
    """Write until no more is taken; return how much that was."""
    size = 0
    with contextlib.suppress(BlockingIOError):
        while True:
            size += os.write(fd, b"\x55" * 1024)
    return size


def linked(name, timeout_s):
    connection = HostConnection(nonce=1)
    return Link(
        open_transport(name), connection, baudrate=50_000_000, timeout_s=timeout_s, keep=None
    )


@pytest.mark.parametrize("spin_ns", [0, PERIOD_NS // 4])
def test_a_board_that_stopped_reading_is_a_lost_link_after_what_it_sent_was_read(ends, spin_ns):
    board, name = ends
    link = linked(name, timeout_s=0.3)
    waiting = fill(board)
    loop = PeriodicLoop(link.now_ns, link.run_until, period_ns=PERIOD_NS, spin_ns=spin_ns)
    start_ns = link.now_ns()

    def write_on():
        for _ in loop.ticks(start_ns, start_ns + 600 * 10**9):
            link.write_frame(WIRE)

    with pytest.raises(LinkLostError, match=r"taken no byte for 0\.3 s"):
        write_on()
    assert link.stalls > 0
    assert link.connection.bytes_received == waiting
    link.close()


@pytest.mark.parametrize("spin_ns", [0, PERIOD_NS // 4])
def test_a_board_that_reads_only_while_it_can_write_does_not_stop_the_loop(ends, spin_ns):
    """The far end of the deadlock: it writes a reply for what it reads, and blocks in that."""
    board, name = ends
    os.set_blocking(board, True)
    received = []
    ended = threading.Event()

    def echo():
        while not ended.is_set():
            data = os.read(board, 4096)
            received.append(len(data))
            os.write(board, data)  # as much as came: both directions carry the same

    link = linked(name, timeout_s=30.0)
    thread = threading.Thread(target=echo, daemon=True)
    thread.start()
    loop = PeriodicLoop(link.now_ns, link.run_until, period_ns=PERIOD_NS, spin_ns=spin_ns)
    sent = 0
    for _ in loop.ticks(link.now_ns(), link.now_ns() + 600 * 10**9):
        link.write_frame(WIRE)
        sent += len(WIRE)
        if sent >= TICKS * len(WIRE):
            break
    while link.connection.bytes_received < sent:
        link.turn(link.now_ns() + 10_000_000)
    assert sum(received) == sent
    ended.set()
    link.write_frame(b"\0")  # wakes the far end once more
    thread.join()
    link.close()


def process_of(board):
    return board.pid


def test_a_board_that_is_stopped_in_mid_stream_ends_it_with_an_error():
    frames = 20_000  # five seconds: the port must fill up and time out long before the end

    def stop(done, _):
        if done >= 1000:
            os.kill(process_of(board), signal.SIGSTOP)

    with VirtualBoard("4x4", reconstruct=False, clock="wall") as board:
        driver = Driver(board.url, timeout_s=0.5)
        driver.arm()
        try:
            with pytest.raises(LinkError), driver:
                driver.stream([(0.0, 0.0, 0.15)], 4000, loops=frames, progress=stop)
        finally:
            os.kill(process_of(board), signal.SIGCONT)
    assert 1000 <= len(driver.intended) < frames

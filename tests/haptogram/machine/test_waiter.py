"""Waiting for descriptors: low and high ones alike, to the time that was asked for."""

import os
import time
from fcntl import F_DUPFD, fcntl

import pytest

from haptogram.driver.line.port import open_transport
from haptogram.errors import LinkLostError
from haptogram.machine.line_process import LineProcess
from haptogram.machine.waiter import DescriptorWaiter
from process_limits import HIGH, only_high_descriptors, room_for_high_descriptors

LOW = 3


@pytest.fixture
def all_low_taken():
    with only_high_descriptors():
        yield


@pytest.fixture(params=[LOW, HIGH])
def pipe(request):
    """The ends of a pipe, at low or at high numbers."""
    with room_for_high_descriptors():
        ends = os.pipe()
        high = [fcntl(end, F_DUPFD, request.param) for end in ends]
        yield high
        for fd in (*ends, *high):
            os.close(fd)


def test_what_can_be_read_and_what_can_be_written_is_told(pipe):
    reading, writing = pipe
    waiter = DescriptorWaiter()
    assert waiter.wait([reading], timeout_s=0) == set()
    assert waiter.wait([reading], [writing]) == {writing}
    os.write(writing, b"x")
    assert waiter.wait([reading], [writing]) == {reading, writing}
    assert waiter.wait([reading], timeout_s=60) == {reading}
    os.read(reading, 1)
    assert waiter.wait([reading], timeout_s=0) == set()


@pytest.mark.parametrize("timeout_s", [0.0, 1e-5, 3e-4, 2.5e-3])
def test_it_waits_no_less_than_it_was_asked_to(pipe, timeout_s):
    before_s = time.monotonic()
    assert DescriptorWaiter().wait(pipe[:1], timeout_s=timeout_s) == set()
    assert time.monotonic() - before_s >= timeout_s


def test_a_closed_descriptor_is_no_silence(pipe):
    waiter, copy = DescriptorWaiter(), os.dup(pipe[0])
    assert waiter.wait([copy], timeout_s=0) == set()
    os.close(copy)
    with pytest.raises(OSError, match="Bad file descriptor"):
        waiter.wait([copy], timeout_s=0)


@pytest.mark.pty
@pytest.mark.usefixtures("all_low_taken")
def test_a_port_above_1024_is_as_good_as_any():
    master, slave = os.openpty()
    try:
        port = open_transport(os.ttyname(slave))
        assert port.read_available(port.now_ns() + 1_000_000) == b""
        os.write(master, b"answer")
        assert port.read_available(port.now_ns() + 60_000_000_000) == b"answer"
        port.close()
        with pytest.raises(LinkLostError):
            port.read_available(port.now_ns())
    finally:
        for fd in (master, slave):
            os.close(fd)


@pytest.mark.usefixtures("all_low_taken")
def test_a_process_whose_pipes_are_above_1024_answers_too():
    process = LineProcess(["cat"])
    try:
        assert process.ask(b"answer\n", lambda text: text.endswith(b"\n")) == b"answer\n"
    finally:
        process.close()

import contextlib
import ctypes
import gc
import os
import pty
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from haptogram.machine.process import TerminalProcesses, real_time_process

linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks Linux itself")


@pytest.fixture(autouse=True)
def frozen():
    """A later collection would look through thousands of tests, which these have thawed."""
    yield
    gc.freeze()


def test_the_collector_pauses_and_comes_back():
    assert gc.isenabled()
    with contextlib.suppress(KeyError), real_time_process():
        assert not gc.isenabled()
        raise KeyError
    assert gc.isenabled()


def test_a_collector_that_was_off_stays_off():
    gc.disable()
    try:
        with real_time_process():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


def slack_ns():
    with open("/proc/self/timerslack_ns") as file:
        return int(file.read())


@linux
def test_the_timer_slack_is_put_back():
    before = slack_ns()
    with real_time_process() as refused:
        assert slack_ns() == 1
        assert refused == []
    assert slack_ns() == before


def locked_kb():
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmLck"))


@linux
def test_what_is_permitted_holds_inside_and_is_put_back():
    before = (os.sched_getscheduler(0), locked_kb())
    frozen = gc.get_freeze_count()  # not 0: Python 3.12 freezes objects of its own as it starts
    with real_time_process(strict=True) as refused:
        assert gc.get_freeze_count() > frozen
        fixed = os.sched_getscheduler(0) == os.SCHED_FIFO
        assert fixed != any("SCHED_FIFO" in line for line in refused)
        assert (locked_kb() > before[1]) != any("memory lock" in line for line in refused)
    assert (os.sched_getscheduler(0), locked_kb()) == before
    assert gc.get_freeze_count() <= frozen


@linux
def test_what_is_not_permitted_is_named_and_the_loop_runs_all_the_same(monkeypatch):
    def forbid(*_):
        raise PermissionError(1, "Operation not permitted")

    class NoLocks:
        """The C library of a user without rights."""

        def __init__(self, *_, **__):
            self.prctl = library.prctl

        def mlockall(self, _):
            ctypes.set_errno(1)
            return -1

    library = ctypes.CDLL(None)
    monkeypatch.setattr(os, "sched_setscheduler", forbid)
    monkeypatch.setattr(ctypes, "CDLL", NoLocks)
    with real_time_process(strict=True) as refused:
        assert not gc.isenabled()
    assert len(refused) == 2
    assert "SCHED_FIFO 50) is not permitted" in refused[0]
    assert "memory lock is not permitted (Operation not permitted)" in refused[1]
    assert gc.isenabled()


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="not told by this system")
def test_the_process_behind_a_pseudo_terminal_is_known_and_how_long_it_waited():
    held, other = pty.openpty(), pty.openpty()
    name = os.ttyname(held[1])
    try:
        processes = TerminalProcesses(name)
        waited_us = processes.waited_us()
        os.close(held[0])
        left = TerminalProcesses(name)
    finally:
        for descriptor in (held[1], *other):
            os.close(descriptor)
    assert Path(f"/proc/{os.getpid()}/task/{threading.get_native_id()}") in processes.threads
    assert {thread.parts[2] for thread in processes.threads} == {str(os.getpid())}
    assert 0 <= waited_us <= processes.waited_us()
    processes.close()
    assert processes.waited_us() == left.waited_us() == 0
    assert left.threads == TerminalProcesses("/dev/null").threads == []


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="not told by this system")
def test_a_process_that_has_ended_waits_no_longer():
    serve = "import os, pty; print(os.ttyname(pty.openpty()[1]), flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", serve], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as board:
        processes = TerminalProcesses(board.stdout.readline().strip())
    with contextlib.closing(processes):
        assert len(processes.threads) == 1
        assert processes.waited_us() == 0

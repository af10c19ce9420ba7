"""Ctrl-C at the worst moment: inside a callback, where Python drops it."""

import ctypes
import signal
import subprocess
import sys
import time

import pytest

from haptogram.commands.shell.interrupts import hear_interrupts_in_callbacks


def interrupted():
    raise KeyboardInterrupt


def call_and_go_on():
    ctypes.CFUNCTYPE(None)(interrupted)()
    for _ in range(1000):
        time.sleep(0.01)


@pytest.fixture
def heeded():
    """An interrupt is ignored in what a shell runs in the background, and so are these tests."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heeded")
def test_an_interrupt_that_was_dropped_comes_again():
    with pytest.raises(KeyboardInterrupt), hear_interrupts_in_callbacks():
        call_and_go_on()
    assert sys.unraisablehook.__module__ != "haptogram.commands.shell.interrupts"


def test_other_errors_of_a_callback_are_told_as_before(monkeypatch):
    told = []
    monkeypatch.setattr(sys, "unraisablehook", told.append)
    with hear_interrupts_in_callbacks():
        ctypes.CFUNCTYPE(None)(lambda: 1 // 0)()
    assert [each.exc_type for each in told] == [ZeroDivisionError]


def test_the_end_of_the_program_looks_for_no_cycles():
    code = (
        "import gc\n"
        "from haptogram.commands.shell.interrupts import exit_at_once\n"
        "exit_at_once()\n"
        "class Loud:\n"
        "    def __init__(self): self.own = self\n"
        "    def __del__(self): print('looked for')\n"
        "def make(): Loud()\n"
        "import atexit; atexit.register(lambda: print('end')); gc.disable(); make()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "end\n"

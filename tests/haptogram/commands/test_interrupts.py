"""Ctrl-C at any moment: while a program is loaded, at work, inside a callback that drops it."""

import ctypes
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from haptogram.commands.shell.interrupts import hear_interrupts_in_callbacks

ROOT = Path(__file__).parents[3]


def interrupted():
    raise KeyboardInterrupt


def call_and_wait():
    ctypes.CFUNCTYPE(None)(interrupted)()
    time.sleep(30)
    raise TimeoutError


@pytest.fixture
def heeded():
    """An interrupt is ignored in what a shell runs in the background, and so are these tests."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heeded")
def test_an_interrupt_that_was_dropped_comes_again():
    with pytest.raises(KeyboardInterrupt), hear_interrupts_in_callbacks():
        call_and_wait()
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


@pytest.mark.parametrize("entry", ["haptogram.start", "sim_device.__main__"])
def test_nothing_else_is_loaded_before_an_interrupt_is_answered(entry):
    """Until then Python itself answers, with a traceback."""
    code = "import sys; sys.path.insert(0, ''); import os; before = set(sys.modules)\n"
    code += f"import {entry}; print(*sorted(set(sys.modules) - before))"
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", code], cwd=ROOT, capture_output=True, text=True
    )
    assert done.stdout.split() == ["__future__", entry.partition(".")[0], entry], done.stderr


#: Says when this program, not the interpreter, answers an interrupt: with its handler in place.
START = """
import os, sys
from haptogram import start
run = start._run_after_start
def say_and_run(argv):
    os.write(1, b".")
    return run(argv)
start._run_after_start = say_and_run
sys.argv[0] = "haptogram"
sys.exit(start.main())
"""
COMMANDS = {
    "verify": ["--virtual-time", "--quiet", "--resolution-mm", "1"],
    "conform": ["--quiet"],
    "field": ["--object", "hemisphere", "--resolution-mm", "1", "--picture", "field.png"],
    "soak": ["--hours", "1", "--quiet"],
    "bench": ["--seconds", "5", "--quiet"],
}


@pytest.mark.sampled(2)
@pytest.mark.usefixtures("heeded")
@pytest.mark.parametrize("command", COMMANDS)
def test_an_interrupt_at_any_moment_is_one_line_and_status_130(command, tmp_path):
    times = random.Random(command)
    # As many while it is loaded as while it is at work.
    for wait_s in [times.uniform(0.001, longest) for longest in (0.05, 0.2, 1.0)]:
        with subprocess.Popen(
            [sys.executable, "-c", START, command, *COMMANDS[command]],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        ) as process:
            process.stdout.read(1)
            time.sleep(wait_s)
            process.send_signal(signal.SIGINT)
            printed, said = process.communicate(timeout=120)
        assert process.returncode == 130, (wait_s, said)
        assert said.startswith(f"haptogram {command}: interrupted".encode())
        assert said.count(b"\n") == 1
        # Where nothing was done, there is no account of it.
        assert printed == b"" or re.search(rb"^(verdict +)?INCONCLUSIVE", printed, re.MULTILINE)
        assert list(tmp_path.iterdir()) == []


#: An interrupt that meets the methods of a dataclass, which are made by exec, and is caught.
INSIDE_EXEC = """
import sys
from haptogram import start
def run(argv):
    try:
        exec("raise KeyboardInterrupt")
    except KeyboardInterrupt:
        return 130
start._run_after_start = run
sys.exit(start.main())
"""


def test_an_interrupt_inside_an_exec_leaves_the_status_of_the_program(tmp_path):
    """``python -m`` ends by SIGINT if the last exec of a text was interrupted, though caught."""
    (tmp_path / "interrupted.py").write_text(INSIDE_EXEC)
    command = [sys.executable, "-m", "interrupted"]
    assert subprocess.run(command, cwd=tmp_path, check=False).returncode == 130


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_that_is_ignored_from_the_start_stays_so(number):
    code = f"import signal; signal.signal({int(number)}, signal.SIG_IGN)\n{START}"
    with subprocess.Popen(
        [sys.executable, "-c", code, "modulation", "am", "--array", "4x4"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        process.stdout.read(1)
        for _ in range(5):
            time.sleep(0.1)
            process.send_signal(number)
        process.communicate(timeout=120)
    assert process.returncode == 0

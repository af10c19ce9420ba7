"""Signals that come while a board starts, before it runs."""

import subprocess
import sys

import pytest

START = """
import ctypes, signal, sys, time
from sim_device import __main__ as start
from sim_device.command import command

def run(*_):
    {steps}

command.main = run
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # these tests may run below nohup
sys.exit(start.main([]))
"""
TWICE = """
    try:
        signal.raise_signal(signal.SIGTERM)
    finally:
        signal.raise_signal(signal.SIGINT)
        print("closed")
"""
IN_A_CALLBACK = """
    ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGHUP))()
    time.sleep(30)
    print("heard late")
"""


@pytest.mark.parametrize(("steps", "told"), [(TWICE, "closed\n"), (IN_A_CALLBACK, "")])
def test_a_signal_is_heard_once_wherever_it_comes(steps, told):
    done = subprocess.run(
        [sys.executable, "-c", START.format(steps=steps.strip())],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, told, "")

"""Systems without the modules of POSIX: whatever does not need them works, all else says so."""

import subprocess
import sys

import pytest

MISSING = ("fcntl", "termios", "tty", "resource", "pty")

# pyserial has modules of its own for each system, so it is imported before they go.
BLOCKED = f"""
import sys, serial
sys.modules.update(dict.fromkeys({MISSING}))
"""

WORKS = {
    "the host": "from haptogram import *",
    "the simulator": "from sim_device import *",
    "a board by URL": """
import sim_device, haptogram
sim_device.register_url_handler()
with haptogram.Driver("haptogram://?clock=virtual&array=4x4&seed=1", seed=1) as driver:
    driver.arm()
    report = driver.stream([(0.0, 0.0, 0.1)] * 20, 500, realtime=True)
assert report.status.counters.latched == 20
""",
}

REFUSED = {
    "a pty port needs the module fcntl, which this system lacks: use a TCP port, or the URL": (
        "from sim_device.line.pty_port import PtyPort; PtyPort('never')"
    ),
    "a virtual board in a process of its own needs the module fcntl, which this system lacks": (
        "from haptogram import VirtualBoard; VirtualBoard(clock='wall').__enter__()"
    ),
}


def run(program):
    return subprocess.run(
        [sys.executable, "-c", BLOCKED + program], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("service", WORKS)
def test_it_works_without_the_modules_of_posix(service):
    done = run(WORKS[service])
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("text", REFUSED)
def test_a_service_that_needs_them_names_another(text):
    done = run(REFUSED[text])
    last = done.stderr.rstrip().splitlines()[-1]
    assert done.returncode == 1
    assert last.startswith("haptogram.errors.ConfigurationError: " + text)

"""``haptogram board --as-device``: a program that lists serial ports finds the board among them."""

import json
import os
import signal
import subprocess
import sys

import pytest

from dialect_boards import DATA
from haptogram.cli import main
from haptogram.errors import ConfigurationError
from haptogram.machine.device_client import DeviceClient

pytestmark = pytest.mark.pty
CLIENT = """
import glob, pathlib, sys
import serial
port = sys.argv[1]
assert port in glob.glob("/dev/ttyS*")
(product,) = pathlib.Path("/sys/devices").glob(f"*/tty/{port[5:]}/product")
assert product.read_text() == "Haptogram virtual board\\n"
with serial.Serial(port, 230_400) as line:
    line.write(pathlib.Path(sys.argv[2]).read_bytes())
sys.exit(int(sys.argv[3]))
"""


# Ctrl-C is ignored in what a shell runs in the background, and so are these tests.
HEEDING = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from haptogram.start import main
sys.exit(main())
"""


@pytest.fixture(scope="module")
def device():
    """The device that a program finds here."""
    try:
        client = DeviceClient("/dev/null", ["true"])
    except ConfigurationError as error:
        pytest.skip(str(error))
    assert client.close() == 0
    return client.device


BOARD = ("board", "--dialect", "sonicsurface")


def board(*words):
    return subprocess.run(
        [sys.executable, "-m", "haptogram", *BOARD, *words],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.nightly
def test_watch_follows_a_program_that_lists_ports(device):
    frame = DATA / "sonicsurface" / "focus_0_120_0.bin"
    program = ["--", sys.executable, "-c", CLIENT, device, str(frame), "0"]
    words = ["watch", "--dialect", "sonicsurface", "--temperature-c", "23.21", "--as-device"]
    found = subprocess.run(
        [sys.executable, "-m", "haptogram", *words, "--expect", "0,120,0", *program],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert found.returncode == 0, found.stdout + found.stderr
    assert "one focus at (0.0, 119.9, 0.0) mm" in found.stdout
    assert "PASS: 1 latch of the client" in found.stdout


@pytest.mark.sampled(1)
@pytest.mark.parametrize("status", [0, 3])
def test_a_program_finds_the_board_and_all_that_it_sent_counts(device, tmp_path, status):
    records = tmp_path / "records.jsonl"
    sent = DATA / "sonicsurface" / "two_foci_then_4_commits.bin"
    program = [sys.executable, "-c", CLIENT, device, str(sent), str(status)]
    done = board("--backdoor", str(records), "--no-reconstruct", "--as-device", "--", *program)
    assert done.returncode == (1 if status else 0), done.stderr
    assert f"listening on {device}" in done.stdout
    if status:
        assert "ended with status 3" in done.stderr
    kinds = [json.loads(line)["kind"] for line in records.read_text().splitlines()]
    assert [kind for kind in kinds if kind != "output"] == ["board", *["pulses"] * 7, "end"]


def test_ctrl_c_ends_the_board_and_its_program_and_neither_has_failed(device):
    words = ["board", "--dialect", "sonicsurface", "--as-device", "--", "sleep", "60"]
    process = subprocess.Popen(
        [sys.executable, "-c", HEEDING, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert process.stdout.readline() == f"listening on {device}\n"
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 0, said


def test_where_the_system_does_not_permit_it_one_line_says_so(tmp_path, monkeypatch, capsys):
    refusing = tmp_path / "unshare"
    refusing.write_text("#!/bin/sh\necho unshare failed: not permitted >&2\nexit 1\n")
    refusing.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    assert main([*BOARD, "--as-device", "--", "true"]) == 2
    complaint = capsys.readouterr().err
    assert complaint.count("\n") == 1
    assert "--as-device" in complaint
    assert "--link PATH" in complaint


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--as-device"], "a program behind --"),
        (["--link", "x", "--", "true"], "a program behind --"),
        (["--as-device", "--", "no-such-program"], "no program no-such-program"),
        (["--as-device", "--fault", "line.disconnect", "--", "true"], "line.disconnect"),
    ],
)
def test_what_makes_no_sense_is_refused(words, says, capsys):
    assert main([*BOARD, *words]) == 2
    complaint = capsys.readouterr().err
    assert says in complaint
    assert complaint.count("\n") == 1

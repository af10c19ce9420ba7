"""``python -m sim_device`` as a process of its own, over a real pseudo-terminal and over TCP."""

import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
import tty
from pathlib import Path

import pytest
import serial

from haptogram.acoustics import Drive, superpose_foci
from haptogram_protocol.connection import NEED_DATA, EventReceived, HostConnection, ReplyReceived
from haptogram_protocol.messages import GetStatus, Ping, Trace, TraceMode
from haptogram_protocol.state import OutputState
from sim_device import board_settings

pytestmark = pytest.mark.pty
REPOSITORY = Path(__file__).resolve().parents[2]
PATIENCE_S = 60


class Process:
    """A board that was started, its first line, and what it leaves behind."""

    def __init__(self, folder, *arguments):
        self.folder = folder
        self.log = open(folder / "log", "ab")  # noqa: SIM115  closed by end()
        paths = [str(REPOSITORY), str(REPOSITORY / "protocol")]
        command = [sys.executable, "-m", "sim_device", "--array", "4x4", *map(str, arguments)]
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=self.log,
            cwd=folder,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        )
        ready = select.select([self.process.stdout], [], [], PATIENCE_S)[0]
        self.first_line = self.process.stdout.readline().decode() if ready else ""

    @property
    def url(self):
        assert self.first_line.startswith("listening on "), self.text()
        return self.first_line.removeprefix("listening on ").strip()

    def end(self, number=signal.SIGTERM):
        if self.process.poll() is None:
            self.process.send_signal(number)
        status = self.process.wait(PATIENCE_S)
        self.process.stdout.close()
        self.log.close()
        return status

    def text(self):
        return (self.folder / "log").read_text()


@pytest.fixture
def start(tmp_path):
    started = []

    def start_one(*arguments):
        started.append(Process(tmp_path, *arguments))
        return started[-1]

    yield start_one
    for one in started:
        one.end(signal.SIGKILL)


def wait_for(condition, what):
    deadline_s = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        assert time.monotonic() < deadline_s, f"waited in vain for {what}"
        time.sleep(0.01)
    return found


def records(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


@pytest.mark.nightly
def test_a_board_below_nohup_outlives_its_terminal(start):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        board = start("--tcp", "0")
    finally:
        signal.signal(signal.SIGHUP, before)
    assert board.url
    status = Path(f"/proc/{board.process.pid}/status").read_text()
    ignored = int(status.partition("SigIgn:")[2].split()[0], 16)
    assert ignored & 1 << signal.SIGHUP - 1
    assert board.end(signal.SIGTERM) == 0


@pytest.mark.sampled(1)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_the_link_appears_and_a_signal_leaves_nothing_behind(start, tmp_path, number):
    link = tmp_path / "board"
    board = start("--link", link)
    assert board.url == str(link)
    assert os.readlink(link).startswith("/dev/pts/")
    assert board.end(number) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log"]
    assert "Traceback" not in board.text()


@pytest.mark.nightly
def test_after_a_kill_the_stale_link_is_replaced(start, tmp_path, open_host):
    link = tmp_path / "board"
    start("--link", link).end(signal.SIGKILL)
    assert link.is_symlink()
    board = start("--link", link)
    assert open_host(board.url).greet().message.transducers == 16
    assert board.end() == 0
    assert not link.is_symlink()


@pytest.mark.nightly
def test_two_boards_cannot_have_one_link(start, tmp_path, open_host):
    link = tmp_path / "board"
    first = start("--link", link)
    second = start("--link", link)
    assert second.end() == 2
    assert f"link {link} is held by a live board" in second.text()
    assert open_host(first.url).greet().message.transducers == 16


def test_what_is_no_link_of_a_board_is_left_alone(start, tmp_path):
    link = tmp_path / "notes"
    link.write_text("mine")
    assert start("--link", link).end() == 2
    assert link.read_text() == "mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log", "notes"]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ([], "one of --link --tcp --serial --as-device is missing"),
        (
            ["--link", "/proc/none/board"],
            "--link '/proc/none/board' cannot be made: there",
        ),
        (["--tcp", "127.0.0.1:x"], "--tcp 127.0.0.1:x: must be HOST:PORT, such as 127.0.0.1:4000"),
        (["--tcp", "127.0.0.1:99999"], "--tcp 127.0.0.1:99999: the port is 99999, must be 0 to"),
        (["--tcp", "a b:0"], "--tcp a b:0: cannot listen there: there is no such host"),
        (["--tcp", "192.0.2.1:0"], "cannot listen there: this machine has no such address"),
        (
            ["--serial", "/dev/no-such-port"],
            "--serial /dev/no-such-port cannot be opened",
        ),
        (
            ["--tcp", "0", "--array", "99x99"],
            "--array is '99x99', must be a grid of 1 to 1024 elements",
        ),
        (
            ["--tcp", "0", "--backdoor", "/dev/null/x"],
            "--backdoor '/dev/null/x' cannot be written: a folder",
        ),
        (
            ["--tcp", "0", "--backdoor", "/dev/full"],
            "'/dev/full' cannot be written: the disk",
        ),
        (["--tcp", "0", "--baud", "0"], "baud is 0, must be 300 to"),
        (["--serial", "/dev/x", "--latency-ms", "1"], "--latency-ms: the line of --serial is a"),
    ],
)
def test_arguments_that_cannot_be_used_end_in_one_line_and_status_2(start, arguments, text):
    board = start(*arguments)
    assert board.end() == 2
    lines = board.text().splitlines()
    assert len(lines) == 1
    assert text in lines[0]


@pytest.mark.nightly
def test_a_client_may_crash_and_another_one_goes_on(start, tmp_path, open_host):
    board = start("--link", tmp_path / "board")
    first = open_host(board.url, 1)
    now_us = first.arm(trace_mode=TraceMode.CRC)
    for k in range(5):
        first.stream(bytes(16), now_us + 50_000 + 1_000 * k)
    first.port.write(b"\x00\x05\x01half a frame")
    first.port.close()
    second = open_host(board.url, 2)
    assert second.greet().message.nonce == 2
    assert second.ask(Ping(7)).message.echo == 7
    assert second.ask(GetStatus()).message.state is OutputState.DISARMED


@pytest.mark.nightly
def test_a_port_that_vanishes_comes_back_under_the_same_link(start, tmp_path, open_host):
    link = tmp_path / "board"
    board = start("--link", link, "--fault", "line.disconnect ms=300 from=1500ms")
    client = open_host(board.url, 1).port
    client.timeout = PATIENCE_S
    with pytest.raises(serial.SerialException):  # as when a cable is pulled
        client.read(1)
    wait_for(link.is_symlink, "the link is back")
    assert open_host(board.url, 2).greet().message.nonce == 2
    assert board.end() == 0
    assert "faults: line.disconnect 1" in board.text()
    assert not link.is_symlink()


@pytest.mark.nightly
def test_garbage_before_and_between_frames_costs_no_frame(start, tmp_path, open_host):
    board = start("--link", tmp_path / "board")
    host = open_host(board.url)
    host.port.write(b"\x03\x04\x11\x13\x0d\x0a boot messages \x00\xff")
    now_us = host.arm(trace_mode=TraceMode.CRC)
    sent = []
    for k in range(10):
        sent.append(host.stream(bytes(range(16)), now_us + 500_000 + 1_000 * k)[0])
        host.port.write(bytes([k, 0x11, 0x0A, 0x0D, 0x00, 0x7F]))
    traced = []
    while len(traced) < 10:
        heard = [e.message for e in host.listen() if isinstance(e, EventReceived)]
        traced += [message.index for message in heard if isinstance(message, Trace)]
    assert traced == sent
    counters = host.ask(GetStatus()).message.counters
    assert counters.cobs + counters.short + counters.crc >= 10


def test_every_latch_reaches_the_back_door_before_the_board_ends(start, tmp_path, open_host):
    door = tmp_path / "door.jsonl"
    board = start("--link", tmp_path / "board", "--backdoor", door, "--seed", 5)
    host = open_host(board.url)
    now_us = host.arm(hold_ms=5000)
    model = board_settings(array="4x4").model
    codes = Drive.from_weights(
        superpose_foci(model, [(0, 0.002, 0.05)], [1], [0])
    ).phase_codes.tobytes()
    sent = [host.stream(codes, now_us + 400_000 + 1_000 * k)[0] for k in range(20)]
    wait_for(lambda: host.ask(GetStatus()).message.counters.latched == 20, "20 latches")
    assert board.end() == 0
    found = records(door)
    assert [record["kind"] for record in (found[0], found[-1])] == ["board", "end"]
    latches = [record for record in found if record["kind"] == "latch"]
    assert [record["index"] for record in latches] == sent
    assert {record["reconstruction"]["kind"] for record in latches} == {"single_focus"}
    assert (found[-1]["latched"], found[-1]["dropped"], found[-1]["clean"]) == (20, 0, True)
    states = [record["state"] for record in found if record.get("event") == "state"]
    assert states == ["ARMED", "MUTED"]  # muted at its end


@pytest.mark.nightly
def test_a_kill_in_mid_stream_ends_the_worker_too_and_keeps_what_it_had(start, tmp_path, open_host):
    door = tmp_path / "door.jsonl"
    arguments = ("--backdoor", door, "--no-reconstruct")
    board = start("--link", tmp_path / "board", *arguments)
    host = open_host(board.url)
    host.arm(hold_ms=5000)
    for _ in range(10):
        host.stream(bytes(16))
        host.ask(Ping(0))
    board.end(signal.SIGKILL)
    # The worker is no child of ours; its last record says that it came to its end.
    last = wait_for(
        lambda: next((r for r in records(door) if r["kind"] == "end"), None), "the end record"
    )
    assert last["clean"] is False
    latched = [record["index"] for record in records(door) if record["kind"] == "latch"]
    assert latched == sorted(latched)
    assert len(latched) == last["latched"]


def test_the_back_door_may_be_a_socket(start, tmp_path, open_host, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a path of a socket has to be short
    door = tmp_path / "door"
    board = start("--link", tmp_path / "board", "--backdoor", "unix:door", "--no-reconstruct")
    assert board.url
    with socket.socket(socket.AF_UNIX) as client:
        client.settimeout(PATIENCE_S)
        client.connect("door")
        lines = client.makefile()
        assert json.loads(lines.readline())["kind"] == "board"
        host = open_host(board.url)
        host.arm()
        host.stream(bytes(16))
        kinds = [json.loads(lines.readline())["kind"] for _ in range(3)]
        assert kinds == ["output", "output", "latch"]
        assert board.end() == 0
        assert json.loads(lines.readlines()[-1])["kind"] == "end"
    assert not door.exists()


def test_over_tcp_one_client_at_a_time_and_the_next_after_it(start, open_host):
    board = start("--tcp", "0")
    assert board.url.startswith("socket://127.0.0.1:")
    first = open_host(board.url, 1)
    first.greet()
    address = board.url.removeprefix("socket://").split(":")
    with socket.create_connection((address[0], int(address[1])), PATIENCE_S) as other:
        assert other.recv(1) == b""
    assert first.ask(Ping(3)).message.echo == 3
    first.port.close()
    wait_for(lambda: "client gone" in board.text(), "the client to be gone")
    second = open_host(board.url, 2)
    assert second.greet().message.nonce == 2
    assert board.end() == 0


def test_at_the_far_end_of_a_cable_until_it_is_pulled(start):
    master, slave = os.openpty()
    tty.setraw(slave)
    board = start("--serial", os.ttyname(slave))
    assert board.url == os.ttyname(slave)
    os.close(slave)
    link = HostConnection(nonce=9)
    link.send_hello(0)
    os.write(master, link.data_to_send())
    heard = []
    while not heard:
        link.receive_data(os.read(master, 4096), 0)
        heard = list(iter(link.next_event, NEED_DATA))
    assert isinstance(heard[0], ReplyReceived)
    os.close(master)
    assert board.process.wait(PATIENCE_S) == 1
    assert "the other side is gone" in board.text() or "error" in board.text()


@pytest.mark.nightly
def test_an_output_that_fails_does_not_hide_a_lost_port(start, tmp_path):
    master, slave = os.openpty()
    port, capture = os.ttyname(slave), tmp_path / "pins.vcd"
    board = start("--serial", port, "--capture", capture)
    assert board.url == port
    os.close(slave)
    capture.mkdir()
    os.close(master)
    assert board.process.wait(PATIENCE_S) == 1
    lost, unwritten = board.text().splitlines()[-1].split("; ", 1)
    assert f": {port}: " in lost
    assert unwritten.startswith(f"--capture '{capture}' cannot be written: it is a folder")


def test_an_output_that_fails_alone_is_an_error_of_the_arguments(start, tmp_path):
    capture = tmp_path / "pins.vcd"
    board = start("--link", tmp_path / "board", "--capture", capture)
    assert board.url == str(tmp_path / "board")
    capture.mkdir()
    assert board.end() == 2
    assert f"--capture '{capture}' cannot be written: it is a folder" in board.text()


def test_the_log_has_one_line_per_event(start, tmp_path, open_host):
    board = start("--link", tmp_path / "board")
    host = open_host(board.url)
    host.arm(hold_ms=10, ramp_ms=5)
    host.stream(bytes(16))
    wait_for(lambda: host.ask(GetStatus()).message.state is OutputState.MUTED, "the hold to end")
    board.end()
    lines = [line.split(" ", 2)[2] for line in board.text().splitlines()]
    texts = ["session 0x5eed opened", "armed", "ramp to silence began: hold expired"]
    texts += ["muted: hold expired", "ramp ended: silence", "told to end"]
    assert [line.rpartition(", at")[0] for line in lines] == texts

"""``haptogram replay``: the same board does the same, a wrong one shows where it does not."""

import json
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
import serial

pytest.importorskip("mcap")

from haptogram.cli import main
from haptogram.evidence.recordings.channels import TO_BOARD
from haptogram.evidence.recordings.reader import Recording
from haptogram.evidence.recordings.writer import RecordingWriter
from mutants import MUTANTS

CAPTURES = Path(__file__).parents[1] / "data" / "dialects"
BUSY = (0, 1, 3)  # a busy machine loses some frames
BUSY_TRIES = 6
MAGIC = b"\x89MCAP0\r\n"
POINT = ("verify", "--quiet", "--object", "point", "--array", "8x8")
STILL = (*POINT, "--virtual-time", "--repeat", "20")


def record(path, *words, status=0, tries=1):
    """Record a run that ends so; on a busy machine it may lose frames, and is tried again."""
    ends = []
    for _ in range(tries):
        ends.append(main([*map(str, words), "--record", str(path)]))
        if ends[-1] == status:
            return path
        path.unlink()
    pytest.fail(f"the runs ended with {ends}, not {status}")


def replay(capsys, path, *words):
    capsys.readouterr()
    status = main(["replay", str(path), *map(str, words)])
    return status, capsys.readouterr()


@pytest.mark.parametrize(
    "words",
    [("--mode", "points"), ("--mode", "sequence"), ("--baud", "921600", "--rate-hz", "200")],
    ids=["points", "sequence", "slow line"],
)
def test_a_board_in_virtual_time_does_the_same_again(words, tmp_path, capsys):
    path = record(tmp_path / "run.mcap", *STILL, *words)
    status, said = replay(capsys, path)
    assert status == 0, said.out
    assert "clock     the board's, every field compared" in said.out
    assert re.search(r"latches +20 the same, 0 different", said.out)


@pytest.mark.parametrize(
    "fault", ["line.flip ber=1e-4", "device.dead transducer=3", "clock.ppm ppm=40"]
)
def test_a_faulty_board_does_the_same_again_and_a_healthy_one_does_not(fault, tmp_path, capsys):
    path = tmp_path / "run.mcap"
    assert main([*STILL, "--fault", fault, "--record", str(path)]) in (0, 1, 3)
    status, said = replay(capsys, path)
    assert status == 0, said.out
    assert replay(capsys, path, "--healthy")[0] == 1


#: How each of them differs from a healthy board, when its own clause is tried.
WRONG = {
    "phase-inverted": "drive differs in",
    "late-unmarked": "late False recorded, True replayed",
    "trace-of-radiated": "crc",
    "counters-stuck": "counters",
    "mute-ignored": "state",
    "replies-without-time": "t_us 0 recorded",
    "events-first": "t_us",
    "crc-unchecked": "",
    "ramp-skipped": "",
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("mutant", WRONG)
def test_a_mutant_is_the_same_again_and_differs_from_a_healthy_board(mutant, tmp_path, capsys):
    path, result = tmp_path / "bug.mcap", tmp_path / "result.json"
    address, clause = MUTANTS[mutant].address, MUTANTS[mutant].clause
    port = f"haptogram://?clock=virtual&array=4x4&mutant={address}"
    words = ("conform", "--quiet", "--port", port, "--clause", clause, "--record", str(path))
    assert main(words) in (0, 1, 3)
    status, said = replay(capsys, path)
    assert status == 2
    assert f"give --mutant {address} to load and run it" in said.err
    status, said = replay(capsys, path, "--mutant", address)
    assert status == 0, said.out
    status, said = replay(capsys, path, "--healthy", "--json", result)
    assert status == 1
    assert said.out.startswith("FAIL: ")
    found = json.loads(result.read_text())
    differences = [d for board in found["boards"] for d in board["differences"]]
    assert any(re.search(WRONG[mutant], d["detail"]) for d in differences), differences
    assert any(d["what"] in said.out for d in differences)


# --- Recordings of the wall clock -----------------------------------------------------------------


@pytest.fixture
def board(tmp_path):
    """Give a function that starts a board in a process of its own, and returns its link."""
    running = []

    def start(*words):
        link = tmp_path / f"board{len(running)}"
        command = [sys.executable, "-m", "haptogram", "board", "--link", str(link), *words]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        running.append(process)
        assert process.stdout.readline().startswith(b"listening")
        return link

    def stop():
        for process in running:
            process.terminate()
            process.wait(30)
            process.stdout.close()

    start.stop, start.running = stop, running
    try:
        yield start
    finally:
        stop()


@pytest.mark.pty
@pytest.mark.realtime
def test_a_board_on_the_wall_clock_does_the_same_again_byte_for_byte(board, tmp_path, capsys):
    path = tmp_path / "board.mcap"
    link = board("--seed", "3", "--array", "8x8", "--baud", "3000000", "--record", str(path))
    assert main([*POINT, "--port", str(link), "--repeat", "50"]) in BUSY
    board.stop()
    status, said = replay(capsys, path)
    assert status == 0, said.out
    assert "every field compared" in said.out


@pytest.mark.nightly
@pytest.mark.pty
@pytest.mark.realtime
def test_a_run_by_the_host_s_clock_is_set_against_the_board_s(board, tmp_path, capsys):
    # The recording has the time of the host: a board that took a frame late would differ.
    path = record(tmp_path / "run.mcap", *POINT, "--repeat", 20, "--lead-ms", 100, tries=BUSY_TRIES)
    status, said = replay(capsys, path)
    assert status == 0, said.out
    assert "fields of the moment left out" in said.out
    link = board("--array", "8x8")
    status, said = replay(capsys, path, "--port", link)
    assert status == 0, said.out
    other = board("--array", "4x4")
    status, said = replay(capsys, path, "--port", other)
    assert status == 2
    assert "the board has 16 transducers; the recording is of 64" in said.err
    assert said.err.count("\n") == 1


@pytest.mark.pty
@pytest.mark.realtime
def test_of_a_board_at_a_port_the_frames_alone_are_compared(board, tmp_path, capsys):
    link = board("--array", "8x8")
    words = (*POINT, "--port", str(link), "--repeat", 20, "--lead-ms", 100)
    status, said = replay(capsys, record(tmp_path / "port.mcap", *words, tries=BUSY_TRIES))
    assert status == 0, said.out
    assert "no latches are in the recording: the frames alone are compared" in said.out


@pytest.mark.pty
@pytest.mark.realtime
def test_a_board_of_another_dialect_does_the_same_again(board, tmp_path, capsys):
    path = tmp_path / "board.mcap"
    link = board("--dialect", "sonicsurface", "--record", str(path))
    sent = (CAPTURES / "sonicsurface" / "two_foci_then_4_commits.bin").read_bytes()
    with serial.serial_for_url(str(link)) as port:
        port.write(sent)
        port.flush()
        while to_board(path) < len(sent):  # the board has come to the end
            port.write(b"\xfd")
            time.sleep(0.06)
    board.stop()
    status, said = replay(capsys, path)
    assert status == 0, said.out
    assert re.search(r"pulses +[1-9]\d* the same, 0 different", said.out)
    assert main(["decode", str(path)]) == 0
    decoded = capsys.readouterr()
    assert decoded.out.count("SetPhases boards") == 2
    assert "look like sonicsurface and ultraino-fpga" in decoded.err


def to_board(path):
    if not path.exists() or path.stat().st_size < 4096:
        return 0
    return sum(len(entry.data) for entry in Recording(path).entries((TO_BOARD,)))


@pytest.mark.pty
@pytest.mark.realtime
def test_a_board_goes_on_when_its_recording_cannot(board, capsys):
    link = board("--array", "8x8", "--record", "/dev/full")
    assert main([*POINT, "--port", str(link)]) in BUSY
    assert "frames    1 sent" in capsys.readouterr().out
    (process,) = board.running
    process.terminate()
    assert process.wait(30) == 2


# --- Parts, and what cannot be replayed -----------------------------------------------------------


def test_a_recording_that_was_cut_off_is_replayed_as_far_as_it_goes(tmp_path, capsys):
    path = record(tmp_path / "run.mcap", *STILL)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    status, said = replay(capsys, cut)
    assert status == 0, said.out
    assert "the recording was cut off" in said.out


def test_an_excerpt_of_a_soak_is_inconclusive(tmp_path, capsys):
    words = ("soak", "--quiet", "--hours", "0.001", "--mutant", "latches-one-period-late")
    path = record(tmp_path / "soak.mcap", *words, status=1)
    status, said = replay(capsys, path)
    assert status == 3
    assert "an excerpt of a soak is not replayed" in said.out


def test_a_recording_without_a_run_is_inconclusive(tmp_path, capsys):
    RecordingWriter(tmp_path / "nothing.mcap").close()
    status, said = replay(capsys, tmp_path / "nothing.mcap")
    assert status == 3
    assert said.out.startswith("INCONCLUSIVE")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--array", "16x16"), "has 256 transducers; the recording is of 64"),
        (("--array", "8x"), "array"),
        (("--mutant", "no-such"), "no-such"),
        (("--port", "/dev/no-such"), "there is no such port"),
        (("--port", "a", "--healthy"), "--healthy acts only without --port"),
        (("--baud", "9600"), "--baud acts only with --port"),
        (("--json", "."), "it is a folder"),
    ],
)
def test_what_does_not_go_together_is_one_line(words, message, tmp_path, capsys):
    path = record(tmp_path / "run.mcap", *STILL)
    status, said = replay(capsys, path, *words)
    assert status == 2
    assert message in said.err
    assert said.err.count("\n") == 1


@pytest.mark.parametrize("command", ["replay", "decode --input recording", "repair"])
@pytest.mark.parametrize(
    "content", [b"", b"\x89MCAP0\r\n", b"hello", b"\x89MCAP0\r\n" + b"\xff" * 99]
)
def test_what_is_no_recording_is_one_line(command, content, tmp_path, capsys):
    path = tmp_path / "file.mcap"
    path.write_bytes(content)
    name, *options = command.split()
    copy = [str(tmp_path / "copy")] if name == "repair" else []
    assert main([name, str(path), *copy, *options]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert str(path) in error

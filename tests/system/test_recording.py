"""``--record`` of every command that talks to a board; a board that is killed; a full disk."""

import collections
import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("mcap")
from mcap.reader import make_reader

from haptogram.cli import main
from haptogram.errors import missing_extra
from haptogram.evidence.recordings.channels import (
    FAULTS,
    FOCUS,
    LATCH,
    LINK,
    OUTPUT,
    RUN,
    SUMMARY,
    TO_BOARD,
    TO_HOST,
    VERDICT,
)
from haptogram.evidence.recordings.reader import Recording
from haptogram_protocol.annotation.frames import FrameAnnotator
from process_limits import run_with_full_disk

HAPTOGRAM = (sys.executable, "-m", "haptogram")
POINT = ("verify", "--quiet", "--object", "point", "--array", "8x8")
STILL = (*POINT, "--virtual-time", "--repeat", "20")


def recorded(path, *words):
    status = main([*map(str, words), "--record", str(path)])
    recording = Recording(path)
    counts = collections.Counter(entry.topic for entry in recording.entries())
    assert recording.is_whole
    return status, recording, counts


def test_a_run_in_virtual_time_keeps_bytes_latches_fields_and_verdicts(tmp_path, capsys):
    result = tmp_path / "result.json"
    status, recording, counts = recorded(tmp_path / "run.mcap", *STILL, "--json", result)
    assert status == 0
    assert "wrote" in capsys.readouterr().err
    assert counts[LATCH] == counts[FOCUS] == counts[VERDICT] == 20
    assert counts[TO_BOARD] >= 20
    assert min(counts[TO_HOST], counts[OUTPUT]) > 0
    assert counts[FAULTS] == counts[SUMMARY] == counts[RUN] == counts[LINK] == 1
    assert recording.run["configuration"]["repeat"] == 20
    (summary,) = recording.entries((SUMMARY,))
    written = json.loads(result.read_text())
    assert summary.fields == written
    verdicts = [entry.fields for entry in recording.entries((VERDICT,))]
    keys = [(v["session"], v["sequence"], v["loop"], v["index"]) for v in verdicts]
    assert keys == [latch.key for latch in recording.latches()]
    assert {v["verdict"] for v in verdicts} == {"on target"}


def test_the_same_run_gives_the_same_file(tmp_path):
    for name in ("one", "two"):
        assert main([*STILL, "--record", str(tmp_path / name)]) == 0
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


@pytest.mark.nightly
@pytest.mark.pty
@pytest.mark.realtime
def test_a_run_over_a_pty_keeps_the_latches_that_the_board_tells_at_its_end(tmp_path):
    pace = ("--rate-hz", 100, "--lead-ms", 1000)  # a busy machine is held up for 0.1 s and more
    status, recording, counts = recorded(tmp_path / "run.mcap", *POINT, "--repeat", 30, *pace)
    assert status in (0, 1, 3)  # it may lose some frames all the same
    assert counts[VERDICT] == 30
    assert counts[LATCH] > 0
    times = [entry.t_ns for entry in recording.entries((TO_BOARD, TO_HOST))]
    assert times == sorted(times)


def test_a_suite_keeps_board_after_board(tmp_path, capsys):
    status, recording, counts = recorded(
        tmp_path / "suite.mcap", "conform", "--quiet", "--clause", "HG-4.1", "--clause", "HG-4.7"
    )
    assert status == 0
    assert capsys.readouterr()
    links = [entry.fields for entry in recording.entries((LINK,))]
    assert [link["event"] for link in links] == ["opened"] * len(links)
    assert [link["board"].get("seed", 0) for link in links] == list(range(len(links)))
    times = [entry.t_ns for entry in recording.entries((TO_BOARD, TO_HOST, LINK))]
    assert times == sorted(times)
    assert counts[SUMMARY] == 1


@pytest.mark.nightly
@pytest.mark.pty
@pytest.mark.realtime
def test_a_benchmark_keeps_its_frames(tmp_path, capsys):
    pace = ("--rate-hz", 100, "--lead-ms", 1000)
    status, _, counts = recorded(tmp_path / "bench.mcap", "bench", "--seconds", 0.5, *pace)
    assert status == 0
    assert 0 < counts[LATCH] <= 50  # a busy machine loses some
    assert counts[TO_BOARD] > 0
    assert capsys.readouterr().err.count("wrote") == 1


@pytest.mark.nightly
@pytest.mark.parametrize("jobs", [2])
def test_a_soak_keeps_the_seconds_around_a_violation(jobs, tmp_path, capsys):
    account = tmp_path / "soak.json"
    words = ("soak", "--quiet", "--hours", "0.004", "--segment-minutes", "0.12", "--jobs", jobs)
    status, recording, counts = recorded(
        tmp_path / "soak.mcap", *words, "--mutant", "latches-one-period-late", "--json", account
    )
    assert status == 1
    assert capsys.readouterr()
    links = [entry.fields for entry in recording.entries((LINK,))]
    examples = json.loads(account.read_text())["tally"]["examples"]
    assert examples
    assert {link["event"] for link in links} == {"excerpt"}
    assert any(links[0]["text"] in example for example in examples)  # whichever segment ended first
    assert min(counts[TO_BOARD], counts[TO_HOST], counts[LATCH]) > 0


def test_a_healthy_soak_has_no_excerpt(tmp_path, capsys):
    status, _, counts = recorded(tmp_path / "soak.mcap", "soak", "--quiet", "--hours", "0.002")
    assert status == 0
    assert capsys.readouterr()
    assert set(counts) == {RUN}


# --- A board that is killed ----------------------------------------------------------------------


@pytest.fixture
def board(tmp_path):
    """Give a recording board in a process of its own, and its recording."""
    link, path = tmp_path / "board", tmp_path / "board.mcap"
    process = subprocess.Popen(
        [*HAPTOGRAM, "board", "--link", link, "--seed", "1", "--array", "8x8", "--record", path],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    try:
        assert process.stdout.readline().startswith(b"listening")
        yield process, link, path
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


@pytest.mark.pty
@pytest.mark.realtime
def test_what_a_killed_board_has_written_is_readable_by_us_and_by_others(board, tmp_path, capsys):
    process, link, path = board
    host = subprocess.Popen(
        [*HAPTOGRAM, *POINT, "--port", link, "--repeat", "100000"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        while latches(path) < 50:  # it streams, and goes on
            assert process.poll() is None
            time.sleep(0.2)
        process.kill()
        process.wait()
    finally:
        host.kill()
        host.wait()
    recording = Recording(path)
    frames = [latch.index for latch in recording.latches()]
    assert not recording.is_whole
    assert frames == list(range(frames[0], frames[0] + len(frames)))
    line = b"".join(entry.data for entry in recording.entries((TO_BOARD,)))
    sent = sum(piece.name == "PHASES" for piece in FrameAnnotator().feed(line))
    assert sent >= len(frames)
    copy = tmp_path / "whole.mcap"
    capsys.readouterr()
    assert main(["repair", str(path), str(copy)]) == 0
    assert "the recording was cut off" in capsys.readouterr().err
    with copy.open("rb") as file:
        reader = make_reader(file)
        assert reader.get_summary().statistics.message_count == sum(1 for _ in recording.entries())
        assert sum(1 for _ in reader.iter_messages(topics=[LATCH])) == len(frames)
    assert main(["decode", str(path)]) == 0


def latches(path):
    if not path.exists() or path.stat().st_size < 4096:
        return 0
    return sum(1 for _ in Recording(path).latches())


@pytest.mark.pty
def test_a_board_that_ends_in_order_leaves_a_whole_recording(board):
    process, _, path = board
    process.terminate()
    assert process.wait(30) == 0
    recording = Recording(path)
    topics = [entry.topic for entry in recording.entries()]
    assert recording.is_whole
    assert topics[-1] == FAULTS
    assert recording.board["transducers"] == 64


# --- A disk that takes no more -------------------------------------------------------------------


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "words",
    [(*STILL, "--repeat", "200"), ("conform", "--quiet", "--clause", "HG-4.1", "--repeat", "30")],
    ids=["verify", "conform"],
)
def test_a_full_disk_ends_the_recording_and_not_the_run(words, tmp_path):
    path = tmp_path / "run.mcap"
    done = run_with_full_disk([*words, "--record", path], room_bytes=30_000)
    assert done.returncode == 2
    assert "PASS" in done.stdout
    assert done.stderr.count("the recording ended early") == 1
    assert "Traceback" not in done.stderr
    assert Path(path).stat().st_size <= 30_000
    assert list(Recording(path).entries())


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((*STILL, "--record", "."), "--record '.' cannot be written: it is"),
        ((*STILL, "--record", "a", "--json", "a"), "are both the same file"),
        (("bench", "--record", "a", "--json", "a"), "are both the same file"),
        (
            ("soak", "--hours", "1", "--record", "."),
            "--record '.' cannot be written: it is",
        ),
        (("conform", "--list", "--record", "a"), "--record acts only where cases are run"),
        (("board", "--tcp", "0", "--record", "-"), "name a file"),
        (("board", "--tcp", "0", "--record", "."), "'.' cannot be written: it is a folder"),
    ],
)
def test_a_recording_that_cannot_be_written_is_refused_before_the_run(words, message, capsys):
    assert main([*words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    "words",
    [
        (*STILL, "--record", "run.mcap"),
        ("bench", "--record", "run.mcap"),
        ("board", "--tcp", "0", "--record", "run.mcap"),
        ("replay", "run.mcap"),
        ("decode", "run.mcap", "--input", "recording"),
        ("repair", "run.mcap", "whole.mcap"),
    ],
    ids=lambda words: words[0],
)
def test_without_the_package_the_extra_is_named_before_the_run(
    words, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    if "--record" not in words:
        Path("run.mcap").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "mcap", None)
    assert main([*words]) == 2
    error = capsys.readouterr().err
    assert str(missing_extra("recordings need the package mcap", "record")) in error
    assert error.count("\n") == 1

"""The benchmark for real, and short: that it measures everything, not how fast anything is."""

import contextlib
import gc
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from haptogram.campaigns.bench import measure
from haptogram.campaigns.bench.config import BenchConfig
from haptogram.campaigns.bench.measure import run_bench
from haptogram.campaigns.bench.result import STAGES, bench_dict, read_bench_result
from haptogram.cli import main
from haptogram.errors import ConfigurationError
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram.report.bench.document import bench_outcome

pytestmark = [pytest.mark.pty, pytest.mark.realtime]


@pytest.fixture(scope="module")
def board():
    with VirtualBoard("4x4", reconstruct=False, clock="wall") as board:
        yield board


@pytest.fixture(scope="module")
def run():
    return run_bench(BenchConfig(rate_hz=500, seconds=0.6, spin_us=100))


def test_every_frame_has_every_stage_or_is_said_to_lack_it(run):
    assert set(run.stages_us) == set(STAGES)
    frames = {name: len(v) for name, v in run.stages_us.items() if name != "control"}
    assert set(frames.values()) == {300}
    assert len(run.stages_us["control"]) > 0
    assert run.latched == (~np.isnan(run.stages_us["latch"])).sum()
    counters = run.report.status.counters
    lost = counters.dropped_late + counters.dropped_state + len(run.report.skipped)
    assert run.latched + lost == 300
    own_us = run.stages_us["line"][~np.isnan(run.stages_us["line"])]
    assert own_us.min() >= 913.333
    assert np.nanmin(run.stages_us["wake"]) >= 0


def test_frames_count_as_latched_whose_records_come_late(monkeypatch):
    opened, stopped = measure._bench_board, []  # noqa: SLF001  no other way to its worker

    def board_with_a_slow_worker(config, parts):
        board = opened(config, parts)
        settle, process = board.settle, board._board.pid  # noqa: SLF001
        stopped.extend(
            map(int, Path(f"/proc/{process}/task/{process}/children").read_text().split())
        )

        def settle_once_the_worker_goes_on(driver):
            for worker in stopped:
                os.kill(worker, signal.SIGCONT)
            settle(driver)

        for worker in stopped:
            os.kill(worker, signal.SIGSTOP)
        board.settle = settle_once_the_worker_goes_on
        return board

    monkeypatch.setattr(measure, "_bench_board", board_with_a_slow_worker)
    try:
        found = run_bench(BenchConfig(rate_hz=500, seconds=0.2))
    finally:
        for worker in stopped:
            with contextlib.suppress(ProcessLookupError):
                os.kill(worker, signal.SIGCONT)
    assert stopped
    assert found.latched == found.report.status.counters.latched


def test_every_miss_has_a_cause(run):
    for misses in run.misses.values():
        assert [miss.limit_us for miss in misses] == [100.0, 1000.0]
        assert misses[0].count >= misses[1].count
        for miss in misses:
            assert sum(miss.by_cause.values()) == miss.count


def test_a_board_at_a_port_is_measured_by_its_own_word(board):
    run = run_bench(BenchConfig(port=board.url, rate_hz=200, seconds=0.5, lead_ms=600))
    assert run.percentiles()["board"].n == 0
    assert run.percentiles()["latch"].n == run.latched > 0


def test_the_command_writes_compares_and_draws(run, tmp_path, capsys):
    old, new, page = tmp_path / "old.json", tmp_path / "new.json", tmp_path / "page.html"
    picture = tmp_path / "histogram.svg"
    old.write_text(json.dumps(bench_dict(run)))
    arguments = ["bench", "--seconds", "0.5", "--rate-hz", "500", "--json", str(new)]
    more = ["--compare", str(old), "--html", str(page), "--picture", str(picture)]
    assert main([*arguments, "--trim", "--realtime", *more]) == 0
    gc.freeze()  # again: a later collection would look through thousands of tests
    text = capsys.readouterr().out
    assert "unchanged within the noise: " in text
    assert "configuration: trim was False, is True" in text
    for name, meaning in STAGES.items():
        assert name in text
        assert meaning in text
    assert json.loads(new.read_text())["frames"]["due"] == 250
    assert page.read_text().count("data:image/svg") == 1
    assert picture.read_text().startswith("<?xml")
    assert read_bench_result(new)["configuration"]["trim"]


def test_a_bench_has_the_tone_of_what_reached_the_output(run):
    result = bench_dict(run)
    for frames, held, late, tone in (
        (400, 0, 0, "good"),
        (400, 0, 300, "doubt"),
        (400, 1, 0, "doubt"),
        (400, 400, 400, "bad"),
        (0, 0, 0, "bad"),
    ):
        result["frames"] |= {"due": 400, "latched": frames, "late": held}
        for miss in result["misses"]["at_board"] + result["misses"]["at_port"]:
            miss["count"] = late
        assert bench_outcome(result)[0] == tone


def test_a_result_survives_its_file(run, tmp_path):
    path = tmp_path / "x.json"
    path.write_text(json.dumps(bench_dict(run)))
    assert read_bench_result(path) == json.loads(path.read_text())


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("{", "line 1"),
        ("[]", "not a result"),
        ('{"format": "other"}', "not a result"),
        ('{"format": "haptogram-bench", "version": 99}', "version 99"),
    ],
)
def test_a_file_that_is_no_result_is_refused(tmp_path, content, text):
    path = tmp_path / "old.json"
    path.write_text(content)
    with pytest.raises(ConfigurationError, match=text):
        read_bench_result(path)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"rate_hz": 50}, "rate_hz is 50, must be 100 to 10000 Hz"),
        ({"rate_hz": float("nan")}, "rate_hz is nan, must be 100 to 10000 Hz"),
        ({"seconds": 0}, "seconds is 0, must be 0.001 to 86400 s"),
        ({"seconds": 1e4}, "these are 10000000 frames, must be 300000 at most"),
        ({"spin_us": -1}, "spin_us is -1, must be 0 to 10000 µs"),
        ({"spin_us": 251}, "spin_us is 251 µs; at 1000 Hz it can be 0 to 250 µs, a quarter"),
        ({"spin_us": 63, "rate_hz": 4000}, "at 4000 Hz it can be 0 to 62.5 µs"),
    ],
)
def test_what_cannot_be_measured_is_refused(options, text):
    with pytest.raises(ConfigurationError, match=text):
        BenchConfig(**options)


def test_the_longest_spin_is_a_quarter_of_the_period():
    assert BenchConfig(spin_us=250).spin_us == 250


def test_a_spin_beyond_its_limit_is_one_line_with_its_option(capsys):
    assert main(["bench", "--spin-us", "1000", "--seconds", "0.1"]) == 2
    said = capsys.readouterr()
    assert said.err == (
        "haptogram bench: --spin-us is 1000 µs; at 1000 Hz it can be 0 to 250 µs, a quarter of the "
        "period\n"
    )
    assert said.out == ""


def test_a_rate_that_the_line_cannot_carry_is_refused_with_the_one_it_can(capsys):
    assert main(["bench", "--rate-hz", "2000", "--seconds", "0.1"]) == 2
    assert (
        "--rate-hz is 2000; 274 bytes a frame at 3000000 baud carry 1094 frames/s"
        in capsys.readouterr().err
    )


def test_pictures_and_the_board_are_imported_only_when_needed():
    code = "import haptogram.commands.bench, sys; print('numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"

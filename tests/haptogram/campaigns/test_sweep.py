"""Sweeps: the same file on any number of workers, in any number of sittings, whoever dies."""

from __future__ import annotations

import contextlib
import csv
import html
import importlib.util
import itertools
import json
import multiprocessing
import os
import pickle
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import pytest

from haptogram.campaigns.sweep.campaign import OpenWorkers, SweepCampaign
from haptogram.campaigns.sweep.plan import SweepPlan
from haptogram.campaigns.sweep.rows import Row, write_rows
from haptogram.campaigns.sweep.workers import Workers, process_workers
from haptogram.cli import command_parser, main
from haptogram.cli.program import result_of_command
from haptogram.errors import ConfigurationError

HAS_DASK = importlib.util.find_spec("distributed") is not None
HAS_PARQUET = importlib.util.find_spec("pyarrow") is not None
needs_dask = pytest.mark.skipif(not HAS_DASK, reason="distributed (extra sweep) is not installed")
needs_parquet = pytest.mark.skipif(not HAS_PARQUET, reason="pyarrow (extra sweep) is not installed")

POINTS = """
[sweep]
run = "verify"

[options]
object = "point"
repeat = 40
array = "6x6"

[axes]
fault = { text = "line.drop p={} from=30ms", values = [0, 5e-3] }
seed = { low = 1, high = 4 }
"""
FATAL = """
[sweep]
run = "soak"
[options]
hours = 2e-5
[axes]
mutant = [[], "sweep_boards:Raises", "sweep_boards:EndsItsProcess"]
seed = {seeds}
"""


def planned(text: str, folder: Path) -> SweepPlan:
    path = folder / "sweep.toml"
    path.write_text(text)
    return SweepPlan.read(path, command_parser)


def quiet() -> None:
    pass


def rows_of(plan: SweepPlan, workers: OpenWorkers, show: Callable[[], None] = quiet) -> list[Row]:
    campaign = SweepCampaign(plan)
    campaign.run(result_of_command, workers, show)
    assert campaign.is_complete
    return campaign.rows_in_order


def jobs(count: int) -> OpenWorkers:
    return lambda: process_workers(count)


class ThisProcess(Executor):
    """Does at once what it is given."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


@contextlib.contextmanager
def no_workers() -> Iterator[Workers]:
    yield Workers(ThisProcess(), 1)


# --- the points ----------------------------------------------------------------------------------


def test_a_grid_is_every_combination_and_the_last_axis_changes_fastest(tmp_path: Path) -> None:
    plan = planned(POINTS, tmp_path)
    found = [tuple(plan[number].values.values()) for number in range(len(plan))]
    assert found == list(itertools.product([0, 5e-3], [1, 2, 3, 4]))
    common = ["verify", "--virtual-time", "--object=point", "--repeat=40", "--array=6x6"]
    assert plan[6].words == [*common, "--fault=line.drop p=0.005 from=30ms", "--seed=3"]


def test_random_points_are_within_their_bounds_and_follow_from_seed_and_number(
    tmp_path: Path,
) -> None:
    text = """
    [sweep]
    run = "verify"
    points = 300
    seed = 5
    [axes]
    board_temperature_c = { low = 15.5, high = 25.5 }
    fault = { text = "line.flip ber={}", low = 1e-7, high = 1e-3, log = true }
    array = ["8x8", "16x16"]
    """
    plan = planned(text, tmp_path)
    found = [plan[number].values for number in range(len(plan))]
    assert len(found) == 300
    assert found == [plan[number].values for number in range(300)]
    assert found[:5] != [
        planned(text.replace("seed = 5", "seed = 6"), tmp_path)[n].values for n in range(5)
    ]
    rates = sorted(values["fault"] for values in found)
    assert 1e-7 <= rates[0] < 2e-7
    assert 5e-4 < rates[-1] <= 1e-3
    assert 3e-6 < rates[150] < 3e-5  # uniform in the logarithm
    assert 15.5 <= min(v["board_temperature_c"] for v in found) < 16.0
    assert {v["array"] for v in found} == {"8x8", "16x16"}


def test_the_page_of_the_docs_has_the_example_that_runs() -> None:
    docs = Path(__file__).resolve().parents[3] / "docs"
    example = docs / "examples" / "sweep.toml"
    assert len(SweepPlan.read(example, command_parser)) == 32
    assert example.read_text().partition("\n")[2] in (docs / "sweep.md").read_text()


VERIFY = '[sweep]\nrun = "verify"\n'


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "[sweep] must say what to run: verify, conform or soak"),
        ('[sweep]\nrun = "bench"\n', "run is 'bench'; known are verify, conform, soak"),
        ("[sweep\n", "is no TOML"),
        ("[sweeps]\n", "[sweeps] is not read; its tables are [sweep], [options], [axes]"),
        (VERIFY, "[axes] names no option: the sweep would be empty"),
        ("sweep = 5\n", "sweep is 5, must be a table: [sweep]"),
        (f"axes = []\n{VERIFY}", "axes is [], must be a table: [axes]"),
        (VERIFY + "point = 3\n", "point is not a setting; did you mean points?"),
        (VERIFY + "points = 0\n", "points is 0, must be 1 to 1000000"),
        (VERIFY + "[axes]\nsede = [1]\n", "there is no option --sede; did you mean --seed?"),
        (VERIFY + "[axes]\nseed = []\n", "seed has no value: the sweep would be empty"),
        (VERIFY + "[axes]\nseed = { low = 3, high = 2 }\n", "high must be low or more"),
        (VERIFY + "[axes]\nseed = { from = 3 }\n", "seed: 'from' is not read; known are values"),
        (VERIFY + "[axes]\nseed = { text = 'x' }\n", "seed: text 'x' has no {} for the value"),
        (VERIFY + "[axes]\nseed = {}\n", "seed has neither values nor low and high"),
        (VERIFY + "[axes]\nseed = [1, -2]\n", "--seed is -2, must be 0 to 4294967295"),
        (VERIFY + "[axes]\nseed = { low = 0, high = 1000000 }\n", "the grid has 1000001 points"),
        (VERIFY + "[axes]\nrate_hz = { low = 1.5, high = 2 }\n", "say points in [sweep]"),
        (VERIFY + "[axes]\nfault = ['line.flop']\n", "line.flop"),
        (VERIFY + "[axes]\nfault = { text = 'line.drop p={}', values = [2] }\n", "must be 0 to 1"),
        (VERIFY + "[axes]\nseed = [{ a = 1 }]\n", "seed is {'a': 1}, must be a value or a list"),
        (VERIFY + "[axes]\njson = ['a']\n", "json is an option of one run, not of many points"),
        (
            VERIFY + "[options]\nfrom-recording = 'a'\n[axes]\nseed = [1]\n",
            "from_recording is an option of one run",
        ),
        (
            VERIFY + "[options]\nrate-hz = 1\n[axes]\nrate_hz = [1]\n",
            "rate_hz is in [options] and in [axes]; name it once",
        ),
        (
            VERIFY + "[axes]\nrate_hz = [1]\nrate-hz = [1]\n",
            "one of rate_hz, rate-hz is named twice",
        ),
        (
            VERIFY + "[axes]\nseed = { low = 0, high = 4000000000 }\n"
            "repeat = { low = 1, high = 4000000000 }\nrate_hz = { low = 1, high = 9 }\n",
            "the grid has 144000000036000000000 points, must be 1 to 1000000",
        ),
        (VERIFY + "[options]\nhelp = true\n", "help is an option of one run, not of many points"),
        (VERIFY + "[axes]\nseed = { values = [1], low = 3 }\n", "seed: 'low' is not read; known"),
        (
            VERIFY + "[options]\nseed = 1\n[axes]\nseed = [1]\n",
            "seed is in [options] and in [axes]; name it once",
        ),
        ('[sweep]\nrun = "soak"\n[axes]\nseed = [1]\n', "--hours is missing"),
    ],
)
def test_a_file_that_is_refused_is_one_line_before_any_work(
    text: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "sweep.toml"
    path.write_text(text)
    assert main(["sweep", str(path), "--rows", str(tmp_path / "rows.csv")]) == 2
    said = capsys.readouterr()
    assert told in said.err
    assert said.err.startswith("haptogram sweep: ")
    assert str(path) in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""
    assert list(tmp_path.iterdir()) == [path]


def test_rows_of_no_known_format_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", "sweep.toml", "--rows", "rows.xlsx"]) == 2
    assert "--rows 'rows.xlsx' ends in '.xlsx'; possible are .csv, .parquet" in (
        capsys.readouterr().err
    )


# --- the rows ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> list[Row]:
    """The rows of :data:`POINTS` without any worker."""
    return rows_of(planned(POINTS, tmp_path_factory.mktemp("one")), no_workers)


@pytest.mark.nightly  # with a commit, workers one of which is killed, and those of the command
@pytest.mark.parametrize("count", [1, 2, 3])
def test_workers_give_the_rows_of_this_process(
    count: int, expected: list[Row], tmp_path: Path
) -> None:
    assert rows_of(planned(POINTS, tmp_path), jobs(count)) == expected


def test_rows_are_in_the_order_of_the_points_and_have_a_verdict(expected: list[Row]) -> None:
    assert [row["point"] for row in expected] == list(range(8))
    assert {row["verdict"] for row in expected[:4]} == {"pass"}
    assert "fail" in {row["verdict"] for row in expected[4:]}


@pytest.mark.nightly
def test_each_row_has_the_command_that_repeats_it(
    expected: list[Row], capsys: pytest.CaptureFixture[str]
) -> None:
    for row in (expected[0], next(row for row in expected if row["verdict"] == "fail")):
        words = shlex.split(row["command"])
        assert words[0] == "haptogram"
        assert main([*words[1:], "--json", "-", "--quiet"]) == (row["verdict"] == "fail")
        result = json.loads(capsys.readouterr().out)
        assert result["verdict"] == row["verdict"]
        assert result["frames"]["lost"] == row["frames.lost"]
        assert result["lateral_error_mm"]["max"] == row["lateral_error_mm.max"]
        assert result["frames"]["sent"] - result["frames"]["on_target"] == row["bad_frames"]


def test_a_conformance_run_is_a_point(tmp_path: Path) -> None:
    text = '[sweep]\nrun = "conform"\n[options]\nclause = ["HG-2.1", "HG-2.3"]\n'
    mutants = "[axes]\nport = ['haptogram://?clock=virtual', "
    mutants += "'haptogram://?clock=virtual&mutant=mutants.framing:SharedDelimiterRefused']\n"
    healthy, wrong = rows_of(planned(text + mutants, tmp_path), no_workers)
    assert healthy["verdict"] == "pass"
    assert healthy["failed"] == 0
    assert healthy["counts.OK"] > 2
    assert wrong["verdict"] == "fail"
    assert wrong["failed"] >= 1


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("count", "seeds"), [(1, [1]), (1, [1, 2]), (2, [1, 2])])
def test_a_point_that_crashes_is_a_row_and_the_others_go_on(
    count: int, seeds: list[int], tmp_path: Path
) -> None:
    rows = rows_of(planned(FATAL.format(seeds=seeds), tmp_path), jobs(count))
    each = len(seeds)
    assert [row["verdict"] for row in rows] == ["pass"] * each + ["error"] * 2 * each
    assert [row["reason"] for row in rows[each:]] == (
        ["LocalError: no such luck"] * each + ["its worker died, 3 times"] * each
    )
    assert rows[0]["tally.totals.frames"] > 0


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("count", "times"), [(1, 1), (2, 1), (2, 3)])
def test_a_worker_that_is_killed_costs_no_row(
    count: int, times: int, expected: list[Row], tmp_path: Path
) -> None:
    killed: list[int] = []

    def kill() -> None:
        worker = multiprocessing.active_children()[0]
        if len(killed) < times and worker.pid is not None and worker.pid not in killed:
            killed.append(worker.pid)
            os.kill(worker.pid, signal.SIGKILL)

    assert rows_of(planned(POINTS, tmp_path), jobs(count), kill) == expected
    assert len(killed) == times
    assert not multiprocessing.active_children()


# --- files and sittings --------------------------------------------------------------------------


def command(folder: Path, *words: str) -> list[str]:
    (folder / "sweep.toml").write_text(POINTS)
    return [sys.executable, "-m", "haptogram", "sweep", "sweep.toml", *words]


def file_of(expected: list[Row], path: Path) -> bytes:
    write_rows(path, expected)
    return path.read_bytes()


def wait_for_lines(path: Path, count: int) -> None:
    end_s = time.monotonic() + 120
    while not path.exists() or path.read_bytes().count(b"\n") < count:
        assert time.monotonic() < end_s
        time.sleep(0.01)


def children_of(pid: int) -> list[int]:
    found = subprocess.run(["pgrep", "-P", str(pid)], capture_output=True, text=True).stdout
    return [int(word) for word in found.split()]


def is_alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def none_is_left(pids: Sequence[int]) -> bool:
    end_s = time.monotonic() + 60
    while any(map(is_alive, pids)) and time.monotonic() < end_s:
        time.sleep(0.02)
    return not any(map(is_alive, pids))


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.sampled(1)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_sweep_that_ends_early_leaves_nothing_and_goes_on(
    number: signal.Signals, expected: list[Row], tmp_path: Path
) -> None:
    words = command(tmp_path, "--jobs", "2", "--rows", "rows.csv", "--quiet")
    with subprocess.Popen(
        words, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    ) as process:
        wait_for_lines(tmp_path / "rows.csv.part", 2)  # heading and one of 8 points
        workers = children_of(process.pid)
        assert len(workers) >= 2
        # Ctrl-C comes to the workers too.
        (os.killpg if number == signal.SIGINT else os.kill)(process.pid, number)
        _, said = process.communicate(timeout=120)
    assert none_is_left(workers)
    assert {path.name for path in tmp_path.iterdir()} == {"sweep.toml", "rows.csv.part"}
    if number != signal.SIGKILL:
        assert process.returncode == 130
        assert said.count(b"\n") == 1
        assert b"of 8 points; the same command goes on from rows.csv.part" in said
    # A line that was cut off is no row.
    with (tmp_path / "rows.csv.part").open("a") as journal:
        journal.write('{"point": 7, "comm')
    words[words.index("--jobs") + 1] = "1"
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stdout.splitlines()[-1].startswith("FAIL: 8 points: ")
    assert {path.name for path in tmp_path.iterdir()} == {"sweep.toml", "rows.csv"}
    assert (tmp_path / "rows.csv").read_bytes() == file_of(expected, tmp_path / "once.csv")


def test_the_rows_of_another_sweep_are_not_gone_on_with(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, rows = tmp_path / "sweep.toml", tmp_path / "rows.csv"
    path.write_text(POINTS)
    (tmp_path / "rows.csv.part").write_text('{"kind": "haptogram sweep"}\n')
    assert main(["sweep", str(path), "--rows", str(rows)]) == 2
    assert "rows.csv.part is of another sweep, or of another version" in capsys.readouterr().err
    assert not rows.exists()


@pytest.mark.parametrize("line", ["", "{", "[]", '{"point": 99}', '{"point": 1}', '{"point": -1}'])
def test_rows_that_were_damaged_are_not_gone_on_with(
    line: str, tmp_path: Path, expected: list[Row]
) -> None:
    plan, journal = planned(POINTS, tmp_path), tmp_path / "rows.csv.part"
    done = SweepCampaign(plan, journal, dict(enumerate(expected)))
    done.run(result_of_command, no_workers, quiet)
    head, first, *_ = journal.read_text().split("\n")
    text = "\n".join([head, line, first, ""])
    journal.write_text(text)
    with pytest.raises(ConfigurationError, match="part is damaged: remove it to begin anew"):
        SweepCampaign.load(plan, journal)
    assert journal.read_text() == text
    journal.write_text(text.replace(f"\n{line}\n", "\n", 1))
    assert SweepCampaign.load(plan, journal).rows == {0: expected[0]}


def test_a_csv_file_and_a_page_say_where_it_breaks(
    expected: list[Row], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, rows, page = (tmp_path / name for name in ("sweep.toml", "rows.csv", "page.html"))
    path.write_text(POINTS)
    assert main(["sweep", str(path), "--jobs", "1", "--rows", str(rows), "--html", str(page)]) == 1
    said = capsys.readouterr()
    assert "sweep: 8 of 8 points, " in said.err
    found = list(csv.DictReader(rows.read_text().splitlines()))
    assert [row["command"] for row in found] == [row["command"] for row in expected]
    assert [float(row["fault"]) for row in found] == [row["fault"] for row in expected]
    worst = max(
        (row for row in expected if row["verdict"] == "fail"), key=lambda row: row["bad_frames"]
    )
    text = html.unescape(page.read_text())
    assert text.count("data:image/svg+xml;base64,") == 1  # with one axis beside the seed
    assert worst["command"] in text.partition("Worst points")[2]
    table = said.out.partition("Worst points:\n")[2].splitlines()
    assert table[1].split()[:2] == [str(worst["point"]), "fail"]
    assert table[1].endswith(worst["command"])


@needs_parquet
def test_a_parquet_file_has_the_rows_with_their_types(expected: list[Row], tmp_path: Path) -> None:
    from pyarrow import parquet

    path = tmp_path / "rows.parquet"
    write_rows(path, expected)
    found = parquet.read_table(path).to_pylist()
    assert [{k: v for k, v in row.items() if v is not None} for row in found] == [
        {k: v for k, v in row.items() if v is not None} for row in expected
    ]


# --- Dask ----------------------------------------------------------------------------------------

SCHEDULER = """
import asyncio, sys
from distributed import Scheduler, Worker
{patch}
async def main():
    async with Scheduler(port=0, dashboard_address=None) as scheduler:
        workers = [await Worker(scheduler.address, nthreads=1) for _ in range({count})]
        print(scheduler.address, flush=True)
        await asyncio.sleep(600)
asyncio.run(main())
"""


#: A process whose installed packages are not those of this one.
HAS = """
import pathlib, tempfile
folder = pathlib.Path(tempfile.mkdtemp(dir="."))
(folder / "{0}-{1}.dist-info").mkdir()
(folder / "{0}-{1}.dist-info" / "METADATA").write_text("Name: {0}\\nVersion: {1}\\n")
sys.path.insert(0, str(folder.resolve()))
"""
LACKS = """
import distributed.versions
installed = distributed.versions.get_package_info
distributed.versions.get_package_info = lambda names: {{**installed(names), "{0}": None}}
"""


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Callable[..., str]]:
    """Start a scheduler with workers in a process of its own; return its address."""
    with contextlib.ExitStack() as stack:

        def start(count: int, patch: str = "") -> str:
            code = SCHEDULER.format(count=count, patch=patch)
            process = stack.enter_context(
                subprocess.Popen(
                    [sys.executable, "-c", code],
                    cwd=tmp_path,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                )
            )
            stack.callback(process.kill)
            assert process.stdout is not None
            return process.stdout.readline().decode().strip()

        yield start


@pytest.mark.nightly
@needs_dask
def test_the_workers_of_a_cluster_give_the_same_rows(
    cluster: Callable[..., str], expected: list[Row], tmp_path: Path
) -> None:
    address = cluster(2)
    words = command(tmp_path, "--scheduler", address, "--rows", "rows.csv", "--quiet")
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr == "wrote rows.csv\n"
    assert (tmp_path / "rows.csv").read_bytes() == file_of(expected, tmp_path / "once.csv")


KILLED = """
import multiprocessing, os, pathlib, pickle, sys
from haptogram.campaigns.sweep.campaign import SweepCampaign
from haptogram.campaigns.sweep.plan import SweepPlan
from haptogram.campaigns.sweep.workers import dask_workers
from haptogram.cli import command_parser
from haptogram.cli.program import result_of_command

def kill():
    if not killed:
        killed.append(multiprocessing.active_children()[0].pid)
        os.kill(killed[0], 9)

if __name__ == "__main__":
    killed = []
    campaign = SweepCampaign(SweepPlan.read(pathlib.Path("sweep.toml"), command_parser))
    campaign.run(result_of_command, lambda: dask_workers("local", 2), kill)
    assert killed
    pathlib.Path("rows.pickle").write_bytes(pickle.dumps(campaign.rows_in_order))
"""


@needs_dask
@pytest.mark.nightly
def test_a_worker_of_dask_that_is_killed_costs_no_row(expected: list[Row], tmp_path: Path) -> None:
    command(tmp_path)
    (tmp_path / "killed.py").write_text(KILLED)
    subprocess.run([sys.executable, "killed.py"], cwd=tmp_path, check=True)
    assert pickle.loads((tmp_path / "rows.pickle").read_bytes()) == expected


@needs_dask
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("count", "patch", "told"),
    [
        (0, "", "the scheduler has no worker: start one with dask worker"),
        (1, HAS.format("distributed", "2020.1"), "the scheduler has distributed 2020.1, this "),
        (1, HAS.format("numba", "0.1"), " has numba 0.1, this machine has "),
        (1, LACKS.format("numba"), " has no numba, this machine has "),
        (1, LACKS.format("haptogram"), " has no haptogram, this machine has "),
    ],
)
def test_workers_that_would_give_other_rows_are_refused_before_any_work(
    count: int, patch: str, told: str, cluster: Callable[..., str], tmp_path: Path
) -> None:
    address = cluster(count, patch)
    words = command(tmp_path, "--scheduler", address, "--rows", "rows.csv")
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.startswith(f"haptogram sweep: --scheduler {address}: ")
    assert told in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""


@pytest.mark.sampled(1)
@needs_dask
@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:1", "tcp://no.such.host.invalid:8786", "x://"]
)
def test_a_scheduler_that_is_not_there_is_one_line(address: str, tmp_path: Path) -> None:
    words = command(tmp_path, "--scheduler", address, "--rows", "rows.csv")
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.startswith(f"haptogram sweep: --scheduler {address}: ")
    assert done.stderr.count("\n") == 1


def test_without_the_extra_its_name_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "sweep.toml"
    path.write_text(POINTS)
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    for words, told in (
        (["--scheduler", "local"], "--scheduler needs distributed: pip install "),
        (["--rows", str(tmp_path / "rows.parquet")], "--rows: Parquet needs pyarrow: pip install "),
    ):
        assert main(["sweep", str(path), *words]) == 2
        said = capsys.readouterr().err
        assert told in said
        assert "[sweep]" in said
    assert list(tmp_path.iterdir()) == [path]

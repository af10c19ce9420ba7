"""The comparison of two commits in ci/bench: what it calls a change, and what it leaves behind."""

import importlib
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.nightly

ROOT = Path(__file__).resolve().parents[2]
BENCHMARKS = ROOT / "ci" / "benchmarks"

PROJECT = """\
[project]
dependencies = []
optional-dependencies = { fast = [], test = ["pytest"] }
"""
CONFTEST = """\
from pathlib import Path

def pytest_addoption(parser):
    parser.addoption("--brief", action="store_true")

def pytest_benchmark_update_machine_info(machine_info):
    machine_info["packages"] = str(Path(__file__).parents[2])
"""
BENCHMARK = """\
def test_{name}(benchmark):
    benchmark.pedantic(lambda: None)
    benchmark.extra_info.update(yards={yards}, ours_s=1e-3{row})
"""


@pytest.fixture(autouse=True)
def _benchmarks(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)


@pytest.fixture
def baseline():
    return importlib.import_module("baseline")


@pytest.fixture
def trees():
    return importlib.import_module("trees")


@pytest.fixture
def rows():
    return importlib.import_module("rows")


@pytest.fixture
def repository(tmp_path, baseline, trees, monkeypatch):
    """A repository with two commits, whose benchmarks say how long they took."""
    who = ["-c", "user.name=nobody", "-c", "user.email=nobody@example.org"]
    run = ["git", "-C", str(tmp_path), *who]
    subprocess.run([*run, "init", "--quiet"], check=True)
    place = tmp_path / "ci" / "benchmarks"
    place.mkdir(parents=True)
    (tmp_path / "pyproject.toml").write_text(PROJECT)
    (tmp_path / "ci" / "constraints.txt").write_text("")
    (place / "conftest.py").write_text(CONFTEST)
    (tmp_path / ".gitignore").write_text("__pycache__\nout\n")
    for state in (OLD, NEW):
        for file in place.glob("test_*.py"):
            file.unlink()
        for file, text in state.items():
            (place / file).write_text(text)
        subprocess.run([*run, "add", "--all"], check=True)
        subprocess.run([*run, "commit", "--quiet", "-m", "state"], check=True)
    monkeypatch.setattr(trees, "ROOT", tmp_path)
    monkeypatch.setattr(baseline, "ROOT", tmp_path)
    monkeypatch.setattr(baseline, "RESULT", tmp_path / "out" / "bench-baseline.json")
    return tmp_path


def a_benchmark(name, yards, row=None):
    return BENCHMARK.format(name=name, yards=yards, row=f", row={row!r}" if row else "")


TRIP = "PING and PONG through both connections"
OLD = {
    "test_wire_speed.py": a_benchmark("round_trip_of_both_connections", 1.0)
    + a_benchmark("warm_fit_against_a_local_search", 1.0)
}
NEW = {
    "test_renamed.py": a_benchmark("ping", 1.5, TRIP) + a_benchmark("new", 1.0, "a new row"),
}


def runs(*yards):
    return [{"yards": yard, "ours_s": yard * 1e-3} for yard in yards]


@pytest.mark.parametrize(
    ("now", "then", "verdict"),
    [
        ((1.2, 1.3, 1.25), (1.0, 1.1, 0.9), "slower"),
        ((0.7, 0.8, 0.75), (1.0, 1.1, 0.9), "faster"),
        ((1.2, 1.0, 1.25), (1.0, 1.1, 0.9), ""),  # the two sides overlap
        ((1.02, 1.02, 1.02), (1.0, 1.0, 1.0), ""),  # too little to matter
    ],
)
def test_a_change_is_one_that_every_round_shows(baseline, now, then, verdict):
    row = baseline.row("it", runs(*now), runs(*then), 0.03)
    assert row["verdict"] == verdict
    ratios = [a / b for a, b in zip(now, then, strict=True)]
    assert (row["lowest_ratio"], row["highest_ratio"]) == (min(ratios), max(ratios))
    assert baseline.table([row]).splitlines()[1].endswith(verdict or ")")
    assert baseline.row("it", runs(*now), runs(*then), 0.5)["verdict"] == ""


def test_each_tree_runs_its_own_benchmarks_and_rows_are_joined_by_name(
    baseline, repository, capsys
):
    """The test of the round trip was renamed and moved; the old commit names no rows."""
    assert baseline.main(["HEAD~1", "--rounds", "3"]) == baseline.SLOWER
    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert " ".join(lines[1].split()) == f"{TRIP} 1 ms 1 ms 1.50 (1.50 to 1.50) slower"
    assert lines[2].split()[-2:] == ["only", "here"]
    assert lines[3].startswith("fit of a focus from a hint")
    assert lines[3].endswith("only in the baseline")
    assert lines[4] == "1 compared: 1 slower, 0 faster, 1 only here, 1 only in the baseline"
    turns = [line.split(", ")[1][:8] for line in err.splitlines() if "round" in line]
    once = ["this tre", "the base", "the base", "this tre", "this tre", "the base"]
    assert turns == once * 2  # what came out slower was measured again
    written = json.loads((repository / "out" / "bench-baseline.json").read_text())
    assert written["baseline"] == baseline.git("rev-parse", "HEAD~1")
    assert len(written["rows"]) == 3


def test_what_cannot_be_compared_is_an_error_of_one_line(baseline, repository, capsys):
    def said(*arguments):
        with pytest.raises(SystemExit, match="2"):
            baseline.main([*arguments, "--rounds", "3"])
        return capsys.readouterr().err

    assert "neither tree has a benchmark of that name" in said("HEAD~1", "-k", "nosuch")
    assert "bench: git rev-parse: " in said("nosuch")
    (repository / "ci" / "benchmarks" / "test_renamed.py").write_text("def test_it(): 1 / 0")
    text = said("HEAD")
    assert "ZeroDivisionError" in text
    assert "the benchmarks of this tree failed: mend them there" in text
    for file in (repository / "ci" / "benchmarks").iterdir():
        file.unlink(missing_ok=True) if file.is_file() else None
    baseline.git("rm", "--quiet", "-r", "--cached", "ci")
    who = ("-c", "user.name=nobody", "-c", "user.email=nobody@example.org")
    baseline.git(*who, "commit", "--quiet", "-m", "none")
    assert "has no benchmarks to compare with: name a later commit" in said("HEAD")


def test_an_environment_of_its_own_is_for_what_is_not_installed(trees, tmp_path):
    (tmp_path / "ci").mkdir()
    pins = tmp_path / "ci" / "constraints.txt"
    pins.write_text("")
    (tmp_path / "pyproject.toml").write_text(PROJECT)
    assert trees.unmet(tmp_path) == []
    pins.write_text("pytest==1.0 ; python_version < '9'\nother==1.0")
    assert trees.unmet(tmp_path) == ["pytest 1.0"]
    pins.write_text("")
    (tmp_path / "pyproject.toml").write_text(PROJECT.replace("= []", "= ['nosuch-package>=2']", 1))
    assert trees.unmet(tmp_path) == ["nosuch-package >=2"]


def test_the_baseline_is_by_default_what_was_committed_last(
    baseline, repository, capsys, monkeypatch
):
    def against(*arguments):
        assert baseline.main([*arguments]) == 0
        return capsys.readouterr().err.partition("against ")[2].split()[0]

    monkeypatch.setattr(baseline.Measurement, "rows", lambda *_: [baseline.row("x", [], [], 0)])
    assert against() == baseline.git("rev-parse", "HEAD~1")[:10]
    (repository / "file").write_text("newer")
    assert against() == baseline.git("rev-parse", "HEAD")[:10]
    assert against("HEAD~1") == baseline.git("rev-parse", "HEAD~1")[:10]


def test_the_command_line_of_the_comparison(baseline, capsys):
    def parsed(*arguments):
        options, others = baseline.parse(list(arguments))
        return options.revision, options.rounds, options.threshold, others

    assert parsed() == (None, 5, 3.0, [])
    assert parsed("--rounds", "3", "-k", "x") == (None, 3, 3.0, ["-k", "x"])
    assert parsed("main", "-k", "x", "--threshold", "10") == ("main", 5, 10.0, ["-k", "x"])
    for wrong, said in [
        (["--rounds"], "expected one argument"),
        (["--rounds", "2"], "--rounds is 2, must be 3 or more"),
        (["--threshold", "-1"], "--threshold is -1 %, must be 0 or more"),
    ]:
        with pytest.raises(SystemExit, match="2"):
            baseline.parse(wrong)
        assert said in capsys.readouterr().err


@pytest.mark.usefixtures("repository")
@pytest.mark.parametrize("end", [None, signal.SIGINT, signal.SIGTERM])
def test_the_baseline_is_removed_in_any_case(trees, end):
    handlers = [signal.getsignal(number) for number in trees.SIGNALS]
    folders = []

    def measure():
        with trees.baseline_tree(trees.git("rev-parse", "HEAD~1")) as tree:
            folders.append(tree.folder)
            assert (tree.folder / "ci" / "benchmarks" / "test_wire_speed.py").exists()
            os.kill(os.getpid(), end) if end else 1 / 0

    with pytest.raises(SystemExit if end else ZeroDivisionError):
        measure()
    assert not folders[0].parent.exists()
    assert len(trees.git("worktree", "list").splitlines()) == 1
    assert [signal.getsignal(number) for number in trees.SIGNALS] == handlers


# --- rows ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("test", "row"),
    [
        ("test_message[encode-GET_STATUS]", "encode GET_STATUS"),
        ("test_sources_against_numpy[bowl-16]", "field of 16 sources, bowl"),
        ("test_arbitrary_points_against_numpy[100]", "field at 100 points"),
        (
            "test_stream_decoder_against_byte_by_byte[Python-zeros in runs of 7]",
            "decoder of a stream, zeros in runs of 7, COBS in Python",
        ),
        ("test_table_of_the_solvers", None),
    ],
)
def test_a_row_of_an_earlier_commit_follows_from_the_name_of_its_test(rows, test, row):
    assert rows.row_of_result({"name": test, "extra_info": {}}) == row
    assert rows.row_of_result({"name": test, "extra_info": {"row": "its own"}}) == "its own"


def test_every_benchmark_of_this_tree_has_a_row_of_its_own(tmp_path):
    """The conftest refuses any other; it is tried on the benchmarks and on two that share one."""
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider"]
    command += ["-c", ROOT / "pyproject.toml"]
    command += ["-o", f"pythonpath={ROOT} {ROOT}/protocol {ROOT}/ci {BENCHMARKS}"]
    alone = {name: value for name, value in os.environ.items() if "PYTEST_XDIST" not in name}

    def collected(*places):
        done = subprocess.run(
            [*command, *places], env=alone, capture_output=True, text=True, check=False
        )
        return done.returncode, done.stdout + done.stderr

    assert collected(BENCHMARKS)[0] == 0
    (tmp_path / "conftest.py").write_text((BENCHMARKS / "conftest.py").read_text())
    wrong = tmp_path / "test_wrong.py"
    wrong.write_text("def test_it(measure): pass")
    assert "test_it: no @pytest.mark.row names what it measures" in collected(wrong)[1]
    mark = "import pytest\n@pytest.mark.row('x')\n@pytest.mark.parametrize('n', [1, 2])\n"
    wrong.write_text(f"{mark}def test_it(measure, n): pass")
    assert "two benchmarks measure 'x': give one another row" in collected(wrong)[1]

"""The comparison of two commits in ci/bench: what it calls a change, and what it leaves behind."""

import importlib
import os
import signal
import subprocess
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "ci" / "benchmarks"


@pytest.fixture
def baseline(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module("baseline")


@pytest.fixture
def repository(tmp_path, baseline, monkeypatch):
    """A repository with two commits."""
    who = ["-c", "user.name=nobody", "-c", "user.email=nobody@example.org"]
    run = ["git", "-C", str(tmp_path), *who]
    subprocess.run([*run, "init", "--quiet"], check=True)
    for text in ("old", "new"):
        (tmp_path / "file").write_text(text)
        subprocess.run([*run, "add", "file"], check=True)
        subprocess.run([*run, "commit", "--quiet", "-m", text], check=True)
    monkeypatch.setattr(baseline, "ROOT", tmp_path)
    return tmp_path


def runs(*yards):
    return [{"yards": yard, "ours_s": yard * 1e-3} for yard in yards]


@pytest.mark.parametrize(
    ("now", "then", "changed"),
    [
        ((1.2, 1.3, 1.25), (1.0, 1.1, 0.9), True),
        ((0.7, 0.8, 0.75), (1.0, 1.1, 0.9), True),
        ((1.2, 1.0, 1.25), (1.0, 1.1, 0.9), False),  # the two sides overlap
        ((1.02, 1.02, 1.02), (1.0, 1.0, 1.0), False),  # too little to matter
    ],
)
def test_a_change_is_one_that_every_round_shows(baseline, now, then, changed):
    row = baseline.row("test_it", runs(*now), runs(*then))
    assert row["changed"] is changed
    ratios = [a / b for a, b in zip(now, then, strict=True)]
    assert (row["lowest_ratio"], row["highest_ratio"]) == (min(ratios), max(ratios))
    verdict = "slower" if row["ratio"] > 1 else "faster"
    assert (verdict in baseline.table([row]).splitlines()[1]) is changed


def test_only_what_ran_everywhere_is_compared(baseline):
    def data(*names):
        return {"benchmarks": [{"name": name, "extra_info": runs(1.0)[0]} for name in names]}

    rows = baseline.compare([data("a", "b"), data("a", "b")], [data("a", "b"), data("a")])
    assert [row["name"] for row in rows] == ["a"]


def test_the_baseline_is_by_default_what_was_committed_last(baseline, repository):
    assert baseline.parse([]) == ("HEAD~1", 5, [])
    (repository / "file").write_text("newer")
    assert baseline.parse(["--rounds", "3", "-k", "x"]) == ("HEAD", 3, ["-k", "x"])
    assert baseline.parse(["main", "-k", "x"]) == ("main", 5, ["-k", "x"])
    for wrong in (["--rounds"], ["--rounds", "2"], ["--rounds", "x"]):
        with pytest.raises(SystemExit, match="a number from 3"):
            baseline.parse(wrong)


@pytest.mark.usefixtures("repository")
@pytest.mark.parametrize("end", [None, signal.SIGINT, signal.SIGTERM])
def test_the_baseline_is_removed_in_any_case(baseline, end):
    handlers = [signal.getsignal(number) for number in baseline.SIGNALS]
    folders = []

    def measure():
        with baseline.working_tree(baseline.git("rev-parse", "HEAD~1")) as folder:
            folders.append(folder)
            assert (folder / "file").read_text() == "old"
            os.kill(os.getpid(), end) if end else 1 / 0

    with pytest.raises(SystemExit if end else ZeroDivisionError):
        measure()
    assert not folders[0].parent.exists()
    assert len(baseline.git("worktree", "list").splitlines()) == 1
    assert [signal.getsignal(number) for number in baseline.SIGNALS] == handlers


@pytest.mark.usefixtures("repository")
def test_a_revision_that_is_not_there_is_said(baseline):
    with pytest.raises(SystemExit, match="bench: git rev-parse: "):
        baseline.main(["nosuch"])

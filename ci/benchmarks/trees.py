"""A commit in a folder of its own, with an interpreter that has what its benchmarks need."""

import contextlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
EXTRAS = "fast,test"  # what the benchmarks need
PIN = re.compile(r"^([\w.-]+)==([^\s;]+)", re.MULTILINE)
ERROR = 2  # exit status
NOTHING_SELECTED = 5  # exit status of pytest


@dataclass(frozen=True)
class Tree:
    """A commit whose benchmarks can be run."""

    name: str
    folder: Path
    python: str

    def run(self, arguments, tests=()):
        """Time the benchmarks of this tree, or some of its tests; return the JSON of pytest."""
        selected = [*(tests or [self.folder / "ci" / "benchmarks"]), *arguments]
        with tempfile.TemporaryDirectory(prefix="haptogram-bench-") as place:
            written = Path(place, "bench.json")
            done = self._pytest(written, selected)
            data = json.loads(written.read_text() or "{}") if written.exists() else {}
        if done.returncode == NOTHING_SELECTED:
            return {"benchmarks": []}
        if done.returncode:
            stop(f"{done.stdout}\nbench: the benchmarks of {self.name} failed: mend them there")
        self._check(Path(data["machine_info"]["packages"]))
        return data

    def _pytest(self, written, selected):
        parts = ("", "protocol", "ci", "ci/benchmarks")
        paths = [self.folder / part for part in parts]
        return subprocess.run(
            [
                *(self.python, "-P", "-m", "pytest", "-p", "pytest_benchmark.plugin"),
                *("-c", self.folder / "pyproject.toml", "-o", f"pythonpath={_joined(paths)}"),
                *("-o", "filterwarnings=default", "-p", "no:cacheprovider", "--tb=short", "-q"),
                *("--brief", "--benchmark-disable-gc", f"--benchmark-json={written}"),
                *selected,
            ],
            cwd=self.folder,
            env=_without_plugins(),
            check=False,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def _check(self, packages):
        if packages != self.folder:
            stop(f"bench: measured the packages in {packages}, not those in {self.folder}")


def _without_plugins():
    """Plugins would bring the packages of another tree; a worker of xdist would time nothing."""
    kept = {name: value for name, value in os.environ.items() if "PYTEST_XDIST" not in name}
    return kept | {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}


def _joined(paths):
    return shlex.join(map(str, paths))


def this_tree():
    """Return the tree that this file belongs to."""
    return Tree("this tree", ROOT, sys.executable)


@contextlib.contextmanager
def baseline_tree(commit):
    """Check *commit* out beside this tree, and remove it whatever happens, Ctrl-C and kill too."""
    before = {number: signal.signal(number, _leave) for number in SIGNALS}
    parent = tempfile.mkdtemp(prefix="haptogram-bench-")
    try:
        folder = Path(parent, "baseline").resolve()
        git("worktree", "add", "--detach", "--quiet", folder, commit)
        _check_comparable(folder, commit)
        yield Tree(f"the baseline {commit[:10]}", folder, _interpreter(folder))
    finally:
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)  # until all is removed
        shutil.rmtree(parent)
        git("worktree", "prune")
        for number, handler in before.items():
            signal.signal(number, handler)


def _leave(number, _):
    say("interrupted; the baseline is removed")
    sys.exit(128 + number)


def _check_comparable(folder, commit):
    conftest = folder / "ci" / "benchmarks" / "conftest.py"
    if not conftest.exists() or '"--brief"' not in conftest.read_text():
        stop(f"bench: {commit[:10]} has no benchmarks to compare with: name a later commit")


def _interpreter(folder):
    """Return this interpreter if it has what the tree needs, else one of the tree's own."""
    if not (lacking := unmet(folder)):
        return sys.executable
    say(f"the baseline needs {', '.join(lacking)}: making an environment of its own")
    done = subprocess.run([folder / "ci" / "bootstrap", EXTRAS], check=False)
    if done.returncode:
        stop("bench: the environment of the baseline could not be made: see the line above")
    return str(folder / ".venv" / "bin" / "python")


def unmet(folder):
    """Return what the benchmarks of a tree need at a version that is not installed here."""
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    texts = [*project["dependencies"]]
    for extra in EXTRAS.split(","):
        texts += project["optional-dependencies"][extra]
    pins = dict(PIN.findall((folder / "ci" / "constraints.txt").read_text()))
    needed = [Requirement(text) for text in texts]
    return [
        f"{one.name} {pins.get(one.name, one.specifier)}"
        for one in needed
        if (one.marker is None or one.marker.evaluate()) and not _met(one, pins.get(one.name))
    ]


def _met(requirement, pin):
    try:
        installed = version(requirement.name)
    except PackageNotFoundError:
        return False
    return installed == pin if pin else requirement.specifier.contains(installed)


def git(*arguments):
    """Return what git prints; leave with its error."""
    done = subprocess.run(
        ["git", "-C", ROOT, *arguments],
        check=False,
        capture_output=True,
        text=True,
        env=os.environ | {"LC_ALL": "C"},
    )
    if done.returncode:
        stop(f"bench: git {arguments[0]}: {done.stderr.strip()}")
    return done.stdout.strip()


def say(text):
    """Report progress."""
    sys.stderr.write(f"bench: {text}\n")


def stop(text):
    """Leave with an error."""
    sys.stderr.write(f"{text}\n")
    sys.exit(ERROR)

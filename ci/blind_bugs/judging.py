"""The conformance suite against one built board, in virtual time or over its pty."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from haptogram.conformance.case import Depth
from haptogram.conformance.cases import all_cases, select
from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner
from haptogram.conformance.run.stepping import SteppedAccess
from haptogram.report.conformance.result import suite_dict

_LONGEST_RUN_S: Final = 3600
_FAULT_COMMAND: Final = "kill -USR1 $BOARD_PID"  # a hardware fault of the reference board
_SHOWN: Final = 400  # characters of the reason of a failure


@dataclass(frozen=True, slots=True)
class Way:
    """How a board is judged.

    Attributes
    ----------
    clock : str
        ``virtual``: ``board_steps`` in virtual time, seconds a board.  ``wall``: the board on
        its pty, as users have it, minutes a board.
    grids : tuple of str
        Grids of the board; each is judged.
    seed : int
        Seed of the suite.
    depth : str
        ``quick``, ``default`` or ``full``.
    clauses : tuple of str
        Cases, clauses, sections or chapters that are judged; none: all.
    arguments : tuple of str
        More arguments of ``haptogram conform``; clock ``wall`` only.
    """

    clock: str = "virtual"
    grids: tuple[str, ...] = ("16x16",)
    seed: int = 0
    depth: str = "default"
    clauses: tuple[str, ...] = ()
    arguments: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Judged:
    """What the suite says of a board.

    Attributes
    ----------
    status : int
        Highest exit status of the suite.
    failed : dict of str to str
        Reason by failed case, in the order of the report: the cause first.
    """

    status: int
    failed: dict[str, str] = field(default_factory=dict)


def judge(
    programs: Path, way: Way, clause: str = "", known: Collection[str] | None = None
) -> Judged:
    """Run the suite against the board in the folder *programs*, on each grid.

    With the failures that are *known*, those of the board without a bug, the first other one is
    enough: the section of *clause* comes first, then its chapter, then the rest.
    """
    run = _in_virtual_time if way.clock == "virtual" else _on_pty
    status, failed = 0, dict[str, str]()
    for part in [way.clauses] if known is None else _parts(way, clause):
        for grid in way.grids:
            found = run(programs, way, part, grid)
            reasons = {item["case"]: _reason(item) for item in found["results"]}
            for case in found["failures"]:
                failed.setdefault(case, reasons[case])
            status = max(status, found["exit_status"])
        if known is not None and failed.keys() - set(known):
            break
    return Judged(status, failed)


def _parts(way: Way, clause: str) -> list[tuple[str, ...]]:
    """Return the parts of the suite in which a bug of *clause* is sought, the nearest first."""
    section, chapter = clause.partition("/")[0], clause.partition(".")[0]
    every = dict.fromkeys(c.clause.partition("/")[0] for c in select(all_cases(), way.clauses))
    if way.clock == "wall" or any("/" in name for name in way.clauses):
        near = [] if way.clauses or not clause else [(section,), (chapter,)]
        return [*near, way.clauses]
    far = sorted(every, key=lambda one: (one != section, one.partition(".")[0] != chapter))
    return [(one,) for one in far]


def _reason(item: dict[str, Any]) -> str:
    text = item["detail"] or (item["recovery"] or {}).get("text") or "not clean after the case"
    return " ".join(text.split())[:_SHOWN]


def _in_virtual_time(programs: Path, way: Way, part: tuple[str, ...], grid: str) -> dict[str, Any]:
    access = SteppedAccess([str(programs / "board_steps"), grid])
    cases = tuple(select(all_cases(), part))
    options = SuiteOptions(seed=way.seed, depth=Depth[way.depth.upper()])
    return suite_dict(SuiteRunner(access, options).run(cases))


def _on_pty(programs: Path, way: Way, part: tuple[str, ...], grid: str) -> dict[str, Any]:
    board = shlex.join([str(programs / "reference_board"), "--grid", grid])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "result.json"
        words = ["conform", "--spawn", board, "--fault-cmd", _FAULT_COMMAND]
        words += ["--seed", str(way.seed), "--quiet", "--json", str(path)]
        if way.depth != "default":
            words.append(f"--{way.depth}")
        for clause in part:
            words += ["--clause", clause]
        command = [sys.executable, "-m", "haptogram", *map(str, words), *way.arguments]
        done = subprocess.run(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=_LONGEST_RUN_S,
            check=False,
        )
        if not path.exists():  # no board answered: nothing was judged
            lines = done.stdout.strip().splitlines() or ["no result"]
            results = [_no_board(lines[-1])]
            return {"exit_status": 1, "results": results, "failures": [results[0]["case"]]}
        found: dict[str, Any] = json.loads(path.read_text("utf-8"))
        return found


def _no_board(text: str) -> dict[str, Any]:
    return {"case": "(no board)", "behaviour": "FAILED", "detail": text, "recovery": None}

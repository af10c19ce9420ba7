"""``ci/blind-bugs FOLDER``: how many bugs of the C board the conformance suite catches.

FOLDER holds patches of ``protocol/c`` (``*.patch``, ``*.diff``), one bug each; a line ``Clause:
HG-5.8/1`` before the diff names the clause that the bug breaks.  Each board is built from a copy
and judged by the suite of this checkout: the section of its clause first, then the chapter, then
the rest, up to the first failure of a case that the board without the bug passes.  Verdicts are
kept in ``FOLDER/results``: a run that was interrupted goes on where it was, and only what has
changed is judged anew.

The rate of an older suite: run this in a checkout of that commit.
"""

from __future__ import annotations

import argparse
import functools
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from haptogram.conformance.cases import all_cases

from .building import HEALTHY, Bug, BuildError, build, digest, read_bugs
from .judging import Way, judge

_ROOT: Final = Path(__file__).resolve().parents[2]
_GRIDS: Final = ("16x16", "5x3")  # long drives; spare bits, and columns that are no rows
_BROKEN: Final = ("does not apply", "does not compile", "no verdict")


def main(words: list[str] | None = None) -> int:
    """Judge every bug and print the table; return 0 if all were judged, 2 if some could not be."""
    arguments = _parser().parse_args(words)
    bugs = read_bugs(arguments.folder) if arguments.folder.is_dir() else []
    if not bugs:
        sys.exit(f"ci/blind-bugs: {arguments.folder}: there is no *.patch and no *.diff")
    if arguments.clock == "virtual" and arguments.arguments:
        sys.exit("ci/blind-bugs: arguments of conform take --clock wall")
    clauses, more = tuple(arguments.clause), tuple(arguments.arguments)
    grids = tuple(arguments.grid or _GRIDS)
    way = Way(arguments.clock, grids, arguments.seed, arguments.depth, clauses, more)
    kept = arguments.results or arguments.folder / "results"
    kept.mkdir(parents=True, exist_ok=True)
    work = functools.partial(_verdict, source=arguments.source, way=way, kept=kept)
    control = work(HEALTHY)
    if "error" in control:
        sys.exit(f"ci/blind-bugs: the board without a bug {control['error']}")
    found = _judge_all(
        bugs, functools.partial(work, known=tuple(control["failed"])), arguments.jobs
    )
    for line in _table(bugs, found, control["failed"]):
        print(line)
    return 2 if any("error" in verdict for verdict in found.values()) else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ci/blind-bugs",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("folder", type=Path, metavar="FOLDER", help="folder of the patches")
    add(
        "--clock",
        choices=("virtual", "wall"),
        default="virtual",
        help="virtual: board_steps, seconds a bug; wall: the board on its pty, minutes a bug "
        "[virtual]",
    )
    add(
        "--grid",
        action="append",
        metavar="NXxNY",
        help="grid of the board; may be repeated: a bug is caught if one shows it [16x16 and 5x3]",
    )
    add(
        "--depth",
        choices=("quick", "default", "full"),
        default="default",
        help="depth of the suite [default]",
    )
    add("--seed", type=int, default=0, metavar="N", help="seed of the suite [0]")
    add(
        "--clause",
        action="append",
        default=[],
        metavar="ID",
        help="only this case, clause, section or chapter; may be repeated",
    )
    add("--jobs", type=int, default=2, metavar="N", help="boards at a time [2]")
    add("--results", type=Path, metavar="FOLDER", help="kept verdicts [FOLDER/results]")
    add(
        "--source",
        type=Path,
        default=_ROOT / "protocol" / "c",
        metavar="FOLDER",
        help="the C board [protocol/c of this checkout]",
    )
    add("arguments", nargs="*", help="of haptogram conform, behind --; with --clock wall")
    return parser


# --- Verdicts ----------------------------------------------------------------------------------


def _judge_all(bugs: Iterable[Bug], work: Any, jobs: int) -> dict[str, dict[str, Any]]:
    """Return the verdict of each bug by its name, and print it as soon as it is there."""
    found = {}
    with ProcessPoolExecutor(jobs) as pool:
        futures = {pool.submit(work, bug): bug for bug in bugs}
        for future in as_completed(futures):
            name = futures[future].name
            verdict = found[name] = future.result()
            what = verdict.get("error") or next(iter(verdict["failed"]), "nothing failed")
            took = f"{verdict['seconds']:.1f} s"
            line = f"{len(found):>4} of {len(futures)}  {name}: {what}, {took}"
            print(line, file=sys.stderr, flush=True)
    return found


def _verdict(
    bug: Bug, *, source: Path, way: Way, kept: Path, known: tuple[str, ...] | None = None
) -> dict[str, Any]:
    """Return the verdict on one bug: the kept one if nothing has changed since."""
    state = digest(
        bug.patch, json.dumps([asdict(way), known]), source, _ROOT / "haptogram" / "conformance"
    )
    path = kept / f"{bug.name or 'healthy'}-{way.clock}.json"
    if path.exists():
        old: dict[str, Any] = json.loads(path.read_text("utf-8"))
        if old["state"] == state:
            return old
    begin_s = time.monotonic()
    found = {"state": state, "clause": bug.clause, **_judged(bug, source, way, known)}
    found["seconds"] = round(time.monotonic() - begin_s, 1)
    if found.get("error") != _BROKEN[2]:
        path.write_text(json.dumps(found, indent=1) + "\n", "utf-8")
    return found


def _judged(bug: Bug, source: Path, way: Way, known: tuple[str, ...] | None) -> dict[str, Any]:
    folder = Path(tempfile.mkdtemp(prefix="blind-bugs-"))
    try:
        return asdict(judge(build(bug, source, folder), way, bug.clause, known))
    except BuildError as error:
        return {"error": str(error)}
    finally:
        shutil.rmtree(folder, ignore_errors=True)


# --- Table -------------------------------------------------------------------------------------


def _table(
    bugs: list[Bug], found: Mapping[str, Mapping[str, Any]], control: Mapping[str, str]
) -> Iterable[str]:
    """Yield a line for each bug, then the rates."""
    clauses = {case.id: case.clause for case in all_cases()}
    caught, named, broken = 0, 0, 0
    for bug in bugs:
        verdict = found[bug.name]
        if "error" in verdict:
            broken += 1
            yield f"ERROR   {bug.name}: {verdict['error']}"
            continue
        failed = {name: why for name, why in verdict["failed"].items() if name not in control}
        caught += bool(failed)
        named += bug.clause in {clauses.get(name) for name in failed} - {""}
        yield from _lines(bug, failed, verdict["status"])
    judged = len(bugs) - broken
    if control:
        yield f"left out: {', '.join(control)} (the board without a bug fails them this way)"
    with_clause = sum(bool(bug.clause) and "error" not in found[bug.name] for bug in bugs)
    yield f"caught {caught} of {judged} ({100 * caught / max(1, judged):.0f} %)"
    if with_clause:
        yield f"the clause that the patch names is among the failed ones: {named} of {with_clause}"


def _lines(bug: Bug, failed: Mapping[str, str], status: int) -> Iterable[str]:
    wanted = f" [{bug.clause}]" if bug.clause else ""
    if not failed:
        yield f"MISSED  {bug.name}{wanted} (exit status {status})"
        return
    first, *rest = failed
    more = f", and {len(rest)} more: {', '.join(rest[:6])}" if rest else ""
    yield f"caught  {bug.name}{wanted}: {first}: {failed[first]}{more}"


if __name__ == "__main__":
    sys.exit(main())

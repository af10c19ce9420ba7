"""Write the kill matrix: every mutant of the virtual board against the conformance suite.

Each mutant meets the cases of the clause that it breaks (seconds), or with ``--full`` every case
(ten minutes and more), which also shows the other clauses that it breaks, and the clauses that no
mutant breaks.
"""

from __future__ import annotations

import argparse
import functools
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TypeAlias

from tqdm import tqdm

from haptogram.cli.boards import access_in_program
from haptogram.conformance.case import Case
from haptogram.conformance.cases import all_cases, select
from haptogram.conformance.clauses import load_clauses
from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner
from haptogram.conformance.verdict import Behaviour
from haptogram.records.frame import Evidence
from mutants import MUTANTS
from sim_device.mutants import Mutant

WORKERS = 2
OPTIONS = SuiteOptions(timeout_s=1.0, seed=0, repeat=1, strict=True, expected={})
#: Cases that each mutant fails, by its name.
Found: TypeAlias = Mapping[str, Sequence[Case]]


def failed_cases(name: str, *, full: bool) -> list[Case]:
    """Return the cases that the mutant *name* fails, of its own clause or of all.

    FAILED is a verdict on the board's behaviour: a board that breaks down inside comes to
    INCONCLUSIVE and is not counted.
    """
    cases = list(select(all_cases(), [] if full else [MUTANTS[name].clause]))
    access = access_in_program(
        f"haptogram://?clock=virtual&mutant={MUTANTS[name].address}", baudrate=3_000_000, seed=0
    )
    failed = {
        r.case for r in SuiteRunner(access, OPTIONS).run(cases).results if is_failed(r.behaviour)
    }
    return [case for case in cases if case.id in failed]


def is_failed(behaviour: Behaviour) -> bool:
    """Return whether the board broke the clause."""
    return behaviour is Behaviour.FAILED


def verdict(mutant: Mutant, failed: Sequence[Case]) -> str:
    """Return ``killed`` for a mutant that fails its own clause, else the reason."""
    if any(case.clause == mutant.clause for case in failed):
        return "killed"
    return "not on the line" if mutant.evidence is Evidence.EXTERNAL else "MISSED"


def missed(found: Found) -> list[str]:
    """Return the mutants that the line shows and the cases of their clause missed."""
    return [name for name, failed in found.items() if verdict(MUTANTS[name], failed) == "MISSED"]


# --- Pages -------------------------------------------------------------------------------------


def table(head: str, rows: list[str]) -> str:
    """Return a table of Markdown."""
    rule = "| " + " | ".join("---" for _ in head.split("|")) + " |"
    return "\n".join([f"| {head} |", rule, *rows, ""])


def short_page(found: Found) -> str:
    """Return the page of every mutant and the cases of its clause."""
    rows, killed = [], 0
    for name, failed in found.items():
        mutant, what = MUTANTS[name], verdict(MUTANTS[name], failed)
        killed += what == "killed"
        cases = ", ".join(case.id for case in failed) or "-"
        says = mutant.docstring.splitlines()[0]
        rows.append(
            f"| `{name}` | {says} | {mutant.clause} | {mutant.evidence} | {what} | {cases} |"
        )
    told = (
        f"{killed} of {len(rows)} mutants fail their own clause, on what the line shows; those\n"
        "marked *not on the line* need a measurement of the output (the back door, or a logic\n"
        "analyser on the drive pins). Each was judged by the cases of the clause that it breaks.\n"
    )
    head = "mutant | what it does wrong | clause | shown by | verdict | failed cases"
    return f"# Kill matrix\n\n{told}\n{table(head, rows)}"


def chapter_table() -> str:
    """Return the table of docs/kill-matrix.md: mutants by the chapter whose clause they break."""
    rows = []
    for chapter in dict.fromkeys(clause.partition(".")[0] for clause in load_clauses()):
        mutants = [m for m in MUTANTS.values() if m.clause.partition(".")[0] == chapter]
        unseen = sum(mutant.evidence is Evidence.EXTERNAL for mutant in mutants)
        if mutants:
            rows.append(f"| {chapter} | {len(mutants)} | {unseen or '-'} |")
    unseen = sum(mutant.evidence is Evidence.EXTERNAL for mutant in MUTANTS.values())
    rows.append(f"| all | {len(MUTANTS)} | {unseen} |")
    return table("chapter | mutants | need a measurement", rows)


def full_page(found: Found) -> str:
    """Return the page of every mutant and every case, by mutant and by clause."""
    cases = [case for case in all_cases() if case.body is not None]
    mutants = [
        f"| `{name}` | {_bare(MUTANTS[name].clause)} | {len(failed)} | {_listed(failed, cases)} |"
        for name, failed in found.items()
    ]
    breakers = {
        clause: [name for name, failed in found.items() if any(c.clause == clause for c in failed)]
        for clause in load_clauses()
        if any(case.clause == clause for case in cases)
    }
    clauses = [
        f"| {_bare(clause)} | {len(names)} | {', '.join(names) or '-'} |"
        for clause, names in breakers.items()
    ]
    bitten = sum(bool(names) for names in breakers.values())
    told = (
        f"{len(found)} mutants, {len(cases)} cases; {bitten} of the {len(breakers)} clauses that a "
        "case judges are broken\nby a mutant at least.\n"
    )
    by_mutant = table("mutant | breaks | fails | cases", mutants)
    by_clause = table("clause | mutants | which", clauses)
    title = "# Kill matrix: every mutant against every case"
    return f"{title}\n\n{told}\n## By mutant\n\n{by_mutant}\n## By clause\n\n{by_clause}"


def _bare(name: str) -> str:
    return name.removeprefix("HG-")


def _listed(failed: Sequence[Case], cases: Sequence[Case]) -> str:
    """Return the failed cases, or the passed ones if most failed."""
    names = [case.id for case in failed]
    if 2 * len(names) <= len(cases):
        return ", ".join(map(_bare, names)) or "-"
    left = [case.id for case in cases if case.id not in names]
    return f"all but {', '.join(map(_bare, left)) or 'none'}"


def main() -> int:
    """Judge all mutants, two at a time, and write the tables."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="where the tables are written")
    parser.add_argument("--full", action="store_true", help="against every case")
    arguments = parser.parse_args()
    judge = functools.partial(_judge, full=arguments.full)
    with ProcessPoolExecutor(WORKERS) as pool:
        names = list(tqdm(pool.map(judge, MUTANTS), total=len(MUTANTS), unit=" mutants"))
    by_id = {case.id: case for case in all_cases()}
    found = {
        mutant: [by_id[name] for name in failed]
        for mutant, failed in zip(MUTANTS, names, strict=True)
    }
    name = "kill-matrix-full.md" if arguments.full else "kill-matrix.md"
    page = full_page(found) if arguments.full else short_page(found)
    arguments.folder.mkdir(exist_ok=True)
    (arguments.folder / name).write_text(page, encoding="utf-8")
    return int(bool(missed(found)))


def _judge(name: str, *, full: bool) -> list[str]:
    """Return the ids of the failed cases: cases themselves do not travel between processes."""
    return [case.id for case in failed_cases(name, full=full)]


if __name__ == "__main__":
    sys.exit(main())

"""Write the kill matrix: every mutant of the virtual board against every conformance case."""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tqdm import tqdm

from haptogram.cli import access_in_program
from haptogram.conformance.cases import all_cases
from haptogram.conformance.runner import Options, Runner
from haptogram.conformance.verdict import Behaviour
from sim_device.mutants import MUTANTS, Mutant

WORKERS = 2
OPTIONS = Options(timeout_s=1.0, seed=0, repeat=1, strict=True, expected={})
HEAD = """\
# Kill matrix

Boards that are wrong in exactly one way each (`sim_device/mutants`), judged by the conformance
suite with the back door closed. Each must fail the clause that it breaks; what else it fails
follows from the same fault. Made by `ci/kill-matrix`. `tests/sim_device/test_mutants.py` holds each
mutant to its clause, `tests/system/test_conformance.py` the healthy board to all of them.

"""


def failed_cases(name: str) -> list[str]:
    """Return the cases that the mutant *name* fails."""
    access = access_in_program(
        f"haptogram://?clock=virtual&mutant={name}", baudrate=3_000_000, seed=0
    )
    suite = Runner(access, OPTIONS, lambda *_: None).run(tuple(all_cases()))
    return [result.case for result in suite.results if result.behaviour is Behaviour.FAILED]


def row(mutant: Mutant, failed: list[str]) -> str:
    """Return the line of the table for one mutant."""
    own = [case for case in failed if case.startswith(mutant.clause)]
    others = ", ".join(case for case in failed if case not in own) or "-"
    verdict = "killed" if own else "not on the line" if mutant.evidence == "external" else "MISSED"
    what = mutant.docstring.splitlines()[0]
    return (
        f"| `{mutant.name}` | {what} | {mutant.clause} | {mutant.evidence} | {verdict} | {others} |"
    )


def main() -> int:
    """Judge all mutants, two at a time, and write the table."""
    target = Path(sys.argv[1])
    with ProcessPoolExecutor(WORKERS) as pool:
        found = list(tqdm(pool.map(failed_cases, MUTANTS), total=len(MUTANTS), unit=" mutants"))
    lines = [row(mutant, failed) for mutant, failed in zip(MUTANTS.values(), found, strict=True)]
    killed = sum("| killed |" in line for line in lines)
    table = [
        f"{killed} of {len(lines)} mutants fail their own clause, on what the line shows; those",
        "marked *not on the line* need a measurement of the output (the back door, or a logic",
        "analyser on the drive pins).",
        "",
        "| mutant | what it does wrong | clause | shown by | verdict | also fails |",
        "| --- | --- | --- | --- | --- | --- |",
        *lines,
    ]
    target.write_text(HEAD + "\n".join(table) + "\n", encoding="utf-8")
    return int(any("MISSED" in line for line in lines))


if __name__ == "__main__":
    sys.exit(main())

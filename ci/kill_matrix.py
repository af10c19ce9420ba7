"""Write the kill matrix: every mutant of the virtual board against the conformance suite.

Against the cases of the clause that it breaks (seconds), or with ``--full`` against every case
(ten minutes and more), which also shows what else the same fault breaks.
"""

from __future__ import annotations

import argparse
import functools
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tqdm import tqdm

from haptogram.cli import access_in_program
from haptogram.conformance.cases import all_cases
from haptogram.conformance.runner import Options, Runner, select
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


def failed_cases(name: str, *, full: bool) -> list[str]:
    """Return the cases that the mutant *name* fails, of its own clause or of all."""
    cases = tuple(select(all_cases(), [] if full else [MUTANTS[name].clause]))
    access = access_in_program(
        f"haptogram://?clock=virtual&mutant={name}", baudrate=3_000_000, seed=0
    )
    suite = Runner(access, OPTIONS, lambda *_: None).run(cases)
    return [result.case for result in suite.results if result.behaviour is Behaviour.FAILED]


def row(mutant: Mutant, failed: list[str]) -> str:
    """Return the line of the table for one mutant."""
    own = [case for case in failed if case.startswith(mutant.clause)]
    verdict = "killed" if own else "not on the line" if mutant.evidence == "external" else "MISSED"
    what = mutant.docstring.splitlines()[0]
    return (
        f"| `{mutant.name}` | {what} | {mutant.clause} | {mutant.evidence} | {verdict} "
        f"| {', '.join(failed) or '-'} |"
    )


def main() -> int:
    """Judge all mutants, two at a time, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("target", type=Path, metavar="FILE")
    parser.add_argument("--full", action="store_true", help="against every case")
    arguments = parser.parse_args()
    judge = functools.partial(failed_cases, full=arguments.full)
    with ProcessPoolExecutor(WORKERS) as pool:
        found = list(tqdm(pool.map(judge, MUTANTS), total=len(MUTANTS), unit=" mutants"))
    lines = [row(mutant, failed) for mutant, failed in zip(MUTANTS.values(), found, strict=True)]
    killed = sum("| killed |" in line for line in lines)
    judged = "every case" if arguments.full else "the cases of the clause that it breaks"
    table = [
        f"{killed} of {len(lines)} mutants fail their own clause, on what the line shows; those",
        "marked *not on the line* need a measurement of the output (the back door, or a logic",
        f"analyser on the drive pins). Each was judged by {judged}.",
        "",
        "| mutant | what it does wrong | clause | shown by | verdict | failed cases |",
        "| --- | --- | --- | --- | --- | --- |",
        *lines,
    ]
    arguments.target.write_text(HEAD + "\n".join(table) + "\n", encoding="utf-8")
    return int(any("MISSED" in line for line in lines))


if __name__ == "__main__":
    sys.exit(main())

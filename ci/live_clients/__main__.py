"""ci/clients: see its --help."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from .checks import CHECKS, HERE
from .environments import ENVIRONMENTS, EnvironmentMissing
from .recordings import record
from .results import Result, exit_status, print_table, report

RECORDED = Path("tests") / "data" / "dialects" / "autd3" / "pyautd3_38.0.1.json"


def main() -> int:
    """Do what the command line says; return the exit status."""
    options = _options()
    if options.record:
        return _record()
    results = [row for name in options.client or CHECKS for row in _results(name)]
    print_table(results)
    if options.junit is not None:
        report(options.junit, results)
    return exit_status(results)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="ci/clients",
        description="Run programs that others wrote, unmodified, against the virtual board, and "
        "compare what it radiates with what they mean. Each client has an environment of its own "
        "in .cache/clients; one whose Python is not here is skipped.",
        epilog="exit status: 0 all pass, 1 a case failed, 2 usage, 3 no client could run",
    )
    parser.add_argument(
        "client", nargs="*", metavar="CLIENT", help=f"{' or '.join(CHECKS)}; absent: all"
    )
    parser.add_argument("--junit", type=Path, metavar="FILE", help="write JUnit XML")
    parser.add_argument(
        "--record",
        action="store_true",
        help="record anew what pyautd3 sends and what autd3's own emulator makes of it: "
        f"{RECORDED}",
    )
    options = parser.parse_args()
    if unknown := set(options.client) - set(CHECKS):
        parser.error(f"{min(unknown)} is no client; known are {', '.join(CHECKS)}")
    return options


def _results(name: str) -> list[Result]:
    environment = ENVIRONMENTS[name]
    dialect = {"pyautd3": "autd3", "levitate": "interactlab"}[name]
    try:
        environment.make()
    except EnvironmentMissing as missing:
        return [Result(environment, dialect, "all", "skip", note=str(missing))]
    with tempfile.TemporaryDirectory() as folder:
        try:
            return list(CHECKS[name](environment, Path(folder)))
        except Exception as error:
            return [Result(environment, dialect, "all", "fail", note=str(error))]


def _record() -> int:
    environment = ENVIRONMENTS["pyautd3"]
    try:
        environment.make()
    except EnvironmentMissing as missing:
        print(f"ci/clients: {missing}", file=sys.stderr)
        return 2
    record(environment, HERE / "pyautd3_program.py", RECORDED)
    return 0


if __name__ == "__main__":
    sys.exit(main())

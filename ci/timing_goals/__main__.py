"""The command ``ci/timing-goals``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from haptogram.errors import ConfigurationError
from haptogram.report.run.result import write_run_json

from .measure import measure_goals


def main() -> int:
    """Measure, print and write the goals; return 0, or 2 if they could not be measured."""
    parser = argparse.ArgumentParser(
        prog="ci/timing-goals",
        description="Measure the project's goals for control loop and round trip on this machine, "
        "each beside the same work in C (where there is a C compiler). It takes two minutes. A "
        "goal that is not met changes no exit status: wall-clock figures depend on the machine.",
    )
    parser.add_argument(
        "--seconds", type=float, default=30.0, metavar="S", help="length of each loop [30]"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the table as JSON")
    arguments = parser.parse_args()
    try:
        found = measure_goals(seconds=arguments.seconds)
    except ConfigurationError as error:
        sys.stderr.write(f"ci/timing-goals: {error}\n")
        return 2
    print(found.as_text())
    if arguments.json is not None:
        write_run_json(arguments.json, found.as_dict())
    return 0


if __name__ == "__main__":
    sys.exit(main())

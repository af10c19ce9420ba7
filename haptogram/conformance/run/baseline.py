"""Expected failures: a baseline lets the CI of a firmware pass in spite of known failures.

::

    [expected]
    "HG-6.11/2" = "FAILED"          # a clause, with all of its cases
    "HG-3.6/1-time" = "FAILED"      # one case
"""

from __future__ import annotations

from pathlib import Path

from haptogram.errors import ConfigurationError
from haptogram.machine.files import write_file_atomically
from haptogram.settings.text_file import read_toml_file

from ..case import Case
from ..verdict import Behaviour, SuiteResult


def load_suite_baseline(path: Path, cases: tuple[Case, ...]) -> dict[str, str]:
    """Return the expected verdicts by case or clause.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, or names an unknown case or an unknown verdict.
    """
    found = read_toml_file(path, "baseline")
    if set(found) != {"expected"} or not isinstance(found["expected"], dict):
        raise ConfigurationError(f"{path}: one table [expected] is due, found {sorted(found)}")
    known = {case.id for case in cases} | {case.clause for case in cases}
    verdicts = {behaviour.value for behaviour in Behaviour}
    for name, verdict in found["expected"].items():
        if name not in known:
            raise ConfigurationError(f"{path}: there is no case {name!r}")
        if verdict not in verdicts:
            raise ConfigurationError(f"{path}: {name} is {verdict!r}; {sorted(verdicts)} are known")
    return dict(found["expected"])


def write_suite_baseline(path: Path, suite: SuiteResult) -> None:
    """Write the failures of a run as the expected ones."""
    rows = [
        f'"{result.case}" = "{result.behaviour}"  # {" ".join(result.detail.split())[:100]}'
        for result in suite.results
        if result.is_failure
    ]
    write_file_atomically(path, "\n".join(["[expected]", *rows, ""]).encode())

"""The result as a JUnit suite: one case for each way in which a run can fail.

A fault that was proved is a ``failure``.  An inconclusive answer is an ``error``, not ``skipped``:
CI servers count skipped cases as fine, and a run that shows nothing must not turn green.
``skipped`` is a question that could not be judged, because no frame was seen that could have
answered it.  Lost and late frames that decide nothing pass; ``system-out`` names them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from haptogram.machine.provenance import UNSTATED, Provenance
from haptogram.verification import RunVerdict

from ..formats.junit import JUnit, JUnitCase, JUnitSuite, write_junit
from .check import CheckOutcome, RunCheck
from .checks import COMPLETE, run_checks_of_result

_OUTCOMES: Final = {
    CheckOutcome.PASSED: JUnit.PASSED,
    CheckOutcome.NOTED: JUnit.PASSED,
    CheckOutcome.FAILED: JUnit.FAILURE,
    CheckOutcome.INCONCLUSIVE: JUnit.ERROR,
    CheckOutcome.NOT_JUDGED: JUnit.SKIPPED,
}


def write_run_junit(
    path: Path,
    run: RunVerdict,
    result: Mapping[str, Any],
    *,
    provenance: Provenance = UNSTATED,
    seconds: float | None = None,
) -> None:
    """Write the result as JUnit XML.

    Parameters
    ----------
    run : RunVerdict
        The judged run.
    result : mapping
        The same as :func:`result_dict` returns it.
    provenance : Provenance, optional
        Origin of the result.
    seconds : float or None
        How long the run took: the time of the check that it came to its end.

    Raises
    ------
    ConfigurationError
        If *path* cannot be written.
    """
    checks = run_checks_of_result(run, result)
    cases = tuple(
        _run_junit_case(check, seconds if check.name == COMPLETE else None) for check in checks
    )
    properties = dict(_run_junit_flat("", _run_junit_uncertainty(result))) | dict(provenance.rows())
    date = provenance.timestamp
    suite = JUnitSuite("haptogram.verify", cases, properties, str(run), date, seconds)
    write_junit(path, suite)


def _run_junit_case(check: RunCheck, seconds: float | None) -> JUnitCase:
    text = "\n".join([check.message, *check.details])
    outcome = _OUTCOMES[check.outcome]
    return JUnitCase(
        check.name, check.statement, outcome, check.message, check.name, text, seconds=seconds
    )


def _run_junit_uncertainty(result: Mapping[str, Any]) -> dict[str, Any]:
    names = ("verdict", "evidence", "seed", "frames", "faults")
    named = {name: result[name] for name in names if name in result}
    asked = {f"configuration.{name}": value for name, value in result["configuration"].items()}
    made_by = {"board": result["board"], "environment": result.get("environment", {})}
    return named | asked | made_by


def _run_junit_flat(prefix: str, value: Any) -> Iterator[tuple[str, str]]:
    """Yield dotted names and texts of nested settings, without those that are not set."""
    if value is None or value == []:
        return
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from _run_junit_flat(f"{prefix}.{name}" if prefix else str(name), item)
    else:
        yield prefix, value if isinstance(value, str) else json.dumps(value)

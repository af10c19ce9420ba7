"""One run of verification for the page of a CI job."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from haptogram.verification import RunVerdict

from ..formats.document import Document, Finding, Level
from .check import CheckOutcome
from .checks import run_checks_of_result
from .pins import run_result_sentence
from .wording import run_faults_wording

_LEVELS: Final = {
    CheckOutcome.FAILED: Level.ERROR,
    CheckOutcome.INCONCLUSIVE: Level.ERROR,
    CheckOutcome.NOTED: Level.WARNING,
}


def run_summary(run: RunVerdict, result: Mapping[str, Any]) -> Document:
    """Return the summary of *run*, of which *result* is the dictionary for JSON."""
    checks = [c for c in run_checks_of_result(run, result) if c.outcome in _LEVELS]
    checks.sort(key=lambda check: not check.decisive)
    findings = [
        Finding(
            _LEVELS[check.outcome],
            f"{check.statement}: {check.outcome}",
            "; ".join([check.message, *check.details[:1]]),
        )
        for check in checks
    ]
    sentence = run_result_sentence(run, result)
    lines = str(run).splitlines()[1:] if result.get("run_judged", True) else []
    lines += result["captures"]["text"].splitlines()[1:] if "captures" in result else []
    warnings = [f"warning: {text}" for text in result["warnings"]]
    facts = [line.strip() for line in lines] + [*run_faults_wording(result), *warnings]
    return Document(command="verify", heading=sentence, findings=findings, lead=facts)

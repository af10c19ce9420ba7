"""One run of verification for the page of a CI job."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from haptogram.verification import RunVerdict

from ..formats.job_summary import Finding, JobSummary, Level
from .checks import CheckOutcome, run_checks
from .wording import faults_and_troubles_text

_FRAMES: Final = 3  # named in a finding; the facts name more
_LEVELS: Final = {
    CheckOutcome.FAILED: Level.ERROR,
    CheckOutcome.INCONCLUSIVE: Level.ERROR,
    CheckOutcome.NOTED: Level.WARNING,
}


def run_summary(run: RunVerdict, result: Mapping[str, Any]) -> JobSummary:
    """Return the summary of *run*, of which *result* is the dictionary for JSON."""
    checks = [c for c in run_checks(run, result["cut_short"]) if c.outcome in _LEVELS]
    checks.sort(key=lambda check: not check.decisive)
    findings = [
        Finding(
            _LEVELS[check.outcome],
            f"{check.statement}: {check.outcome}",
            "; ".join([check.message, *check.details[:_FRAMES]]),
        )
        for check in checks
    ]
    sentence, *lines = str(run).splitlines()
    warnings = [f"warning: {text}" for text in result["warnings"]]
    facts = [line.strip() for line in lines] + [*faults_and_troubles_text(result), *warnings]
    return JobSummary("verify", sentence, findings, facts)

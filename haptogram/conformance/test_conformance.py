"""One test for every case, collected by ``pytest --pyargs haptogram.conformance``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from haptogram.conformance.cases import all_cases

if TYPE_CHECKING:
    from haptogram.conformance.case import Case
    from haptogram.conformance.run.runner import SuiteRunner


@pytest.mark.parametrize("case", all_cases(), ids=lambda case: case.id)
def test_clause(case: Case, haptogram_board: SuiteRunner) -> None:
    """Judge the board under test by one case."""
    from haptogram.conformance.verdict import MEANINGS

    result = haptogram_board.result(case)
    verdict = f"{result.behaviour} [{result.evidence.upper()}] {result.detail}"
    junit = MEANINGS[result.behaviour].junit
    if junit == "skipped":
        pytest.skip(verdict)
    if junit is not None or not result.recovers:
        recovery = "" if result.recovers else f"recovery: {result.recovery}"
        lines = [
            verdict,
            f"requirement: {result.requirement}",
            recovery,
            result.traceback,
            *result.transcript,
        ]
        pytest.fail("\n".join(filter(None, lines)), pytrace=False)

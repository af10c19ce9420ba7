"""What came of a client: rows of a table, a JUnit file, an exit status."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from haptogram.machine.provenance import UNSTATED
from haptogram.report.formats.document import Check, Document, Outcome
from haptogram.report.formats.junit import write_document_junit

from .environments import Environment

__all__ = ["Result", "exit_status", "print_table", "report"]

PASS, FAIL, NOT_VERIFIED = 0, 1, 3
_HEAD: Final = ("client", "version", "dialect", "case", "codes right", "coherence", "verdict")
_OUTCOMES: Final = {
    "pass": Outcome.PASSED,
    "fail": Outcome.FAILED,
    "skip": Outcome.NOT_JUDGED,
}


@dataclass(frozen=True)
class Result:
    """One case of one client.

    Attributes
    ----------
    right, codes : int
        Codes (phase and width of a channel in a latch) that are as the client means them, of all.
    coherence : float or None
        At the target, where the case has one.
    verdict : str
        ``pass``, ``fail`` or ``skip``.
    note : str
        Why, or what was found in the client.
    """

    client: Environment
    dialect: str
    case: str
    verdict: str
    right: int = 0
    codes: int = 0
    coherence: float | None = None
    note: str = ""

    def cells(self) -> tuple[str, ...]:
        """Return the cells of its row."""
        return (
            self.client.client,
            self.client.version,
            self.dialect,
            self.case,
            f"{self.right} of {self.codes}" if self.codes else "-",
            "-" if self.coherence is None else f"{self.coherence:.4f}",
            self.verdict + (f": {self.note}" if self.note else ""),
        )


def print_table(results: list[Result]) -> None:
    """Print a row for each result."""
    rows = [_HEAD, *(result.cells() for result in results)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEAD) - 1)]
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=False)]
        print("  ".join([*cells, row[-1]]))  # noqa: T201  the table of a command


def report(path: Path, results: list[Result]) -> None:
    """Write JUnit XML."""
    checks = [
        Check(
            group=f"{result.client.client} {result.client.version}",
            name=f"{result.dialect}: {result.case}",
            outcome=_OUTCOMES[result.verdict],
            message=result.note,
            details=["  ".join(result.cells())],
            kind=result.verdict,
        )
        for result in results
    ]
    document = Document(command="clients", heading="clients of other boards", checks=checks)
    write_document_junit(path, document, UNSTATED)


def exit_status(results: list[Result]) -> int:
    """Return 1 if a case failed, 3 if none ran, else 0."""
    verdicts = {result.verdict for result in results}
    if "fail" in verdicts:
        return FAIL
    return PASS if "pass" in verdicts else NOT_VERIFIED

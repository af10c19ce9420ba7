"""A result for the page of a CI job: Markdown, and the annotations of GitHub.

Every text goes in escaped: a board names its firmware, and may name it in Markdown.
"""

from __future__ import annotations

import enum
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from haptogram.machine.files import write_file_atomically

if TYPE_CHECKING:
    from haptogram.machine.provenance import Provenance

_SHOWN: Final = 10  # annotations of one level in a step: GitHub shows no more
_ROWS: Final = 100  # of a table; the page and the JSON file have all
_ACTIVE: Final = re.compile(r"([\\`*_\[\]|~#])")
_LIST: Final = re.compile(r"^(\d+)(?=[.)])|^(?=[-+=:])")
#: Characters that would begin an element, a reference, mathematics, a link or a mention.
_ENTITIES: Final = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", "$": "&#36;", "@": "&#64;"}
)
_LINKS: Final = re.compile(r":(?=//)|\.(?<=www\.)", re.IGNORECASE)


class Level(enum.StrEnum):
    """Weight of a finding; the value is the command of GitHub for it."""

    ERROR = "error"
    WARNING = "warning"
    NOTICE = "notice"


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding.

    Attributes
    ----------
    level : Level
        An error decides the verdict, a warning does not.
    name : str
        Name of the case, the check or the kind of event.
    text : str
        The finding in one line.
    """

    level: Level
    name: str
    text: str


@dataclass(frozen=True, slots=True)
class SummaryTable:
    """A table of a summary: its title, the names of its columns, and the texts of its rows."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True, slots=True)
class JobSummary:
    """A result, as short as a person reads it first.

    Attributes
    ----------
    command : str
        Name of the command.
    sentence : str
        The verdict and its reason, as on the terminal.
    findings : sequence of Finding
        What is wrong, the likeliest cause first.
    facts : sequence of str
        Further sentences.
    tables : sequence of SummaryTable
        Figures.
    """

    command: str
    sentence: str
    findings: Sequence[Finding] = ()
    facts: Sequence[str] = ()
    tables: Sequence[SummaryTable] = ()


def escape_job_markdown(text: str) -> str:
    r"""Return *text* on one line, so that GitHub and GitLab show it as it is.

    Examples
    --------
    >>> escape_job_markdown("<b>*1*</b> | [x](y)")
    '&lt;b&gt;\\*1\\*&lt;/b&gt; \\| \\[x\\](y)'
    """
    line = " ".join(text.split())
    escaped = _ACTIVE.sub(r"\\\1", line).translate(_ENTITIES)
    return _LIST.sub(r"\1\\", _LINKS.sub(lambda found: f"&#{ord(found[0])};", escaped))


def job_markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table; every text is escaped."""
    lines = [head, ["---"] * len(head), *rows]
    return [
        f"| {' | '.join(cells if number == 1 else map(escape_job_markdown, cells))} |"
        for number, cells in enumerate(lines)
    ]


def summary_markdown(summary: JobSummary, provenance: Provenance) -> str:
    """Return *summary* in Markdown: the verdict, what is wrong, the facts, the figures."""
    return "\n".join(_summary_markdown_lines(summary, provenance)) + "\n"


def write_job_summary(path: Path, summary: JobSummary, provenance: Provenance) -> None:
    """Write *summary* in Markdown.

    Raises
    ------
    ConfigurationError
        If *path* cannot be written.
    """
    text = summary_markdown(summary, provenance)
    write_file_atomically(path, text.encode("utf-8", errors="replace"))


def _summary_markdown_lines(summary: JobSummary, provenance: Provenance) -> Iterator[str]:
    yield f"## {escape_job_markdown(f'haptogram {summary.command}: {summary.sentence}')}"
    yield ""
    found = [(f.level.value, f.name, f.text) for f in summary.findings]
    yield from _summary_markdown_table("", ("", "where", "found"), found)
    if summary.facts:
        yield from (f"- {escape_job_markdown(fact)}" for fact in summary.facts)
        yield ""
    for table in summary.tables:
        yield from _summary_markdown_table(table.title, table.head, table.rows)
    yield "; ".join(f"{name}: {escape_job_markdown(text)}" for name, text in provenance.rows())


def _summary_markdown_table(
    title: str, head: Sequence[str], rows: Sequence[Sequence[str]]
) -> Iterator[str]:
    if not rows:
        return
    if title:
        yield f"### {escape_job_markdown(title)}"
        yield ""
    yield from job_markdown_table(head, rows[:_ROWS])
    if len(rows) > _ROWS:
        yield ""
        yield f"... and {len(rows) - _ROWS} more, in the other files."
    yield ""


# --- GitHub ----------------------------------------------------------------------------------


def github_job_annotations(summary: JobSummary) -> Iterator[str]:
    """Yield the lines that a job of GitHub prints to have *summary* shown beside its steps."""
    for level in Level:
        found = [finding for finding in summary.findings if finding.level is level]
        shown = found if len(found) <= _SHOWN else found[: _SHOWN - 1]
        for finding in shown:
            title = f"haptogram {summary.command}: {finding.name}"
            yield github_job_command(level, title, finding.text)
        if len(shown) < len(found):
            title = f"haptogram {summary.command}: {summary.sentence}"
            yield github_job_command(level, title, f"{len(found) - len(shown)} more")


def github_job_command(level: Level, title: str, message: str) -> str:
    r"""Return a workflow command, escaped by GitHub's rules.

    Examples
    --------
    >>> github_job_command(Level.ERROR, "HG-2.2/1: a, b", "50 %\n::error::not this")
    '::error title=HG-2.2/1%3A a%2C b::50 %25%0A::error::not this'
    """
    title = _escape_github_job_data(title).replace(":", "%3A").replace(",", "%2C")
    return f"::{level} title={title}::{_escape_github_job_data(message)}"


def _escape_github_job_data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")

"""A result for the page of a CI job: Markdown, and the annotations of GitHub.

Every text goes in escaped: a board names its firmware, and may name it in Markdown.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from haptogram.machine.files import write_file_atomically

from .document import Document, Level, Listing, Table

if TYPE_CHECKING:
    from haptogram.machine.provenance import Provenance

_SHOWN: Final = 10  # annotations of one level in a step: GitHub shows no more
_ROWS: Final = 100  # most rows of a table; the page and the JSON file have all
_ACTIVE: Final = re.compile(r"([\\`*_\[\]|~#])")
_LIST: Final = re.compile(r"^(\d+)(?=[.)])|^(?=[-+=:])")
#: Characters that would begin an element, a reference, mathematics, a link or a mention.
_ENTITIES: Final = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", "$": "&#36;", "@": "&#64;"}
)
_LINKS: Final = re.compile(r":(?=//)|\.(?<=www\.)", re.IGNORECASE)


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


def summary_markdown(document: Document, provenance: Provenance) -> str:
    """Return *document* in Markdown: the verdict, what is wrong, the facts, the figures."""
    return "\n".join(_summary_markdown_lines(document, provenance)) + "\n"


def write_job_summary(path: Path, document: Document, provenance: Provenance) -> None:
    """Write *document* in Markdown.

    Raises
    ------
    ConfigurationError
        If *path* cannot be written.
    """
    text = summary_markdown(document, provenance)
    write_file_atomically(path, text.encode("utf-8", errors="replace"))


def _summary_markdown_lines(document: Document, provenance: Provenance) -> Iterator[str]:
    """Yield the Markdown lines of a document: heading, findings, texts, tables, provenance."""
    yield f"## {escape_job_markdown(f'haptogram {document.command}: {document.heading}')}"
    yield ""
    found = [(f.level.value, f.name, f.text) for f in document.findings]
    yield from _summary_markdown_table("", ("", "where", "found"), found)
    yield from _markdown_listing(document.lead)
    for section in document.sections:
        for block in section.blocks:
            if isinstance(block, Table):
                yield from _summary_markdown_table(section.title, block.head, block.rows)
            elif isinstance(block, Listing):
                yield from _markdown_listing(block.items)
    yield "; ".join(f"{name}: {escape_job_markdown(text)}" for name, text in provenance.rows())


def _markdown_listing(items: Sequence[str]) -> Iterator[str]:
    """Yield the items as a Markdown list, then an empty line; nothing without items."""
    if items:
        yield from (f"- {escape_job_markdown(item)}" for item in items)
        yield ""


def _summary_markdown_table(
    title: str, head: Sequence[str], rows: Sequence[Sequence[str]]
) -> Iterator[str]:
    """Yield a Markdown table of the first 100 rows below its title; nothing without rows.

    A line then says how many more there are; an empty *title* is left out.
    """
    if not rows:
        return
    if title:
        yield f"### {escape_job_markdown(title)}"
        yield ""
    yield from job_markdown_table(head or [""] * len(rows[0]), rows[:_ROWS])
    if len(rows) > _ROWS:
        yield ""
        yield f"... and {len(rows) - _ROWS} more, in the other files."
    yield ""


# --- GitHub ----------------------------------------------------------------------------------


def github_job_annotations(document: Document) -> Iterator[str]:
    """Yield the lines that a job of GitHub prints to have *document* shown beside its steps."""
    for level in Level:
        found = [finding for finding in document.findings if finding.level is level]
        shown = found if len(found) <= _SHOWN else found[: _SHOWN - 1]
        for finding in shown:
            title = f"haptogram {document.command}: {finding.name}"
            yield github_job_command(level, title, finding.text)
        if len(shown) < len(found):
            title = f"haptogram {document.command}: {document.heading}"
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
    """Return *text* with % and line ends escaped, as workflow commands of GitHub demand."""
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")

"""Summaries of CI jobs: every text shows as it is, none becomes Markdown or a command."""

from __future__ import annotations

import re

import pytest

from haptogram.machine.provenance import UNSTATED
from haptogram.report.formats.document import Document, Finding, Level, Listing, Section, Table
from haptogram.report.formats.job_summary import (
    escape_job_markdown,
    github_job_annotations,
    github_job_command,
    summary_markdown,
)

HOSTILE = [
    "<script>alert(1)</script>",
    "![x](http://a.example/x.png)",
    "[x](javascript:alert(1))",
    "a | b",
    "`code` **bold** _it_ ~~no~~",
    "line\n# heading\r\n- list",
    "&lt;b&gt;",
    "http://a.example www.a.example @somebody $x$",
    "\\",
]


def unescaped(markdown: str) -> str:
    """Return the text that a reader of *markdown* sees, if nothing in it is active."""
    assert not re.search(r"[<>$@]|(?<![\\&])[`*_\[\]|~#]|://|www\.", markdown.replace("\\\\", ""))
    text = re.sub(r"\\([!-/:-@\[-`{-~])", r"\1", markdown)
    for entity, sign in {"&lt;": "<", "&gt;": ">", "&#36;": "$", "&#64;": "@"}.items():
        text = text.replace(entity, sign)
    text = text.replace("&#58;", ":").replace("&#46;", ".")
    return text.replace("&amp;", "&")


@pytest.mark.parametrize("text", HOSTILE)
def test_a_text_shows_as_it_is(text: str) -> None:
    assert unescaped(escape_job_markdown(text)) == " ".join(text.split())


@pytest.mark.parametrize("text", ["- a", "+ a", "1. a", "12) a", "= a", ":--- a"])
def test_a_text_begins_no_list_and_no_heading(text: str) -> None:
    assert re.match(r"\d*\\", escape_job_markdown(text))


def test_a_summary_holds_no_active_text_of_a_board() -> None:
    hostile = "| x\n## heading <img src=x> [a](b)"
    document = Document(
        command="conform",
        heading=f"FAIL: {hostile}",
        findings=[Finding(Level.ERROR, hostile, hostile)],
        lead=[hostile],
        sections=[
            Section(hostile, [Table(["", hostile], [[hostile, hostile]]), Listing([hostile])])
        ],
    )
    markdown = summary_markdown(document, UNSTATED)
    assert "<img" not in markdown
    assert "](" not in markdown.replace("\\](", "")
    lines = markdown.splitlines()
    assert sum(line.startswith("#") for line in lines) == 2  # its own, and that of the table
    for line in lines:
        if line.startswith("|"):
            cells = re.split(r"(?<!\\)\|", line)[1:-1]
            assert len(cells) in (2, 3)


@pytest.mark.parametrize(
    ("message", "shown"),
    [("50 %", "50 %25"), ("a\r\nb", "a%0D%0Ab"), ("%0A", "%250A"), ("a: b, c", "a: b, c")],
)
def test_a_message_is_escaped_by_github_s_rules(message: str, shown: str) -> None:
    assert github_job_command(Level.ERROR, "t", message) == f"::error title=t::{shown}"


def test_a_title_cannot_end_its_property() -> None:
    command = github_job_command(Level.WARNING, "a::b,file=/etc/passwd\n::error::", "m")
    assert command == "::warning title=a%3A%3Ab%2Cfile=/etc/passwd%0A%3A%3Aerror%3A%3A::m"


def test_github_shows_ten_annotations_and_the_last_says_how_many_follow() -> None:
    findings = [Finding(Level.ERROR, f"case {n}", "x") for n in range(14)]
    lines = list(
        github_job_annotations(Document(command="conform", heading="FAIL", findings=findings))
    )
    assert len(lines) == 10
    assert lines[0] == "::error title=haptogram conform%3A case 0::x"
    assert lines[-1].endswith("::5 more")

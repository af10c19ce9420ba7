"""Every page of Markdown as GitHub renders it: links, anchors, tables, no unmeant mathematics."""

from __future__ import annotations

import re
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
_FOLDERS = ("ci", "docs", "haptogram", "protocol", "sim_device", "tests")
PAGES = sorted(
    [*ROOT.glob("*.md"), *(page for folder in _FOLDERS for page in (ROOT / folder).rglob("*.md"))]
)
_FENCE = re.compile(r"^( *)(```+|~~~+).*?^\1\2[`~]*$", re.DOTALL | re.MULTILINE)
_SPAN = re.compile(r"(`+)(?!`).*?(?<!`)\1(?!`)", re.DOTALL)
_RULE = re.compile(r"\|(?: *:?-+:? *\|)+")  # below the head of a table
_LINK = re.compile(r"!?\[[^\]]*\]\(<?([^)>\s]+)>?(?:\s+\"[^\"]*\")?\)")


def prose(page: Path) -> str:
    """Return the text of a page without its blocks and spans of code."""
    return _SPAN.sub("code", without_blocks(page))


def without_blocks(page: Path) -> str:
    return _FENCE.sub("", page.read_text(encoding="utf-8"))


def slug(heading: str) -> str:
    """Return the anchor that GitHub gives a heading, before it counts those that are alike."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "")
    text = re.sub(r"[*]+|(?<!\w)_|_(?!\w)", "", text)
    return re.sub(r"[^\w\- ]", "", text.strip().lower()).replace(" ", "-")


@cache
def anchors(page: Path) -> set[str]:
    """Return the anchors of a page: those of its headings, and those that are written down."""
    counted: Counter[str] = Counter()
    found = set(re.findall(r"<a (?:id|name)=\"([^\"]+)\"", page.read_text(encoding="utf-8")))
    for heading in re.findall(r"^#{1,6} +(.+?) *#*$", without_blocks(page), re.MULTILINE):
        name = slug(heading)
        found.add(f"{name}-{counted[name]}" if counted[name] else name)
        counted[name] += 1
    return found


def cells(row: str) -> int:
    """Return the number of cells of a row of a table."""
    return len(re.split(r"(?<!\\)\|", row.strip().removeprefix("|").removesuffix("|")))


@pytest.fixture(params=PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def page(request: pytest.FixtureRequest) -> Path:
    return Path(request.param)


def test_all_pages_are_found() -> None:
    names = {str(page.relative_to(ROOT)) for page in PAGES}
    assert {"README.md", "CHANGELOG.md", "protocol/SPEC.md", "docs/index.md"} <= names


def test_links_and_anchors_of_a_page_lead_somewhere(page: Path) -> None:
    lost = []
    for link in _LINK.findall(prose(page)):
        if re.match(r"[a-z][a-z0-9+.-]*:", link):
            continue
        place, _, anchor = link.partition("#")
        target = (page.parent / place).resolve() if place else page
        if not target.exists() or (
            anchor and target.suffix == ".md" and anchor not in anchors(target)
        ):
            lost.append(link)
    assert lost == []


def test_tables_of_a_page_have_rows_as_wide_as_their_heads(page: Path) -> None:
    lines = without_blocks(page).splitlines()
    wrong = []
    for at, line in enumerate(lines):
        if (
            at
            and re.fullmatch(r"\s*\|?(?:\s*:?-+:?\s*\|)*\s*:?-+:?\s*\|?\s*", line)
            and "|" in line
        ):
            width = cells(line)
            rows = [lines[at - 1]]
            for row in lines[at + 1 :]:
                if not row.strip().startswith("|"):
                    break
                rows.append(row)
            wrong += [row for row in rows if cells(row) != width]
    assert wrong == []


#: Pages that are there for the site alone; GitHub shows a directive as it is written.
OF_THE_SITE = {"changes.md", "firmware-c.md", "index.md", "python.md", "spec.md"}


def test_a_page_reads_well_where_it_is_not_built(page: Path) -> None:
    if page.parent == ROOT / "docs" and page.name in OF_THE_SITE:
        return
    assert "```{" not in page.read_text(encoding="utf-8")
    names = {Path(link.partition("#")[0]).name for link in _LINK.findall(prose(page))}
    assert names & OF_THE_SITE == set()


def test_no_dollar_of_a_page_begins_mathematics(page: Path) -> None:
    """GitHub takes what stands between two dollars of a paragraph for LaTeX."""
    paragraphs = re.split(r"\n\s*\n", prose(page))
    assert [text for text in paragraphs if re.search(r"(?<!\\)\$\S[^$]*\S?\$", text)] == []


def test_the_checks_see_what_is_wrong(tmp_path: Path) -> None:
    bad = tmp_path / "bad.md"
    bad.write_text(
        "# A `b` (c), d\n\n# A `b` (c), d\n\n[x](nowhere.md) [y](#nothing) [z](#a-b-c-d-1)\n\n"
        "| a | b |\n|---|---|\n| 1 | 2 | 3 |\n\nfrom $5 to 6$ apart\n\n```\n[q](none)\n```\n"
        "```{include}\n```\n"
    )
    assert anchors(bad) == {"a-b-c-d", "a-b-c-d-1"}
    for check in (
        test_links_and_anchors_of_a_page_lead_somewhere,
        test_tables_of_a_page_have_rows_as_wide_as_their_heads,
        test_no_dollar_of_a_page_begins_mathematics,
        test_a_page_reads_well_where_it_is_not_built,
    ):
        with pytest.raises(AssertionError):
            check(bad)

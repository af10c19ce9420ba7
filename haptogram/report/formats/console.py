"""Text for a terminal: tables and paragraphs, at most 98 columns wide where the text can wrap."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from typing import Final

from haptogram.machine.terminal import printable_on_terminal

from .document import Block, Document, Listing, Table

WIDTH: Final = 98
_GAP: Final = "  "


def console_table(
    head: Sequence[str],
    rows: Iterable[Sequence[object]],
    *,
    numbers: Sequence[int] = (),
    indent: int = 0,
) -> list[str]:
    """Return the lines of a table: the names of the columns, then one line for each row.

    Parameters
    ----------
    head : sequence of str
        Names of the columns; empty: a table without a head.
    rows : iterable of sequences
        Cells of each row, as many as there are columns.
    numbers : sequence of int
        Columns of numbers, which are aligned to the right; 0 is the first.
    indent : int
        Number of spaces before every line.
    """
    lines = [
        *([list(head)] if head else []),
        *([printable_on_terminal(str(cell)) for cell in row] for row in rows),
    ]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    signs = [">" if place in numbers else "<" for place in range(len(widths))]
    return [
        " " * indent
        + _GAP.join(
            f"{cell:{sign}{width}}" for cell, sign, width in zip(line, signs, widths, strict=True)
        ).rstrip()
        for line in lines
    ]


def console_paragraph(text: str, *, indent: int = 0, bullet: str = "", hang: int = 2) -> list[str]:
    """Return *text* in lines of at most 98 columns; those after the first are indented further."""
    first = " " * indent
    return textwrap.wrap(
        text, WIDTH, initial_indent=first + bullet, subsequent_indent=first + " " * hang
    )


def document_text(document: Document) -> str:
    """Return *document* without its pictures; the verdict is last, with what was found."""
    lead, *more = document.lead
    parts = [[f"{document.command}: {lead}", *more]]
    for section in document.sections:
        lines = [line for block in section.blocks for line in _console_block(block)]
        if lines:
            parts.append([f"{section.title}:", *lines])
    found = (f"  {one.level}: {one.name}: {one.text}" for one in document.findings)
    parts.append([document.heading, *found])
    return "\n\n".join("\n".join(part) for part in parts)


def _console_block(block: Block) -> list[str]:
    """Return a table or a listing as lines; [] for a picture or view."""
    if isinstance(block, Table):
        return console_table(block.head, block.rows, numbers=block.numbers, indent=2)
    if isinstance(block, Listing):
        return [line for item in block.items for line in console_paragraph(item, indent=2)]
    return []

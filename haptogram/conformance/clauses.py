"""The clauses and tables of SPEC.md, read from its text.

A wheel carries SPEC.md inside ``haptogram_protocol`` (``setup.py`` puts it there); a checkout and
an editable install have it beside that package, in ``protocol/``.
"""

from __future__ import annotations

import enum
import functools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from types import MappingProxyType
from typing import Final

_CLAUSE: Final = re.compile(r"^- \*\*(HG-\d+\.\d+/\d+)\*\* ((?:.|\n  )*)", re.MULTILINE)


class Level(enum.StrEnum):
    """Level of demand of a clause."""

    MUST = "MUST"
    SHOULD = "SHOULD"
    MAY = "MAY"


@dataclass(frozen=True, slots=True)
class Clause:
    """One numbered requirement.

    Attributes
    ----------
    number : str
        ``HG-<chapter>.<section>/<n>``.
    text : str
        The requirement, on one line.
    """

    number: str
    text: str

    @property
    def level(self) -> Level:
        """The strongest word in the text."""
        return next(level for level in Level if level.value in self.text)

    @property
    def section(self) -> str:
        """Number of the section, ``HG-<chapter>.<section>``."""
        return self.number.partition("/")[0]

    @property
    def order(self) -> tuple[int, ...]:
        """Key that sorts clauses in the order of SPEC.md."""
        return tuple(int(part) for part in re.findall(r"\d+", self.number))


def read_spec_of_clauses() -> str:
    """Return the text of SPEC.md.

    Raises
    ------
    FileNotFoundError
        If the installation lacks the file.
    """
    package = resources.files("haptogram_protocol")
    packed = package / "SPEC.md"
    spec = packed if packed.is_file() else package / ".." / "SPEC.md"
    return spec.read_text("utf-8")


def parse_spec(text: str) -> tuple[Clause, ...]:
    """Return the clauses in the text of SPEC.md, in order."""
    return tuple(Clause(number, " ".join(body.split())) for number, body in _CLAUSE.findall(text))


@functools.cache
def load_clauses() -> Mapping[str, Clause]:
    """Return every clause by its number, in the order of SPEC.md."""
    return MappingProxyType(
        {clause.number: clause for clause in parse_spec(read_spec_of_clauses())}
    )


@functools.cache
def load_spec_table(first: str) -> tuple[Mapping[str, str], ...]:
    """Return the rows of the table whose first column is *first*: cells by column, if not empty."""
    text = read_spec_of_clauses()
    lines = text[text.index(f"\n| {first} | ") + 1 :].partition("\n\n")[0].splitlines()
    head, _, *rows = ([cell.strip() for cell in line.split("|")[1:-1]] for line in lines)
    return tuple({name: cell for name, cell in zip(head, row, strict=True) if cell} for row in rows)

"""The clauses of SPEC.md, as data that travels with the package.

``python -m haptogram.conformance.clauses protocol/SPEC.md`` writes ``clause_table.py``; a test
proves that it is up to date.
"""

from __future__ import annotations

import enum
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

_CLAUSE: Final = re.compile(r"^- \*\*(HG-\d+\.\d+/\d+)\*\* ((?:.|\n  )*)", re.MULTILINE)
_WIDTH: Final = 94
_FITS: Final = 92  # beside its indent and a comma: the formatter would join what is shorter
_HEAD: Final = '''\
"""Every clause of SPEC.md: its number and its text.

Written by ``python -m haptogram.conformance.clauses protocol/SPEC.md``; not edited by hand.
"""

from __future__ import annotations

from typing import Final

TABLE: Final = (
'''


class Level(enum.StrEnum):
    """How much a clause demands."""

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
        """The strongest word in it."""
        return next(level for level in Level if level.value in self.text)

    @property
    def chapter(self) -> int:
        """Chapter of SPEC.md."""
        return self.order[0]

    @property
    def order(self) -> tuple[int, ...]:
        """Key that sorts clauses as the text has them."""
        return tuple(int(part) for part in re.findall(r"\d+", self.number))


def parse_spec(text: str) -> tuple[Clause, ...]:
    """Return the clauses in the text of SPEC.md, in order."""
    return tuple(Clause(number, " ".join(body.split())) for number, body in _CLAUSE.findall(text))


def load_clauses() -> dict[str, Clause]:
    """Return every clause by its number, in order."""
    from .clause_table import TABLE

    return {number: Clause(number, text) for number, text in TABLE}


def render_table(clauses: tuple[Clause, ...]) -> str:
    """Return the module that holds *clauses*."""
    return _HEAD + "".join(_row(clause) for clause in clauses) + ")\n"


def _row(clause: Clause) -> str:
    pieces = [clause.text] if len(_quoted(clause.text)) < _FITS else _wrapped(clause)
    quoted = "".join(f"        {_quoted(piece)}\n" for piece in pieces)
    return f'    (\n        "{clause.number}",\n{quoted.rstrip()},\n    ),\n'


def _wrapped(clause: Clause) -> list[str]:
    pieces, line = [], ""
    for word in clause.text.split(" "):
        if line and len(repr(line + word)) + 8 > _WIDTH:
            pieces.append(line)
            line = ""
        line += word + " "
    return [*pieces, line.rstrip()]


def _quoted(text: str) -> str:
    """Return *text* as a literal, quoted as the formatter quotes."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def main(arguments: list[str]) -> int:
    """Write the table beside this module; return the exit status."""
    (spec,) = arguments
    table = render_table(parse_spec(Path(spec).read_text("utf-8")))
    Path(__file__).with_name("clause_table.py").write_text(table, "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""The goals with their figures, as text and as JSON."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

_WORDS: Final = {True: "met", False: "NOT met", None: "-"}
_HEAD: Final = ("figure", "measured", "beside it", "goal", "")


@dataclass(frozen=True, slots=True)
class Goal:
    """One line of the table.

    Attributes
    ----------
    figure, measured : str
        Name of the figure, and its value.
    against : str
        The value that was measured beside it.
    goal : str
        The limit.
    met : bool or None
        Whether the figure keeps the limit; None if there is no limit, or nothing to compare with.
    """

    figure: str
    measured: str
    against: str
    goal: str
    met: bool | None


@dataclass(frozen=True, slots=True)
class Goals:
    """The table, the machine, and how busy its processors were meanwhile."""

    lines: list[Goal]
    environment: Mapping[str, Any]
    processors: Mapping[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Return the table for JSON."""
        return {
            "goals": [dataclasses.asdict(line) for line in self.lines],
            "environment": dict(self.environment),
            "processors": dict(self.processors),
        }

    def as_text(self) -> str:
        """Return the table for a terminal."""
        rows = [_HEAD]
        rows += [(g.figure, g.measured, g.against, g.goal, _WORDS[g.met]) for g in self.lines]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        lines = [
            "  ".join(map(str.ljust, row, widths)).rstrip()  # one cell a column
            for row in rows
        ]
        return "\n".join([*lines, "", self._machine()])

    def _machine(self) -> str:
        found = self.environment
        shares = ", ".join(f"{name} {100 * v:.0f} %" for name, v in self.processors.items())
        return (
            f"{found['cpu']}, {found['cpus_usable']} processors, {found['virtualisation']}, "
            f"{found['kernel']} {found['preemption']}, {found['python']}\n"
            f"processors meanwhile: {shares}"
        )

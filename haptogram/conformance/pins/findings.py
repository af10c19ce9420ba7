"""Findings of a capture about clauses: how often each was seen to hold, and where it was not."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from haptogram.records.pins import PinRecord


@dataclass
class PinClauseFindings:
    """Findings by clause.

    Attributes
    ----------
    held : Counter of str
        Number of occasions at which the pins met a clause.
    broken : dict of str to list of str
        Occasions at which they did not, in words.
    unclear : dict of str to list of str
        Occasions that look as if the pins did not, and that the capture itself may explain.
    missing : dict of str to str
        Why a clause could not be judged, where the capture itself is the reason.
    partial : dict of str to str
        The occasions of a clause that the captured lines show, where they do not show all.
    paths : set of (str, str)
        Clause and path of every drive that was compared with the pins.
    offered : set of (str, str)
        Clause and path of every drive that the board offers.
    """

    held: Counter[str] = field(default_factory=Counter)
    broken: dict[str, list[str]] = field(default_factory=dict)
    unclear: dict[str, list[str]] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    partial: dict[str, str] = field(default_factory=dict)
    paths: set[tuple[str, str]] = field(default_factory=set)
    offered: set[tuple[str, str]] = field(default_factory=set)

    def add(self, clause: str, broken: str) -> None:
        """Count an occasion; *broken* says what the pins did wrong, empty: nothing."""
        if broken:
            self.broken.setdefault(clause, []).append(broken)
        else:
            self.held[clause] += 1

    def paths_left_out(self, clause: str) -> str:
        """Return the paths of a drive about which the capture says nothing; empty: none."""
        left = sorted(path for one, path in self.offered - self.paths if one == clause)
        return f"; no pin showed {', '.join(left)}" if left else ""

    def doubt(self, clause: str, text: str) -> None:
        """Note an occasion that looks wrong, and that the capture may explain."""
        self.unclear.setdefault(clause, []).append(text)


def time_by_pins(record: PinRecord, periods: float) -> str:
    """Return a time of the capture in words."""
    return f"at {periods * record.period_s * 1e3:.3f} ms"


def duration_by_pins(record: PinRecord, periods: float) -> str:
    """Return a length of time in words."""
    return f"{periods * 1e6 / record.carrier_hz:.0f} µs"


def names_of_pins(record: PinRecord, elements: list[int]) -> str:
    """Return pins in words, the first four by name."""
    names = [f"{element} ({record.pins[element].channel})" for element in elements[:4]]
    more = f" and {len(elements) - 4} more" if len(elements) > 4 else ""
    return f"element{'s' if len(elements) > 1 else ''} {', '.join(names)}{more}"

"""The plan of a sweep, as its file states it: points, each the words of a command."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self, TypeAlias

from haptogram.errors import ConfigurationError, refusals_of
from haptogram.settings.arguments import shown_argument
from haptogram.settings.faults.plan import read_faults
from haptogram.settings.option import Settings, option, option_of
from haptogram.settings.parser import Parser
from haptogram.settings.run.frames import LimitConfig
from haptogram.settings.text_file import read_toml_file

from .axis import SweepAxis, option_text, option_words

MOST_POINTS: Final = 1_000_000
_TABLES: Final = ("sweep", "options", "axes")
#: Options of the commands that are for one run, not for a point among many.
_OF_ONE_RUN: Final = (
    *("capture", "channels", "from_recording", "compare", "config", "list", "resume", "view"),
    *("jobs", "quiet", "verbose", "stamp", "write_baseline", "record", "frames", "json", "junit"),
    *("html", "summary", "help"),
)

#: Returns the parser of the options of a command.
ParserOf: TypeAlias = Callable[[str], Parser]


@dataclass(frozen=True, kw_only=True)
class SweepConfig(Settings):
    """The table ``[sweep]`` of a file."""

    run: str = option(choices=("verify", "conform", "soak"), help="command of every point")
    points: int | None = option(
        None, unit="N", low=1, high=MOST_POINTS, help="random points", absent="the whole grid"
    )
    seed: int = option_of(LimitConfig, "seed", help="seed of the random points")


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """One point.

    Attributes
    ----------
    number : int
        Its place in the sweep, from 0 on.
    values : mapping of str to str, int, float or bool
        The value on each axis, as a row has it.
    words : sequence of str
        The words of the command that runs it.
    """

    number: int
    values: Mapping[str, Any]
    words: Sequence[str]


@dataclass(frozen=True)
class SweepPlan:
    """Every point of a sweep; each follows from the file and its number alone.

    Attributes
    ----------
    document : mapping
        The content of the file.
    config : SweepConfig
    fixed : sequence of str
        The words that all points share, the name of the command first.
    axes : sequence of SweepAxis
        The varied options; in a grid the last one changes fastest.
    """

    document: Mapping[str, Any]
    config: SweepConfig
    fixed: Sequence[str]
    axes: Sequence[SweepAxis]

    @classmethod
    def read(cls, path: Path, parser_of: ParserOf) -> Self:
        """Return the plan in a TOML file; the parser of its command checks every option.

        Raises
        ------
        ConfigurationError
            Names the file, and what in it is not known, is refused or leaves no point.
        """
        document = read_toml_file(path, "file")
        with refusals_of(f"{path}:"):
            plan = cls.of(document)
            plan.check(parser_of(plan.config.run))
        return plan

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Self:
        """Return the plan that *document* states; errors do not name its file."""
        for name, table in document.items():
            if name in _TABLES and not isinstance(table, dict):
                raise ConfigurationError(
                    f"{name} is {shown_argument(table)}, must be a table: [{name}]"
                )
            if name not in _TABLES:
                known = ", ".join(f"[{table}]" for table in _TABLES)
                raise ConfigurationError(f"[{name}] is not read; its tables are {known}")
        if "run" not in document.get("sweep", {}):
            raise ConfigurationError("[sweep] must say what to run: verify, conform or soak")
        config = SweepConfig.of(**document["sweep"])
        given, varied = (_options_by_name(document.get(table, {})) for table in ("options", "axes"))
        for name in (*given, *varied):
            if name in _OF_ONE_RUN:
                raise ConfigurationError(f"{name} is an option of one run, not of many points")
            if name in given and name in varied:
                raise ConfigurationError(f"{name} is in [options] and in [axes]; name it once")
        fixed = [word for name, value in given.items() for word in option_words(name, value)]
        # Points in real time would disturb each other; a board at a port has a clock of its own.
        if config.run == "verify" and not {"port", "virtual_time"} & {*given, *varied}:
            fixed = ["--virtual-time", *fixed]
        if not varied:
            raise ConfigurationError("[axes] names no option: the sweep would be empty")
        axes = [SweepAxis.of(name, value) for name, value in varied.items()]
        return cls(document, config, [config.run, *fixed], axes)

    def check(self, parser: Parser) -> None:
        """Refuse an option or a value that is wrong by itself, and a grid that has no end."""
        if self.config.points is None:
            for axis in self.axes:
                if not axis.values:
                    raise ConfigurationError(
                        f"{axis.name} is a range of real numbers, which a grid cannot take: say "
                        "points in [sweep] for a random sample, or list values"
                    )
            # Not by len(), which takes no number beyond 64 bits.
            if (count := math.prod(len(axis.values) for axis in self.axes)) > MOST_POINTS:
                raise ConfigurationError(f"the grid has {count} points, must be 1 to {MOST_POINTS}")
        usual = {axis.name: axis.words(axis.ends[0]) for axis in self.axes}
        for axis in self.axes:
            for value in axis.values if isinstance(axis.values, list) else axis.ends:
                words = (usual | {axis.name: axis.words(value)}).values()
                options = parser.parse_args([*self.fixed[1:], *itertools.chain(*words)])
                read_faults(getattr(options, "fault", None) or (), None)

    def __len__(self) -> int:
        if self.config.points is not None:
            return self.config.points
        return math.prod(len(axis.values) for axis in self.axes)

    def __getitem__(self, number: int) -> SweepPoint:
        if self.config.points is None:
            values = self._at_place(number)
        else:
            source = random.Random(f"{self.config.seed}/{number}")
            values = [axis.drawn(source) for axis in self.axes]
        pairs = list(zip(self.axes, values, strict=True))
        shown = {a.name: v if isinstance(v, int | float) else option_text(v) for a, v in pairs}
        words = itertools.chain(*(axis.words(value) for axis, value in pairs))
        return SweepPoint(number, shown, [*self.fixed, *words])

    def _at_place(self, number: int) -> list[Any]:
        """Return the value of each axis at point *number* of the grid; the last axis is fastest."""
        values: list[Any] = []
        for axis in reversed(self.axes):
            number, place = divmod(number, len(axis.values))
            values.insert(0, axis.values[place])
        return values


def _options_by_name(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a table by name, each - made _; refuse one given in both ways."""
    options = {name.replace("-", "_"): value for name, value in table.items()}
    if len(options) < len(table):
        raise ConfigurationError(f"one of {', '.join(table)} is named twice, with - and with _")
    return options

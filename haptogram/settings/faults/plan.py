"""A plan of faults as data, its text and its TOML; docs/faults.md describes both."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Self

from haptogram.errors import ConfigurationError, refusals_of
from haptogram.settings.frozen import dataclass, field

from ..arguments import check_texts
from ..text_file import read_toml_file
from . import kinds

#: The largest seed of chance that a plan takes.
MOST_FAULT_SEED: Final = 2**64 - 1
#: Most faults of a plan.
MOST_FAULTS: Final = 1000
_NS_PER_MS: Final = 1_000_000
_BOTH: Final = "both"
_DISCONNECT: Final = "line.disconnect"
_SUCH_AS: Final = "line.flip ber=1e-5"


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault of a plan.

    Attributes
    ----------
    name : str
        Such as ``line.flip``.
    values : mapping of str to float
        Its parameters, all of them.
    from_ns, until_ns : int
        When it is there, since power-up.
    direction : str
        Bytes that it acts on: ``down`` to the board, ``up`` from it, or ``both``.
    written : str
        The text that a user wrote, for reports.
    option : str
        Beginning of a refusal of the fault: ``fault``, or ``fault_plan`` and the file.
    """

    name: str
    values: Mapping[str, float]
    from_ns: int = 0
    until_ns: int = kinds.FOR_EVER_NS
    direction: str = _BOTH
    written: str = field(default="", compare=False)
    option: str = field(default="fault", compare=False)

    def __post_init__(self) -> None:
        """Check name, values, direction and times, and set the text if none was written."""
        kinds.check_fault_values(self.name, self.values)
        kinds.check_fault_direction(self.name, self.direction)
        kinds.check_fault_window(self.name, self.from_ns, self.until_ns)
        end_ns = _fault_end_ns(self.name, self.values, self.from_ns)
        if self.name == _DISCONNECT and self.until_ns != end_ns and "ms" in self.non_default:
            raise ConfigurationError(
                _conflicting_fault_end(self.values["ms"], kinds.fault_time_text(self.until_ns))
            )
        object.__setattr__(self, "written", self.written or str(self))

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the fault that *text* names: ``NAME [PARAMETER=VALUE ...]``.

        Raises
        ------
        ConfigurationError
            For another type, for a fault or a parameter that is not known or given twice, and for
            a value that is outside its limits or contradicts another one.
        """
        if not isinstance(text, str):
            raise ConfigurationError(f"fault {text!r}: must be a text such as {_SUCH_AS!r}")
        name, *words = text.split() or [""]
        values: dict[str, str] = {}
        for key, _, value in (word.partition("=") for word in words):
            if key in values:
                raise ConfigurationError(f"{name} {key}={value}: {key} is said twice; say it once")
            values[key] = value
        return cls.of(name, values, text)

    @classmethod
    def of(cls, name: str, texts: Mapping[str, str], written: str = "") -> Self:
        """Return the fault *name* with the parameters in *texts*; see :meth:`parse`."""
        kinds.check_fault_name(name)
        known = kinds.fault_words(name)
        for key in texts:
            if key not in known:
                raise ConfigurationError(
                    f"{name} has no parameter {key!r}; known: {', '.join(known)}"
                )
        values = {
            key: kinds.fault_number(name, key, texts[key]) if key in texts else limits.default
            for key, limits in kinds.FAULT_KINDS[name].items()
        }
        if name == _DISCONNECT and {"ms", "until"} <= texts.keys():
            raise ConfigurationError(_conflicting_fault_end(values["ms"], texts["until"]))
        times = {
            key: kinds.fault_time_ns(name, key, texts[key])
            for key in ("from", "until")
            if key in texts
        }
        from_ns = times.get("from", 0)
        until_ns = times.get("until", _fault_end_ns(name, values, from_ns))
        direction = texts.get("direction", kinds.usual_fault_direction(name))
        return cls(name, values, from_ns, until_ns, direction, written)

    @property
    def non_default(self) -> dict[str, float | str]:
        """Parameters whose value is not the default, in order."""
        given: dict[str, float | str] = {
            key: value
            for key, value in self.values.items()
            if value != kinds.FAULT_KINDS[self.name][key].default
        }
        if self.direction != kinds.usual_fault_direction(self.name):
            given["direction"] = self.direction
        if self.from_ns:
            given["from"] = kinds.fault_time_text(self.from_ns)
        if self.until_ns != _fault_end_ns(self.name, self.values, self.from_ns):
            given["until"] = kinds.fault_time_text(self.until_ns)
        return given

    def __str__(self) -> str:
        """Return the shortest text that :meth:`parse` takes."""
        given = self.non_default.items()
        return " ".join([self.name, *(f"{key}={_fault_value_text(value)}" for key, value in given)])

    def is_there(self, t_ns: int) -> bool:
        """Return True if the fault acts at *t_ns*."""
        return self.from_ns <= t_ns < self.until_ns


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """Faults, and the seed of their chance.

    Attributes
    ----------
    faults : tuple of Fault
        In the order in which they act.
    seed : int
        Two runs with the same plan, seed and traffic meet the same faults.
    """

    faults: tuple[Fault, ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse objects that are no faults, and faults that exclude each other."""
        if not all(isinstance(fault, Fault) for fault in self.faults):
            raise ConfigurationError("the faults of a plan must be Fault; see FaultPlan.parse")
        if len(self.faults) > MOST_FAULTS:
            raise ConfigurationError(f"{len(self.faults)} faults; a plan takes {MOST_FAULTS}")
        if len(wraps := [str(fault) for fault in self.named("clock.wrap")]) > 1:
            raise ConfigurationError(f"{' and '.join(wraps)}: the clock wraps once; say it once")

    @classmethod
    def parse(cls, texts: Sequence[str], seed: int = 0) -> Self:
        """Return the plan of *texts*; see :meth:`Fault.parse`.

        Raises
        ------
        ConfigurationError
            Also for one text where a list of them is wanted.
        """
        return cls(parse_faults(texts), seed)

    def as_toml(self) -> str:
        """Return the text of the document that :func:`faults_of_toml` reads as this plan."""
        tables = (
            "\n".join(
                ["[[fault]]", *(f"{key} = {_fault_value_toml(value)}" for key, value in items)]
            )
            for items in (
                [("name", fault.name), *fault.non_default.items()] for fault in self.faults
            )
        )
        return "\n\n".join([f"seed = {self.seed}", *tables]) + "\n"

    def named(self, name: str) -> Iterator[Fault]:
        """Yield the faults with this name."""
        return (fault for fault in self.faults if fault.name == name)


def parse_faults(texts: Sequence[str]) -> tuple[Fault, ...]:
    """Return the faults of *texts*; see :meth:`Fault.parse`.

    Raises
    ------
    ConfigurationError
        Also for one text instead of a list.
    """
    check_texts("faults", texts, _SUCH_AS)
    return tuple(map(Fault.parse, texts))


def read_faults(
    texts: Sequence[str], file: str | Path | None
) -> tuple[tuple[Fault, ...], int | None]:
    """Return the faults of a file, if one is named, then those of *texts*, and the file's seed.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, or a fault is refused.
    """
    with refusals_of("fault"):
        added = parse_faults(texts)
    if file is None:
        return added, None
    document = read_toml_file(Path(file), "fault_plan")
    option = f"fault_plan '{file}':"
    with refusals_of(option):
        faults, seed = faults_of_toml(document)
    return tuple(dataclasses.replace(fault, option=option) for fault in faults) + added, seed


def faults_of_toml(document: Mapping[str, Any]) -> tuple[tuple[Fault, ...], int | None]:
    """Return the faults of a TOML document, tables ``[[fault]]``, and its ``seed``, if it has one.

    Raises
    ------
    ConfigurationError
        For what :meth:`Fault.parse` refuses.
    """
    tables, seed = document.get("fault", []), document.get("seed")
    if unknown := [key for key in document if key not in ("fault", "seed")]:
        raise ConfigurationError(f"{unknown[0]} is not read; known are seed and [[fault]]")
    if seed is not None and (type(seed) is not int or not 0 <= seed <= MOST_FAULT_SEED):
        raise ConfigurationError(f"seed = {seed}, must be a whole number, 0 to {MOST_FAULT_SEED}")
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise ConfigurationError("must have tables [[fault]]")
    return tuple(map(_fault_from_table, tables)), seed


def _fault_end_ns(name: str, values: Mapping[str, float], from_ns: int) -> int:
    """Return when (ns) a fault ends by its own parameter "ms"; only line.disconnect has one.

    Others never end by themselves: FOR_EVER_NS.
    """
    return from_ns + round(values["ms"] * _NS_PER_MS) if name == _DISCONNECT else kinds.FOR_EVER_NS


def _conflicting_fault_end(ms: float, until: str) -> str:
    """Return the error text for a fault with both duration and end."""
    said = f"{_DISCONNECT} ms={kinds.fault_number_text(ms)} until={until}"
    return f"{said}: say either how long, or until when"


def _fault_from_table(table: dict[str, Any]) -> Fault:
    """Return the fault of a [[fault]] table of a TOML file."""
    if "name" not in table:
        raise ConfigurationError('a table [[fault]] has no name; such as name = "line.drop"')
    name = str(table["name"])
    # In one line, whatever a string of the document holds: so are the errors.
    words = {key: " ".join(str(value).split()) for key, value in table.items() if key != "name"}
    return Fault.of(name, words)


def _fault_value_text(value: float | str) -> str:
    """Return a parameter's value as text; a text as it is."""
    return value if isinstance(value, str) else kinds.fault_number_text(value)


def _fault_value_toml(value: float | str) -> str:
    """Return a parameter's value in TOML: a text in quotes."""
    return f'"{value}"' if isinstance(value, str) else kinds.fault_number_text(value)

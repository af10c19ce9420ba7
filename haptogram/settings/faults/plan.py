"""A plan of faults as data, its text and its TOML; docs/faults.md describes both."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self

from haptogram.errors import ConfigurationError

from .checks import (
    FOR_EVER_NS,
    check_direction,
    check_name,
    check_values,
    check_window,
    number_of,
    time_ns,
    time_text,
    usual_direction,
)
from .kinds import FAULT_KINDS, shown, words_of

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
        ``down`` to the board, ``up`` from it, or ``both``: on which bytes it acts.
    """

    name: str
    values: Mapping[str, float]
    from_ns: int = 0
    until_ns: int = FOR_EVER_NS
    direction: str = _BOTH

    def __post_init__(self) -> None:
        """Refuse what makes no sense, however the fault was made."""
        check_values(self.name, self.values)
        check_direction(self.name, self.direction)
        check_window(self.name, self.from_ns, self.until_ns)
        end_ns = _end_ns(self.name, self.values, self.from_ns)
        if self.name == _DISCONNECT and self.until_ns != end_ns and "ms" in self.said:
            raise ConfigurationError(_twice(self.values["ms"], time_text(self.until_ns)))

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the fault that *text* names: ``NAME [PARAMETER=VALUE ...]``.

        Raises
        ------
        ConfigurationError
            For what is no text, for a fault or a parameter that is not known or said twice, and
            for a value that makes no sense, by itself or beside another one.
        """
        if not isinstance(text, str):
            raise ConfigurationError(f"fault {text!r}: must be a text such as {_SUCH_AS!r}")
        name, *words = text.split() or [""]
        pairs = [word.partition("=")[::2] for word in words]
        for number, (key, value) in enumerate(pairs):
            if key in (earlier for earlier, _ in pairs[:number]):
                raise ConfigurationError(f"{name} {key}={value}: {key} is said twice; say it once")
        return cls.of(name, dict(pairs))

    @classmethod
    def of(cls, name: str, texts: Mapping[str, str]) -> Self:
        """Return the fault *name* with the parameters in *texts*; see :meth:`parse`."""
        check_name(name)
        known = words_of(name)
        for key in texts:
            if key not in known:
                raise ConfigurationError(
                    f"{name} has no parameter {key!r}; known: {', '.join(known)}"
                )
        values = {
            key: number_of(name, key, texts[key]) if key in texts else limits.default
            for key, limits in FAULT_KINDS[name].items()
        }
        if name == _DISCONNECT and {"ms", "until"} <= texts.keys():
            raise ConfigurationError(_twice(values["ms"], texts["until"]))
        times = {key: time_ns(name, key, texts[key]) for key in ("from", "until") if key in texts}
        from_ns = times.get("from", 0)
        until_ns = times.get("until", _end_ns(name, values, from_ns))
        return cls(name, values, from_ns, until_ns, texts.get("direction", usual_direction(name)))

    @property
    def said(self) -> dict[str, float | str]:
        """Parameters that are not what they would be if nothing were said, in order."""
        said: dict[str, float | str] = {
            key: value
            for key, value in self.values.items()
            if value != FAULT_KINDS[self.name][key].default
        }
        if self.direction != usual_direction(self.name):
            said["direction"] = self.direction
        if self.from_ns:
            said["from"] = time_text(self.from_ns)
        if self.until_ns != _end_ns(self.name, self.values, self.from_ns):
            said["until"] = time_text(self.until_ns)
        return said

    def __str__(self) -> str:
        """Return the text that :meth:`parse` takes."""
        return " ".join([self.name, *(f"{key}={_text(value)}" for key, value in self.said.items())])

    def is_there(self, t_ns: int) -> bool:
        """Return whether the fault is there at *t_ns*."""
        return self.from_ns <= t_ns < self.until_ns


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """Faults, and the seed of what is random about them.

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
        """Refuse what is no plan, and faults that cannot both be."""
        if not all(isinstance(fault, Fault) for fault in self.faults):
            raise ConfigurationError("the faults of a plan must be Fault; see FaultPlan.parse")
        if len(wraps := [str(fault) for fault in self.named("clock.wrap")]) > 1:
            raise ConfigurationError(f"{' and '.join(wraps)}: the clock wraps once; say it once")

    @classmethod
    def parse(cls, texts: Iterable[str], seed: int = 0) -> Self:
        """Return the plan of *texts*; see :meth:`Fault.parse`.

        Raises
        ------
        ConfigurationError
            Also for one text where a list of them is wanted.
        """
        if isinstance(texts, str | bytes) or not isinstance(texts, Iterable):
            raise ConfigurationError(f"faults {texts!r}: must be a list such as [{_SUCH_AS!r}]")
        return cls(tuple(Fault.parse(text) for text in texts), seed)

    @classmethod
    def from_toml(cls, text: str, seed: int = 0) -> Self:
        """Return the plan that a TOML document holds, tables ``[[fault]]`` and maybe a ``seed``.

        Parameters
        ----------
        seed : int
            The seed, if the document has none.

        Raises
        ------
        ConfigurationError
            If it is no TOML, or for what :meth:`Fault.parse` refuses.
        """
        try:
            document = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ConfigurationError(f"fault plan: {error}") from error
        tables, own_seed = document.pop("fault", []), document.pop("seed", seed)
        if document:
            raise ConfigurationError(f"fault plan: {', '.join(document)}; known: seed, [[fault]]")
        if type(own_seed) is not int or own_seed < 0:
            raise ConfigurationError(f"fault plan: seed = {own_seed}, must be 0 or more")
        if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
            raise ConfigurationError("fault plan: must have tables [[fault]]")
        return cls(tuple(_from_table(table) for table in tables), own_seed)

    def as_toml(self) -> str:
        """Return the document that :meth:`from_toml` makes this plan of."""
        tables = (
            "\n".join(["[[fault]]", *(f"{key} = {_toml(value)}" for key, value in items)])
            for items in ([("name", fault.name), *fault.said.items()] for fault in self.faults)
        )
        return "\n\n".join([f"seed = {self.seed}", *tables]) + "\n"

    def named(self, name: str) -> Iterator[Fault]:
        """Yield the faults with this name."""
        return (fault for fault in self.faults if fault.name == name)


def _end_ns(name: str, values: Mapping[str, float], from_ns: int) -> int:
    """Return when a fault is over by itself."""
    return from_ns + round(values["ms"] * _NS_PER_MS) if name == _DISCONNECT else FOR_EVER_NS


def _twice(ms: float, until: str) -> str:
    return f"{_DISCONNECT} ms={shown(ms)} until={until}: say either how long, or until when"


def _from_table(table: dict[str, Any]) -> Fault:
    name = str(table.get("name", ""))
    # In one line, whatever a string of the document holds: so are the errors.
    words = {key: " ".join(str(value).split()) for key, value in table.items() if key != "name"}
    return Fault.of(name, words)


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else shown(value)


def _toml(value: float | str) -> str:
    return f'"{value}"' if isinstance(value, str) else shown(value)


def read_fault_plan(texts: Iterable[str], file: str | Path | None, seed: int) -> FaultPlan:
    """Return the plan of a file, if one is named, and of *texts* after it.

    Parameters
    ----------
    seed : int
        Seed of the plan, unless the file gives another.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, or a fault is refused.
    """
    added = FaultPlan.parse(texts, seed)
    if file is None:
        return added
    try:
        plan = FaultPlan.from_toml(Path(file).read_text(encoding="utf-8"), seed)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigurationError(f"cannot read the fault plan {file}: {reason}") from error
    return FaultPlan(plan.faults + added.faults, plan.seed)

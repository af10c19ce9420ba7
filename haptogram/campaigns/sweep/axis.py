"""One axis of a sweep: an option, and the values that it takes."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Self

from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_argument_kind, check_number, shown_argument
from haptogram.settings.option import unknown_setting_text

_OF_VALUES: Final = ("values", "text")
_KEYS: Final = (*_OF_VALUES, "low", "high", "log")
_PLACE: Final = "{}"  # placeholder of the value in a text
_MOST: Final = 1e12


@dataclass(frozen=True, slots=True)
class SweepAxis:
    """One axis.

    Attributes
    ----------
    name : str
        Name of the option, as in a file of settings.
    values : sequence
        The values; empty for a range of real numbers.
    bounds : tuple of float
        The ends of a range of real numbers.
    is_log : bool
        Whether a random value is uniform in its logarithm.
    text : str
        The value of the option, with ``{}`` for the value on the axis.
    """

    name: str
    values: Sequence[Any] = ()
    bounds: tuple[float, float] = (0.0, 0.0)
    is_log: bool = False
    text: str = _PLACE

    @classmethod
    def of(cls, name: str, given: Any) -> Self:
        """Return the axis that a file states: a list of values, or a table.

        Raises
        ------
        ConfigurationError
            Names the axis and what is wrong with it.
        """
        table = given if isinstance(given, dict) else {"values": given}
        known = _OF_VALUES if "values" in table else _KEYS
        for key in table:
            if key not in known:
                guess = unknown_setting_text(key, known)
                raise ConfigurationError(f"{name}: {key!r} is not read{guess}")
        text, is_log = table.get("text", _PLACE), table.get("log", False)
        check_argument_kind(f"{name}: text", text, str, "a text with {} for the value")
        check_argument_kind(f"{name}: log", is_log, bool, "true or false")
        if _PLACE not in text:
            raise ConfigurationError(f"{name}: text {text!r} has no {{}} for the value")
        if "values" in table:
            values = table["values"]
            check_argument_kind(f"{name}: values", values, list, "a list")
            if not values:
                raise ConfigurationError(f"{name} has no value: the sweep would be empty")
            return cls(name, values, text=text)
        low, high = (_axis_end(name, table, key) for key in ("low", "high"))
        if not low <= high or (is_log and low <= 0.0):
            limit = "low must be above 0 with log" if low <= high else "high must be low or more"
            raise ConfigurationError(f"{name}: low {low:g}, high {high:g}: {limit}")
        if isinstance(table["low"], int) and isinstance(table["high"], int) and not is_log:
            return cls(name, range(int(low), int(high) + 1), text=text)
        return cls(name, (), (low, high), is_log, text)

    @property
    def label(self) -> str:
        """The option, and where in its value the value on the axis stands."""
        return self.name if self.text == _PLACE else f"{self.name} {self.text}"

    @property
    def ends(self) -> Sequence[Any]:
        """The first value and the last one."""
        return (self.values[0], self.values[-1]) if self.values else self.bounds

    def drawn(self, source: random.Random) -> Any:
        """Return a random value."""
        if self.values:
            return source.choice(self.values)
        ends = map(math.log, self.bounds) if self.is_log else self.bounds
        value = source.uniform(*ends)
        return float(f"{math.exp(value) if self.is_log else value:.6g}")

    def words(self, value: Any) -> list[str]:
        """Return the words of a command line for *value*."""
        if self.text != _PLACE:
            value = self.text.replace(_PLACE, option_text(value))
        return option_words(self.name, value)


def _axis_end(name: str, table: dict[str, Any], key: str) -> float:
    """Return the end *key*, "low" or "high", of the axis *name*; refuse a table without it."""
    if key not in table:
        raise ConfigurationError(f"{name} has neither values nor low and high")
    return check_number(f"{name}: {key}", table[key], -_MOST, _MOST)


def option_words(name: str, value: Any) -> list[str]:
    """Return the words of a command line that give the option *name* this value of a file.

    Raises
    ------
    ConfigurationError
        For a value that no option takes.

    Examples
    --------
    >>> option_words("center_mm", [0, 0, 120])
    ['--center-mm=0,0,120']
    >>> option_words("fault", ["line.drop p=0.1", "device.dead column=3"])
    ['--fault=line.drop p=0.1', '--fault=device.dead column=3']
    >>> option_words("strict", True), option_words("strict", False), option_words("fault", [])
    (['--strict'], [], [])
    """
    word = f"--{name.replace('_', '-')}"
    if isinstance(value, bool):
        return [word] if value else []
    if isinstance(value, list) and all(isinstance(item, str) for item in value):
        return [f"{word}={item}" for item in value]
    if isinstance(value, str | int | float | list):
        return [f"{word}={option_text(value)}"]
    raise ConfigurationError(f"{name} is {shown_argument(value)}, must be a value or a list")


def option_text(value: Any) -> str:
    """Return a value of a file as a command line has it."""
    if isinstance(value, list):
        return ("; " if any(isinstance(item, str) for item in value) else ",").join(map(str, value))
    return str(value)

"""Options: fields of a settings class with unit, limits and help.

A settings class is the one table of its options. The command line, the URL, TOML, Python and the
tables of the documentation all read its rows.
"""

from __future__ import annotations

import dataclasses
import functools
import types
from collections.abc import Collection, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Self, TypeVar, get_args, get_origin, get_type_hints

from haptogram.errors import ConfigurationError
from haptogram.settings.frozen import dataclass

from . import arguments

_S = TypeVar("_S", bound="Settings")
_FLAGS: Final = {"0": False, "1": True}
#: Signs of the units by their placeholders.
_SIGNS: Final = {
    "BAUD": "Bd",
    "BITS": "bits",
    "BYTES": "bytes",
    "C": "degrees Celsius",
    "HOURS": "h",
    "HZ": "Hz",
    "MINUTES": "min",
    "MM": "mm",
    "MS": "ms",
    "PERCENT": "%",
    "PPM": "ppm",
    "RAD": "rad",
    "S": "s",
    "US": "µs",
    "X,Y,Z": "mm",
}


class SettingError(ConfigurationError):
    """A setting has a value that is refused.

    Parameters
    ----------
    name : str
        Name of the setting, as a field.
    message : str
        The rest of the sentence that begins with the name.
    """

    def __init__(self, name: str, message: str) -> None:
        super().__init__(f"{name} {message}")
        self.name, self.message = name, message


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """One row of the table of options.

    Attributes
    ----------
    name : str
        Name of the field, with its unit.
    kind : type
        int, float, str, bool or Path; of the items, if there are several.
    is_optional : bool
        Whether the value may be None.
    count : int or None
        Number of items: None for a single value, 0 for any number.
    default : object
        Value if none is given; ``dataclasses.MISSING`` if one must be given.
    low, high : float
        Limits of a number.
    choices : tuple
        The values that are allowed; empty: every value.
    unit : str
        Placeholder of the value in help texts.
    help : str
        One sentence for help texts, without the default.
    absent : str
        Meaning of None in help texts.
    """

    name: str
    kind: type
    is_optional: bool
    count: int | None
    default: Any
    low: float
    high: float
    choices: tuple[Any, ...]
    unit: str
    help: str
    absent: str

    @property
    def word(self) -> str:
        """The option on a command line."""
        return arguments.option_word(self.name)

    @property
    def is_required(self) -> bool:
        """True if there is no default."""
        return self.default is dataclasses.MISSING

    @property
    def default_text(self) -> str:
        """The default in help texts; empty if there is none."""
        if self.is_required:
            return ""
        if self.default is None or self.default == ():
            return self.absent
        if self.kind is bool:
            return "on" if self.default else "off"
        if self.count:
            return ",".join(f"{item:g}" for item in self.default)
        return f"{self.default:.10g}" if self.kind is float else str(self.default)

    def checked(self, value: Any, shown: str | None = None) -> Any:
        """Return *value* in its own type; *shown* is what a user wrote, for a refusal.

        Raises
        ------
        ConfigurationError
            Names the option, the value and the limit.
        """
        if value is None and self.is_optional:
            return None
        if self.count is None:
            return self._checked_item(value)
        if isinstance(value, list | tuple) and self.count in (0, len(value)):
            try:
                return tuple(map(self._checked_item, value))
            except ConfigurationError:
                if self.count == 0 and all(isinstance(item, str) for item in value):
                    raise
        text = shown or arguments.shown_argument(value)
        raise ConfigurationError(f"{self.name} is {text}, must be {self._list_text}")

    @property
    def _list_text(self) -> str:
        """Return what a list option must be: its unit and limits, or "a list of texts"."""
        if self.kind in (str, Path):
            return "a list of texts"
        limits = f"{self.low:.10g} to {self.high:.10g} {self.sign}".rstrip()
        return f"{self.unit}, each {limits}"

    @property
    def sign(self) -> str:
        """Sign of the unit in messages."""
        return _SIGNS.get(self.unit, "")

    def _checked_item(self, value: Any) -> Any:
        """Return *value*, one item if the option is a list, as the option's kind: a path as Path.

        Raises ConfigurationError for another kind, a value beyond the limits or not among the
        choices.
        """
        if self.choices:
            arguments.check_choice(self.name, value, self.choices)
        elif self.kind is int:
            return arguments.check_whole(self.name, value, int(self.low), int(self.high), self.sign)
        elif self.kind is float:
            return arguments.check_number(self.name, value, self.low, self.high, self.sign)
        else:
            kinds = (str, Path) if self.kind is Path else self.kind
            arguments.check_argument_kind(self.name, value, kinds, _KIND_TEXTS[self.kind])
            if value == "":  # Path("") is the current folder
                raise ConfigurationError(f"{self.name} is '', must be {_KIND_TEXTS[self.kind]}")
        return Path(value) if self.kind is Path else value

    def read(self, text: str) -> Any:
        """Return the value that *text* is, of one item where there may be any number.

        A text that is no number stays one, for :meth:`checked` to refuse.

        Raises
        ------
        ConfigurationError
            If *text* is not 0 or 1 for a flag.
        """
        if self.kind is bool:
            if text not in _FLAGS:
                raise ConfigurationError(f"{self.name}={text}; known are {', '.join(_FLAGS)}")
            return _FLAGS[text]
        if self.kind not in (int, float):
            return text
        if not self.count:
            return arguments.read_number_argument(self.kind, text)
        return tuple(arguments.read_number_argument(self.kind, part) for part in text.split(","))

    def checked_item(self, text: str) -> Any:
        """Return the value of :meth:`read`, checked; of one item where there may be any number.

        Raises
        ------
        ConfigurationError
            Names the option, the value and the limit.
        """
        value = self.read(text)
        return self._checked_item(value) if self.count == 0 else self.checked(value, text)

    def write(self, value: Any) -> str:
        """Return the text that :meth:`read` takes for *value*."""
        if self.kind is bool:
            return str(int(value))
        if self.count:
            return ",".join(map(repr, value))
        return repr(value) if self.kind is float else str(value)


_KIND_TEXTS: Final = {
    str: "a text that is not empty",
    bool: "true or false",
    Path: "the name of a file",
}


def option(
    default: Any = dataclasses.MISSING,
    *,
    help: str,
    unit: str = "",
    low: float = 0.0,
    high: float = 0.0,
    choices: tuple[Any, ...] = (),
    absent: str = "none",
) -> Any:
    """Return a dataclass field that is an option; see :class:`Option`."""
    row = {"help": help, "unit": unit, "low": low, "high": high, "choices": choices}
    return dataclasses.field(default=default, metadata={"option": row | {"absent": absent}})


def option_of(kind: type[Settings], name: str, **changed: Any) -> Any:
    """Return a dataclass field that is the option *name* of another settings class.

    Parameters
    ----------
    changed
        Arguments of :func:`option` that differ, ``default`` among them.
    """
    fields = {field.name: field for field in dataclasses.fields(kind)}  # type: ignore[arg-type]
    default = changed.pop("default", fields[name].default)
    row = fields[name].metadata["option"] | changed
    return dataclasses.field(default=default, metadata={"option": row})


def option_group(kind: type[Settings]) -> Any:
    """Return a dataclass field that holds a settings class of its own."""
    return dataclasses.field(default_factory=kind, metadata={"group": kind})


def options_of(kind: type[Any]) -> Mapping[str, Option]:
    """Return the options of a settings class and of its groups by name."""
    key: Any = kind  # mypy takes no class for hashable
    return _option_table(key)


@functools.cache
def _option_table(kind: type[Any]) -> Mapping[str, Option]:
    """Return the options of a settings class by name, those of its groups included."""
    hints, rows = get_type_hints(kind), dict[str, Option]()
    for field in dataclasses.fields(kind):
        if "group" in field.metadata:
            rows |= options_of(field.metadata["group"])
        elif "option" in field.metadata:
            rows[field.name] = _option_row(field, hints[field.name])
    return MappingProxyType(rows)


def _option_row(field: dataclasses.Field[Any], hint: Any) -> Option:
    """Return the option that a dataclass field declares; *hint* is its type, which gives the kind.

    A union with None makes it optional; a tuple makes it a list.
    """
    kinds = get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    kind = next(kind for kind in kinds if kind is not type(None))
    count = None
    if get_origin(kind) is tuple:
        items = get_args(kind)
        kind, count = items[0], 0 if items[-1] is Ellipsis else len(items)
    return Option(
        name=field.name,
        kind=kind,
        is_optional=type(None) in kinds,
        count=count,
        default=field.default,
        **field.metadata["option"],
    )


def build_settings(kind: type[_S], values: Mapping[str, Any]) -> _S:
    """Return the settings with those of *values* that are its options, or those of its groups."""
    given: dict[str, Any] = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]  # subclasses are dataclasses
        if (part := field.metadata.get("group")) is not None:
            given[field.name] = build_settings(part, values)
        elif field.name in values:
            given[field.name] = values[field.name]
    return kind(**given)


def unknown_setting_text(name: str, known: Collection[str]) -> str:
    """Return the end of a message about an unknown *name*: a guess at the right one, or all."""
    return arguments.did_you_mean(name, known) or f"; known are {', '.join(known)}"


class Settings:
    """Base of the settings classes, which are frozen dataclasses of options and groups.

    Every value is checked once, when an object is made, and converted to its own type.
    """

    def __post_init__(self) -> None:
        """Check every option.

        Raises
        ------
        SettingError
            Names the option, the value and the limit.
        """
        for field in dataclasses.fields(self):  # type: ignore[arg-type]  # of the subclass
            if "option" in field.metadata:
                row = options_of(type(self))[field.name]
                try:
                    value = row.checked(getattr(self, field.name))
                except ConfigurationError as error:
                    message = str(error).removeprefix(f"{field.name} ")
                    raise SettingError(field.name, message) from error
                object.__setattr__(self, field.name, value)

    @classmethod
    def of(cls, **values: Any) -> Self:
        """Return the settings with *values*, which are those of the groups as well.

        Raises
        ------
        SettingError
            Also for a name that is no option.
        """
        for name in sorted(values.keys() - options_of(cls).keys()):
            raise SettingError(
                name, f"is not a setting{unknown_setting_text(name, options_of(cls))}"
            )
        return build_settings(cls, values)

    def values(self) -> dict[str, Any]:
        """Return every option with its value, those of the groups as well."""
        values: dict[str, Any] = {}
        for field in dataclasses.fields(self):  # type: ignore[arg-type]  # of the subclass
            value = getattr(self, field.name)
            if "group" in field.metadata:
                values |= value.values()
            elif "option" in field.metadata:
                values[field.name] = value
        return values

    def non_default(self) -> dict[str, Any]:
        """Return the options whose value is not the default."""
        rows = options_of(type(self))
        return {name: value for name, value in self.values().items() if value != rows[name].default}

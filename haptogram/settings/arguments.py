"""Arguments of a caller: every refusal is one line with argument, value and limit."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Collection, Sequence
from typing import Any, Final, TypeAlias, TypeVar

from haptogram.errors import ConfigurationError

#: Called with the number done and the total.
Progress: TypeAlias = Callable[[int, int], None]

MOST_SEED: Final = 2**32 - 1
_SHOWN: Final = 40  # characters of a value that are printed
_T = TypeVar("_T")


def check_number(name: str, value: Any, low: float, high: float, unit: str = "") -> float:
    """Return *value* as a float, or raise unless it is a real number within [low, high]."""
    if type(value) is float and low <= value <= high:  # nearly always: a tenth of the time
        return value
    limits = f"{low:.10g} to {high:.10g} {unit}".rstrip()
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        number = _argument_as_float(value)
        if low <= number <= high:  # NaN is not
            return number
        raise ConfigurationError(f"{name} is {shown_argument(value)}, must be {limits}")
    raise ConfigurationError(f"{name} is {shown_argument(value)}, must be a number, {limits}")


def check_positive(name: str, value: Any) -> float:
    """Return *value* as a float, or raise unless it is a finite real number above zero."""
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        number = _argument_as_float(value)
        if math.isfinite(number) and number > 0.0:
            return number
        raise ConfigurationError(f"{name} is {shown_argument(value)}, must be finite and above 0")
    raise ConfigurationError(f"{name} is {shown_argument(value)}, must be a number")


def _argument_as_float(value: numbers.Real) -> float:
    """Return a number as float; infinity if it is too large for one."""
    try:
        return float(value)
    except OverflowError:  # a whole number beyond every float
        return math.inf


def check_whole(name: str, value: Any, low: int, high: int, unit: str = "") -> int:
    """Return *value* as an int, or raise unless it is a whole number within [low, high]."""
    if type(value) is int and low <= value <= high:  # nearly always: a tenth of the time
        return value
    limits = f"{low} to {high} {unit}".rstrip()
    if isinstance(value, numbers.Integral) and not isinstance(value, bool):
        if low <= int(value) <= high:
            return int(value)
        raise ConfigurationError(f"{name} is {shown_argument(value)}, must be {limits}")
    raise ConfigurationError(
        f"{name} is {_argument_with_type(value)}, must be a whole number, {limits}"
    )


def _argument_with_type(value: Any) -> str:
    """Return *value* as an error about its type shows it: a float keeps its ".0"."""
    return repr(float(value)) if isinstance(value, float) else shown_argument(value)


def read_number_argument(kind: Callable[[str], float], text: str) -> float | str:
    """Return the number that *text* is, or *text* itself, which a check of numbers refuses."""
    try:
        return kind(text)
    except ValueError:
        return text


def check_choice(name: str, value: Any, known: Collection[Any]) -> None:
    """Raise unless *value* is one of *known*, which are texts or whole numbers."""
    if not isinstance(value, str | int) or isinstance(value, bool) or value not in known:
        texts = [str(choice) for choice in known]
        guess = did_you_mean(value, texts) if isinstance(value, str) else ""
        raise ConfigurationError(
            f"{name} is {_argument_with_type(value)}; known are {', '.join(texts)}{guess}"
        )


def did_you_mean(word: str, known: Collection[str]) -> str:
    """Return "; did you mean ...?" with the word of *known* that resembles *word*, or nothing.

    Examples
    --------
    >>> did_you_mean("--quite", ["--no-compensate", "--quiet"])
    '; did you mean --quiet?'
    >>> did_you_mean("--nonsense", ["--no-compensate", "--quiet"])  # their dashes are no likeness
    ''
    """
    import difflib

    plain = {name.lstrip("-"): name for name in known}  # dashes make no option like another
    longer = [name for name in known if len(word) > 2 and name.startswith(word)]
    longer += [name for name in known if len(word) > 4 and word.lstrip("-") in name]
    near = difflib.get_close_matches(word.lstrip("-"), plain, n=1)
    found = longer or [plain[name] for name in near]
    return f"; did you mean {found[0]}?" if found else ""


def check_argument_kind(
    name: str, value: Any, kind: type[_T] | tuple[type[_T], ...], expected: str
) -> None:
    """Raise unless *value* is of *kind*, which the message calls *expected*."""
    if not isinstance(value, kind):
        raise ConfigurationError(f"{name} is {shown_argument(value)}, must be {expected}")


def check_texts(name: str, value: Any, such_as: str) -> None:
    """Raise unless *value* is a sequence of texts *such_as* that one; one text alone is none."""
    if isinstance(value, str | bytes) or not isinstance(value, Sequence):
        raise ConfigurationError(
            f"{name} is {shown_argument(value)}, must be a list such as [{such_as!r}]"
        )
    for place, text in enumerate(value):
        if not isinstance(text, str):
            raise ConfigurationError(
                f"{name}[{place}] is {shown_argument(text)}, must be a text such as {such_as!r}"
            )


def check_callable(name: str, value: Any) -> None:
    """Raise unless *value* can be called, or is None."""
    if value is not None and not callable(value):
        raise ConfigurationError(f"{name} is {shown_argument(value)}, must be callable, or None")


def option_word(name: str) -> str:
    """Return the option on a command line of the setting *name*."""
    return f"--{name.replace('_', '-')}"


def shown_argument(value: Any) -> str:
    """Return *value* as a message shows it: on one line, not too long."""
    text = f"{value:.10g}" if isinstance(value, float) else " ".join(repr(value).split())
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."

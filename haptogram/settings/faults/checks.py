"""Checks of a fault's parameters; an error names fault, parameter, value and limit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from haptogram.errors import ConfigurationError

from ..arguments import did_you_mean
from .kinds import (
    FAULT_KINDS,
    NOWHERE,
    PLACES,
    REPORTS,
    Parameter,
    fault_has_direction,
    fault_number_text,
    is_transducer_fault,
)

FOR_EVER_NS: Final = 1 << 62
_UNITS_NS: Final = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
_DIRECTIONS: Final = ("down", "up", "both")


def check_fault_name(name: str) -> None:
    """Refuse a fault that there is not.

    Raises
    ------
    ConfigurationError
        As all checks of this module.
    """
    if name not in FAULT_KINDS:
        guess = did_you_mean(name, FAULT_KINDS) or ";"
        raise ConfigurationError(f"{name!r} is no fault{guess} docs/faults.md has them all")


def check_fault_values(name: str, values: Mapping[str, float]) -> None:
    """Refuse values that are missing, beyond their limits, or contradict each other."""
    check_fault_name(name)
    kind = FAULT_KINDS[name]
    if values.keys() != kind.keys():
        raise ConfigurationError(f"{name}: its parameters are {', '.join(kind) or 'none'}")
    for key, value in values.items():
        if key not in PLACES or value != NOWHERE:
            _check_fault_value(name, key, value)
    _check_fault_place(name, values)


def _check_fault_value(name: str, key: str, value: float) -> None:
    """Refuse a value that is beyond its limits."""
    limits = FAULT_KINDS[name][key]
    if not isinstance(value, int | float):
        raise _not_a_number_error(name, key, repr(value))
    if not limits.least <= value <= limits.most:
        shown = f"{name} {key}={fault_number_text(value)}"
        raise ConfigurationError(f"{shown}, must be {_limits_text(limits)}")
    if limits.whole and value != round(value):
        raise _not_a_number_error(name, key, fault_number_text(value))


def _not_a_number_error(name: str, key: str, shown: str) -> ConfigurationError:
    limits = FAULT_KINDS[name][key]
    kind = "a whole number" if limits.whole else "a number"
    return ConfigurationError(f"{name} {key}={shown}, must be {kind}, {_limits_text(limits)}")


def _limits_text(limits: Parameter) -> str:
    return f"{fault_number_text(limits.least)} to {fault_number_text(limits.most)}"


def _check_fault_place(name: str, values: Mapping[str, float]) -> None:
    if not is_transducer_fault(name):
        return
    said = [f"{place}={fault_number_text(values[place])}" for place in PLACES if values[place] >= 0]
    if len(said) != 1:
        words = [f"{place}=N" for place in PLACES]
        text = f"{', '.join(words[:-1])} or {words[-1]}"
        raise ConfigurationError(f"{' '.join([name, *said])}: must have either {text}")


def check_fault_direction(name: str, direction: str) -> None:
    """Refuse a direction that the fault does not have."""
    if fault_has_direction(name) and direction not in _DIRECTIONS:
        raise ConfigurationError(f"{name} direction={direction}, must be down, up or both")
    if not fault_has_direction(name) and direction != usual_fault_direction(name):
        raise ConfigurationError(
            f"{name} direction={direction}, must be {usual_fault_direction(name)}"
        )


def check_fault_window(name: str, from_ns: int, until_ns: int) -> None:
    """Refuse a time at which the fault could never be there."""
    if not 0 <= from_ns < FOR_EVER_NS:
        raise _time_limit_error(name, "from", fault_time_text(from_ns))
    if until_ns <= from_ns:
        times = f"from={fault_time_text(from_ns)} until={fault_time_text(until_ns)}"
        raise ConfigurationError(f"{name} {times}: until must be after {fault_time_text(from_ns)}")


def usual_fault_direction(name: str) -> str:
    """Return on which bytes a fault acts if nothing else is said."""
    if name in REPORTS:
        return "up"
    return "down" if name.startswith("frame.") else "both"


def fault_number(name: str, key: str, text: str) -> float:
    """Return the number that *text* is."""
    try:
        value = float(text)
    except ValueError as error:
        raise _not_a_number_error(name, key, text) from error
    _check_fault_value(name, key, value)
    return value


def fault_time_ns(name: str, key: str, text: str) -> int:
    """Return the nanoseconds since power-up that *text* is."""
    number = text.rstrip("nums")
    try:
        t_ns = round(float(number) * _UNITS_NS[text[len(number) :]])
    except (KeyError, ValueError, OverflowError) as error:
        such_as = "must be a time such as 2s, 500ms, 10us"
        raise ConfigurationError(f"{name} {key}={text}: {such_as}") from error
    if not 0 <= t_ns < FOR_EVER_NS:
        raise _time_limit_error(name, key, text)
    return t_ns


def _time_limit_error(name: str, key: str, text: str) -> ConfigurationError:
    """Return the error for a time outside its limits."""
    last = fault_time_text(FOR_EVER_NS // _UNITS_NS["s"] * _UNITS_NS["s"])
    return ConfigurationError(
        f"{name} {key}={text}: must not be before power-up (0s), nor after {last}"
    )


def fault_time_text(t_ns: int) -> str:
    """Return *t_ns* as :func:`fault_time_ns` takes it."""
    unit = next(unit for unit, size_ns in _UNITS_NS.items() if t_ns % size_ns == 0)
    return f"{t_ns // _UNITS_NS[unit]}{unit}"

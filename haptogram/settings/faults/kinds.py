"""Which faults there are, and what may be said of each: names, parameters, limits, their checks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final, TypeAlias

from haptogram.errors import ConfigurationError
from haptogram.settings.frozen import dataclass

from ..arguments import did_you_mean

REPORTS: Final = ("device.clock", "device.status")  # what a board says, not what it radiates
_TIMES: Final = ("from", "until")
_TIMES_OF: Final = {"clock.offset": (), "clock.wrap": (), "clock.step": ("from",)}
FOR_EVER_NS: Final = 1 << 62
_UNITS_NS: Final = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
_DIRECTIONS: Final = ("down", "up", "both")


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number that a fault takes.

    Attributes
    ----------
    default : float
        Value if none is given.
    least, most : float
        Its limits.
    whole : bool
        Whether it must be a whole number.
    """

    default: float
    least: float = 0.0
    most: float = 1e9
    whole: bool = False


Parameters: TypeAlias = Mapping[str, Parameter]


def _fault_chance(default: float) -> Parameter:
    """Return a parameter that is a probability, from 0 to 1."""
    return Parameter(default, 0.0, 1.0)


def _fault_count(default: int, least: int, most: int) -> Parameter:
    """Return a parameter that is a whole number from *least* to *most*."""
    return Parameter(default, least, most, whole=True)


def _signed_fault_value(default: float, most: float = 1e9) -> Parameter:
    """Return a parameter that may be negative, from -*most* to *most*."""
    return Parameter(default, -most, most)


NOWHERE: Final = -1.0
PLACES: Final = ("transducer", "column", "bank")
_PLACE: Final = {name: Parameter(NOWHERE, 0, 65_535, whole=True) for name in PLACES}
_CODE: Final = _fault_count(0, 0, 255)
_TURNED: Final = _fault_count(64, 0, 255)

FAULT_KINDS: Final[Mapping[str, Parameters]] = MappingProxyType(
    {
        "line.flip": {"ber": _fault_chance(1e-5)},
        "line.drop": {"p": _fault_chance(1e-4)},
        "line.insert": {"p": _fault_chance(1e-4)},
        "line.burst": {"p": _fault_chance(1e-4), "bytes": _fault_count(8, 1, 65_536)},
        "line.duplicate": {"p": _fault_chance(1e-2)},
        "line.truncate": {"p": _fault_chance(1e-2)},
        "line.overrun": {"p": _fault_chance(1e-2), "bytes": _fault_count(16, 1, 65_536)},
        "line.break": {"p": _fault_chance(1e-3)},
        "line.baud": {"ppm": _signed_fault_value(60_000, 200_000)},
        "line.half_open": {},
        "line.disconnect": {"ms": Parameter(100, 1e-6)},
        "line.delay": {"us": Parameter(1000), "jitter_us": Parameter(0)},
        "line.slice": {"bytes": _fault_count(16, 1, 65_536), "gap_us": Parameter(1000)},
        "line.coalesce": {"us": Parameter(1000)},
        "line.batch": {"ms": Parameter(16)},
        "frame.crc": {"p": _fault_chance(1e-2)},
        "frame.length": {"p": _fault_chance(1e-2), "bytes": _fault_count(1, -1024, 1024)},
        "frame.sequence": {"p": _fault_chance(1e-2), "by": _fault_count(-1, -65_535, 65_535)},
        "frame.session": {"p": _fault_chance(1e-2), "by": _fault_count(1, -65_535, 65_535)},
        "frame.flags": {"p": _fault_chance(1e-2), "bits": _fault_count(0x80, 0, 255)},
        "frame.type": {"p": _fault_chance(1e-2), "type": _fault_count(0x3F, 0, 255)},
        "frame.past": {"p": _fault_chance(1e-2), "us": Parameter(1e6)},
        "frame.future": {"p": _fault_chance(1e-2), "us": Parameter(20e6)},
        "clock.offset": {"us": _signed_fault_value(1000)},
        "clock.wrap": {"us": Parameter(1e6, 0, 2**32 - 1)},
        "clock.ppm": {"ppm": _signed_fault_value(100, 999_999)},
        "clock.step": {"us": Parameter(1000)},
        "device.ok": _PLACE,
        "device.off": _PLACE,
        "device.dead": _PLACE,
        "device.stuck": {**_PLACE, "code": _CODE},
        "device.delayed": {**_PLACE, "code": _TURNED},
        "device.intermittent": {**_PLACE, "p": _fault_chance(0.5)},
        "device.garbage": _PLACE,
        "device.wrong": _PLACE,
        "device.slow": {**_PLACE, "us": Parameter(1000)},
        "device.clock": {
            "p": _fault_chance(1.0),
            "us": _signed_fault_value(1000),
            "jitter_us": Parameter(0),
        },
        "device.status": {"p": _fault_chance(1.0)},
    }
)


def described_faults() -> Iterator[str]:
    """Yield each fault with its parameters, and what they are if nothing is said."""
    places = "|".join(f"{place}=N" for place in PLACES)
    for name, parameters in FAULT_KINDS.items():
        words = [
            f"{key}={fault_number_text(limits.default)}"
            for key, limits in parameters.items()
            if key not in PLACES
        ]
        yield " ".join([name, *([places] if PLACES[0] in parameters else []), *words])


def fault_number_text(value: float) -> str:
    """Return *value* as one writes it: 9, not 9.0; 1e-05."""
    return f"{value:.0f}" if math.isfinite(value) and value == round(value) else repr(value)


def is_transducer_fault(name: str) -> bool:
    """Return True if a fault changes the radiated drive."""
    return name.startswith("device.") and name not in REPORTS


def fault_has_direction(name: str) -> bool:
    """Return True if a fault takes a direction of the line."""
    return name.startswith("line.") and name != "line.disconnect"


def fault_words(name: str) -> tuple[str, ...]:
    """Return every word that may be said of the fault *name*."""
    direction = ("direction",) if fault_has_direction(name) else ()
    return (*FAULT_KINDS[name], *_TIMES_OF.get(name, _TIMES), *direction)


# --- Checks: an error names fault, parameter, value and limit ------------------------------------


def check_fault_name(name: str) -> None:
    """Refuse a fault that there is not.

    Raises
    ------
    ConfigurationError
        As all checks of this module.
    """
    if name not in FAULT_KINDS:
        guess = did_you_mean(name, FAULT_KINDS) or ";"
        raise ConfigurationError(
            f"{name!r} is no fault{guess} docs/faults.md has them all, such as 'line.drop p=0.01'"
        )


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
    """Refuse a *value* beyond the limits of the parameter *key* of the fault *name*."""
    limits = FAULT_KINDS[name][key]
    if not isinstance(value, int | float):
        raise _not_a_number_error(name, key, repr(value))
    if not limits.least <= value <= limits.most:
        shown = f"{name} {key}={fault_number_text(value)}"
        raise ConfigurationError(f"{shown}, must be {_limits_text(limits)}")
    if limits.whole and value != round(value):
        raise _not_a_number_error(name, key, fault_number_text(value))


def _not_a_number_error(name: str, key: str, shown: str) -> ConfigurationError:
    """Return the error that a parameter of a fault is no number, with its limits."""
    limits = FAULT_KINDS[name][key]
    kind = "a whole number" if limits.whole else "a number"
    return ConfigurationError(f"{name} {key}={shown}, must be {kind}, {_limits_text(limits)}")


def _limits_text(limits: Parameter) -> str:
    """Return "least to most" of a parameter."""
    return f"{fault_number_text(limits.least)} to {fault_number_text(limits.most)}"


def _check_fault_place(name: str, values: Mapping[str, float]) -> None:
    """Refuse a fault of transducers unless exactly one of transducer, column, bank is given."""
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
    """Return the error for a fault's time before power-up or beyond the last one that it can have.

    *name*: of the fault; *key*: of the parameter; *text*: the time as it was given.
    """
    last = fault_time_text(FOR_EVER_NS // _UNITS_NS["s"] * _UNITS_NS["s"])
    return ConfigurationError(
        f"{name} {key}={text}: must not be before power-up (0s), nor after {last}"
    )


def fault_time_text(t_ns: int) -> str:
    """Return *t_ns* as :func:`fault_time_ns` takes it."""
    unit = next(unit for unit, size_ns in _UNITS_NS.items() if t_ns % size_ns == 0)
    return f"{t_ns // _UNITS_NS[unit]}{unit}"

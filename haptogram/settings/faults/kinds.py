"""Which faults there are, and what may be said of each: names, parameters, limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, TypeAlias


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
    return Parameter(default, 0.0, 1.0)


def _fault_count(default: int, least: int, most: int) -> Parameter:
    return Parameter(default, least, most, whole=True)


def _signed_fault_value(default: float, most: float = 1e9) -> Parameter:
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


REPORTS: Final = ("device.clock", "device.status")  # what a board says, not what it radiates
_TIMES: Final = ("from", "until")
_TIMES_OF: Final = {"clock.offset": (), "clock.wrap": (), "clock.step": ("from",)}


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

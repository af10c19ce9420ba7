"""The types of options that are settings of a run: their limits and units are said there once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from haptogram.settings.option import options_of
from haptogram.settings.parser import number, whole_number
from haptogram.settings.verify_config import VerifyConfig

#: Last part of a setting's name, and the sign of its unit.
_UNITS: Final = {
    "baud": "Bd",
    "c": "degrees Celsius",
    "humidity": "%",
    "hz": "Hz",
    "mm": "mm",
    "ms": "ms",
    "rad": "rad",
}


def setting_type(name: str) -> Callable[[str], float]:
    """Return the type of the option that is the setting *name* of :class:`VerifyConfig`."""
    row = options_of(VerifyConfig)[name]
    unit = _UNITS.get(name.rpartition("_")[2], "")
    if row.kind is int:
        return whole_number(int(row.low), int(row.high), unit)
    return number(row.low, row.high, unit)

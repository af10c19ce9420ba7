"""The settings of a virtual board: the one table of its options."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Self

from haptogram.settings.frozen import dataclass

from .faults.plan import MOST_FAULT_SEED, Fault, FaultPlan, read_faults
from .line import LineSettings
from .option import (
    Option,
    SettingError,
    Settings,
    build_settings,
    option,
    option_group,
    options_of,
    unknown_setting_text,
)

DEFAULT_ARRAY: Final = "16x16"
MOST_TRANSDUCERS: Final = 1024  # that of haptogram.acoustics, which takes numpy
MOST_LEAD_US: Final = 100_000  # HG-5.8
_GRID: Final = re.compile(r"\s*(\d+)x(\d+)\s*")


def is_grid_setting(array: str) -> bool:
    """Return True if *array* is a grid (NXxNY), False if it names a file."""
    return _GRID.fullmatch(array) is not None


def check_array_setting(array: str) -> None:
    """Raise :class:`SettingError` if *array* is a grid with no transducer or too many."""
    if (found := _GRID.fullmatch(array)) is not None:
        nx, ny = (int(side) if len(side) < 9 else MOST_TRANSDUCERS + 1 for side in found.groups())
        if not 1 <= nx * ny <= MOST_TRANSDUCERS:
            raise SettingError(
                "array", f"is {array.strip()!r}, must be a grid of 1 to {MOST_TRANSDUCERS} elements"
            )


@dataclass(frozen=True, kw_only=True)
class FaultWords(Settings):
    """Faults as they are written on a command line, in a URL or in TOML."""

    fault: tuple[str, ...] = option(
        (),
        unit="FAULT",
        help="something that goes wrong with the virtual board's line, clock or transducers, such "
        'as "line.flip ber=1e-5" or "device.stuck column=3 from=2s"; may be repeated. from= and '
        "until= are times since power-up, a moment before the first frame: in virtual time the "
        "session is up after some milliseconds, over a pty after a second or so. A fault that "
        "is there sooner hits the handshake as well. All faults: docs/faults.md",
    )
    fault_plan: Path | None = option(
        None,
        unit="FILE",
        help="TOML file with faults, before those of --fault: seed = N, and tables [[fault]] with "
        "name and parameters",
    )


@dataclass(frozen=True, kw_only=True)
class PinCaptureConfig(Settings):
    """The capture that a virtual board writes of its own drive pins."""

    capture: Path | None = option(
        None,
        unit="FILE",
        help="write what a logic analyser would see at the drive pins, and with --baud on the two "
        "lines of the UART, as VCD, when the board ends",
    )
    capture_ms: float = option(
        100.0,
        unit="MS",
        low=0.1,
        high=600_000.0,
        help="length of the capture, from the first latch on; with --baud from the first byte on",
    )
    capture_elements: str | None = option(
        None, unit="N,N,...", help="elements whose pins are captured", absent="all"
    )
    capture_rate_hz: float = option(
        24e6, unit="HZ", low=1e5, high=1e9, help="sampling rate of the analyser"
    )
    capture_ppm: float = option(
        0.0, unit="PPM", low=-1000.0, high=1000.0, help="error of the clock of the analyser"
    )
    capture_late: tuple[str, ...] = option(
        (),
        unit="ELEMENT=US",
        help="the pin of this element (or all) latches so much later than the board; may be "
        "repeated",
    )
    capture_lingers: tuple[str, ...] = option(
        (),
        unit="ELEMENT=US",
        help="the pin of this element (or all) sounds on for so long after the board has fallen "
        "silent; may be repeated",
    )

    def elements(self, count: int) -> list[int]:
        """Return the elements of an array of *count* whose pins are captured.

        Raises
        ------
        SettingError
            An element that is no number, that the array lacks, or that comes twice.
        """
        if self.capture_elements is None:
            return list(range(count))
        found = [
            _element_setting("capture_elements", text.strip(), count)
            for text in self.capture_elements.split(",")
        ]
        if len(set(found)) < len(found):
            raise SettingError("capture_elements", f"is {self.capture_elements}: one comes twice")
        return found

    def late_us(self, count: int) -> list[float]:
        """Return by how much later than the board each of *count* pins latches."""
        return _settings_by_element("capture_late", self.capture_late, count)

    def lingering_us(self, count: int) -> list[float]:
        """Return for how long each of *count* pins sounds on in the silence of the board."""
        return _settings_by_element("capture_lingers", self.capture_lingers, count)


def _element_setting(name: str, text: str, count: int) -> int:
    """Return the element that *text* names; raise SettingError unless it is below *count*.

    The error names the setting *name*.
    """
    if not text.isascii() or not text.isdigit() or len(text) > 4 or int(text) >= count:
        raise SettingError(name, f"names the element {text!r}, must be 0 to {count - 1}")
    return int(text)


def _settings_by_element(name: str, texts: tuple[str, ...], count: int) -> list[float]:
    """Return a time in µs for each of *count* elements, 0 where none is given.

    *texts* are ELEMENT=US or all=US; others are refused.
    """
    found = [0.0] * count
    for text in texts:
        element, _, time_us = text.partition("=")
        try:
            value_us = float(time_us)
        except ValueError:
            value_us = math.nan
        if not 0.0 <= value_us < math.inf:
            raise SettingError(name, f"is {text!r}, must be ELEMENT=US with 0 µs or more")
        for place in range(count) if element == "all" else [_element_setting(name, element, count)]:
            found[place] = value_us
    return found


@dataclass(frozen=True, kw_only=True)
class BoardConfig(Settings):
    """A virtual board before it is built.

    Attributes
    ----------
    line : LineSettings
        The line to its host.
    faults : tuple of Fault
        Faults on purpose, in the order in which they act.

    Raises
    ------
    SettingError
        If a value is outside its limits.
    """

    array: str | None = option(
        None,
        unit="NXxNY|FILE",
        help="grid, or CSV file of positions; with a dialect also the name of a layout or an array "
        "file of Ultraino",
        absent=f"{DEFAULT_ARRAY}; of a dialect its own",
    )
    pitch_mm: float = option(10.0, unit="MM", low=1.0, high=100.0, help="pitch of a grid")
    temperature_c: float = option(
        20.0, unit="C", low=-20.0, high=50.0, help="temperature of the air over the board"
    )
    calibration: Path | None = option(
        None,
        unit="FILE",
        help="CSV file with gain, phase and position of each element as they really are; neither "
        "the firmware nor the host knows them",
        absent="all equal",
    )
    latch_lead_us: int = option(
        0,
        unit="US",
        high=MOST_LEAD_US,
        help="time that the firmware takes from the arrival of a stream frame to its latch",
    )
    point_time_us: int = option(
        0, unit="US", low=0, high=MOST_LEAD_US, help="time that each focal point adds to it"
    )
    max_playback_rate_hz: int = option(
        10_000, unit="HZ", low=1, high=40_000, help="fastest playback of a stored sequence"
    )
    seed: int = option(0, unit="N", low=0, high=MOST_FAULT_SEED, help="seed of everything random")
    mutant: str | None = option(
        None,
        unit="NAME",
        help="firmware that is wrong in one way, or the MODULE:CLASS of one",
        absent="healthy",
    )
    dialect: str | None = option(
        None,
        unit="NAME",
        help="wire that the board speaks, as the boards that are sold and built do",
        absent="Haptogram's own",
    )
    dialect_option: tuple[str, ...] = option(
        (), unit="NAME=VALUE", help="option of the dialect; may be given many times"
    )
    simulator: str | None = option(
        None,
        unit="COMMAND",
        help="program that simulates the firmware, whose pins are the drive (docs/simulators.md)",
        absent="emulated",
    )
    simulator_capture: Path | None = option(
        None,
        unit="FILE",
        help="VCD file to which the pins and the line of a simulated board are appended, each time "
        "that it is switched on",
        absent="none",
    )
    slow_down: float = option(
        1.0,
        unit="K",
        low=1.0,
        high=1e6,
        help="seconds that a second of a simulated board takes at least, for a program on a pty",
    )
    fault_seed: int | None = option(
        None,
        unit="N",
        high=MOST_FAULT_SEED,
        help="seed of the faults",
        absent="that of the plan, else of the board",
    )
    line: LineSettings = option_group(LineSettings)
    faults: tuple[Fault, ...] = ()

    def __post_init__(self) -> None:
        """Check the values, and that the faults can be there together."""
        super().__post_init__()
        check_array_setting(self.array or DEFAULT_ARRAY)
        self.plan  # noqa: B018  it checks

    @property
    def plan(self) -> FaultPlan:
        """The faults with their seed."""
        return FaultPlan(self.faults, self.seed if self.fault_seed is None else self.fault_seed)

    @classmethod
    def of(cls, **values: Any) -> Self:
        """Return the board with *values*: options of :data:`BOARD_OPTIONS` by name.

        Raises
        ------
        SettingError
            For a name that is no option, or a value outside its limits.
        ConfigurationError
            For a fault that is refused, or a plan that cannot be read.
        """
        for name in sorted(values.keys() - BOARD_OPTIONS.keys()):
            raise SettingError(name, f"is not an option{unknown_setting_text(name, BOARD_OPTIONS)}")
        words = FaultWords.of(**{n: values.pop(n) for n in options_of(FaultWords) if n in values})
        faults, seed = read_faults(words.fault, words.fault_plan)
        if values.get("fault_seed") is None:
            values["fault_seed"] = seed
        return dataclasses.replace(build_settings(cls, values), faults=faults)

    def non_default(self) -> dict[str, Any]:
        """Return the options whose value is not the default; :meth:`of` takes them."""
        faults = {"fault": tuple(fault.written for fault in self.faults)} if self.faults else {}
        return super().non_default() | faults


#: Every option of a virtual board by name.
BOARD_OPTIONS: Final[Mapping[str, Option]] = MappingProxyType(
    {**options_of(BoardConfig), **options_of(FaultWords)}
)

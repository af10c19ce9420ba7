"""From the configuration of a board to its settings and its parts."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from haptogram.acoustics import Calibration, TransducerArray
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.errors import ConfigurationError
from haptogram.settings.board import BoardConfig
from haptogram.settings.faults.kinds import REPORTS
from haptogram.settings.faults.plan import FaultPlan
from haptogram.settings.frozen import dataclass
from haptogram.settings.option import Settings

from .assembly import Assembly, OtherAssembly
from .board.settings import BoardSettings
from .faults.clock import faulty_clock
from .mutants import mutant_parts

if TYPE_CHECKING:
    from .dialects.emulation import Emulation

# Another board has no frames with a CRC, no reports, and no clock that it shows.
_OF_HAPTOGRAM: Final = (*REPORTS, "clock.offset", "clock.wrap", "clock.step")


_OF_A_SIMULATOR: Final = ("slow_down", "simulator_capture")
_OF_OUR_FIRMWARE: Final = ("mutant", "latch_lead_us", "point_time_us", "max_playback_rate_hz")


@dataclass(frozen=True)
class Blueprint:
    """A board that can be built.

    Attributes
    ----------
    settings : BoardSettings
        Its hardware and its line.
    parts : Assembly
        Its parts.
    faults : FaultPlan
        Faults on purpose.
    """

    settings: BoardSettings
    parts: Assembly
    faults: FaultPlan


def blueprint_of(config: BoardConfig) -> Blueprint:
    """Return the board that *config* describes, of Haptogram or of another dialect.

    Raises
    ------
    ConfigurationError
        For an array or a calibration that cannot be read, an unknown mutant or dialect, an option
        or a fault that makes no sense in this dialect, and a fault that this board cannot have.
    """
    if config.simulator is None and (name := _first_given(config, _OF_A_SIMULATOR)):
        raise ConfigurationError(f"{name} is for a simulated board; give simulator too")
    if config.simulator is not None and (name := _first_given(config, _OF_OUR_FIRMWARE)):
        raise ConfigurationError(f"{name} acts on an emulated board; leave it out with simulator")
    if config.dialect is None:
        if config.dialect_option:
            raise ConfigurationError(
                f"dialect_option {config.dialect_option[0]} needs a dialect; give dialect too"
            )
        parts: Assembly = mutant_parts(config.mutant)
        if config.simulator is not None:
            from .dialects.simulated.unit import SimulatedBoard

            parts = OtherAssembly(SimulatedBoard)
        own = Blueprint(BoardSettings.of(config), parts, config.plan)
        return _with_checked_faults(own)
    return _with_checked_faults(_foreign_blueprint(config, config.dialect))


def _with_checked_faults(blueprint: Blueprint) -> Blueprint:
    """Return *blueprint* unchanged, its faults checked.

    ConfigurationError if its array or clock cannot have one of them.
    """
    if blueprint.faults.faults:
        from .faults.injector import FaultInjector

        healthy = blueprint.parts.clock(blueprint.settings.boot_us)
        FaultInjector(blueprint.faults, blueprint.settings, faulty_clock(blueprint.faults, healthy))
    return blueprint


def _foreign_blueprint(config: BoardConfig, name: str) -> Blueprint:
    """Return the blueprint of a board that speaks the dialect *name*, not Haptogram's."""
    from .dialects.table import emulation_of, read_emulation_options  # many modules

    emulation = emulation_of(name)
    options = read_emulation_options(emulation, config.dialect_option)
    _check_blueprint(config, name)
    emitters = _blueprint_emitters(config, emulation, options)
    elements = config.calibration
    mounted = emitters.mounting if elements is None else Calibration.from_file(elements)
    own = BoardSettings.of(dataclasses.replace(config, array=None, calibration=None))
    line = own.line
    if line.baud is None and emulation.dialect.bauds:
        line = dataclasses.replace(line, baud=emulation.dialect.bauds[0])
    settings = dataclasses.replace(
        own,
        model=dataclasses.replace(own.model, array=emitters.array),
        calibration=mounted,
        line=line,
        wiring=emulation.wiring(options, emitters.channels),
        firmware=emulation.dialect.title,
    )
    power_up = functools.partial(emulation.power_up, options)
    return Blueprint(settings, OtherAssembly(power_up), config.plan)


def _first_given(config: BoardConfig, names: Sequence[str]) -> str | None:
    """Return the first of the options *names* that differs from its default; None if none does."""
    given = config.non_default()
    return next((name for name in names if name in given), None)


def _check_blueprint(config: BoardConfig, name: str) -> None:
    """Raise ConfigurationError for an option or fault that acts on Haptogram's own boards only.

    *name* is the dialect of the board, another one.
    """
    given = config.non_default()
    if own := _first_given(config, _OF_OUR_FIRMWARE):
        raise ConfigurationError(
            f"{own} {given[own]} acts only on Haptogram's own firmware, not on a board of the "
            f"dialect {name}; leave it out"
        )
    if "pitch_mm" in given and config.array is None:
        raise ConfigurationError("pitch_mm acts only on an array that is a grid; leave it out")
    for fault in config.faults:
        if fault.name.startswith("frame.") or fault.name in _OF_HAPTOGRAM:
            raise ConfigurationError(
                f"{fault.option} {fault.name} acts on what only Haptogram's own wire has; "
                f"leave it out with dialect {name}"
            )


@dataclass(frozen=True)
class _Emitters:
    """The emitters that a line reaches, the channel of each, and how they are mounted.

    Mounting None: without a calibration.
    """

    array: TransducerArray
    channels: Sequence[int]
    mounting: Calibration | None = None


def _blueprint_emitters(config: BoardConfig, emulation: Emulation, options: Settings) -> _Emitters:
    """Return the transducers that *config* names: file, layout or grid; else the dialect's."""
    from haptogram.acoustics.model.boards.ultraino_file import SUFFIXES

    text = config.array
    if text is None:
        array = emulation.layout(options).array()
        mounted = None if emulation.mounting is None else emulation.mounting(array)
        return _Emitters(array, range(array.count), mounted)
    if text.endswith(SUFFIXES):
        return _blueprint_from_ultraino(Path(text), emulation)
    if text in LAYOUTS:
        array = LAYOUTS[text].array()
    else:
        array = TransducerArray.parse(text, pitch_m=config.pitch_mm * 1e-3)
    return _Emitters(array, range(array.count))


def _blueprint_from_ultraino(path: Path, emulation: Emulation) -> _Emitters:
    """Return the emitters of an Ultraino array file, with the phases of how they are mounted.

    Those are the file's phase corrections, negated; None if all are 0.
    """
    from haptogram.acoustics.model.boards.ultraino_file import read_ultraino_array

    found = read_ultraino_array(path, emulation.numbered_by)
    mounted = None
    if found.corrections_rad.any():
        phases_rad = -np.remainder(found.corrections_rad, math.tau)
        mounted = Calibration(np.ones(found.array.count), phases_rad, found.array.positions_m)
    return _Emitters(found.array, found.numbers, mounted)

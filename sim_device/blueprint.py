"""From the configuration of a board to its settings and its parts."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Final

from haptogram.acoustics import Calibration, TransducerArray
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.errors import ConfigurationError
from haptogram.settings.board import DEFAULT_ARRAY, BoardConfig
from haptogram.settings.faults.kinds import REPORTS
from haptogram.settings.faults.plan import FaultPlan

from .assembly import Assembly, ForeignParts
from .board.settings import BoardSettings
from .dialects.table import emulation_of, read_options
from .mutants import mutant_parts

# Another board has no frames with a CRC, no reports, and no clock that it shows.
_OF_HAPTOGRAM: Final = (*REPORTS, "clock.offset", "clock.wrap", "clock.step")


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
        What is to go wrong.
    """

    settings: BoardSettings
    parts: Assembly
    faults: FaultPlan


def blueprint_of(config: BoardConfig) -> Blueprint:
    """Return the board that *config* describes, of Haptogram or of another dialect.

    Raises
    ------
    ConfigurationError
        For an array or a calibration that cannot be read, an unknown mutant or dialect, and an
        option or a fault that makes no sense in this dialect.
    """
    if config.dialect is None:
        if config.dialect_option:
            raise ConfigurationError(
                f"dialect_option {config.dialect_option[0]} needs a dialect; give dialect too"
            )
        return Blueprint(BoardSettings.of(config), mutant_parts(config.mutant), config.plan)
    return _of_another_dialect(config, config.dialect)


def _of_another_dialect(config: BoardConfig, name: str) -> Blueprint:
    emulation = emulation_of(name)
    options = read_options(emulation, config.dialect_option)
    _check_sense(config, name)
    layout = emulation.layout(options)
    own_layout = config.array == DEFAULT_ARRAY
    array = layout.array() if own_layout else read_array(config.array, config.pitch_mm * 1e-3)
    mounted = None
    if config.calibration is not None:
        mounted = Calibration.from_file(config.calibration)
    elif own_layout and emulation.mounting is not None:
        mounted = emulation.mounting(array)
    own = BoardSettings.of(dataclasses.replace(config, array=DEFAULT_ARRAY, calibration=None))
    line = own.line
    if line.baud is None and emulation.dialect.bauds:
        line = dataclasses.replace(line, baud=emulation.dialect.bauds[0])
    settings = dataclasses.replace(
        own,
        model=dataclasses.replace(own.model, array=array),
        calibration=mounted,
        line=line,
        wiring=emulation.wiring(options, array),
        firmware=emulation.dialect.title,
    )
    return Blueprint(settings, ForeignParts(emulation, options), config.plan)


def _check_sense(config: BoardConfig, name: str) -> None:
    if config.mutant is not None:
        raise ConfigurationError(
            f"mutant {config.mutant} is of Haptogram's firmware; leave it out with dialect {name}"
        )
    for fault in config.faults:
        if fault.name.startswith("frame.") or fault.name in _OF_HAPTOGRAM:
            raise ConfigurationError(
                f"fault {fault.name} acts on what only Haptogram's own wire has; "
                f"leave it out with dialect {name}"
            )


def read_array(text: str, pitch_m: float) -> TransducerArray:
    """Return the layout of that name, a grid, or the array in a file.

    Raises
    ------
    ConfigurationError
        If there is none.
    """
    if text in LAYOUTS:
        return LAYOUTS[text].array()
    return TransducerArray.parse(text, pitch_m=pitch_m)

"""``haptogram modulation``: what a modulated focus makes at the skin, in time and as a spectrum."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from haptogram.machine.files import write_file_atomically, write_json_file
from haptogram.settings.command_line import add_command_options, add_setting_options
from haptogram.settings.option import Settings, option, option_of, options_of
from haptogram.settings.parser import Acting, Parser
from haptogram.settings.run.files import OutputConfig
from haptogram.settings.run.verify import VerifyConfig, load_verify_config
from haptogram.settings.shape import ModulationConfig, ShapeConfig

from .. import acting_options
from ..shell.array_options import add_array_options, array_model
from ..shell.exit_status import PASS, USAGE
from ..shell.output_files import FILE_HELP, CommandOutputs
from ..shell.positions import add_position_option, metres_of_position

HOLD: Final = "dwell"
KINDS: Final = ("am", "lm", "stm", HOLD)
_OUTPUTS: Final = ("csv", "json")
_CENTER_MM: Final = (0.0, 0.0, 150.0)
_RADIUS_MM: Final = 20.0


@dataclass(frozen=True, kw_only=True)
class ModulationResultConfig(Settings):
    """Bandwidth of the transducers, and the files that are written."""

    bandwidth_hz: float = option(
        2000.0,
        unit="HZ",
        low=1.0,
        high=1e6,
        help="bandwidth of the transducers at -6 dB: how fast they follow a frame",
    )
    csv: Path | None = option(
        None, unit="FILE", help="frames as CSV: time_s, x_mm, y_mm, z_mm, amplitude"
    )
    json: Path | None = option_of(OutputConfig, "json", help="figures and spectrum as JSON")


_ACTING: Final = {
    "modulation_hz": Acting("with am, lm and stm", lambda a: a.kind != "dwell"),
    "depth": acting_options.AM,
    "shift_mm": acting_options.LM,
    "dwell_ms": Acting("with am, lm and dwell", lambda a: a.kind != "stm"),
    "radius_mm": Acting(
        acting_options.RADIUS.where,
        lambda a: (
            acting_options.acts_on_a_size(a)
            and (a.object is not None or a.kind in ("stm", "dwell"))
        ),
    ),
    "resolution_mm": Acting(
        acting_options.RESOLUTION.where,
        lambda a: a.object != "point" and (a.object is not None or a.kind in ("stm", "dwell")),
    ),
    "unit": acting_options.MESH,
    "pitch_mm": acting_options.PITCH,
}


def set_up_modulation(parser: Parser) -> None:
    """Add the options of the command."""
    parser.main_options = "modulation_hz depth object rate_hz center_mm array at_mm csv json"
    parser.add_argument(
        "kind",
        choices=KINDS,
        metavar="KIND",
        help=f"{', '.join(KINDS)}: amplitude, lateral, spatio-temporal along the object, or each "
        "of its points held",
    )
    modulation = [row for name, row in options_of(ModulationConfig).items() if name != "modulation"]
    add_setting_options(parser.add_argument_group("modulation"), modulation)
    _add_modulation_object(parser)
    _add_modulation_skin(parser)
    _add_modulation_outputs(parser)
    parser.acting = _ACTING
    parser.set_defaults(run=run_modulation)


def _add_modulation_object(parser: Parser) -> None:
    """Add the options of the object that is modulated, and the rate of its frames."""
    shape = parser.add_argument_group("object that is modulated")
    rows = options_of(VerifyConfig)
    add_setting_options(
        shape,
        [rows[name] for name in (*options_of(ShapeConfig), "rate_hz")],
        object="point; stm and dwell: circle",
        radius_mm=f"{_RADIUS_MM:g}",
        center_mm=",".join(f"{value:g}" for value in _CENTER_MM),
    )


def _add_modulation_skin(parser: Parser) -> None:
    """Add the options of array, air, bandwidth of the skin, and where it feels."""
    skin = parser.add_argument_group("array, air and skin")
    add_array_options(skin)
    add_command_options(skin, [options_of(ModulationResultConfig)["bandwidth_hz"]])
    add_position_option(skin, "--at-mm", help="where it is felt [the first focus]")


def _add_modulation_outputs(parser: Parser) -> None:
    """Add the options of output files."""
    result = parser.add_argument_group("result", FILE_HELP)
    rows = options_of(ModulationResultConfig)
    add_command_options(result, [rows[name] for name in _OUTPUTS])


def run_modulation(arguments: argparse.Namespace) -> int:
    """Compute, print and write; return the exit status."""
    from haptogram.acoustics import NumpyEngine, Resonator
    from haptogram.objects.run_frames import frames_of_run

    from .result import ModulationResult, describe_felt, felt_csv, felt_dict

    acting_options.refuse_idle_options(arguments)
    outputs = CommandOutputs(arguments, *_OUTPUTS)
    config = _modulation_config(arguments)
    lag = Resonator.from_bandwidth(arguments.bandwidth_hz)
    frames = frames_of_run(config.shape, config.pace, config.modulation)
    place = None if arguments.at_mm is None else metres_of_position(arguments.at_mm)
    felt = ModulationResult.of(
        NumpyEngine(array_model(arguments)),
        config.shape.object,
        config.modulation,
        frames,
        lag,
        place,
    )
    for line in describe_felt(felt, arguments.bandwidth_hz):
        print(line, file=outputs.text)
    written = outputs.write_files(
        csv=lambda path: write_file_atomically(path, felt_csv(frames).encode("ascii")),
        json=lambda path: write_json_file(path, felt_dict(felt, arguments.bandwidth_hz)),
    )
    return PASS if written else USAGE


def _modulation_config(arguments: argparse.Namespace) -> VerifyConfig:
    """Return the settings of a run that shows this modulation, with defaults for its kind.

    An object is a circle for stm and dwell, else a point.
    """
    runs_along = arguments.kind in ("stm", HOLD)
    defaults = {
        "object": "circle" if runs_along else "point",
        "radius_mm": _RADIUS_MM,
        "center_mm": _CENTER_MM,
        "mode": "points",
    }
    names = options_of(VerifyConfig)
    given = {
        name: value
        for name, value in vars(arguments).items()
        if name in names and name != "json" and value is not None
    }
    kind = None if arguments.kind == HOLD else arguments.kind
    return load_verify_config(None, defaults | given | {"modulation": kind})

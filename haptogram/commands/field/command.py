"""``haptogram field``: what a focus, an object or a drive does in the air, as a picture."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from haptogram.settings.command_line import add_command_options, add_setting_options
from haptogram.settings.option import Settings, option, option_of, options_of
from haptogram.settings.parser import Acting, Parser, add_flag
from haptogram.settings.run.verify import VerifyConfig
from haptogram.settings.shape import ModulationConfig

from .. import acting_options
from ..shell.array_options import add_array_options
from ..shell.exit_status import PASS, USAGE
from ..shell.output_files import FILE_HELP, CommandOutputs
from ..shell.positions import Position, add_position_option
from ..shell.progress import progress_bar

PLANES: Final = ("xy", "xz", "yz")
QUANTITIES: Final = ("pressure", "phase", "force")
EAR_MM: Final[Position] = (0.0, -300.0, 400.0)  # someone who sits before an array that looks up


@dataclass(frozen=True, kw_only=True)
class FieldConfig(Settings):
    """The drive or focus that sounds, and the picture of its field."""

    drive: Path | None = option(
        None, unit="FILE", help="codes of every element as CSV", absent="one focus"
    )
    phase_bits: int = option(
        8, unit="BITS", low=1, high=16, help="resolution of the phases, 1 to 16"
    )
    modulation: str = option_of(
        ModulationConfig,
        "modulation",
        default="am",
        help="of what reaches --ear-mm: amplitude, lateral, or spatio-temporal along a circle",
    )
    plane: str = option("xz", choices=PLANES, help="axes of a plane")
    quantity: str = option(
        "pressure",
        choices=QUANTITIES,
        help="RMS pressure, phase, or radiation pressure on a reflecting wall",
    )
    decibels: bool = option(
        False, help="levels relative to the largest of the picture, down to -40 dB"
    )
    half_width_mm: float = option(
        60.0, unit="MM", low=0.1, high=10_000.0, help="how far a picture reaches around the target"
    )
    step_mm: float = option(0.75, unit="MM", low=0.01, high=1000.0, help="spacing of the samples")
    picture: Path | None = option(None, unit="FILE", help="write the picture: .png, .svg or .pdf")


_PICTURE: Final = ("plane", "quantity", "decibels", "half_width_mm", "step_mm", "picture")


def _is_ear_beside_focus(arguments: argparse.Namespace) -> bool:
    """Return True if --ear-mm is given with a single focus: neither --object nor --drive."""
    return arguments.ear_mm is not None and not arguments.object and not arguments.drive


_WITH_PICTURE: Final = acting_options.with_option("picture")
_FOR_AN_EAR: Final = Acting("on one focus, with --ear-mm", _is_ear_beside_focus)
_ACTING: Final = {
    "resolution_mm": Acting(
        "with --object, on other objects than a point",
        lambda a: a.object is not None and a.object != "point",
    ),
    "radius_mm": Acting(
        "with --object, on a shape that has a radius",
        lambda a: a.object is not None and acting_options.acts_on_a_size(a),
    ),
    "unit": Acting(
        "with --object, on a mesh file",
        lambda a: a.object and not acting_options.acts_on_a_shape(a),
    ),
    "center_mm": acting_options.with_option("object"),
    "rate_hz": Acting(
        "with --object, on other objects than a point, or on one focus with --ear-mm",
        lambda a: a.object not in (None, "point") or _is_ear_beside_focus(a),
    ),
    "modulation": _FOR_AN_EAR,
    "modulation_hz": _FOR_AN_EAR,
    "pitch_mm": acting_options.PITCH,
    "ear_mm": Acting("without --quiet", lambda a: not a.quiet),
    "quiet": _WITH_PICTURE,
    **dict.fromkeys(("plane", "quantity", "half_width_mm", "step_mm"), _WITH_PICTURE),
    "decibels": Acting(
        "with --picture, on pressure and force",
        lambda a: a.picture is not None and a.quantity != "phase",
    ),
}


def set_up_field(parser: Parser) -> None:
    """Add the options of the command."""
    parser.main_options = "focus_mm object drive rate_hz array picture plane quantity at_mm ear_mm"
    _add_field_source(parser)
    add_array_options(parser.add_argument_group("array and air"))
    _add_field_picture(parser)
    parser.acting = _ACTING
    parser.set_defaults(run=run_field)


def _add_field_source(parser: Parser) -> None:
    """Add the options of the source: a focus, an object or a file of drives, with details."""
    group = parser.add_argument_group("source of the field")
    source = group.add_mutually_exclusive_group()
    add_position_option(source, "--focus-mm", help="one focus [0,0,150, or that of the preset]")
    rows = options_of(VerifyConfig)
    add_setting_options(source, [rows["object"]], object="one focus")
    own = options_of(FieldConfig)
    add_command_options(source, [own["drive"]])
    names = ("unit", "resolution_mm", "radius_mm", "rate_hz", "center_mm", "modulation_hz")
    add_command_options(group, [rows[name] for name in names])
    add_command_options(group, [own["phase_bits"], own["modulation"]])


def _add_field_picture(parser: Parser) -> None:
    """Add the options of the picture, and of the place and the ear to look at."""
    group = parser.add_argument_group("picture", FILE_HELP)
    rows = options_of(FieldConfig)
    add_command_options(group, [rows[name] for name in _PICTURE])
    add_position_option(
        group,
        "--at-mm",
        help="place to look at: its pressure is printed, and a picture is centred there [the "
        "focus, the centre of the object; of --drive, where it is loudest]",
    )
    add_position_option(
        group,
        "--ear-mm",
        nargs="?",
        const=EAR_MM,
        help="also print the levels at an ear [0,-300,400: before the array, bent over it], next "
        "to a guideline; a focus is modulated",
    )
    add_flag(group, "--quiet", help="no progress and no text")


def run_field(arguments: argparse.Namespace) -> int:
    """Draw, write and print; return the exit status."""
    from haptogram.report.figures import write_figure

    from .scene import FieldScene, describe_field_levels
    from .views import check_field_picture_size, describe_field_scene, draw_field_picture

    acting_options.refuse_idle_options(arguments)
    outputs = CommandOutputs(arguments, "picture")
    if arguments.picture is not None:
        check_field_picture_size(arguments)
    scene = FieldScene.from_arguments(arguments)
    levels = [] if arguments.quiet else list(describe_field_levels(arguments, scene))
    lines = [] if arguments.quiet else [*describe_field_scene(scene), *levels]
    for line in lines:
        print(line, file=outputs.text)

    def write_picture(path: Path) -> None:
        with progress_bar("field", quiet=arguments.quiet, unit="points") as progress:
            figure = draw_field_picture(arguments, scene, progress)
        write_figure(path, figure)

    return PASS if outputs.write_files(picture=write_picture) else USAGE

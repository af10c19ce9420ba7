"""``haptogram field``: what a focus, an object or a drive does in the air, as a picture."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from haptogram.settings.command_line import add_command_options, add_setting_options
from haptogram.settings.option import Settings, option, option_of, options_of
from haptogram.settings.parser import Acting
from haptogram.settings.run.verify import VerifyConfig
from haptogram.settings.shape import ModulationConfig

from ..acting_options import (
    PITCH,
    acts_on_a_shape,
    acts_on_a_size,
    refuse_idle_options,
    with_option,
)
from ..shell.array_options import add_array_options
from ..shell.exit_status import PASS, USAGE
from ..shell.output_files import FILE_HELP, CommandOutputs, write_picture_output
from ..shell.positions import Position, position_argument_mm
from ..shell.progress import progress_bar

if TYPE_CHECKING:
    from haptogram.settings.parser import Parser

PLANES: Final = ("xy", "xz", "yz")
QUANTITIES: Final = ("pressure", "phase", "force")
EAR_MM: Final[Position] = (0.0, -300.0, 400.0)  # someone who sits before an array that looks up

_EPILOG: Final = """\
examples:
  haptogram field --focus-mm 20,0,120
      the figures of a focus: pressure, place of the maximum, spot, force, levels
  haptogram field --focus-mm 20,0,120 --picture field.png
      and |p| in the plane y = 0 through it as a picture
  haptogram field --focus-mm 20,0,120 --plane xy --quantity phase --picture phase.svg
  haptogram field --preset autd3 --picture autd3.png
  haptogram field --object circle --radius-mm 20 --plane xy --picture circle.png
      what a hand feels over one pass: mean square over the sequence, with narrow transducers
  haptogram field --ear-mm --modulation am
      what reaches an ear of a focus that is modulated at 200 Hz, in dB SPL
  haptogram field --drive drive.csv --at-mm 10,0,120 --plane xy --picture drive.svg
      a drive as codes, a header phase,amplitude and one line for each element, around a place

exit status:
  0    the figures were printed, and the picture was written
  2    usage or environment error
  130  interrupted (Ctrl-C, SIGTERM, SIGHUP)
"""


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


def _acts_for_an_ear(arguments: argparse.Namespace) -> bool:
    """Return True if the options for a listener take effect."""
    return arguments.ear_mm is not None and not arguments.object and not arguments.drive


_WITH_PICTURE: Final = with_option("picture")
_FOR_AN_EAR: Final = Acting("on one focus, with --ear-mm", _acts_for_an_ear)
_ACTING: Final = {
    "resolution_mm": Acting(
        "with --object, on other objects than a point",
        lambda a: a.object is not None and a.object != "point",
    ),
    "radius_mm": Acting(
        "with --object, on a shape that has a radius",
        lambda a: a.object is not None and acts_on_a_size(a),
    ),
    "unit": Acting("with --object, on a mesh file", lambda a: a.object and not acts_on_a_shape(a)),
    "center_mm": with_option("object"),
    "rate_hz": Acting(
        "with --object, or on one focus with --ear-mm",
        lambda a: a.object is not None or _acts_for_an_ear(a),
    ),
    "modulation": _FOR_AN_EAR,
    "modulation_hz": _FOR_AN_EAR,
    "pitch_mm": PITCH,
    "ear_mm": Acting("without --quiet", lambda a: not a.quiet),
    "quiet": _WITH_PICTURE,
    **dict.fromkeys(("plane", "quantity", "half_width_mm", "step_mm"), _WITH_PICTURE),
    "decibels": Acting(
        "with --picture, on pressure and force",
        lambda a: a.picture is not None and a.quantity != "phase",
    ),
}


def set_up_field(parser: Parser) -> None:
    """Describe the command and add its options."""
    parser.description = (
        "Draw the sound field of a focus, of a tactile object or of a drive: |p|, its "
        "phase or the radiation pressure on a plane. Axes are in mm; the target is marked by a "
        "cross, the peak by a ring. What a modulation makes of a focus is shown by 'haptogram "
        "modulation'."
    )
    parser.epilog = _EPILOG
    parser.main_options = "focus_mm object drive rate_hz array picture plane quantity at_mm ear_mm"
    _add_field_source(parser)
    add_array_options(parser.add_argument_group("array and air"))
    _add_field_picture(parser)
    parser.acting = _ACTING
    parser.set_defaults(run=run_field)


def _add_field_source(parser: Parser) -> None:
    group = parser.add_argument_group("source of the field")
    source = group.add_mutually_exclusive_group()
    source.add_argument(
        "--focus-mm",
        type=position_argument_mm,
        metavar="X,Y,Z",
        help="one focus [0,0,150, or that of the preset]",
    )
    rows = options_of(VerifyConfig)
    add_setting_options(source, [rows["object"]], object="one focus")
    own = options_of(FieldConfig)
    add_command_options(source, [own["drive"]])
    names = ("unit", "resolution_mm", "radius_mm", "rate_hz", "center_mm", "modulation_hz")
    add_command_options(group, [rows[name] for name in names])
    add_command_options(group, [own["phase_bits"], own["modulation"]])


def _add_field_picture(parser: Parser) -> None:
    group = parser.add_argument_group("picture", FILE_HELP)
    rows = options_of(FieldConfig)
    add_command_options(group, [rows[name] for name in _PICTURE])
    group.add_argument(
        "--at-mm",
        type=position_argument_mm,
        metavar="X,Y,Z",
        help="place to look at: its pressure is printed, and a picture is centred there [the "
        "focus, the centre of the object; of --drive, where it is loudest]",
    )
    group.add_argument(
        "--ear-mm",
        type=position_argument_mm,
        nargs="?",
        const=EAR_MM,
        metavar="X,Y,Z",
        help="also print the levels at an ear [0,-300,400: before the array, bent over it], next "
        "to a guideline; a focus is modulated",
    )
    group.add_argument("--quiet", action="store_true", help="no progress and no text")


def run_field(arguments: argparse.Namespace) -> int:
    """Draw, write and print; return the exit status."""
    from .scene import FieldScene, describe_field_levels
    from .views import check_field_picture_size, describe_field_scene, draw_field_picture

    refuse_idle_options(arguments)
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
        write_picture_output(path, figure)

    return PASS if outputs.write_files(picture=write_picture) else USAGE

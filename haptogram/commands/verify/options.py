"""The options of ``haptogram verify``: those of its settings, in groups."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from haptogram.settings import command_line
from haptogram.settings.array import ArrayConfig, ElementConfig
from haptogram.settings.board import FaultWords
from haptogram.settings.option import options_of
from haptogram.settings.parser import file_name_option
from haptogram.settings.run.captures import CaptureConfig
from haptogram.settings.run.link import LinkConfig
from haptogram.settings.run.outputs import OutputConfig
from haptogram.settings.run.verify import VerifyConfig
from haptogram.settings.shape import ModulationConfig, ShapeConfig
from haptogram.settings.tolerance import ToleranceConfig, UncertaintyConfig

from ..shell.output_files import FILE_HELP

if TYPE_CHECKING:
    from haptogram.settings.parser import Parser

_TOLERANCE: Final = (
    "A tolerance decides which miss passes, on top of what rounding of the phases makes; the "
    "default is none. Of an uncertainty the result tells what it makes in mm; one that is stated "
    "of the elements also says by how much one of them may be off where a miss is tolerated."
)
#: The names of the options by group, in the order of the help text.
GROUPS: Final[Mapping[str, tuple[str, ...]]] = {
    "tactile object": (
        *options_of(ShapeConfig),
        *("rate_hz", "repeat"),
        *options_of(ModulationConfig),
        *("foci", "solver"),
    ),
    "array and air": (*options_of(ArrayConfig), *options_of(ElementConfig)),
    "tolerance and uncertainty": (*options_of(ToleranceConfig), *options_of(UncertaintyConfig)),
    "board and link": (
        *options_of(LinkConfig),
        *("mode", "lead_ms", "seed"),
        *options_of(FaultWords),
    ),
    "drive pins": tuple(options_of(CaptureConfig)),
    "result": ("min_verified", *options_of(OutputConfig)),
}
_PINS: Final = (
    "Evidence that is not the firmware's own word, for the elements that were captured: "
    "docs/captures.md."
)
_DESCRIPTIONS: Final = {
    "drive pins": _PINS,
    "tolerance and uncertainty": _TOLERANCE,
    "result": FILE_HELP,
}


def add_verify_options(verify: Parser) -> None:
    """Add every option; one that is not given is None, so that a file can set it."""
    rows = options_of(VerifyConfig)
    for title, names in GROUPS.items():
        group = verify.add_argument_group(title, _DESCRIPTIONS.get(title))
        command_line.add_setting_options(group, [rows[name] for name in names])
    verify.add_argument(
        "--config",
        type=file_name_option,
        metavar="FILE",
        help="TOML file with a [verify] table of these options",
    )
    verify.add_argument("--quiet", action="store_true", help="no progress bar")
    verify.add_argument(
        "--view",
        action="store_true",
        help="show what the virtual board radiates, live, in a browser (see haptogram view)",
    )

"""``haptogram presets``: known systems, with their published figures next to ours."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Final

from haptogram.machine.files import write_json_file
from haptogram.settings.parser import file_name_option

from .shell.exit_status import PASS, USAGE
from .shell.output_files import CommandOutputs

if TYPE_CHECKING:
    from haptogram.settings.parser import Parser

_EPILOG: Final = """\
examples:
  haptogram presets                            all of them
  haptogram presets tactile-display autd3      these two
  haptogram presets --json -                   as JSON on standard output
  haptogram field --preset tactile-display --picture field.png
                                               the field of its typical focus, as a picture

exit status:
  0    the figures were printed
  2    usage or environment error
  130  interrupted (Ctrl-C, SIGTERM, SIGHUP)
"""


def set_up_presets(parser: Parser) -> None:
    """Describe the command and add its options."""
    parser.description = (
        "List the systems behind the Haptogram paper and open boards: what each is, "
        "where its geometry is from, and its published figures next to what the model gives. "
        "Where no source was at hand, it says so."
    )
    parser.epilog = _EPILOG
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="presets to show, by name [all of them]"
    )
    parser.add_argument(
        "--json",
        type=file_name_option,
        metavar="FILE",
        help="write the figures as JSON instead of text; - is standard output [none]",
    )
    parser.set_defaults(run=run_presets)


def run_presets(arguments: argparse.Namespace) -> int:
    """Compute and print; return the exit status."""
    from haptogram.published import PRESETS, compare_preset, find_preset
    from haptogram.report.presets import presets_text

    outputs = CommandOutputs(arguments, "json")
    chosen = [find_preset(name) for name in arguments.names] or PRESETS
    compared = [(preset, compare_preset(preset)) for preset in chosen]
    rows = [row for _, rows in compared for row in rows]
    if not outputs.paths:
        outputs.print(presets_text(compared).rstrip())
    written = outputs.write_files(json=lambda path: write_json_file(path, {"presets": rows}))
    return PASS if written else USAGE

"""``haptogram presets``: known systems, with their published figures next to ours."""

from __future__ import annotations

import argparse

from haptogram.machine.files import write_json_file
from haptogram.settings.parser import Parser, add_file_option

from .shell.exit_status import PASS, USAGE
from .shell.output_files import CommandOutputs


def set_up_presets(parser: Parser) -> None:
    """Add the options of the command."""
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="presets to show, by name [all of them]"
    )
    add_file_option(
        parser,
        "--json",
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

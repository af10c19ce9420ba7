"""``haptogram repair``: a recording that was cut off, as a whole file."""

from __future__ import annotations

import argparse
import sys

from haptogram.errors import ConfigurationError
from haptogram.machine.files import STANDARD_OUTPUT, check_file_writable
from haptogram.settings.parser import Parser, add_file_option


def set_up_repair(parser: Parser) -> None:
    """Add the options of the command."""
    parser.set_defaults(run=run_repair)
    add_file_option(parser, "file", help="the recording that is read")
    add_file_option(parser, "copy", metavar="COPY", help="the whole file that is written")


def run_repair(arguments: argparse.Namespace) -> int:
    """Copy the recording; return 0."""
    from haptogram.evidence.recordings.reader import repair_recording

    if STANDARD_OUTPUT in (arguments.file, arguments.copy):
        raise ConfigurationError("-: a repair reads and writes files; name both")
    check_file_writable(arguments.copy)
    count, left_out = repair_recording(arguments.file, arguments.copy)
    if left_out:
        print(left_out, file=sys.stderr)
    print(f"wrote {arguments.copy}: {count} messages", file=sys.stderr)
    return 0

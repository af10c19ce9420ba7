"""``haptogram repair``: a recording that was cut off, as a whole file."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Final

from haptogram.errors import ConfigurationError
from haptogram.machine.files import STANDARD_OUTPUT, check_file_writable
from haptogram.settings.parser import file_name_option

if TYPE_CHECKING:
    from haptogram.settings.parser import Parser

_EPILOG: Final = """\
examples:
  haptogram repair run.mcap whole.mcap
      what a killed run has left, for programs that read whole files only

exit status:
  0    everything that could be read was copied
  2    usage or environment error
  130  interrupted (Ctrl-C, SIGTERM, SIGHUP)
"""


def set_up_repair(parser: Parser) -> None:
    """Describe the command and add its options."""
    parser.description = (
        "Copy what can be read of a recording that was cut off or damaged into a whole file, with "
        "its index.  The commands of haptogram read a recording that was cut off as it is."
    )
    parser.epilog = _EPILOG
    parser.set_defaults(run=run_repair)
    parser.add_argument(
        "file", type=file_name_option, metavar="FILE", help="the recording that is read"
    )
    parser.add_argument(
        "copy", type=file_name_option, metavar="COPY", help="the whole file that is written"
    )


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

"""Options of ``haptogram conform``: what they are, and what of them does not go together."""

from __future__ import annotations

import argparse
import re
from typing import Final

from haptogram.errors import ConfigurationError
from haptogram.settings.command_line import add_setting_options as add_rows
from haptogram.settings.option import options_of
from haptogram.settings.parser import file_name_option, number_option, whole_number_option
from haptogram.settings.verify_config import LinkConfig

from ..shell.output_files import FILE_HELP
from ..shell.recording import RECORD_HELP

_SCHEME: Final = "haptogram://"
PULSE: Final = "pulse"
EXAMPLES: Final = """\
examples:
  haptogram conform
      the virtual board, in virtual time
  haptogram conform --port /dev/ttyACM0 --junit conform.xml --html conform.html
      a board; every case, every byte of what failed
  haptogram conform --spawn ./build/firmware --port-regex 'PTY is (/dev/pts/[0-9]+)'
      a native build on a pty, restarted for the clauses about a reset
  haptogram conform --spawn ./build/firmware --quick
      what takes no time, for every commit; --full before a release
  haptogram conform --port /dev/ttyACM0 --clause HG-2 --clause HG-3.4/1
      one chapter and one clause
  haptogram conform --compare a.json b.json --html matrix.html
      two devices side by side
"""


def add_conform_options(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    _add_board(parser.add_argument_group("board and port"))
    _add_choice(parser.add_argument_group("what is run, and how"))
    _add_results(parser.add_argument_group("result", FILE_HELP))


def _add_board(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--port", metavar="URL", help="any pyserial URL [the virtual board, in virtual time]"
    )
    baud = options_of(LinkConfig)["baud"]
    add_rows(group, [baud])
    group.set_defaults(baud=baud.default)
    group.add_argument("--spawn", metavar="CMD", help="start this program; it says its port")
    group.add_argument(
        "--port-regex", metavar="REGEX", help="finds the port in what --spawn prints, first group"
    )
    group.add_argument("--reset-cmd", metavar="CMD", help="shell command that restarts the board")
    group.add_argument(
        "--boot-timeout",
        type=number_option(0.0, 3600.0, "s"),
        default=10.0,
        metavar="S",
        help="until its port is there [10]",
    )
    for line in ("dtr", "rts"):
        group.add_argument(
            f"--{line}",
            choices=("0", "1", PULSE),
            help=f"state of {line.upper()}; pulse: a pulse of it restarts the board",
        )


def _add_choice(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--list", action="store_true", help="list the cases and run none")
    group.add_argument(
        "--clause",
        action="append",
        default=[],
        metavar="ID",
        help="only this case, clause (HG-3.4/1), section or chapter (HG-3); may be repeated",
    )
    depth = group.add_mutually_exclusive_group()
    depth.add_argument("--quick", action="store_true", help="20 s, for every commit")
    depth.add_argument(
        "--full", action="store_true", help="minutes: the longest timers and largest numbers too"
    )
    group.add_argument(
        "--explore",
        type=number_option(0.0, 100_000.0, "minutes"),
        default=0.0,
        metavar="MINUTES",
        help="go on with random dialogues, beside a model [a few dialogues]",
    )
    group.add_argument("--strict", action="store_true", help="a SHOULD that is not met: FAILED")
    group.add_argument(
        "--timeout",
        type=number_option(0.001, 60.0, "s"),
        default=1.0,
        metavar="S",
        help="how long an answer may take [1]",
    )
    group.add_argument(
        "--seed",
        type=whole_number_option(0, 2**64 - 1),
        metavar="N",
        help="of nonces and contents [0; on a port: random]",
    )
    group.add_argument(
        "--repeat",
        type=whole_number_option(1, 1000),
        default=1,
        metavar="N",
        help="run each case N times; mixed: FLAKY",
    )
    group.add_argument(
        "--baseline",
        type=file_name_option,
        metavar="FILE",
        help="TOML of failures that are expected",
    )
    group.add_argument("--quiet", action="store_true", help="no progress")


def _add_results(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--junit", type=file_name_option, metavar="FILE", help="write JUnit XML")
    group.add_argument("--json", type=file_name_option, metavar="FILE", help="write JSON")
    group.add_argument("--html", type=file_name_option, metavar="FILE", help="write an HTML page")
    group.add_argument(
        "--write-baseline",
        type=file_name_option,
        metavar="FILE",
        help="write today's failures as expected",
    )
    group.add_argument("--record", type=file_name_option, metavar="FILE", help=RECORD_HELP)
    group.add_argument("--verbose", action="store_true", help="print every case")
    group.add_argument(
        "--compare",
        type=file_name_option,
        nargs="+",
        metavar="JSON",
        help="run nothing: put results of several devices side by side, in --html",
    )


# --- What cannot be ----------------------------------------------------------------------------


def check_conform_arguments(arguments: argparse.Namespace) -> None:
    """Refuse what does not go together.

    Raises
    ------
    ConfigurationError
        Before anything is run.
    """
    if arguments.spawn is not None and arguments.port is not None:
        raise ConfigurationError("--spawn names its own port: --port is one too many")
    if arguments.port_regex is not None and arguments.spawn is None:
        raise ConfigurationError("--port-regex is about what --spawn prints; there is no --spawn")
    if arguments.port_regex is not None:
        _check_regex(arguments.port_regex)
    for name in ("reset_cmd", "dtr", "rts"):
        if getattr(arguments, name) is not None and not _is_port(arguments):
            option = name.replace("_", "-")
            raise ConfigurationError(f"--{option} is about a board at --port; there is none")


def _check_regex(text: str) -> None:
    try:
        groups = re.compile(text).groups
    except re.error as error:
        raise ConfigurationError(
            f"--port-regex {text!r} is no regular expression: {error}; an example is 'on (.*)'"
        ) from error
    if not groups:
        raise ConfigurationError(
            f"--port-regex {text!r} has no group; put the port in parentheses, as in 'on (.*)'"
        )


def _is_port(arguments: argparse.Namespace) -> bool:
    return arguments.port is not None and not asks_for_virtual_board(arguments)


def asks_for_virtual_board(arguments: argparse.Namespace) -> bool:
    """Return True if the board is a virtual one in this program."""
    if arguments.spawn is not None:
        return False
    return arguments.port is None or arguments.port.startswith(_SCHEME)

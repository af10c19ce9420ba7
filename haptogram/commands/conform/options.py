"""Options of ``haptogram conform``: what they are, and what of them does not go together."""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError
from haptogram.settings.command_line import add_command_options
from haptogram.settings.option import Settings, option, option_of, options_of
from haptogram.settings.parser import Acting, Parser, add_file_option, add_flag
from haptogram.settings.run.files import CaptureConfig, output_options
from haptogram.settings.run.frames import LimitConfig, LinkConfig, PaceConfig

from ..acting_options import with_option
from ..shell.output_files import FILE_HELP

_SCHEME: Final = "haptogram://"
PULSE: Final = "pulse"
_LEVELS: Final = ("0", "1", PULSE)


@dataclass(frozen=True, kw_only=True)
class BoardUnderTestConfig(Settings):
    """The board under test, its port, and how it is restarted."""

    port: str | None = option_of(
        LinkConfig, "port", help="any pyserial URL", absent="the virtual board, in virtual time"
    )
    baud: int = option_of(LinkConfig, "baud")
    spawn: str | None = option(
        None, unit="CMD", help="program that is started, and prints its port"
    )
    simulator: str | None = option_of(
        LinkConfig, "simulator", absent="the virtual board is emulated"
    )
    port_regex: str | None = option(
        None, unit="REGEX", help="finds the port in what --spawn prints, first group"
    )
    reset_cmd: str | None = option(
        None, unit="CMD", help="shell command that restarts the board, and returns once it has"
    )
    fault_cmd: str | None = option(
        None,
        unit="CMD",
        help="shell command that lets its hardware fail for 1 s at most, and returns before "
        "that is over ($BOARD_PID: --spawn)",
    )
    boot_timeout: float = option(
        10.0,
        unit="S",
        high=3600.0,
        help="longest time until the port of the board is there",
    )
    dtr: str | None = option(
        None, choices=_LEVELS, help="state of DTR; pulse: a pulse of it restarts the board"
    )
    rts: str | None = option(
        None, choices=_LEVELS, help="state of RTS; pulse: a pulse of it restarts the board"
    )


@dataclass(frozen=True, kw_only=True)
class ChoiceConfig(Settings):
    """The cases that are run, how thoroughly, and what is expected of them."""

    clause: tuple[str, ...] = option(
        (),
        unit="ID",
        help="only this case, clause (HG-3.4/1), section or chapter (HG-3); may be repeated",
        absent="all",
    )
    explore: float = option(
        0.0,
        unit="MINUTES",
        high=100_000.0,
        help="time of random dialogues that are compared with a model of the board",
    )
    timeout: float = option(1.0, unit="S", low=0.001, high=60.0, help="longest time to an answer")
    seed: int | None = option_of(
        LimitConfig,
        "seed",
        default=None,
        high=2**64 - 1,
        help="seed of nonces and contents",
        absent="0; on a port: random",
    )
    repeat: int = option_of(
        PaceConfig, "repeat", high=1000, help="run each case N times; mixed: FLAKY"
    )
    baseline: Path | None = option(None, unit="FILE", help="TOML of failures that are expected")


_PINS: Final = (
    "Evidence that is not the firmware's own word, by pins and lines of the UART in one "
    "capture: docs/captures.md."
)


@dataclass(frozen=True, kw_only=True)
class PinConfig(CaptureConfig):
    """The captures of a run of the suite."""

    capture: tuple[Path, ...] = option_of(
        CaptureConfig,
        "capture",
        help="capture of drive pins and UART (VCD, or .sr of sigrok) of the run at --port, or of "
        "the one in --from-recording; may be repeated; with --simulator the VCD file that is made",
    )
    from_recording: Path | None = option_of(
        CaptureConfig,
        "from_recording",
        help="judge --capture beside the results in this recording (--record), and run nothing",
    )


def _acts_in_conform_run(arguments: argparse.Namespace) -> bool:
    """Return True if cases will run: neither a comparison nor a list was asked for."""
    return not arguments.compare and not arguments.list


_RUN: Final = Acting(
    "where cases are run (not with --list, --compare or --from-recording)",
    lambda a: _acts_in_conform_run(a) and a.from_recording is None,
)
_RUN_OPTIONS: Final = "port baud spawn quick full explore strict timeout seed repeat quiet record"
_AT_PORT: Final = Acting("on a board at --port", lambda a: _RUN.is_there(a) and _is_conform_port(a))
_REAL: Final = Acting(
    "on a board at --port or from --spawn",
    lambda a: _RUN.is_there(a) and (a.spawn is not None or _is_conform_port(a)),
)
_RESULT: Final = Acting(
    "where there is a result (not with --list or --compare)", _acts_in_conform_run
)
_RESULT_OPTIONS: Final = (
    "baseline junit json summary write_baseline verbose capture channels from_recording"
)
_ACTING: Final = {
    **dict.fromkeys(_RUN_OPTIONS.split(), _RUN),
    **dict.fromkeys(_RESULT_OPTIONS.split(), _RESULT),
    **dict.fromkeys(("boot_timeout", "fault_cmd"), _REAL),
    **dict.fromkeys(("reset_cmd", "dtr", "rts"), _AT_PORT),
    "port_regex": with_option("spawn"),
    "clause": Acting(
        "without --compare and --from-recording",
        lambda a: not a.compare and a.from_recording is None,
    ),
    "html": Acting("without --list", lambda a: not a.list),
    "list": Acting("without --compare", lambda a: not a.compare),
}


def add_conform_options(parser: Parser) -> None:
    """Add the options, and when each acts."""
    parser.acting = _ACTING
    board = parser.add_argument_group("board and port")
    add_command_options(board, options_of(BoardUnderTestConfig).values())
    _add_conform_choice(parser.add_argument_group("cases and depth"))
    pins = parser.add_argument_group("drive pins", _PINS)
    add_command_options(pins, options_of(PinConfig).values())
    _add_conform_results(parser.add_argument_group("result", FILE_HELP))


def _add_conform_choice(group: argparse._ArgumentGroup) -> None:
    """Add the options that choose cases and their depth."""
    add_flag(group, "--list", help="list the cases and run none")
    add_command_options(group, options_of(ChoiceConfig).values(), explore="a few dialogues")
    depth = group.add_mutually_exclusive_group()
    add_flag(depth, "--quick", help="what needs no long wait, for every commit")
    add_flag(depth, "--full", help="minutes: the longest timers and largest numbers too")
    add_flag(group, "--strict", help="a SHOULD that is not met: FAILED")
    add_flag(group, "--quiet", help="no progress")


def _add_conform_results(group: argparse._ArgumentGroup) -> None:
    """Add the options for output files and the baseline."""
    add_command_options(group, output_options("junit json html summary stamp record"))
    add_file_option(group, "--write-baseline", help="write today's failures as expected [none]")
    add_flag(group, "--verbose", help="print every case")
    add_file_option(
        group,
        "--compare",
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
    if arguments.capture and not arguments.simulator and not _is_conform_port(arguments):
        raise ConfigurationError(
            "--capture is of a run at --port, or with --from-recording of the run in it; a board "
            "that --spawn starts writes its capture when it ends: use --record, and "
            "--from-recording later"
        )
    if arguments.spawn is not None and arguments.port is not None:
        raise ConfigurationError("--spawn names its own port: --port is one too many")
    if arguments.simulator is not None and (arguments.port or arguments.spawn):
        raise ConfigurationError("--simulator is a board of its own: leave out --port and --spawn")
    if arguments.port_regex is not None:
        _check_conform_regex(arguments.port_regex)


def _check_conform_regex(text: str) -> None:
    """Raise ConfigurationError if a --port-regex is invalid or has no group."""
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


def _is_conform_port(arguments: argparse.Namespace) -> bool:
    """Return True if the board under test is at a port, and not the virtual one."""
    return arguments.port is not None and not asks_to_conform_virtual_board(arguments)


def asks_to_conform_virtual_board(arguments: argparse.Namespace) -> bool:
    """Return True if the board is a virtual one in this program."""
    if arguments.spawn is not None:
        return False
    return arguments.port is None or arguments.port.startswith(_SCHEME)

"""The options of the board's command, and the configuration that they give."""

from __future__ import annotations

import argparse
import functools
import secrets
from pathlib import Path
from typing import TYPE_CHECKING, Final

from haptogram.errors import ConfigurationError, writing_file
from haptogram.machine import files
from haptogram.settings.board import BOARD_OPTIONS, BoardConfig, PinCaptureConfig, is_grid_setting
from haptogram.settings.command_line import add_setting_options, given_options
from haptogram.settings.faults.kinds import described_faults
from haptogram.settings.line import LineSettings
from haptogram.settings.option import options_of
from haptogram.settings.parser import Parser, add_flag, name_option

if TYPE_CHECKING:
    from ..backdoor.line_tap import OpenRecording

SERIAL_BAUD: Final = 3_000_000
_CAPTURE: Final = options_of(PinCaptureConfig)
SOCKET: Final = "unix:"  # a back door that is no file


def set_up_board(parser: Parser, open_recording: OpenRecording | None = None) -> None:
    """Describe the command and add its options."""
    text = Path(__file__).with_name("help.txt").read_text("utf-8")
    parser.description, _, parser.epilog = text.replace("PROGRAM", parser.prog).partition("\n\n")
    parser.listed = _listed_faults_and_dialects
    parser.main_options = "link tcp array dialect baud fault seed backdoor record view"
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument(
        "--link", metavar="PATH", type=name_option, help="pseudo-terminal with this stable name"
    )
    where.add_argument(
        "--tcp",
        metavar="[HOST:]PORT",
        type=functools.partial(name_option, what="[HOST:]PORT"),
        help="TCP server [host 127.0.0.1]",
    )
    where.add_argument(
        "--serial",
        metavar="PORT",
        type=functools.partial(name_option, what="the name of a port"),
        help="real serial port, at its far end; --baud is 3000000 there, or that of the dialect",
    )
    add_flag(
        where,
        "--as-device",
        help="start COMMAND, behind --, which finds the board as a serial device (Linux)",
    )
    parser.add_argument(
        "client", nargs="*", metavar="COMMAND", help="program of --as-device, with its arguments"
    )
    line = options_of(LineSettings)
    board = [row for name, row in BOARD_OPTIONS.items() if name not in line]
    add_setting_options(parser.add_argument_group("board"), board, seed="another one each time")
    add_setting_options(parser.add_argument_group("line"), line.values())
    parser.add_argument(
        "--backdoor",
        metavar="PATH|unix:PATH",
        type=name_option,
        help="radiated drives, as JSON lines",
    )
    add_flag(parser, "--no-reconstruct", help="leave the field out of the back door")
    if open_recording is not None:
        parser.add_argument(
            "--record",
            metavar="FILE",
            type=name_option,
            help="write the bytes in both directions and the latches, as MCAP",
        )
    add_setting_options(parser.add_argument_group("drive pins"), _CAPTURE.values())
    add_flag(
        parser, "--view", help="show what is radiated, live, in a browser (see haptogram view)"
    )
    add_flag(
        parser,
        "--until-eof",
        help="end when standard input ends: with the program that started this one",
    )
    log = parser.add_mutually_exclusive_group()
    add_flag(log, "--quiet", help="log warnings only")
    add_flag(log, "-v", "--verbose", help="log every change, and the counts every second")


def _listed_faults_and_dialects() -> str:
    """Return the help text on faults with their parameters, and on dialects."""
    from haptogram_protocol.dialects.table import DIALECTS

    dialects = "\n".join(f"  {name:<23}{one.title}" for name, one in DIALECTS.items())
    faults = "\n".join(f"  {text}" for text in described_faults())
    return (
        "\nfaults, their parameters and defaults (all but those of the clock also take\n"
        "from=500ms until=2s, those of the line direction=down or up; see docs/faults.md):\n"
        f"{faults}\n"
        "\ndialects; their options are in docs/dialects.md, and packages may bring more:\n"
        f"{dialects}\n"
    )


def board_config_of(options: argparse.Namespace) -> BoardConfig:
    """Return the configuration of the board.

    Raises
    ------
    ConfigurationError
        If an option needs another one, or acts on nothing.
    """
    if options.no_reconstruct and options.backdoor is None:
        raise ConfigurationError("--no-reconstruct acts only with --backdoor; leave it out")
    if options.as_device != bool(options.client):
        raise ConfigurationError("--as-device and a program behind -- need each other")
    values = given_options(options, BOARD_OPTIONS)
    line = [BOARD_OPTIONS[name].word for name in options_of(LineSettings) if name in values]
    if options.serial is not None:
        if imperfect := [word for word in line if word != "--baud"]:
            raise ConfigurationError(f"{', '.join(imperfect)}: the line of --serial is a real one")
        if options.dialect is None:
            values.setdefault("baud", SERIAL_BAUD)
    values.setdefault("seed", secrets.randbits(32))
    return BoardConfig.of(**values)


def pin_capture_config_of(options: argparse.Namespace) -> PinCaptureConfig | None:
    """Return the configuration of the capture of the drive pins, if one is wanted.

    Raises
    ------
    ConfigurationError
        If an option acts only with ``--capture``.
    """
    values = given_options(options, _CAPTURE)
    if options.capture is not None:
        return PinCaptureConfig.of(**values)
    if values:
        word = _CAPTURE[next(iter(values))].word
        raise ConfigurationError(f"{word} acts only with --capture; leave it out")
    return None


def check_board_outputs(options: argparse.Namespace) -> None:
    """Refuse outputs that cannot be written, or have the name of another file of the command.

    Raises
    ------
    ConfigurationError
        Names the option, the path and the reason.
    """
    outputs = _board_outputs_of(options)
    array = None if options.array is None or is_grid_setting(options.array) else options.array
    inputs = (
        ("--array", array),
        ("--calibration", options.calibration),
        ("--fault-plan", options.fault_plan),
    )
    files.check_distinct_files(
        outputs, [(option, Path(path)) for option, path in inputs if path is not None]
    )
    for word, path in outputs.items():
        if files.is_standard_output(path):
            raise ConfigurationError(f"{word} {path}: standard output names the port; name a file")
    outputs.pop("--link", None)  # which looks after itself
    files.check_files_writable(outputs, in_place=True)


def _board_outputs_of(options: argparse.Namespace) -> dict[str, Path]:
    """Return the files that the board writes, by option; sockets are left out."""
    given = {
        "--link": options.link,
        "--backdoor": options.backdoor,
        "--record": getattr(options, "record", None),
        "--capture": options.capture,
        "--simulator-capture": options.simulator_capture,
    }
    names = {option: str(path) for option, path in given.items() if path is not None}
    return {option: Path(name) for option, name in names.items() if not name.startswith(SOCKET)}


def make_board_folders(options: argparse.Namespace) -> None:
    """Make the folders of the outputs, and say so; that of the link is made with the link.

    Raises
    ------
    ConfigurationError
        If a folder cannot be made.
    """
    outputs = _board_outputs_of(options)
    outputs.pop("--link", None)
    if options.backdoor is not None:  # by this process, whose log is read; a socket has one too
        outputs["--backdoor"] = Path(options.backdoor.removeprefix(SOCKET))
    for option, path in outputs.items():
        with writing_file(path, option):
            files.make_folder_of(path)

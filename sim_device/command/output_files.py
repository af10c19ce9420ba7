"""The files that the board's command writes: checked, and their folders made, before it starts."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError, unwritable_file
from haptogram.machine import files
from haptogram.settings.board import is_grid_setting

SOCKET: Final = "unix:"  # a back door that is no file


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
    for option, path in outputs.items():
        if path == files.STANDARD_OUTPUT:
            raise ConfigurationError(f"{option} -: standard output names the port; name a file")
    outputs.pop("--link", None)  # which looks after itself
    files.check_files_writable(outputs, in_place=True)


def _board_outputs_of(options: argparse.Namespace) -> dict[str, Path]:
    """Return the files that the board makes, by option; a socket is none."""
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
        try:
            files.make_folder_of(path)
        except OSError as error:
            raise unwritable_file(path, error, option) from error

"""Settings of a watch, and the foci that are expected, in the axes of the board's programs."""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from haptogram.errors import ConfigurationError
from haptogram.settings.command_line import settings_of
from haptogram.settings.option import Settings, option
from haptogram.settings.tolerance import ToleranceConfig

if TYPE_CHECKING:
    from haptogram.evidence.dialects.watched_board import WatchedBoard
    from haptogram.verification.watch import Expectation


_HEADERS: Final = (["x", "y", "z"], ["frame", "x", "y", "z"])
_MOST_MM: Final = 10_000.0
_MM: Final = 1e3

Foci = list[tuple[float, float, float]]


def expected_frames_mm(arguments: argparse.Namespace) -> list[Foci]:
    """Return the foci of every frame that is expected, in mm; empty: nothing is.

    Raises
    ------
    ConfigurationError
        A file that holds no foci, or both it and single foci.
    """
    if arguments.expect and arguments.expect_file:
        raise ConfigurationError(
            "--expect and --expect-file both say what is expected; leave one out"
        )
    if arguments.expect_file:
        return _read_expected_frames(arguments.expect_file)
    return [[focus] for focus in arguments.expect or ()]


def make_watch_expectation(
    arguments: argparse.Namespace, frames_mm: list[Foci], board: WatchedBoard
) -> Expectation | None:
    """Return the expectation of *board*; None if the user gave none."""
    import numpy as np

    from haptogram.verification import tolerance_of
    from haptogram.verification.watch import Expectation

    if not frames_mm:
        return None
    tolerance = tolerance_of(settings_of(arguments, ToleranceConfig))
    frames_m = [board.ours_m(np.array(foci) / _MM) for foci in frames_mm]
    return Expectation(board.model, frames_m, tolerance=tolerance)


def _read_expected_frames(path: Path) -> list[Foci]:
    """Return the foci (mm) of each expected frame from a CSV file; ConfigurationError without foci.

    Rows with the same value of *frame* are foci of one frame; without that column each is one.
    """
    from haptogram.acoustics.model.csv_rows import read_element_rows

    rows = read_element_rows(path, "--expect-file")
    header = [cell.lower() for cell in rows[0][1]] if rows else []
    if header not in _HEADERS or len(rows) < 2:
        raise ConfigurationError(
            f"--expect-file {path}: must begin with the line x,y,z or frame,x,y,z, and foci in mm"
        )
    frames: dict[str, Foci] = {}
    for number, cells in rows[1:]:
        if len(cells) != len(header):
            raise ConfigurationError(
                f"{path}:{number}: {len(cells)} cells, must be {len(header)}: {','.join(header)}"
            )
        frame = cells[0] if len(header) == 4 else str(number)
        frames.setdefault(frame, []).append(_expected_watch_focus(f"{path}:{number}", cells[-3:]))
    return list(frames.values())


def _expected_watch_focus(where: str, cells: list[str]) -> tuple[float, float, float]:
    """Return x, y and z of a row in mm.

    ConfigurationError, naming the row *where*, if they are not 3 numbers within ± 10 m.
    """
    try:
        x, y, z = (float(cell) for cell in cells)
    except ValueError as error:
        raise ConfigurationError(f"{where}: {','.join(cells)} is not x,y,z in mm") from error
    if not all(math.isfinite(value) and abs(value) <= _MOST_MM for value in (x, y, z)):
        raise ConfigurationError(
            f"{where}: {','.join(cells)} mm, each must be -{_MOST_MM:g} to {_MOST_MM:g}"
        )
    return x, y, z


#: Options of a virtual board that can be watched from its power-up on.
WATCHED_BOARD_OPTIONS: Final = (
    "dialect",
    "dialect_option",
    "simulator",
    "slow_down",
    "array",
    "temperature_c",
    "calibration",
)


@dataclass(frozen=True, kw_only=True)
class WatchConfig(Settings):
    """The foci that are expected, the end of the watch, and what it writes."""

    capture: Path | None = option(
        None, unit="FILE", help="capture of the drive pins of a board (VCD, or .sr of sigrok)"
    )
    channels: Path | None = option(
        None, unit="FILE", help="TOML map of the channels of --capture (docs/captures.md)"
    )
    expect_file: Path | None = option(
        None,
        unit="FILE",
        help="CSV file of expected foci in mm, with the header x,y,z, a frame a line; or with "
        "frame,x,y,z, where lines of one frame are the foci that it has together",
    )
    latches: int | None = option(
        None,
        unit="N",
        low=1,
        high=1_000_000_000,
        help="end after so many latches of the client",
        absent="until the board ends, or Ctrl-C",
    )
    fail_on: str | None = option(
        None,
        choices=("unknown",),
        help="unknown: a latch of the client that makes none of the patterns fails",
        absent="a run in which no latch makes a pattern is inconclusive",
    )
    frames: Path | None = option(None, unit="FILE", help="write a line of JSON for each latch")

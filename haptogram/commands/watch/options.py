"""Settings of a board that is watched."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from haptogram.settings.board import BoardConfig
from haptogram.settings.option import Settings, option, option_of
from haptogram.settings.run.outputs import OutputConfig

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
    json: Path | None = option_of(OutputConfig, "json")
    junit: Path | None = option_of(OutputConfig, "junit")
    html: Path | None = option_of(OutputConfig, "html")
    summary: Path | None = option_of(OutputConfig, "summary")
    stamp: str | None = option_of(OutputConfig, "stamp")


def watched_board_config(**values: object) -> BoardConfig:
    """Return the virtual board with *values*: options of :data:`WATCHED_BOARD_OPTIONS` by name."""
    return BoardConfig.of(**{name: value for name, value in values.items() if value is not None})

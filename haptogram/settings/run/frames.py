"""Settings of the frames of a run: their pace, their foci, and who computes their drive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from ..option import Settings, option

MODES: Final = ("phases", "drives", "points", "sequence")
# Those of haptogram.acoustics.solvers.several, which takes numpy: --help shall not.
SOLVERS: Final = ("naive", "ibp", "gs", "wgs", "gspat", "gradient")


@dataclass(frozen=True, kw_only=True)
class PaceConfig(Settings):
    """Rate, number and lead of the frames."""

    rate_hz: float = option(1000.0, unit="HZ", low=1.0, high=40_000.0, help="points per second")
    repeat: int = option(
        1, unit="N", low=1, high=1_000_000, help="how often the object is displayed"
    )
    lead_ms: float | None = option(
        None,
        unit="MS",
        low=1.0,
        high=1000.0,
        help="how long before its time a frame is sent",
        absent="100, or 3/4 of the board's queue",
    )


@dataclass(frozen=True, kw_only=True)
class DriveConfig(Settings):
    """Number of foci in a frame, and who computes their drive."""

    foci: int = option(
        1, unit="N", low=1, high=32, help="foci in every frame, evenly apart along the object"
    )
    solver: str | None = option(
        None,
        choices=SOLVERS,
        help="how the host makes the drive of several foci: docs/performance.md compares them",
        absent="wgs; --mode points: naive, by the board",
    )
    mode: str = option(
        "phases",
        choices=MODES,
        help="phases: the host computes every drive; drives: with amplitudes; points: the board "
        "does; sequence: uploaded once, played on the board's clock",
    )

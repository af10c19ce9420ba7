"""Settings of the frames of a run and of the link that carries them; seed and limit of a run."""

from __future__ import annotations

from typing import Final

from haptogram.settings.frozen import dataclass

from ..board import BoardConfig
from ..line import DEFAULT_BAUD, LEAST_BAUD, MAX_BAUD
from ..option import Settings, option, option_of

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


@dataclass(frozen=True, kw_only=True)
class LimitConfig(Settings):
    """Seed of the run, and the limit of its verdict."""

    min_verified: float | None = option(
        None,
        unit="SHARE",
        high=1.0,
        help="share of frames that must be verified",
        absent="1 in virtual time, else 0.9",
    )
    seed: int = option(
        0, unit="N", low=0, high=2**32 - 1, help="seed of everything random, faults among it"
    )


@dataclass(frozen=True, kw_only=True)
class LinkConfig(Settings):
    """The board's port, its line and its clock."""

    port: str | None = option(
        None,
        unit="URL",
        help="a board on any pyserial URL (/dev/ttyUSB0, /dev/pts/7, socket://...)",
        absent="a virtual board on a pty, in a process of its own",
    )
    backdoor: str | None = option(
        None,
        unit="PATH|unix:PATH",
        help="back door of the board at --port, if it is emulated: its latches are the evidence",
        absent="the board's own word, or the bytes that left the host",
    )
    dialect: str | None = option(
        None,
        unit="NAME",
        help="wire of other boards, such as sonicsurface: they are given phases, at the usual baud "
        "of their line and as fast as it carries, unless other rates are named (docs/dialects.md)",
        absent="Haptogram's own",
    )
    dialect_option: tuple[str, ...] = option(
        (), unit="NAME=VALUE", help="option of the dialect, such as boards=2; may be repeated"
    )
    simulator: str | None = option_of(BoardConfig, "simulator")
    baud: int = option(
        DEFAULT_BAUD, unit="BAUD", low=LEAST_BAUD, high=MAX_BAUD, help="rate of the line"
    )
    virtual_time: bool = option(
        False, help="no wall clock at all: the same inputs give the same result, byte for byte"
    )

"""Settings of the link to a board: its port, its dialect, its line and its clock."""

from __future__ import annotations

from dataclasses import dataclass

from ..board import BoardConfig
from ..line import DEFAULT_BAUD, LEAST_BAUD, MAX_BAUD
from ..option import Settings, option, option_of


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

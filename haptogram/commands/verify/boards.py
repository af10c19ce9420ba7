"""The boards that ``haptogram verify`` runs on: which, at which rates, and how they are opened."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import functools
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeAlias

from haptogram.errors import LinkError
from haptogram.settings.board import BoardConfig
from haptogram.settings.board_url import SCHEME, PortConfig, read_board_url, write_board_url
from haptogram.settings.command_line import given_options
from haptogram.settings.frozen import dataclass
from haptogram.settings.option import options_of
from haptogram.settings.run.verify import VerifyConfig, verify_config_of

if TYPE_CHECKING:
    from haptogram.evidence.boards import BoardUnderTest
    from haptogram.evidence.run_record import DialectBoardsUnderTest
    from haptogram.settings.board import BoardConfig

_LAST_MOMENTS_S: Final = 2.0  # wait for the last records of a board that has closed its port
_PTYS: Final = "/dev/pts/"
_NETWORK: Final = "socket://"
_MOST_HZ: Final = 1000.0  # highest default rate of boards of other dialects,
_WITHOUT_A_LINE_HZ: Final = 100.0  # and of those without a line, limited by an answer to each frame

#: Shows a back door in a browser, if that is wanted.
Show: TypeAlias = "Callable[[Path], None]"


class ProgramBoards(Protocol):
    """Boards as only the composition root can make them."""

    def prepare_simulator(self, config: VerifyConfig) -> BoardConfig:
        """Return the settings of the virtual board, checked before anything starts."""

    def board_in_virtual_time(
        self, config: BoardConfig, *, searches: bool
    ) -> AbstractContextManager[BoardUnderTest]:
        """Make a virtual board in this program; *searches*: for fields in the whole volume too."""

    def board_behind_url(self, url: str) -> AbstractContextManager[BoardUnderTest]:
        """Make the board in this program that a ``haptogram://`` URL describes."""

    def boards_of_dialect(self, config: VerifyConfig) -> DialectBoardsUnderTest:
        """Return the boards of the dialect that the settings name."""


@dataclass(frozen=True)
class RunBoards:
    """The boards of one run.

    Attributes
    ----------
    config : VerifyConfig
        The settings, with the rates that these boards have where the user named none.
    dialect : DialectBoardsUnderTest or None
        The boards, if they speak another wire.
    names_baud : bool
        Whether the user named the rate of the line, be it that of the default.
    """

    config: VerifyConfig
    dialect: DialectBoardsUnderTest | None
    names_baud: bool
    _made: ProgramBoards

    @classmethod
    def of(
        cls,
        config: VerifyConfig,
        arguments: argparse.Namespace,
        in_file: Mapping[str, Any],
        made: ProgramBoards,
    ) -> RunBoards:
        """Return the boards that *arguments* and the table of its file name, read as *config*.

        Raises
        ------
        ConfigurationError
            For an option that is refused, a dialect that is not known, and a rate that its line
            cannot carry.
        """
        given = given_options(arguments, options_of(VerifyConfig))
        names_baud = "baud" in in_file or "baud" in given
        if config.link.dialect is None:
            return cls(config, None, names_baud, made)
        from haptogram.driver.frames.dialect_frames import dialect_display_of
        from haptogram.driver.line.budget import check_dialect_rate

        boards = made.boards_of_dialect(config)
        dialect_display_of(boards.dialect, boards.count)  # refuses one that cannot be driven
        usual = _usual_dialect_rates(config, boards, names_baud=names_baud)
        config = verify_config_of(arguments.config, in_file, given, usual)
        check_dialect_rate(
            boards.dialect,
            boards.count,
            baudrate=config.link.baud,
            rate_hz=config.pace.rate_hz,
        )
        return cls(config, boards, names_baud, made)

    @functools.cached_property
    def virtual(self) -> BoardConfig:
        """Settings of a virtual board, checked.

        Raises
        ------
        ConfigurationError
            For a URL or a fault that is refused, or a plan that cannot be read.
        """
        virtual = self._made.prepare_simulator(self.config)
        if self.config.link.port is None and self.dialect is not None:
            baud = self.config.link.baud if self.dialect.dialect.bauds else None
            virtual = dataclasses.replace(
                virtual, line=dataclasses.replace(virtual.line, baud=baud)
            )
        return virtual

    @property
    def _simulated_url(self) -> str | None:
        """URL of a board that --simulator runs on our own wire; None for any other board."""
        if self.config.link.simulator is None or self.dialect is not None:
            return None
        return write_board_url(PortConfig(board=self.virtual, clock="virtual"))

    @contextlib.contextmanager
    def open(self, show: Show) -> Iterator[BoardUnderTest]:
        """Give the board at a port, else the virtual one, and clean up after it."""
        from haptogram.evidence.boards import (
            PortBoardUnderTest,
            ProcessBoardUnderTest,
            ShownPortBoardUnderTest,
        )

        config, port = self.config, self.config.link.port or self._simulated_url
        if port is not None and port.startswith(SCHEME) and self.dialect is not None:
            with self._made.board_behind_url(port) as board:
                yield board
        elif port is not None and config.link.backdoor is not None:
            with ShownPortBoardUnderTest.opened(port, config.link.backdoor) as shown:
                yield shown
        elif port is not None:
            yield PortBoardUnderTest(
                port,
                baudrate=baud_of_verified_port(port, config.link.baud, is_named=self.names_baud),
                rate_hz=config.pace.rate_hz,
                board_computes=config.frame_kind == "points",
            )
        elif config.link.virtual_time:
            # A verdict on several foci reads no field but silence; whoever reads a recording may.
            searches = config.drive.foci == 1 or config.outputs.record is not None
            with self._made.board_in_virtual_time(self.virtual, searches=searches) as board:
                yield board
        else:
            from haptogram.evidence.virtual_board import VirtualBoard

            with VirtualBoard.of(self.virtual) as process:
                show(process.backdoor)
                try:
                    yield ProcessBoardUnderTest(process)
                except LinkError as error:
                    if (fate := process.how_it_ended(_LAST_MOMENTS_S)) is None:
                        raise
                    raise LinkError(f"{error}; {fate}") from error


def baud_of_verified_port(port: str, baud: int, *, is_named: bool) -> int | None:
    """Return the rate of the line, None for a port without one, unless the user names a rate."""
    if is_named:
        return baud
    if port.startswith(SCHEME):
        return read_board_url(port).board.line.baud
    is_pty = os.path.realpath(port).startswith(_PTYS)
    return None if is_pty or port.startswith(_NETWORK) else baud


def _usual_dialect_rates(
    config: VerifyConfig, boards: DialectBoardsUnderTest, *, names_baud: bool
) -> dict[str, Any]:
    """Return the settings *baud* and *rate_hz*: the highest whole frame rate that the line carries.

    The baud is that of *config* if *names_baud*, else the dialect's first. The rate is 1 to 1000
    Hz; 100 Hz, and no baud, for a board without a serial line.
    """
    from haptogram.driver.line.budget import highest_line_rate_hz

    if not boards.dialect.bauds:
        return {"rate_hz": _WITHOUT_A_LINE_HZ}
    baud = config.link.baud if names_baud else boards.dialect.bauds[0]
    highest_hz = highest_line_rate_hz(boards.frame_bytes, baud)
    return {"baud": baud, "rate_hz": max(1.0, min(_MOST_HZ, float(math.floor(highest_hz))))}


@contextlib.contextmanager
def live_view(*, wanted: bool) -> Iterator[Show]:
    """Give what shows the board whose records a back door gets; on a terminal it stays.

    It stays until Ctrl-C, and shows nothing unless that is *wanted*.
    """
    if not wanted:
        yield lambda _: None
        return
    from haptogram.machine.view_process import ViewProcess

    with contextlib.ExitStack() as stack:
        shown: list[ViewProcess] = []

        def show(backdoor: Path) -> None:
            shown.append(ViewProcess(str(backdoor)))
            stack.callback(shown[0].close)

        yield show
        if shown and sys.stderr.isatty():
            print("the view stays; Ctrl-C ends it", file=sys.stderr)
            shown[0].wait()

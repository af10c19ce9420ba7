"""The parts that a board is assembled from; mutants replace one of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeAlias

from haptogram.settings.frozen import dataclass
from haptogram_protocol.cobs import fastest_cobs
from haptogram_protocol.connection import BoardConnection, BoardEvent
from haptogram_protocol.framing import FrameDecoder
from haptogram_protocol.rules import unsupported_types

from .board.board import Board, BoardParts
from .board.clock import BoardClock
from .board.settings import BoardSettings
from .dialects.haptogram import OUTPUT_LIMIT, VirtualHaptogramDialect
from .dialects.virtual_dialect import VirtualDialect


@dataclass(frozen=True, slots=True)
class BoardAssembly(BoardParts):
    """The parts of a board with its end of the link; each is healthy unless another is given."""

    board: type[Board] = Board
    dialect: type[VirtualHaptogramDialect] = VirtualHaptogramDialect
    connection: type[BoardConnection] = BoardConnection
    decoder: type[FrameDecoder] = FrameDecoder
    clock: type[BoardClock] = BoardClock

    def assemble(
        self,
        settings: BoardSettings,
        watch: Callable[[BoardEvent], None] | None = None,
    ) -> VirtualHaptogramDialect:
        """Return a board at the end of its line, powered up; *watch* sees the link's events."""
        link = self.connection(
            output_limit=OUTPUT_LIMIT,
            cobs=fastest_cobs(),  # a wrong decoder has its own
            decoder=None if self.decoder is FrameDecoder else self.decoder(),
            unsupported=unsupported_types(settings.features),
        )
        return self.dialect(self.board(settings, self), link, watch)


HEALTHY: Final = BoardAssembly()


@dataclass(frozen=True, slots=True)
class OtherAssembly:
    """Boards that another process simulates, or that speak another dialect.

    Attributes
    ----------
    assemble : callable
        From their settings to the boards at the end of their line, powered up.
    """

    assemble: Callable[[BoardSettings], VirtualDialect]
    clock: type[BoardClock] = BoardClock


#: Parts of a board with its end of the line.
Assembly: TypeAlias = BoardAssembly | OtherAssembly

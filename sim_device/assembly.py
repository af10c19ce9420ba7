"""What a board is put together from, so that one part of it can be a wrong one."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Final

from haptogram_protocol.connection import BoardConnection
from haptogram_protocol.framing import FrameDecoder, fastest_cobs

from .board.board import Board
from .board.clock import DeviceClock
from .board.settings import BoardSettings
from .dialects.haptogram import BoardDialect


@dataclass(frozen=True, slots=True)
class Parts:
    """The parts of a board; each is the healthy one unless something else is said."""

    board: type[Board] = Board
    dialect: type[BoardDialect] = BoardDialect
    connection: type[BoardConnection] = BoardConnection
    decoder: type[FrameDecoder] = FrameDecoder
    clock: type[DeviceClock] = DeviceClock

    def assemble(self, settings: BoardSettings, description_hash: int) -> BoardDialect:
        """Return a board at the end of its line, powered up."""
        # A wrong decoder chooses its own COBS.
        decoder = None if self.decoder is FrameDecoder else self.decoder()
        connection = functools.partial(self.connection, cobs=fastest_cobs(), decoder=decoder)
        return self.dialect(self.board(settings), description_hash, connection)


HEALTHY: Final = Parts()

"""The parts that a board is put together from, any of which may be replaced by a wrong one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from haptogram_protocol.connection import BoardConnection, BoardEvent
from haptogram_protocol.framing import FrameDecoder, fastest_cobs

from .board.board import Board, BoardParts
from .board.clock import DeviceClock
from .board.output import OutputStage
from .board.settings import BoardSettings
from .board.stream_queue import StreamQueue
from .board.timers import OutputTimers
from .board.uploads import Uploads
from .dialects.haptogram import OUTPUT_LIMIT, BoardDialect


@dataclass(frozen=True, slots=True)
class Parts:
    """The parts of a board with its end of the link; each is healthy unless another is given."""

    board: type[Board] = Board
    output: type[OutputStage] = OutputStage
    timers: type[OutputTimers] = OutputTimers
    queue: type[StreamQueue] = StreamQueue
    uploads: type[Uploads] = Uploads
    dialect: type[BoardDialect] = BoardDialect
    connection: type[BoardConnection] = BoardConnection
    decoder: type[FrameDecoder] = FrameDecoder
    clock: type[DeviceClock] = DeviceClock

    def assemble(
        self,
        settings: BoardSettings,
        description_hash: int,
        watch: Callable[[BoardEvent], None] | None = None,
    ) -> BoardDialect:
        """Return a board at the end of its line, powered up; *watch* sees the link's events."""
        parts = BoardParts(self.output, self.timers, self.queue, self.uploads)

        link = self.connection(
            description_hash,
            output_limit=OUTPUT_LIMIT,
            cobs=fastest_cobs(),  # a wrong decoder has its own
            decoder=None if self.decoder is FrameDecoder else self.decoder(),
        )
        return self.dialect(self.board(settings, parts), link, watch)


HEALTHY: Final = Parts()

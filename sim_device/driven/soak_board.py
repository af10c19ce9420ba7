"""A virtual board for a soak: it has no line, and keeps its verdict on every frame.

Bytes are handed over at the moment at which the last of them has come: the line and its faults are
the caller's.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Final, Self, TypeAlias

from haptogram.settings.faults.plan import FaultPlan
from haptogram_protocol import messages as m
from haptogram_protocol.connection import BoardEvent, StreamReceived
from haptogram_protocol.connection.events import FrameDropped

from ..assembly import HEALTHY, BoardAssembly
from ..board.clock import BoardClock
from ..board.events import Latch
from ..board.settings import BOOT_US, BoardSettings, board_settings
from ..faults.clock import faulty_clock
from ..mutants import mutant_parts

#: The index of a stream frame that was taken, ``request``, or why a frame was dropped.
Verdict: TypeAlias = int | str

REQUEST: Final = "request"


class VirtualSoakBoard:
    """A board from its power-up on; times are nanoseconds since then.

    Parameters
    ----------
    settings : BoardSettings
        Hardware and limits of the board.
    clock : BoardClock
        The clock of the board.
    parts : BoardAssembly
        The parts of the board.
    """

    def __init__(self, settings: BoardSettings, clock: BoardClock, parts: BoardAssembly) -> None:
        self._settings, self._clock = settings, clock
        #: The unwrapped device time at a number of nanoseconds, which is asked for repeatedly.
        self.device_us = functools.lru_cache(maxsize=4)(clock.device_us)
        self._verdicts: list[Verdict] = []
        self._dialect = parts.assemble(settings, self._note)
        self.transducers = settings.count
        self.carrier_us = settings.carrier_us

    @classmethod
    def power_up(
        cls,
        *,
        seed: int,
        baud: int,
        plan: FaultPlan,
        running_us: int = 0,
        mutant: str | None = None,
    ) -> Self:
        """Return a board of random identity *seed*, with the faults of its clock from *plan*.

        It reports a line of *baud*, and its clock has been running for *running_us*; *mutant* is
        firmware that is wrong in one way.
        """
        parts = mutant_parts(mutant)
        clock = faulty_clock(plan, parts.clock(BOOT_US + running_us))
        settings = board_settings(seed=seed, baud=baud)
        return cls(dataclasses.replace(settings, boot_us=clock.boot_us), clock, parts)

    def model(self) -> Self:
        """Return a healthy board like this one, just powered up, whose clock goes as this one's."""
        return type(self)(self._settings, self._clock, HEALTHY)

    @property
    def session(self) -> int:
        """The open session, 0: none."""
        return self._dialect.board.output.session

    @property
    def counters(self) -> dict[str, int]:
        """Every counter of HG-9.2."""
        return self._dialect.counters

    @property
    def is_silent(self) -> bool:
        """True if the transducers radiate nothing."""
        board = self._dialect.board
        return board.output.radiated(board.output.now_us).is_muted

    def receive(self, data: bytes, t_ns: int, up_free_ns: int) -> None:
        """Take bytes whose last one is there at *t_ns*; the line up is free at *up_free_ns*."""
        self._dialect.line_free_us = self.device_us(max(up_free_ns, t_ns))
        self._dialect.receive(data, self._now_us(t_ns))

    def receive_stream(
        self, header: m.Header, message: m.Phases | m.Drives | m.Points, t_ns: int
    ) -> None:
        """Take a stream frame that came whole at *t_ns*, without its bytes."""
        self._dialect.receive_stream(header, message, self._now_us(t_ns))

    def advance_to(self, t_ns: int) -> None:
        """Let everything happen that is due up to *t_ns*."""
        self._dialect.advance_to(self._now_us(t_ns))

    def _now_us(self, t_ns: int) -> int:
        return max(self.device_us(t_ns), self._dialect.board.output.now_us)

    def take_output(self) -> bytes:
        """Return whole frames for the line."""
        self._dialect.take_notices()
        return self._dialect.take_output() if self._dialect.output_bytes else b""

    def take_verdicts(self) -> list[Verdict]:
        """Return the verdict on each frame since the last call, in order."""
        taken, self._verdicts = self._verdicts, []
        return taken

    def take_latches(self) -> list[Latch]:
        """Return the latches since the last call."""
        return self._dialect.take_latches()

    def _note(self, event: BoardEvent) -> None:
        """Record the board's verdict on a frame."""
        if isinstance(event, StreamReceived):
            self._verdicts.append(event.index)
        else:
            self._verdicts.append(event.reason if isinstance(event, FrameDropped) else REQUEST)

"""A virtual board without its line that keeps its verdict on every frame: what a soak needs.

Bytes are handed over at the moment at which the last of them has come, so the line, and whatever
goes wrong on it, is the caller's.
"""

from __future__ import annotations

import dataclasses
from typing import Final, TypeAlias

from haptogram.settings.faults.plan import FaultPlan
from haptogram_protocol.connection import BoardConnection, BoardEvent, NeedData, StreamReceived
from haptogram_protocol.connection.events import FrameDropped, RequestReceived
from haptogram_protocol.export.tables import description_hash

from .board.events import Latch, StateChange
from .board.settings import BOOT_US, board_settings
from .faults.clock import faulty_clock
from .mutants import parts_of

#: The index of a stream frame that was taken, ``request``, or why a frame was dropped.
Verdict: TypeAlias = int | str

REQUEST: Final = "request"


class JudgedBoard:
    """A board from its power-up on; times are nanoseconds since then.

    Parameters
    ----------
    seed : int
        Of everything about it that looks random.
    baud : int
        What it believes its line to carry.
    clock_faults : sequence of str
        Faults of its clock, as in docs/faults.md.
    running_us : int
        How long its clock has been running at power-up, as if it were an earlier one.
    mutant : str or None
        What is wrong with its firmware.
    """

    def __init__(
        self,
        *,
        seed: int,
        baud: int,
        clock_faults: tuple[str, ...] = (),
        running_us: int = 0,
        mutant: str | None = None,
    ) -> None:
        parts = parts_of(mutant)
        self._verdicts: list[Verdict] = []
        plan = FaultPlan.parse(clock_faults, seed)
        self._clock = faulty_clock(plan, parts.clock(BOOT_US + running_us))
        settings = dataclasses.replace(
            board_settings(seed=seed, baud=baud), boot_us=self._clock.boot_us
        )
        judging = dataclasses.replace(parts, connection=_judging(parts.connection, self._verdicts))
        self._dialect = judging.assemble(settings, description_hash())
        self.transducers = settings.count
        self.carrier_us = settings.carrier_us

    @property
    def session(self) -> int:
        """The open session, 0: none."""
        return self._dialect.board.session

    @property
    def counters(self) -> dict[str, int]:
        """Every counter of HG-9.2."""
        return self._dialect.counters

    @property
    def is_silent(self) -> bool:
        """Whether nothing leaves the transducers."""
        board = self._dialect.board
        return board.radiated(board.now_us).is_muted

    def device_us(self, t_ns: int) -> int:
        """Return the unwrapped device time at *t_ns*."""
        return self._clock.device_us(t_ns)

    def receive(self, data: bytes, t_ns: int, up_free_ns: int) -> None:
        """Take bytes whose last one is there at *t_ns*; the line up is free at *up_free_ns*."""
        self._dialect.line_free_us = self._clock.device_us(max(up_free_ns, t_ns))
        self._dialect.receive(data, self._now_us(t_ns))

    def advance_to(self, t_ns: int) -> None:
        """Let happen what is due up to *t_ns*."""
        self._dialect.advance_to(self._now_us(t_ns))

    def _now_us(self, t_ns: int) -> int:
        return max(self._clock.device_us(t_ns), self._dialect.board.now_us)

    def take_output(self) -> bytes:
        """Return whole frames for the line."""
        return self._dialect.take_output() if self._dialect.output_bytes else b""

    def take_verdicts(self) -> list[Verdict]:
        """Return what became of each frame, in order, since the last call."""
        taken = self._verdicts[:]
        self._verdicts.clear()
        return taken

    def take_latches(self) -> list[Latch]:
        """Return the latches since the last call."""
        return self._dialect.take_latches()

    def take_timeouts(self) -> int:
        """Return how often a timer has switched the output off since the last call."""
        notices = self._dialect.take_notices()
        return sum(isinstance(n, StateChange) and not n.requested for n in notices)


def _judging(kind: type[BoardConnection], verdicts: list[Verdict]) -> type[BoardConnection]:
    """Return *kind*, telling *verdicts* about every frame."""

    class _Judging(kind):  # type: ignore[valid-type,misc]  # chosen at run time
        def next_event(self) -> BoardEvent | NeedData:
            event: BoardEvent | NeedData = super().next_event()
            if isinstance(event, StreamReceived):
                verdicts.append(event.index)
            elif isinstance(event, FrameDropped):
                verdicts.append(event.reason)
            elif isinstance(event, RequestReceived):
                verdicts.append(REQUEST)
            return event

    return _Judging

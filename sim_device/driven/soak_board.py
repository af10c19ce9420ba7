"""A virtual board for a soak: it has no line, and keeps its verdict on every frame.

Bytes are handed over at the moment at which the last of them has come: the line and its faults are
the caller's.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Final, Protocol, Self, TypeAlias

from haptogram.acoustics import Drive
from haptogram.settings.faults.plan import FaultPlan
from haptogram_protocol import messages as m
from haptogram_protocol.connection import BoardEvent, StreamReceived
from haptogram_protocol.connection.events import FrameDropped
from haptogram_protocol.framing import DELIMITER

from ..assembly import HEALTHY, BoardAssembly
from ..board.clock import BoardClock
from ..board.events import Latch
from ..board.settings import BOOT_US, BoardSettings, board_settings
from ..board.stream_queue import StreamFrame
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

    def model(self) -> VirtualSoakModel:
        """Return a healthy board like this one, just powered up, whose clock goes as this one's."""
        model = VirtualSoakModel(self._settings, self._clock, HEALTHY)
        model.device_us = self.device_us
        return model

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

    def receive(self, data: bytes, t_ns: int, up_free_ns: int) -> list[Verdict]:
        """Take bytes whose last one is there at *t_ns*; the line up is free at *up_free_ns*.

        Return the verdict on each frame, in order.
        """
        self._dialect.line_free_us = self.device_us(max(up_free_ns, t_ns))
        self._verdicts.clear()
        self._dialect.receive(data, self._now_us(t_ns))
        return self._verdicts

    def advance_to(self, t_ns: int) -> None:
        """Let everything happen that is due up to *t_ns*."""
        self._dialect.advance_to(self._now_us(t_ns))

    def _now_us(self, t_ns: int) -> int:
        """Return the device time at *t_ns*, never before what the board has reached."""
        return max(self.device_us(t_ns), self._dialect.board.output.now_us)

    def take_frames(self) -> list[bytes]:
        """Return whole frames for the line."""
        if not self._dialect.output_bytes:
            return []
        self._dialect.take_notices()
        output = self._dialect.take_output().split(DELIMITER)
        return [DELIMITER + encoded + DELIMITER for encoded in output if encoded]

    def take_latches(self) -> list[Latch]:
        """Return the latches since the last call."""
        return self._dialect.take_latches()

    def _note(self, event: BoardEvent) -> None:
        """Keep what became of a frame: its index if streamed, why it was dropped, or "request"."""
        if isinstance(event, StreamReceived):
            self._verdicts.append(event.index)
        else:
            self._verdicts.append(event.reason if isinstance(event, FrameDropped) else REQUEST)


class SentFrame(Protocol):
    """A frame of the host; see :class:`~haptogram.campaigns.soak.line.Sent`."""

    wire: bytes
    session: int
    index: int
    due_us: int
    drive: m.Phases | m.Drives | None


@dataclasses.dataclass(slots=True)
class DueLatch:
    """A latch of the model; see :class:`~sim_device.board.events.Latch`."""

    session: int
    index: int
    t_latch_us: int
    late: bool
    drive: Drive


class VirtualSoakModel(VirtualSoakBoard):
    """A healthy board that is told of most stream frames without their bytes.

    It keeps them, and takes them all at once before anything happens that somebody could hear of.
    """

    def __init__(self, settings: BoardSettings, clock: BoardClock, parts: BoardAssembly) -> None:
        super().__init__(settings, clock, parts)
        self._content = functools.lru_cache(maxsize=128)(self._dialect.content)
        self._kept: list[tuple[int, StreamFrame]] = []
        self._due: list[DueLatch] = []
        self._session = self._next_index = self._quiet_until_us = 0
        self._first_apply_us = self._room = 0

    def hear(self, sent: SentFrame, t_ns: int, up_free_ns: int) -> Verdict:
        """Take a frame that came whole at *t_ns*, and return the verdict on it."""
        if sent.drive is not None and self._keep_if_in_time(sent, sent.drive, t_ns):
            return sent.index
        return self.receive(sent.wire, t_ns, up_free_ns)[-1]

    def _keep_if_in_time(self, sent: SentFrame, drive: m.Phases | m.Drives, t_ns: int) -> bool:
        """Keep a frame for later and return True if it is next, in time, and the queue has room.

        In time is from the latch lead to the horizon, and no event may be due before. Else False,
        and nothing is kept.
        """
        if sent.index != self._next_index or sent.session != self._session:
            return False
        now_us = self.device_us(t_ns)
        t_apply_us = m.unwrap(sent.due_us & 0xFFFFFFFF, now_us, 32)
        first_us = max(now_us + self._settings.latch_lead_us, self._first_apply_us)
        in_time = first_us <= t_apply_us <= now_us + self._settings.max_horizon_us
        if not (in_time and self._room and now_us < self._quiet_until_us):
            return False
        self._kept.append((now_us, StreamFrame(sent.index, t_apply_us, self._content(drive))))
        self._next_index += 1
        self._room -= 1
        self._first_apply_us = t_apply_us + self.carrier_us
        return True

    @property
    def counters(self) -> dict[str, int]:
        """Every counter of HG-9.2."""
        self._take_kept()
        return super().counters

    def receive(self, data: bytes, t_ns: int, up_free_ns: int) -> list[Verdict]:
        """Take bytes; see :meth:`VirtualSoakBoard.receive`."""
        self._take_kept()
        verdicts = super().receive(data, t_ns, up_free_ns)
        self._update_limits()
        return verdicts

    def advance_to(self, t_ns: int) -> None:
        """Let everything happen that is due up to *t_ns*."""
        self._take_kept()
        super().advance_to(t_ns)
        self._update_limits()

    def take_due(self) -> list[DueLatch]:
        """Return the latches since the last call that are known."""
        taken, self._due = self._due, []
        return taken

    def _take_kept(self) -> None:
        """Pass the kept frames to the board together; note the latches due."""
        if self._kept:
            for entry in self._dialect.take_run(self._kept):
                due = self._session, entry.index, entry.t_latch_us, entry.late, entry.drive
                self._due.append(DueLatch(*due))
            self._kept.clear()
        self._note_latches()

    def _note_latches(self) -> None:
        """Note the latches due since the last call."""
        for one in self.take_latches():
            due = one.session, one.index, one.t_latch_us, one.late, one.drive
            self._due.append(DueLatch(*due))

    def _update_limits(self) -> None:
        """Note what the board surely accepts next: session, frame index, earliest apply time, room.

        Also until when it does nothing by itself.
        """
        self._note_latches()
        board = self._dialect.board
        self._session, self._next_index = self.session, self._dialect.next_stream_index
        self._quiet_until_us = self._dialect.quiet_until_us
        self._first_apply_us = board.last_apply_us + self.carrier_us
        self._room = self._settings.queue_depth - board.queued

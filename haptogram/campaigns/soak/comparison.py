"""The board under test beside a healthy one that hears only the frames that came whole.

The line knows which of them did.  So damage may change nothing but the counters of damage:
verdicts, latches, silence and all other counters must be those of the model, at the same times.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Protocol

from haptogram.acoustics.model.drive import Drive
from haptogram.errors import HaptogramError
from haptogram.records.latch import LatchRecord
from haptogram.settings.faults.plan import FaultPlan
from haptogram_protocol import messages as m

from .excerpts import SoakExcerpts
from .line import Sent, SoakLine
from .tally import DAMAGE, UNEXPLAINED, SoakTally


class Hopeless(HaptogramError):
    """The board is so wrong that the account cannot go on."""


class SoakLatch(Protocol):
    """A latch of a board; see ``sim_device.board.events.Latch``."""

    session: int
    t_latch_us: int
    late: bool
    drive: Drive

    @property
    def index(self) -> int: ...  # noqa: D102


class SeenSoakLatch(SoakLatch, Protocol):
    """A latch of the board under test."""

    def record(self) -> LatchRecord: ...  # noqa: D102


class BoardUnderSoak(Protocol):
    """A board without its line; times are nanoseconds since power-up."""

    transducers: int
    carrier_us: int

    @property
    def session(self) -> int: ...  # noqa: D102  see sim_device.driven.soak_board.VirtualSoakBoard
    @property
    def counters(self) -> dict[str, int]: ...  # noqa: D102
    @property
    def is_silent(self) -> bool: ...  # noqa: D102
    def model(self) -> SoakModel: ...  # noqa: D102
    def device_us(self, t_ns: int) -> int: ...  # noqa: D102
    def receive(self, data: bytes, t_ns: int, up_free_ns: int) -> list[int | str]: ...  # noqa: D102
    def advance_to(self, t_ns: int) -> None: ...  # noqa: D102
    def take_frames(self) -> list[bytes]: ...  # noqa: D102
    def take_latches(self) -> Sequence[SeenSoakLatch]: ...  # noqa: D102


class SoakModel(BoardUnderSoak, Protocol):
    """A healthy board that need not hear the bytes of most stream frames."""

    def take_due(self) -> Sequence[SoakLatch]: ...  # noqa: D102
    def hear(self, sent: Sent, t_ns: int, up_free_ns: int) -> int | str: ...  # noqa: D102


class MakeBoard(Protocol):
    """Powers a board up; see ``sim_device.driven.soak_board.VirtualSoakBoard``."""

    def __call__(self, *, seed: int, baud: int, plan: FaultPlan, running_us: int) -> BoardUnderSoak:
        """Return it."""


class SoakComparison:
    """Compares a board with its model.

    Parameters
    ----------
    board : BoardUnderSoak
        Just powered up.
    line : SoakLine
        To the board.
    tally : SoakTally
        The account.
    excerpts : SoakExcerpts
        Keeps what the board takes and latches, for a recording.
    """

    def __init__(
        self, board: BoardUnderSoak, line: SoakLine, tally: SoakTally, excerpts: SoakExcerpts
    ) -> None:
        self._board, self._line, self._tally, self._excerpts = board, line, tally, excerpts
        self._model = board.model()
        self._seen: deque[SeenSoakLatch] = deque()
        self._due: deque[SoakLatch] = deque()
        self._silent = (True, True)  # the board, and the model
        self._last: Sent | None = None

    def receive(self, data: bytes, t_ns: int, up_free_ns: int) -> None:
        """Let bytes come to the board, and compare what it makes of each frame."""
        self._excerpts.add(t_ns, True, data)
        verdicts = self._board.receive(data, t_ns, up_free_ns)
        ends = [self._judge(verdict, t_ns, up_free_ns) for verdict in verdicts]
        self._compare_latches(t_ns)
        if any(ends):
            self.compare(t_ns + self._board.carrier_us * 1000, requested=True)  # HG-6.6/1

    def take_frames(self, t_ns: int) -> list[bytes]:
        """Return the frames that the board sends: those of the model, but for their content."""
        if frames := self._board.take_frames():
            self._model.advance_to(t_ns)
        due = self._model.take_frames()
        if [frame[2] for frame in frames] != [frame[2] for frame in due]:
            text = f"the board sends {len(frames)} frames; {len(due)} of other types were due"
            self._tally.violate(UNEXPLAINED, text)
        return frames

    def _judge(self, verdict: int | str, t_ns: int, up_free_ns: int) -> bool:
        """Report a violation if the board did to a frame, at *t_ns*, what its model does not.

        *verdict*: the number of the stream frame that the board took, or a text: a request taken,
        or why it dropped the frame. *up_free_ns*: when the line to the host is free. Returns True
        for a HELLO or MUTE that was due to be taken, which ends the output.
        """
        sent = self._line.next_sent(verdict)
        if sent is None:
            return False
        due = self._model.hear(sent, t_ns, up_free_ns)
        if verdict != due:
            name = "copy taken" if isinstance(verdict, int) else "undamaged frame dropped"
            text = f"type {sent.type:#04x} at the board: {verdict}; {due} was due"
            self._tally.violate(name, text)
        if sent is self._last and sent.hit is not None:  # the line carried it twice
            self._tally.find(sent.hit, str(due))
        elif isinstance(due, int):
            self._tally.count("gap", self._line.explain_gap(sent), column="lost")
            self._judge_lateness(sent, due, t_ns)
        self._last = sent
        return sent.type in (m.Hello.TYPE, m.Mute.TYPE) and due == "request"

    def _judge_lateness(self, sent: Sent, index: int, t_ns: int) -> None:
        """Attribute the lateness of frame *index* to its fault; report a violation if it has none.

        *sent* is that frame, which came at *t_ns*. One that came before its due time is left as it
        is.
        """
        late_us = m.signed_difference(self._board.device_us(t_ns), sent.due_us, 32)
        if late_us <= 0:
            return
        self._tally.note_lateness(late_us)
        dropped = self._model.counters["dropped_late"] - self._tally.totals["dropped_late"]
        self._tally.count("dropped_late", dropped, column="late")
        if sent.cause is None:
            self._tally.violate("late without a cause", f"frame {index}, by {late_us} µs")
        else:
            self._tally.find(sent.cause, "dropped_late" if dropped else "late")

    def compare(self, t_ns: int, *, requested: bool = False) -> None:
        """Let time pass for both, and compare what was latched and whether anything sounds.

        *requested*: whether a frame has just ended the output.
        """
        self._board.advance_to(t_ns)
        self._model.advance_to(t_ns)
        self._compare_latches(t_ns)
        for latch in self._seen:
            self._tally.violate("wrong frame latched", f"frame {latch.index}; none was due")
        for due in self._due:
            self._tally.violate("not latched", f"frame {due.index}")
        self._seen.clear()
        self._due.clear()
        self._compare_silence(t_ns, requested=requested)

    def _compare_latches(self, t_ns: int) -> None:
        """Compare latches of board and model, as many as both have; a difference is a violation."""
        latches = self._board.take_latches()
        if self._excerpts.kept:
            for latch in latches:
                self._excerpts.add(t_ns, None, latch.record())
        self._seen += latches
        self._due += self._model.take_due()
        while self._seen and self._due:
            latch, due = self._seen.popleft(), self._due.popleft()
            index, wanted = latch.index, due.index
            if (latch.session, index) == (due.session, wanted):
                self._compare_latch(latch, due, index)
            elif wanted < index:
                self._tally.violate("not latched", f"frame {wanted}")
                self._seen.appendleft(latch)
            else:
                text = f"frame {index}; frame {wanted} was due"
                self._tally.violate("wrong frame latched", text)
                self._due.appendleft(due)

    def _compare_latch(self, latch: SoakLatch, due: SoakLatch, index: int) -> None:
        """Count a latch; report a violation if its time or drive differs from the model's."""
        self._tally.totals["latched"] += 1
        self._tally.count("late", latch.late, column="late")
        if (latch.t_latch_us, latch.late) != (due.t_latch_us, due.late):
            moved_us = latch.t_latch_us - due.t_latch_us
            self._tally.violate("latched at a wrong time", f"frame {index}, by {moved_us} µs")
        if latch.drive is not due.drive and latch.drive != due.drive:
            self._tally.violate("torn latch", f"frame {index} is not the drive that was sent")

    def _compare_silence(self, t_ns: int, *, requested: bool) -> None:
        """Report a violation if only one of board and model is silent; once per change.

        *requested*: a frame has just ended the output.
        """
        before, self._silent = self._silent, (self._board.is_silent, self._model.is_silent)
        silent, due = self._silent
        if silent == due or before == self._silent:
            return
        too_late = not before[1] and not requested
        name = "muted too late" if too_late else "sounds when it is off"
        self._tally.violate("muted too early" if silent else name, f"at {t_ns // 1000} µs")

    def count(self) -> None:
        """Take down what the model has counted: what came, and what became of it."""
        due, totals = self._model.counters, self._tally.totals
        for name in ("accepted", "flushed", "duplicate", "repeated", "timeouts"):
            totals[name] = due[name]
        totals["board frames"], totals["request"] = due["frames"], due["requests"]
        totals["muted by a timer"] = due["timeouts"]

    def compare_counters(self) -> None:
        """Compare the board's counters with the model's, and with the damage of the line."""
        totals = self._tally.totals
        damage = {name: totals[f"the board: {name}"] for name in DAMAGE}
        due = self._model.counters | damage | {"gap": totals["gap"]}
        for name, count in self._board.counters.items():
            totals[f"counter {name}"] += count
            if count != due[name]:
                text = f"{name} is {count}; the account says {due[name]}"
                self._tally.violate("counter unexplained", text)

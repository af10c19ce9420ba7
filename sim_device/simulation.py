"""One board at the far end of one line: joins the line, the dialect and recorders.

It knows no clock: times are nanoseconds since power-up, given by the caller, and it goes from event
to event, so a run on the wall clock and one in virtual time are the same code.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Final, Protocol

from haptogram.records.remark import About
from haptogram.settings.faults.plan import FaultPlan
from haptogram.settings.line import LineSettings
from haptogram_protocol.framing import DELIMITER, MAX_ENCODED_BYTES, end_of_frame

from .assembly import HEALTHY, Assembly
from .board.clock import NS_PER_US, whole_board_us
from .board.events import AnyLatch, Counted, Notice, PowerDown, Remark
from .board.settings import BoardSettings
from .dialects.haptogram import VirtualHaptogramDialect
from .dialects.virtual_dialect import VirtualDialect
from .faults.clock import faulty_clock
from .line.uart import Uart, uart_to_board, uart_to_host

if TYPE_CHECKING:
    from .faults.injector import FaultInjector

HOST_BUFFER: Final = 65_536  # bytes that a host may leave unread before the board holds back
LINE_BUFFER: Final = 16_384  # bytes that a host may write ahead of the line: as a pty takes
_LINE_CHUNK: Final = MAX_ENCODED_BYTES + 2  # handed to the line at a time: the longest frame
_LINES: Final = {"down": "to_board", "up": "to_host"}
MAX_CREDIT_NS: Final = 100_000_000  # most line time that a stalled process may catch up
_NEVER_NS: Final = 1 << 80
_TOGETHER_US: Final = 1_000_000  # longest playback whose latches reach the recorders together


class SimulationRecorder(Protocol):
    """Takes down what the board does.  It must not block."""

    def latch(self, latch: AnyLatch) -> None:
        """Take down a latch."""

    def notice(self, notice: Notice) -> None:
        """Take down a change of the output."""


class LineProbe(Protocol):
    """Takes down what the two lines of the UART carry; it must not block."""

    def carried(self, name: str, begin_us: float, data: bytes) -> None:
        """Take down bytes on the line *name*, back to back from this device time on."""

    def lines_cut(self, t_us: float) -> None:
        """Take down that no byte arrives any more that has not arrived by this device time."""


class Simulation:
    """A virtual board with its line, from power-up at 0 ns on.

    Parameters
    ----------
    settings : BoardSettings
        The board, with its line.
    *recorders : SimulationRecorder
        Recorders of what the board does.
    paced : bool, keyword-only
        Whether the line takes its time; not, if the bytes come over a real one.
    parts : Assembly, keyword-only
        Parts of the board: healthy parts of a board of Haptogram, unless it is a mutant or
        speaks another dialect.
    faults : FaultPlan or None, keyword-only
        Faults of line, clock and transducers.
    probe : LineProbe or None, keyword-only
        Recorder of the bytes on the lines.

    Attributes
    ----------
    settings : BoardSettings
        The board.
    dialect : VirtualDialect
        The board at the end of its line.
    now_ns : int
        Time up to which everything has happened.

    Raises
    ------
    ConfigurationError
        If a fault is not possible on this board.
    """

    def __init__(
        self,
        settings: BoardSettings,
        *recorders: SimulationRecorder,
        paced: bool = True,
        parts: Assembly = HEALTHY,
        faults: FaultPlan | None = None,
        probe: LineProbe | None = None,
    ) -> None:
        self._probe = probe
        self._clock = parts.clock(settings.boot_us)
        self._injector: FaultInjector | None = None
        if faults is not None and faults.faults:
            from .faults.injector import FaultInjector

            self._clock = faulty_clock(faults, self._clock)
            self._injector = FaultInjector(faults, settings, self._clock)
            self._injector.has_left(0)
            settings = dataclasses.replace(settings, boot_us=self._clock.boot_us)
        self.settings = settings
        self.dialect: VirtualDialect = parts.assemble(settings)
        self._recorders = recorders
        # Nothing of our own wire acts before the end of a frame; first bytes of others may.
        self._takes_whole_frames = isinstance(self.dialect, VirtualHaptogramDialect)
        self._plays_on = self._takes_whole_frames and self._injector is None
        self._line = settings.line if paced else LineSettings()
        self._down, self._up = uart_to_board(self._line), uart_to_host(self._line)
        if self.dialect.ahead is not None:
            self._up = uart_to_host(LineSettings())  # its own UART takes the time
        self._unread = bytearray()
        self._unread_lost = 0
        self.now_ns = 0
        self._idle_until_ns = 0  # nothing happens before by itself; 0: not known
        # An injector changes with time, and a board that runs ahead when it is asked.
        self._changes_unasked = self._injector is not None or self.dialect.ahead is not None
        self._record()  # some boards radiate from power-up on

    def device_us(self, t_ns: int) -> int:
        """Return the unwrapped device time at *t_ns*, rounded up."""
        shown_us = self._clock.device_us(t_ns)
        return shown_us + (self._clock.reached_ns(shown_us) < t_ns)

    # --- the host's side -----------------------------------------------------------------------

    @property
    def host_room(self) -> int:
        """Bytes that the host may write now."""
        room = LINE_BUFFER if self.dialect.room_bytes is None else self.dialect.room_bytes
        return max(0, min(room, LINE_BUFFER) - self._down.in_transit)

    @property
    def host_unsent(self) -> int:
        """Bytes that the host has written and the line still carries."""
        return self._down.in_transit

    @property
    def host_waiting(self) -> int:
        """Bytes that the host may read now."""
        return len(self._unread)

    def host_write(self, data: bytes, t_ns: int, *, waited_ns: int = 0) -> int:
        """Put bytes of the host on the line at *t_ns*; return how many there was room for.

        Parameters
        ----------
        waited_ns : int
            How long the bytes may have waited for a board whose process had stalled: a real line
            would have carried them meanwhile. It counts up to :data:`MAX_CREDIT_NS`; they still
            arrive at *t_ns* at the earliest.
        """
        self.advance_to(t_ns)
        taken = data[: self.host_room]
        credit_ns = min(waited_ns, MAX_CREDIT_NS, t_ns)
        self._send(self._down, "down", taken, t_ns, credit_ns)
        return len(taken)

    def host_read(self, limit: int | None = None) -> bytes:
        """Return bytes that have come from the board, at most *limit*."""
        if len(self._unread) >= HOST_BUFFER:  # the board may go on
            self._idle_until_ns = 0
        taken = bytes(self._unread[:limit])
        del self._unread[: len(taken)]
        self._feed_line()
        return taken

    def unplug(self) -> None:
        """Lose what is on the line and what the host has not read: it has closed the port."""
        self._idle_until_ns = 0
        if data := self._down.receive(self.now_ns):
            self.dialect.receive(data, self._clock.device_us(self.now_ns))
        self._down.cut()
        self._up.cut()
        if self._probe is not None:
            self._probe.lines_cut(self._exact_us(self.now_ns))
        self._unread.clear()
        self.dialect.client_left()
        self._record()

    def raise_hardware_fault(self) -> None:
        """Let the hardware of a board of Haptogram's own dialect fail now."""
        if isinstance(self.dialect, VirtualHaptogramDialect):
            self._end_idle_time()
            self.dialect.raise_hardware_fault()
            self._idle_until_ns = 0
            self._record()
            self._feed_line()

    def power_down(self) -> None:
        """Mute the board for good; recorders get the end."""
        self._end_idle_time()
        for recorder in self._recorders:
            recorder.notice(PowerDown(self.dialect.now_us))
        self.dialect.power_down()
        self._idle_until_ns = 0
        self._record()
        self.report_counts()

    @property
    def fault_counts(self) -> dict[str, int]:
        """Counts of the faults that fired."""
        return {} if self._injector is None else self._injector.counts(self.now_ns)

    @property
    def line_counts(self) -> dict[str, int]:
        """Counts of the bytes that the line lost or damaged by its own nature."""
        return {
            "board_overrun": self._down.overrun,
            "host_overrun": self._unread_lost,
            "framing": self._down.framing + self._up.framing,
        }

    @property
    def is_connected(self) -> bool:
        """True if the host has a port: not while ``line.disconnect`` keeps it away."""
        return self._injector is None or not self._injector.is_away

    def remark(self, about: About, text: str) -> None:
        """Tell the recorders something about the client, in one line."""
        self._end_idle_time()
        for recorder in self._recorders:
            recorder.notice(Remark(self.dialect.now_us, text, about))

    def report_counts(self) -> None:
        """Tell the recorders of faults and losses, for their last record."""
        notices: list[Notice] = []
        if self._line != LineSettings(baud=self._line.baud):
            notices.append(Counted(self.dialect.now_us, "line", self.line_counts))
        if self._injector is not None:
            notices.append(self._injector.counted(self.dialect.now_us, self.now_ns))
        for recorder in self._recorders:
            for notice in notices:
                recorder.notice(notice)

    # --- time ----------------------------------------------------------------------------------

    def next_event_ns(self) -> int | None:
        """Return when something happens next by itself, or None."""
        next_ns = self._idle_until_ns or self._first_event_ns()
        if not self._changes_unasked:
            self._idle_until_ns = next_ns
        return None if next_ns == _NEVER_NS else max(next_ns, self.now_ns)

    def _first_event_ns(self) -> int:
        """Return when board, line or a fault next does something; 2^80 ns if never."""
        first_ns = _NEVER_NS
        if (board_us := self.dialect.next_event_us()) is not None:
            first_ns = self._clock.reached_ns(board_us)
        if (down_ns := self._down.next_event_ns(self.dialect.next_frame_end)) is not None:
            first_ns = min(first_ns, whole_board_us(down_ns))
        if (up_ns := self._up.next_event_ns(_frame_end)) is not None:
            first_ns = min(first_ns, up_ns)
        if self._can_feed:
            first_ns = min(first_ns, self._up.free_ns)
        if self._injector is not None:
            change_ns = self._injector.next_change_ns(self.now_ns)
            first_ns = first_ns if change_ns is None else min(first_ns, change_ns)
        return first_ns

    def advance_to(self, t_ns: int) -> None:
        """Let everything happen that is due up to *t_ns*.

        Raises
        ------
        ValueError
            If time would run backwards.
        """
        if t_ns < self.now_ns:
            raise ValueError(f"simulation is at {self.now_ns} ns, cannot go back to {t_ns} ns")
        if t_ns >= self._idle_until_ns:
            self._run_ahead(t_ns)
            while (next_ns := self.next_event_ns()) is not None and next_ns <= t_ns:
                self._step(next_ns)
                self._play_on(t_ns)
                self._run_ahead(t_ns)
        self.now_ns = t_ns

    def advance_to_output(self, t_ns: int) -> None:
        """Let happen what is due up to *t_ns*, or up to the first bytes that the host may read."""
        while self.is_connected and not self._unread:
            self._run_ahead(t_ns)
            next_ns = self.next_event_ns()
            if next_ns is None or next_ns > t_ns:
                self.advance_to(t_ns)
                return
            self._step(next_ns)
            if not self._unread:
                self._play_on(t_ns)

    def _run_ahead(self, t_ns: int) -> None:
        """Let a board that is another process compute up to *t_ns*, or the next byte for it."""
        if self.dialect.ahead is not None:
            up_ns = self._up.next_event_ns(_frame_end)
            until_ns = t_ns if up_ns is None else min(t_ns, up_ns)
            self.dialect.ahead.run_ahead(self._clock.device_us(until_ns))
            self._idle_until_ns = 0

    def _play_on(self, t_ns: int) -> None:
        """Advance a playback towards *t_ns* by at most a second, if no byte is under way.

        A second at a time: a playback may be hours long, and its latches are kept until then.
        """
        dialect = self.dialect
        if not self._plays_on or self._down.in_transit or self._up.in_transit or self._can_feed:
            return
        assert isinstance(dialect, VirtualHaptogramDialect)
        if dialect.board.is_playing:
            dialect.play_to(min(self._clock.device_us(t_ns), dialect.now_us + _TOGETHER_US))
            self.now_ns = max(self.now_ns, self._clock.reached_ns(dialect.now_us))
            self._idle_until_ns = 0
            self._record()

    def _end_idle_time(self) -> None:
        """Advance the board from its last event to now."""
        self.dialect.advance_to(self._clock.device_us(self.now_ns))
        self._idle_until_ns = 0
        self._record()

    def _step(self, t_ns: int) -> None:
        """Advance the board to *t_ns*, with the bytes that arrive then, and feed the line."""
        self.now_ns, self._idle_until_ns = t_ns, 0
        if self._injector is not None and self._injector.has_left(t_ns):
            self.unplug()
        t_us = self._clock.device_us(t_ns)
        has_come = t_ns % NS_PER_US == 0  # only on whole microseconds: never before it came
        if has_come and self._takes_whole_frames:
            end_ns = self._down.next_event_ns(self.dialect.next_frame_end)
            has_come = end_ns is not None and end_ns <= t_ns
        if has_come and (data := self._down.receive(t_ns)):
            self.dialect.receive(data, t_us)
        else:
            self.dialect.advance_to(t_us)
        self._record()
        self._feed_line()
        if self._up.in_transit:
            self._unread += self._up.receive(t_ns)
        if self._line.host_buffer is not None:
            self._overrun_host(self._line.host_buffer)

    def _record(self) -> None:
        """Pass new notices and latches to the recorders, latches with their injected faults."""
        notices, latches = self.dialect.take_notices(), self.dialect.take_latches()
        if self._injector is not None:
            latches = [self._injector.radiate(latch, self.now_ns) for latch in latches]
        for recorder in self._recorders:
            for notice in notices:
                recorder.notice(notice)
            for latch in latches:
                recorder.latch(latch)

    def _send(self, line: Uart, direction: str, data: bytes, t_ns: int, credit_ns: int = 0) -> None:
        """Put bytes on a line at *t_ns*, through the fault injector, which may change them.

        *direction* is "down", to the board, or "up". They may have left up to *credit_ns* earlier,
        as they may have waited while the process was stalled.
        """
        if self._injector is None:
            self._put(line, direction, data, t_ns, credit_ns)
            return
        for chunk in self._injector.line(direction, t_ns, data):
            self._put(line, direction, chunk.data, chunk.t_ns, credit_ns)

    def _put(self, line: Uart, direction: str, data: bytes, t_ns: int, credit_ns: int) -> None:
        """Put bytes on a line; tell the board's dialect and a probe on the line when they leave.

        They leave at *t_ns* or up to *credit_ns* earlier, as they may have waited while the process
        was stalled.
        """
        self._idle_until_ns = 0
        begin_ns = max(t_ns - credit_ns, line.free_ns)
        line.send(data, t_ns - credit_ns)
        if self.dialect.announce is not None and line is self._down:
            self.dialect.announce(self._exact_us(max(begin_ns, t_ns)), data)
        if self._probe is not None and data:
            # Bytes that have waited for a stalled process arrive now, not in its past.
            behind_ns = max(0, t_ns - line.free_ns)
            self._probe.carried(_LINES[direction], self._exact_us(begin_ns + behind_ns), data)

    def _exact_us(self, t_ns: int) -> float:
        """Return the unwrapped device time at *t_ns* with its fraction."""
        whole_ns = t_ns // NS_PER_US * NS_PER_US
        return self._clock.device_us(whole_ns) + (t_ns - whole_ns) / NS_PER_US

    def _overrun_host(self, room: int) -> None:
        """Drop bytes beyond the *room* of the host's receive buffer; count them."""
        self._unread_lost += max(0, len(self._unread) - room)
        del self._unread[room:]

    @property
    def _can_feed(self) -> bool:
        """Return True if the board has output and the host's buffer has room."""
        # With a buffer of its own the host never makes the board wait: what does not fit is lost.
        if not self.dialect.output_bytes:
            return False
        return self._line.host_buffer is not None or len(self._unread) < HOST_BUFFER

    def _feed_line(self) -> None:
        """Pass more bytes to the line once it is idle."""
        if self._can_feed and self._up.free_ns <= self.now_ns:
            self._send(self._up, "up", self.dialect.take_output(_LINE_CHUNK), self.now_ns)
            self.dialect.line_free_us = self.device_us(self._up.free_ns)


def _frame_end(data: bytes, at: int) -> int:
    """Return the index after the delimiter that ends the next frame; the length if none does.

    A delimiter at *at* begins the frame.
    """
    return end_of_frame(data, at + data.startswith(DELIMITER, at))

"""Boards of another dialect: the bytes of their wire become operations, and these become pulses."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from haptogram_protocol.dialects.codec import BoardEnd, Commits, Dialect, Reply

from ..board.clock import earliest_board_time
from ..board.events import CarrierState
from ..board.settings import BoardSettings
from .client_remarks import ClientRemarks, UnshownToClient
from .unit import HearsBytesUnit, HoldsBackUnit, RunsAheadUnit, Unit
from .virtual_dialect import VirtualDialect

PAUSE_US: Final = 30_000  # silence after which another frame may begin
PATIENCE_US: Final = 500_000  # time without a byte after which the rest of a frame will not come
OUTPUT_LIMIT: Final = 16_384  # bytes that wait for the line; what comes then is dropped


class VirtualForeignDialect(VirtualDialect):
    """All boards on one line that speaks another dialect than Haptogram's.

    Bytes are handed to the codec message by message, so that each latch knows what went wrong
    since the one before it.

    Parameters
    ----------
    dialect : Dialect
        The wire.
    end : callable
        Makes the board's end of it.
    unit : Unit
        What the boards do.
    settings : BoardSettings
        The boards, with the wiring of the emitters and the line.
    boards : int
        Boards on the line.

    Raises
    ------
    TypeError
        The board speaks Haptogram's own wire.
    """

    def __init__(
        self,
        dialect: Dialect,
        end: Callable[[], BoardEnd],
        unit: Unit,
        settings: BoardSettings,
        boards: int,
    ) -> None:
        super().__init__(settings.boot_us)
        if settings.wiring is None:
            raise TypeError("settings of a board that speaks Haptogram's own wire")
        channels = np.array(settings.wiring.channels, dtype=np.intp)
        byte_us = 10e6 / settings.line.baud if settings.line.baud else 0.0
        self._dialect, self._unit, self._channels = dialect, unit, channels
        self.ahead = unit if isinstance(unit, RunsAheadUnit) else None
        if self.ahead is not None:
            self.announce = self.ahead.announce
        elif isinstance(unit, HearsBytesUnit):
            hear = unit.hear
            self.announce = lambda begin_us, data: hear(begin_us, begin_us + byte_us * len(data))
        self._new_end = end
        self._connect()
        self._own: Counter[str] = Counter()
        self._counted: Counter[str] = Counter()  # at the last latch
        self._latched = 0
        self._byte_us, self._last_us = byte_us, settings.boot_us  # when the last byte came
        self._quiet_us: int | None = None  # when the client has been silent for long enough
        self._frame_bytes = 0  # since the last latch
        sizes = [*map(dialect.frame_bytes, range(1, boards + 1))]
        self._remarks = ClientRemarks(dialect, sizes, self._notices, self._own)
        self._collect()

    def _connect(self) -> None:
        """Create the decoder for a new connection, without bytes from before."""
        self._end = self._new_end()
        # Asked once: whether an object fits a protocol costs as much as a frame.
        self._commits = self._end if isinstance(self._end, Commits) else None

    # --- time and bytes ------------------------------------------------------------------------

    @property
    def counters(self) -> dict[str, int]:
        """Counts of bytes and operations that codec and boards refused, by kind."""
        return dict(self._end.counters + self._unit.counters + self._own)

    @property
    def room_bytes(self) -> int | None:
        """Bytes that the boards take now; None if nothing holds their client back."""
        return self._unit.room_bytes if isinstance(self._unit, HoldsBackUnit) else None

    def next_frame_end(self, data: bytes, at: int) -> int:
        """Return the index after the first byte of *data* from *at* on that may end a message."""
        return self._end.next_frame_end(data, at)

    def next_event_us(self) -> int | None:
        """Return when the boards next do something by themselves, or None."""
        return earliest_board_time(self._unit.next_event_us(), self._quiet_us)

    def advance_to(self, t_us: int) -> None:
        """Let everything happen that is due up to *t_us*."""
        while (next_us := self.next_event_us()) is not None and next_us <= t_us:
            self._now_us = next_us
            if next_us == self._quiet_us:
                self._quiet_us = None
                self._remarks.silent(self._unshown(), next_us)
            self._reply(self._unit.advance_to(next_us))
            self._collect()
        self._now_us = max(self._now_us, t_us)

    def receive(self, data: bytes, t_us: int) -> None:
        """Take bytes whose last one is complete at *t_us*."""
        self.advance_to(t_us)
        if t_us - self._byte_us * len(data) - self._last_us > PAUSE_US:
            self._remarks.pause(self._unshown().unfinished)
        if data:
            self._last_us = t_us
        at = 0
        while at < len(data):
            end = self._end.next_frame_end(data, at)
            self._frame_bytes += end - at
            for operation in self._end.receive_data(data[at:end]):
                self._reply(self._unit.take(operation, t_us))
                self._collect()
            at = end
        unshown = self._unshown()
        self._remarks.take(data, unshown, t_us)
        waits = unshown.is_something or self._remarks.waits
        self._quiet_us = t_us + PATIENCE_US if waits else None

    def client_left(self) -> None:
        """Report an unfinished frame, and start over with the next client.

        A serial board does not see that its client leaves: what the board holds stays. A link that
        has no line ends with its connection, and with it the answers that wait; the next latch
        counts what the next client does.
        """
        self._remarks.left(self._unshown(), self._now_us)
        self._quiet_us, self._frame_bytes = None, 0
        if not self._dialect.bauds:
            self._own.update(self._end.counters)
            self._connect()
            self._counted = self._unit.counters.copy()
            self._output.clear()

    # --- what happened -------------------------------------------------------------------------

    def _reply(self, replies: Sequence[Reply | bytes]) -> None:
        """Queue replies for the host; drop and count bytes if over 16 384 would wait."""
        for reply in replies:
            data = reply if isinstance(reply, bytes) else self._end.send(reply)
            room = OUTPUT_LIMIT - len(self._output)
            if len(data) > room:
                self._own["reply_bytes_dropped"] += len(data) - room
            self._output += data[:room]

    def _unshown(self) -> UnshownToClient:
        """Return what has come since the last latch and shows nothing yet.

        It has the bytes of an unfinished frame, whole frames without a commit, and kinds of errors.
        """
        kinds, end = self._counted_since_latch().keys(), self._commits
        if end is None:
            return UnshownToClient(self._end.pending, kinds=kinds)
        return UnshownToClient(end.unfinished, end.uncommitted, end.commit, kinds)

    def _counted_since_latch(self) -> dict[str, int]:
        """Return the counters that have grown since the last latch, and by how much."""
        counters = self._end.counters + self._unit.counters
        return {
            kind: count - self._counted[kind]
            for kind, count in counters.items()
            if count != self._counted[kind]
        }

    def _collect(self) -> None:
        """Collect new latches of the unit, each with what was counted since the one before."""
        for latch in self._unit.take_latches():
            counted = self._counted_since_latch()
            self._counted = self._end.counters + self._unit.counters
            if counted:
                self._remarks.counted(counted, self._now_us)
            if self._frame_bytes and self._commits is not None:
                self._remarks.frame(self._frame_bytes, counted)
                self._frame_bytes = 0
            self._latches.append(
                dataclasses.replace(
                    latch,
                    number=self._latched,
                    counted=counted,
                    radiated=latch.pulses.weights()[self._channels] * latch.carrier.level,
                    is_faulty=latch.carrier is not CarrierState.STEADY,
                )
            )
            self._latched += 1

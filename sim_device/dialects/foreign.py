"""Boards of another dialect: the bytes of their wire become operations, and these become pulses."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram_protocol.dialects.codec import BoardEnd, Dialect, Reply
from haptogram_protocol.dialects.looks_like import LOOKED_AT_BYTES, looks_like_dialect

from ..board.clock import earliest_time
from ..board.events import Notice, PulseLatch, Remark
from .unit import HoldsBack, Unit

PATIENCE_US: Final = 500_000  # without a byte: the rest of the frame will not come
OUTPUT_LIMIT: Final = 16_384  # bytes that wait for the line; what comes then is dropped

# Lines for the user, the first time that a client makes these counters move.
_CLUES: Final = {
    "frames_short": "a frame ends before the last channel: the client has a smaller array",
    "codes_beyond_array": "a frame has more codes than the board has channels: the client has a "
    "larger array, or adds what this board takes for codes",
    "codes_out_of_range": "codes beyond those of this board: the client has more steps in a period",
    "bytes_beyond_chain": "bytes for a board that is not there: the client has a longer chain",
    "frames_without_commit": "a frame was overwritten before it was shown: its commit is missing",
}


class ForeignDialect:
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
    channels : (N,) numpy.ndarray of integers
        For each emitter of the array the channel that drives it.
    now_us : int
        Device time at power-up.

    Attributes
    ----------
    line_free_us : int
        See :class:`~sim_device.dialects.endpoint.Endpoint`.
    """

    def __init__(
        self,
        dialect: Dialect,
        end: Callable[[], BoardEnd],
        unit: Unit,
        channels: NDArray[np.intp],
        now_us: int,
    ) -> None:
        self.line_free_us = now_us
        self._dialect, self._unit, self._channels = dialect, unit, channels
        self._new_end, self._end = end, end()
        self._now_us = now_us
        self._output = bytearray()
        self._own: Counter[str] = Counter()
        self._counted: Counter[str] = Counter()  # at the last latch
        self._latched = 0
        self._quiet_us: int | None = None  # when the client has been silent for long enough
        self._latches: list[PulseLatch] = []
        self._notices: list[Notice] = []
        self._clues, self._clue_counts = set(_CLUES), Counter[str]()  # not said; at its beginning
        self._first_bytes: bytearray | None = bytearray()  # None: the wire has been guessed
        self._collect()

    # --- time and bytes ------------------------------------------------------------------------

    @property
    def now_us(self) -> int:
        """Time up to which everything has happened."""
        return self._now_us

    @property
    def counters(self) -> dict[str, int]:
        """Counts of bytes and operations that codec and boards refused, by kind."""
        return dict(self._end.counters + self._unit.counters + self._own)

    @property
    def output_bytes(self) -> int:
        """Bytes that wait for the line."""
        return len(self._output)

    @property
    def room_bytes(self) -> int | None:
        """Bytes that the boards take now; None if nothing holds their client back."""
        return self._unit.room_bytes if isinstance(self._unit, HoldsBack) else None

    def next_end(self, data: bytes, at: int) -> int:
        """Return the index behind the first byte of *data* from *at* on that may end a message."""
        return self._end.next_end(data, at)

    def next_event_us(self) -> int | None:
        """Return when the boards next do something by themselves, or None."""
        return earliest_time(self._unit.next_event_us(), self._quiet_us)

    def advance_to(self, t_us: int) -> None:
        """Let everything happen that is due up to *t_us*."""
        while (next_us := self.next_event_us()) is not None and next_us <= t_us:
            self._now_us = next_us
            if next_us == self._quiet_us:
                self._look_at_silence()
            self._reply(self._unit.advance_to(next_us))
            self._collect()
        self._now_us = max(self._now_us, t_us)

    def receive(self, data: bytes, t_us: int) -> None:
        """Take bytes whose last one is complete at *t_us*."""
        self.advance_to(t_us)
        at = 0
        while at < len(data):
            end = self._end.next_end(data, at)
            for operation in self._end.receive_data(data[at:end]):
                self._reply(self._unit.take(operation, t_us))
                self._collect()
            at = end
        self._say_clues()
        self._keep_first_bytes(data)
        waits = self._end.pending or self._first_bytes
        self._quiet_us = t_us + PATIENCE_US if waits else None

    def take_output(self, limit: int | None = None) -> bytes:
        """Return bytes for the line, at most *limit* if given."""
        taken = bytes(self._output[:limit])
        del self._output[: len(taken)]
        return taken

    def client_left(self) -> None:
        """Say so if a frame has not ended, and look at the first bytes of the next client anew.

        A serial board does not see that its client leaves: what the board holds stays. A link that
        has no line ends with its connection, and with it the answers that wait; the next latch
        counts what the next client does.
        """
        if self._quiet_us is not None:
            self._look_at_silence()
        self._first_bytes = bytearray()
        if not self._dialect.bauds:
            self._own.update(self._end.counters)
            self._end = self._new_end()
            self._counted = self._unit.counters.copy()
            self._output.clear()
        self._clues, self._clue_counts = set(_CLUES), self._end.counters.copy()

    def power_down(self) -> None:
        """Do nothing: these boards say nothing as they go."""

    # --- what happened -------------------------------------------------------------------------

    def take_latches(self) -> list[PulseLatch]:
        """Return the latches since the last call, in order."""
        taken, self._latches = self._latches, []
        return taken

    def take_notices(self) -> list[Notice]:
        """Return the remarks since the last call, in order."""
        taken, self._notices = self._notices, []
        return taken

    def _reply(self, replies: list[Reply]) -> None:
        for reply in replies:
            data = self._end.send(reply)
            room = OUTPUT_LIMIT - len(self._output)
            if len(data) > room:
                self._own["reply_bytes_dropped"] += len(data) - room
            self._output += data[:room]

    def _collect(self) -> None:
        for latch in self._unit.take_latches():
            counters = self._end.counters + self._unit.counters
            counted = {
                kind: count - self._counted[kind]
                for kind, count in counters.items()
                if count != self._counted[kind]
            }
            self._counted = counters
            self._latches.append(
                dataclasses.replace(
                    latch,
                    number=self._latched,
                    counted=counted,
                    radiated=latch.pulses.weights()[self._channels],
                )
            )
            self._latched += 1

    def _say_clues(self) -> None:
        """Say once for each client what its frames have in common with no frame of this board."""
        for kind, clue in _CLUES.items():
            if kind in self._clues and self._end.counters[kind] > self._clue_counts[kind]:
                self._clues.discard(kind)
                self._remark(clue)

    def _keep_first_bytes(self, data: bytes) -> None:
        if self._first_bytes is None:
            return
        self._first_bytes += data[: LOOKED_AT_BYTES - len(self._first_bytes)]
        if len(self._first_bytes) == LOOKED_AT_BYTES:
            self._recognise(bytes(self._first_bytes))

    def _look_at_silence(self) -> None:
        """Say if what came before the silence is a part of a frame, or looks like another wire."""
        self._quiet_us = None
        if self._end.pending:
            self._own["frames_unfinished"] += 1
            self._remark(f"a frame stops in its middle: {self._end.pending} bytes have no end")
        if self._first_bytes:
            self._recognise(bytes(self._first_bytes))

    def _recognise(self, first_bytes: bytes) -> None:
        """Say once for each client that its bytes look like another wire."""
        self._first_bytes = None
        names = looks_like_dialect(first_bytes)
        if names and self._dialect.name not in names:
            self._own["other_wires"] += 1
            self._remark(
                f"these bytes look like {' or '.join(names)}, not {self._dialect.name}: "
                "choose the dialect that the client speaks"
            )

    def _remark(self, text: str) -> None:
        self._notices.append(Remark(self._now_us, text))

"""The records of a board that runs: read as they come, and waited for."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from haptogram.evidence import backdoor
from haptogram.evidence.backdoor_stream import BackdoorReader
from haptogram.evidence.dialects.latches import has_dialect_latched_all
from haptogram.records.frame import FrameKey, Intended

_POLL_S: Final = 0.01
_QUIET_S: Final = 15.0  # without a new record: the one that is waited for will not come
_LAST_WORDS_S: Final = 3.0  # the same, of a board that has ended: nothing holds its writer up


class BoardRecords:
    """Reads the back door of a board, and waits for its records.

    Parameters
    ----------
    path : Path
        File that the board appends to.
    is_running : callable
        Returns whether the board runs.
    now_s, sleep : callable
        The clock on which the board is waited for.

    Attributes
    ----------
    records : list of dict
        Those that were read.
    """

    def __init__(
        self,
        path: Path,
        *,
        is_running: Callable[[], bool],
        now_s: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        path.touch()
        self.records: list[dict[str, Any]] = []
        self._stream = BackdoorReader(str(path))
        self._is_running, self._now_s, self._sleep = is_running, now_s, sleep

    def read(self) -> list[dict[str, Any]]:
        """Return all records so far."""
        while self._stream.is_open and (found := self._stream.read()):
            self.records += found
        return self.records

    def close(self) -> None:
        """Read what there is, and close the back door."""
        self.read()
        self._stream.close()

    def wait_for_latches(self, count: int, timeout_s: float) -> bool:
        """Wait for *count* latches; return whether they came before the end and *timeout_s*."""
        end_s = self._now_s() + timeout_s
        while sum(record["kind"] in backdoor.LATCHES for record in self.read()) < count:
            if self._now_s() > end_s or self._is_closed:
                return False
            self._sleep(_POLL_S)
        return True

    def wait_for_latch(self, key: FrameKey) -> str | None:
        """Wait for the latch with this *key*, for the end, or until the board falls silent.

        Returns
        -------
        str or None
            Why latches of its session may be missing; None: none is.
        """
        looked_at = 0

        def is_there() -> bool:
            nonlocal looked_at
            new = self.records[looked_at:]
            looked_at += len(new)
            return any(backdoor.is_observed_latch_of(record, key) for record in new)

        self._read_until(is_there)
        return backdoor.why_observations_incomplete(self.records, key.session, key)

    def wait_for_all(self, intended: Sequence[Intended]) -> str | None:
        """Wait for a latch of each frame of *intended* on a board that numbers none.

        Returns
        -------
        str or None
            As :meth:`wait_for_latch`.
        """
        self._read_until(lambda: has_dialect_latched_all(intended, self.records))
        if has_dialect_latched_all(intended, self.records):
            return None
        return backdoor.why_observations_incomplete(self.records)

    def read_to_the_end(self, progress: Callable[[int], None] | None = None) -> None:
        """Read until the end record, or until the board falls silent.

        Parameters
        ----------
        progress : callable, optional
            Called with the number of records so far.
        """
        self._read_until(lambda: False, progress)

    def _read_until(
        self, enough: Callable[[], bool], progress: Callable[[int], None] | None = None
    ) -> None:
        """Read until *enough* returns True, or until no more records are expected."""
        quiet_since_s = self._now_s()
        while True:
            count = len(self.records)
            if len(self.read()) > count:
                quiet_since_s = self._now_s()
                if progress is not None:
                    progress(len(self.records))
            if enough() or self._is_closed:
                return
            patience_s = _QUIET_S if self._is_running() else _LAST_WORDS_S
            if self._now_s() - quiet_since_s > patience_s:
                return
            self._sleep(_POLL_S)

    @property
    def _is_closed(self) -> bool:
        """Return True once the end record has been received."""
        records = self.records
        return bool(records) and records[-1]["kind"] == "end"

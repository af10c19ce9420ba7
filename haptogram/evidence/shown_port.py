"""A board at a port that is emulated: what it latches is seen through its back door."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final, Self

from haptogram.driver.driver import Driver
from haptogram.evidence.backdoor import (
    board_model_of_evidence,
    why_observations_incomplete,
)
from haptogram.evidence.backdoor_stream import BackdoorReader
from haptogram.evidence.boards import BoardUnderTest, DriverEvidence
from haptogram.evidence.dialects.latches import (
    are_records_of_another_dialect,
    has_dialect_latched_all,
)
from haptogram.records.frame import Observation
from haptogram.settings.arguments import Progress

_LAST_S: Final = 10.0  # wait for the last latch records
_QUEUE_S: Final = 2.0
_POLL_S: Final = 0.01


class ShownPortBoardUnderTest(BoardUnderTest):
    """A board started elsewhere, at a port, seen through its back door.

    Parameters
    ----------
    url : str
        Its port.
    reader : BackdoorReader
        Its back door.

    Attributes
    ----------
    unseen : str or None
        Why it may have latched what it did not show.

    Raises
    ------
    ConfigurationError
        The back door tells nothing.
    """

    def __init__(self, url: str, reader: BackdoorReader) -> None:
        super().__init__(f"{url}, seen through its back door", url)
        self._reader = reader
        self._records: list[Mapping[str, Any]] = [*reader.read_first()]
        self.model = board_model_of_evidence(self._records[0])
        while self._read():
            pass
        if are_records_of_another_dialect(self._records):
            del self._records[1:]  # of clients before; frames of other boards carry no number

    @classmethod
    @contextmanager
    def opened(cls, url: str, source: str) -> Iterator[Self]:
        """Open the back door at *source* and give the board."""
        with BackdoorReader(source) as reader:
            yield cls(url, reader)

    @property
    def fault_counts(self) -> dict[str, int] | None:
        """None: it has not ended."""
        return None

    def wait_for_queue(self, driver: Driver) -> None:  # noqa: ARG002  it cannot tell any more
        """Wait for the frames that the board still has."""
        time.sleep(_QUEUE_S)

    def observations(
        self,
        driver: DriverEvidence,
        progress: Progress | None = None,
        *,
        skip_fields: bool = False,  # noqa: ARG002  the board decides
    ) -> Sequence[Observation]:
        """Return the latches of the session, when all that are due have come, or after 10 s."""
        end_s, total = time.monotonic() + _LAST_S, driver.intended.total
        while (why := self._why_incomplete(driver)) is not None and time.monotonic() < end_s:
            self._read()
            if progress is not None:
                progress(min(len(self._records), total), total)
        self.unseen = why
        return super().observations(driver)

    def records(self) -> Sequence[Mapping[str, Any]]:
        """Return the records so far."""
        return self._records

    def _why_incomplete(self, driver: DriverEvidence) -> str | None:
        if are_records_of_another_dialect(self._records):
            if has_dialect_latched_all(driver.intended, self._records):
                return None
            return "the back door has told fewer latches than frames were sent"
        last = driver.intended[-1].key if driver.intended else None
        return why_observations_incomplete(self._records, driver.session, last)

    def _read(self) -> bool:
        """Read new records; return False after a short sleep if there are none."""
        if found := self._reader.read():
            self._records += found
            return True
        time.sleep(_POLL_S)
        return False

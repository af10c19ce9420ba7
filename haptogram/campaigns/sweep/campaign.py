"""A sweep from its first point to its last: on many workers, in several sittings, interrupted."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Self, TextIO, TypeAlias

import haptogram
from haptogram.errors import (
    ConfigurationError,
    LinkError,
    plain_reason,
    refusing_other_content,
    writing_file,
)
from haptogram.machine.files import write_file_atomically
from haptogram.settings.text_file import read_text_file

from .plan import SweepPlan
from .rows import Row, row_of_crash, row_of_point
from .workers import Workers

_TRIES: Final = 3  # attempts at a point whose worker dies
_MOST_JOURNAL: Final = 1 << 34  # most characters of a journal

#: Runs the words of a command; returns exit status, result as JSON, and text on standard error.
RunWords: TypeAlias = Callable[[Sequence[str]], tuple[int, bytes, str]]
#: Gives workers, and others when one of them has died.
OpenWorkers: TypeAlias = Callable[[], AbstractContextManager[Workers]]
_Running: TypeAlias = "dict[Future[tuple[int, bytes, str]], int]"


@dataclass
class SweepCampaign:
    """A sweep and how far it has come.

    Attributes
    ----------
    plan : SweepPlan
    journal : Path or None
        A line for every row, written as soon as there is one.
    rows : dict of int to Row
        The points that are done, by number.
    """

    plan: SweepPlan
    journal: Path | None = None
    rows: dict[int, Row] = field(default_factory=dict)
    _suspects: list[int] = field(default_factory=list)  # which one of them ends its worker?
    _deaths: Counter[int] = field(default_factory=Counter)

    @classmethod
    def load(cls, plan: SweepPlan, journal: Path | None) -> Self:
        """Continue the campaign of *journal*; start a new one if there is no such file.

        Raises
        ------
        ConfigurationError
            If it holds something else, or another sweep.
        """
        campaign = cls(plan, journal)
        if journal is None or not journal.exists():
            return campaign
        head, *lines = read_text_file(journal, "rows", _MOST_JOURNAL).split("\n")
        if head != campaign._head:
            raise ConfigurationError(
                f"{journal} is of another sweep, or of another version: remove it to begin anew"
            )
        with refusing_other_content(f"{journal} is damaged: remove it to begin anew"):
            for line in lines[:-1]:  # the last one was cut off, if it is not empty
                row = json.loads(line)
                number = range(len(plan)).index(row["point"])
                if not row.keys() >= row_of_crash(plan[number], "").keys():
                    raise ValueError(line)
                campaign.rows[number] = row
        return campaign

    @property
    def _head(self) -> str:
        """Return the first line of the result file: version and plan."""
        about = {"kind": "haptogram sweep", "version": haptogram.__version__}
        return json.dumps(about | {"sweep": self.plan.document}, default=str)

    @property
    def is_complete(self) -> bool:
        """True if every point is done."""
        return len(self.rows) == len(self.plan)

    @property
    def rows_in_order(self) -> list[Row]:
        """The rows by the numbers of their points."""
        return [self.rows[number] for number in sorted(self.rows)]

    def run(self, run_words: RunWords, open_workers: OpenWorkers, show: Callable[[], None]) -> None:
        """Run the points that are left; *show* is called when some are done.

        Raises
        ------
        ConfigurationError
            If the rows so far cannot be kept.
        LinkError
            If the scheduler of the workers has gone.
        """
        with ExitStack() as stack:
            file = None
            if self.journal is not None:
                stack.enter_context(writing_file(self.journal))
                rows = [json.dumps(row) for row in self.rows_in_order]
                write_file_atomically(self.journal, "\n".join([self._head, *rows, ""]).encode())
                file = stack.enter_context(self.journal.open("a", encoding="ascii"))
            left = [n for n in reversed(range(len(self.plan))) if n not in self.rows]
            while left or self._suspects:
                running: _Running = {}
                try:
                    with open_workers() as workers:
                        self._feed(workers, run_words, left, running, file, show)
                except BrokenExecutor:
                    self._mark_suspects(list(running.values()), file)

    def _feed(
        self,
        workers: Workers,
        run_words: RunWords,
        left: list[int],
        running: _Running,
        file: TextIO | None,
        show: Callable[[], None],
    ) -> None:
        """Run the points *left* on workers, write their rows; a suspect of killing runs alone.

        A suspect is a point that was under way when a worker died. *file*: the journal, None for
        none; *show* is called as points end.
        """
        while left or self._suspects or running:
            count = 1 if self._suspects else workers.count
            while (self._suspects or left) and len(running) < count:
                number = (self._suspects or left)[-1]
                running[workers.executor.submit(run_words, self.plan[number].words)] = number
                (self._suspects or left).pop()
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                self._keep(running[future], future, file)
                del running[future]
            show()

    def _keep(
        self, number: int, future: Future[tuple[int, bytes, str]], file: TextIO | None
    ) -> None:
        """Write the row of a point that ended or raised; raise if its worker or the scheduler died.

        That is BrokenExecutor for the worker, LinkError for the scheduler.
        """
        try:
            error = future.exception()
        except CancelledError:
            raise LinkError("the scheduler has gone, and its workers with it") from None
        if error is None:
            self._write(row_of_point(self.plan[number], *future.result()), file)
        elif not isinstance(error, BrokenExecutor):
            text = f"{type(error).__name__}: {plain_reason(error)}"
            self._write(row_of_crash(self.plan[number], text), file)
        else:
            raise error

    def _mark_suspects(self, numbers: list[int], file: TextIO | None) -> None:
        """Mark the points under way when a worker died: each of them runs again, alone.

        One whose worker died three times alone gets a row of a crash.
        """
        if len(numbers) == 1:
            self._deaths[numbers[0]] += 1
        for number in numbers:
            if self._deaths[number] < _TRIES:
                self._suspects.append(number)
            else:
                text = f"its worker died, {_TRIES} times"
                self._write(row_of_crash(self.plan[number], text), file)

    def _write(self, row: dict[str, Any], file: TextIO | None) -> None:
        """Keep a row, and append it to the journal *file* at once, if there is one."""
        self.rows[row["point"]] = row
        if file is not None:
            print(json.dumps(row), file=file, flush=True)

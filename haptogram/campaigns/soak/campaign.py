"""A soak from its first segment to its last: in parallel, in several sittings, interrupted."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias

from haptogram.errors import ConfigurationError, HaptogramError
from haptogram.machine.files import write_json_file
from haptogram.settings.text_file import read_json_file

from .account.tally import MEMORY_GREW, SoakTally
from .memory import SoakMemory, resident_soak_bytes
from .segment import MakeBoard, run_soak_segment
from .setup import SoakSetup

if TYPE_CHECKING:
    from haptogram.evidence.recordings.writer import RecordingWriter

VERSION: Final = 2

#: Called with the virtual seconds that are done, of this segment and those before it.
Progress: TypeAlias = Callable[[float], None]
_Done: TypeAlias = tuple[SoakTally, int, int]  # with process id and memory


class Interrupted(HaptogramError):
    """The soak was interrupted between two segments; what is done is kept."""


@dataclass(slots=True)
class SoakCampaign:
    """A soak and how far it has come.

    Attributes
    ----------
    setup : SoakSetup
    done : int
        Segments that are in the account: the first ones.
    tally : SoakTally
        The account.
    memory : SoakMemory
        Of every process that took part.
    spent_s : float
        Wall-clock time, all sittings together.
    """

    setup: SoakSetup
    done: int = 0
    tally: SoakTally = field(default_factory=SoakTally)
    memory: SoakMemory = field(default_factory=SoakMemory)
    spent_s: float = 0.0

    @classmethod
    def load(cls, path: Path, setup: SoakSetup) -> Self:
        """Go on with what *path* holds; begin anew if there is no such file.

        Raises
        ------
        ConfigurationError
            If it holds something else, or another soak.
        """
        if not path.exists():
            return cls(setup)
        state = read_json_file(path, "resume")
        try:
            known = state["kind"], state["version"]
        except (KeyError, TypeError) as error:
            raise ConfigurationError(f"{path} is no checkpoint of a soak") from error
        if known != ("haptogram soak", VERSION):
            raise ConfigurationError(f"{path} is no checkpoint of a soak of version {VERSION}")
        for name, value in setup.as_dict().items():
            if state["setup"].get(name) != value:
                before = state["setup"].get(name)
                raise ConfigurationError(f"{path} is of another soak: {name} {before}, not {value}")
        return cls(
            setup,
            state["done"],
            SoakTally.from_dict(state["tally"]),
            SoakMemory.from_dict(state["memory"]),
            state["spent_s"],
        )

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        return {
            "kind": "haptogram soak",
            "version": VERSION,
            "setup": self.setup.as_dict(),
            "segments": self.setup.segments,
            "interval_s": self.setup.interval_s,
            "done": self.done,
            "spent_s": round(self.spent_s, 3),
            "times_real_time": round(self.times_real_time, 3),
            "memory": self.memory.as_dict(),
            "tally": self.tally.as_dict(),
        }

    def save(self, path: Path) -> None:
        """Write the checkpoint: as a whole, or not at all."""
        write_json_file(path, self.as_dict())

    @property
    def done_s(self) -> float:
        """Virtual time that is in the account."""
        return self.setup.start_s(self.done)

    @property
    def times_real_time(self) -> float:
        """Speed over all sittings."""
        return self.done_s / self.spent_s if self.spent_s else 0.0

    @property
    def is_complete(self) -> bool:
        """True if every segment is in the account."""
        return self.done == self.setup.segments

    @property
    def failures(self) -> dict[str, int]:
        """Counts of the events that must not happen, by name."""
        grown = {MEMORY_GREW: 1} if self.memory.grown_bytes is not None else {}
        return dict(sorted(self.tally.violations.items())) | grown

    def run(
        self,
        make_board: MakeBoard,
        *,
        jobs: int = 1,
        checkpoint: Path | None = None,
        progress: Progress | None = None,
        writer: RecordingWriter | None = None,
    ) -> None:
        """Run the segments that are left.

        Parameters
        ----------
        make_board : callable
            Powers a board up; another process must be able to import it.
        jobs : int
            Processes.
        checkpoint : Path or None
            Written after every segment.
        writer : RecordingWriter, optional
            The recording of what happens around violations.

        Raises
        ------
        Interrupted
            At a KeyboardInterrupt; the segments under way are lost, those before are kept.
        """
        self.memory.begin_sitting()
        try:
            with self._segments(make_board, jobs, progress, writer is not None) as segments:
                since_s = time.monotonic()
                for tally, process, resident in segments:
                    if writer is not None:
                        for excerpt in tally.excerpts:
                            excerpt.write(writer, round(self.done_s * 1e9))
                    merged = self.tally.plus(tally)  # an interrupt finds the one or the other
                    self.tally, self.done = merged, self.done + 1
                    self.memory.add(process, resident)
                    now_s = time.monotonic()
                    self.spent_s, since_s = self.spent_s + now_s - since_s, now_s
                    if checkpoint is not None:
                        self.save(checkpoint)
                    if progress is not None:
                        progress(self.done_s)
        except KeyboardInterrupt as interrupt:
            raise Interrupted from interrupt

    @contextmanager
    def _segments(
        self, make_board: MakeBoard, jobs: int, progress: Progress | None, recorded: bool
    ) -> Iterator[Iterator[_Done]]:
        """Give the results of the segments that are left, in order."""
        numbers = range(self.done, self.setup.segments)
        if jobs == 1:
            yield (
                _run_soak_worker(make_board, self.setup, number, progress, recorded=recorded)
                for number in numbers
            )
            return
        # Spawned, not forked: no process inherits threads or memory of this one.
        with multiprocessing.get_context("spawn").Pool(jobs, _leave_interrupts_to_soak) as pool:
            yield pool.imap(_Work(make_board, self.setup, recorded), numbers)


@dataclass(frozen=True, slots=True)
class _Work:
    """The work of a process of the pool: one segment for each call."""

    make_board: MakeBoard
    setup: SoakSetup
    recorded: bool

    def __call__(self, number: int) -> _Done:
        return _run_soak_worker(self.make_board, self.setup, number, None, recorded=self.recorded)


def _run_soak_worker(
    make_board: MakeBoard,
    setup: SoakSetup,
    number: int,
    progress: Progress | None,
    *,
    recorded: bool,
) -> _Done:
    start_s = setup.start_s(number)
    tally = run_soak_segment(
        make_board,
        seed=setup.seed,
        number=number,
        seconds=setup.length_s(number),
        start_s=start_s,
        fault_rate=setup.fault_rate,
        interval_s=setup.interval_s,
        progress=None if progress is None else lambda done_s: progress(start_s + done_s),
        recorded=recorded,
    )
    return tally, os.getpid(), resident_soak_bytes()


def _leave_interrupts_to_soak() -> None:
    """Leave Ctrl-C to the process that owns the pool."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

"""A soak from its first segment to its last: in parallel, in several sittings, interrupted."""

from __future__ import annotations

import functools
import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias

from haptogram.errors import ConfigurationError, refusing_other_content
from haptogram.machine.files import write_json_file
from haptogram.machine.process import resident_bytes
from haptogram.settings.text_file import read_json_file

from ..sweep.workers import process_workers
from .comparison import MakeBoard
from .segment import Progress, run_soak_segment
from .setup import SoakSetup
from .tally import MEMORY_GREW, SoakTally, checked_soak_counts

if TYPE_CHECKING:
    from haptogram.evidence.recordings.writer import RecordingWriter

VERSION: Final = 3
_HEADER: Final = {"kind": "haptogram soak", "version": VERSION}
GROWTH_LIMIT_BYTES: Final = 32 << 20  # a byte lost per frame would be 82 MiB a day

_Done: TypeAlias = tuple[SoakTally, int, int]  # with process id and memory


@dataclass(slots=True)
class SoakMemory:
    """Resident memory of every process, after its first segment and after its last one.

    Attributes
    ----------
    processes : dict
        By sitting and process: number of segments, first, last and largest sample in bytes.
    """

    processes: dict[str, dict[str, int]] = field(default_factory=dict)
    _sitting: int = 0

    @classmethod
    def of(cls, processes: dict[str, dict[str, int]]) -> Self:
        """Return the memory of a checkpoint; ValueError: it is none."""
        for name, samples in processes.items():
            int(name.split("/")[0])
            checked_soak_counts(samples, ("segments", "first", "last", "most"))
        return cls(processes)

    def begin_sitting(self) -> None:
        """Take samples of new processes from now on."""
        self._sitting = 1 + max((int(name.split("/")[0]) for name in self.processes), default=0)

    def add(self, process: int, resident: int) -> None:
        """Take a sample, after a segment."""
        new = {"segments": 0, "first": resident, "most": 0}
        own = self.processes.setdefault(f"{self._sitting}/{process}", new)
        own["segments"] += 1
        own["last"] = resident
        own["most"] = max(own["most"], resident)

    @property
    def growth_bytes(self) -> int:
        """By how much the process that grew most has grown since its first segment."""
        return max((own["last"] - own["first"] for own in self.processes.values()), default=0)


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
        """Continue the campaign of *path*; start a new one if there is no such file.

        Raises
        ------
        ConfigurationError
            If it holds something else, or another soak.
        """
        if not path.exists():
            return cls(setup)
        state = read_json_file(path, "resume")
        with refusing_other_content(f"{path} is no checkpoint of a soak of version {VERSION}"):
            if state | _HEADER != state:
                raise ValueError
            for key, value in setup.as_dict().items():
                if (old := state["setup"].get(key)) != value:
                    raise ConfigurationError(f"{path} is of another soak: {key} {old}, not {value}")
            tally, memory = SoakTally.from_dict(state["tally"]), SoakMemory.of(state["memory"])
            done, spent_s = state["done"], float(state["spent_s"])
            if type(done) is not int or not 0 <= done <= setup.segments or not 0 <= spent_s < inf:
                raise ValueError
            return cls(setup, done, tally, memory, spent_s)

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        return {
            **_HEADER,
            "setup": self.setup.as_dict(),
            "segments": self.setup.segments,
            "interval_s": self.setup.interval_s,
            "done": self.done,
            "spent_s": round(self.spent_s, 3),
            "times_real_time": round(self.times_real_time, 3),
            "memory": self.memory.processes,
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
        grown = {MEMORY_GREW: 1} if self.memory.growth_bytes > GROWTH_LIMIT_BYTES else {}
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
        KeyboardInterrupt
            The segments under way are lost, those before are kept.
        """
        self.memory.begin_sitting()
        told = progress if jobs == 1 else None
        run = functools.partial(_run_soak_worker, make_board, self.setup, told, writer is not None)
        mapping: Callable[..., Iterator[_Done]] = map
        with ExitStack() as stack:
            if jobs > 1:
                mapping = stack.enter_context(process_workers(jobs)).executor.map
            since_s = time.monotonic()
            for tally, process, resident in mapping(run, range(self.done, self.setup.segments)):
                if writer is not None:
                    for excerpt in tally.excerpts:
                        excerpt.write(writer, round(self.done_s * 1e9))
                # An interrupt finds the one or the other.
                self.tally, self.done = self.tally.plus(tally), self.done + 1
                self.memory.add(process, resident)
                now_s = time.monotonic()
                self.spent_s, since_s = self.spent_s + now_s - since_s, now_s
                if checkpoint is not None:
                    self.save(checkpoint)
                if progress is not None:
                    progress(self.done_s)


def _run_soak_worker(
    make_board: MakeBoard, setup: SoakSetup, progress: Progress | None, recorded: bool, number: int
) -> _Done:
    """Run segment *number*; return its tally, the worker's process id and its memory in bytes.

    *recorded*: whether the tally keeps excerpts of the dialogue around violations.
    """
    tally = run_soak_segment(make_board, setup, number, progress, recorded=recorded)
    return tally, os.getpid(), resident_bytes()

"""Growth of the memory of the processes."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Self

from haptogram.machine.posix import posix_module

GROWTH_LIMIT_BYTES: Final = 32 << 20  # a byte lost per frame would be 82 MiB a day
_STATM: Final = Path("/proc/self/statm")


def resident_soak_bytes() -> int:
    """Return the resident memory of this process; where the system does not tell, its largest."""
    try:
        return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        resource = posix_module("resource", "the memory of a soak", "a POSIX system for it")
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return int(most) if sys.platform == "darwin" else int(most) * 1024


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

    def begin_sitting(self) -> None:
        """Take samples of new processes from now on."""
        self._sitting = 1 + max((int(name.split("/")[0]) for name in self.processes), default=0)

    def add(self, process: int, resident: int) -> None:
        """Take a sample, after a segment."""
        own = self.processes.setdefault(
            f"{self._sitting}/{process}", {"segments": 0, "first": resident, "most": 0}
        )
        own["segments"] += 1
        own["last"] = resident
        own["most"] = max(own["most"], resident)

    @property
    def growth_bytes(self) -> int:
        """By how much the process that grew most has grown since its first segment."""
        return max((own["last"] - own["first"] for own in self.processes.values()), default=0)

    @property
    def grown_bytes(self) -> int | None:
        """The same, if it is more than is allowed."""
        return self.growth_bytes if self.growth_bytes > GROWTH_LIMIT_BYTES else None

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON can hold it."""
        return self.processes

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Return the object that :meth:`as_dict` has written."""
        return cls(dict(data))

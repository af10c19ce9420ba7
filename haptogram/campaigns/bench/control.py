"""The control loop: an idle loop in a process of its own beside the measured loop.

Its lateness is the noise floor of the machine at this moment.  A stall of both loops at once is the
machine's, so a late frame can be attributed to the machine or to the program.
"""

from __future__ import annotations

import array
import os
import subprocess
import sys
from types import TracebackType
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from haptogram.campaigns.bench.percentiles import percentiles_with_missed_ticks
from haptogram.errors import ConfigurationError

_STALL_NS: Final = 100_000  # lateness from which on the control loop counts as stalled
_STOP_S: Final = 10.0

#: The program imports the standard library alone: more would run beside the measured loop.
_PROGRAM: Final = """
import array, ctypes, gc, os, signal, sys, time
period_ns, count = int(sys.argv[1]), int(sys.argv[2])
stopping = []
signal.signal(signal.SIGTERM, lambda *_: stopping.append(1))
signal.signal(signal.SIGINT, signal.SIG_IGN)
if sys.platform.startswith("linux"):
    ctypes.CDLL(None).prctl(29, ctypes.c_ulong(1), 0, 0, 0)
gc.disable()
clock, sleep = time.monotonic_ns, time.sleep
found = array.array("q", bytes(16 * count))
os.write(1, b"ready")
deadline, n = clock() + period_ns // 2, 0
while n < count and not stopping:
    wait = deadline - clock()
    if wait > 0:
        sleep(wait / 1e9)
    now = clock()
    found[2 * n], found[2 * n + 1] = deadline, now
    n += 1
    deadline += period_ns * (max(0, now - deadline) // period_ns + 1)
sys.stdout.buffer.write(found[: 2 * n].tobytes())
"""


class NoiseFloorLoop:
    """Run the control loop from entering to leaving the ``with`` block.

    Parameters
    ----------
    period_ns : int
        Period of the ticks, in nanoseconds: that of the measured loop.
    seconds : float
        Longest duration, in seconds.

    Attributes
    ----------
    deadline_ns, wake_ns : (n,) numpy.ndarray of int
        Times of each tick on the monotonic clock, in nanoseconds; empty inside the block.
    """

    def __init__(self, period_ns: int, seconds: float) -> None:
        self._period_ns = period_ns
        count = int(seconds * 1e9 / period_ns) + 1
        self._command = [sys.executable, "-I", "-c", _PROGRAM, str(period_ns), str(count)]
        self.deadline_ns: NDArray[np.int64] = np.zeros(0, np.int64)
        self.wake_ns: NDArray[np.int64] = np.zeros(0, np.int64)

    def __enter__(self) -> Self:
        self._process: subprocess.Popen[bytes] = subprocess.Popen(
            self._command, stdout=subprocess.PIPE
        )
        assert self._process.stdout is not None
        if os.read(self._process.stdout.fileno(), 5) != b"ready":
            raise ConfigurationError(f"the control loop did not start: try {self._command[0]} -I")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._process.terminate()
        try:
            data, _ = self._process.communicate(timeout=_STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            data, _ = self._process.communicate()
        rows = np.array(array.array("q", data[: len(data) // 16 * 16]), np.int64).reshape(-1, 2)
        self.deadline_ns, self.wake_ns = rows[:, 0], rows[:, 1]

    @property
    def lateness_us(self) -> NDArray[np.float64]:
        """Lateness of each tick, (n,) in microseconds; missed ticks are included."""
        return percentiles_with_missed_ticks(
            (self.wake_ns - self.deadline_ns) / 1e3, self._period_ns / 1e3
        )

    def stalled(self, begin_ns: NDArray[np.int64], end_ns: NDArray[np.int64]) -> Any:
        """Return, for each of (n,) spans of time, whether the control loop stalled within it."""
        slow = self.wake_ns - self.deadline_ns > _STALL_NS
        starts, ends = self.deadline_ns[slow], self.wake_ns[slow]
        # Stalls do not overlap: the last one that began before the end of a span decides.
        last = np.searchsorted(starts, end_ns) - 1
        known = np.concatenate([ends, [np.iinfo(np.int64).min]])
        return known[last] > begin_ns

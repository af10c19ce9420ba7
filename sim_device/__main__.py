"""``python -m sim_device``: a virtual board on a pseudo-terminal, a TCP port or a serial port."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from .backdoor.line_tap import OpenRecording

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def main(
    words: Sequence[str] | None = None,
    program: str | None = None,
    open_recording: OpenRecording | None = None,
) -> int:
    """Settle the signals and, before numpy is imported, the number of threads; run the board."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _leave)  # until the board runs: what is open is closed
    # A real-time process that computes on two threads waits for the second one.
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    from .command.command import PROGRAM
    from .command.command import main as run

    return run(sys.argv[1:] if words is None else words, program or PROGRAM, open_recording)


def _leave(*_: object) -> NoReturn:
    raise SystemExit(0)


if __name__ == "__main__":
    sys.exit(main())

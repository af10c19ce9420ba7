"""The entry point of the command line: answers Ctrl-C in one line before anything is loaded.

It imports nothing but what every interpreter has loaded already, so that the time in which Python
itself would answer, with a traceback, is short.
"""

from __future__ import annotations

import _signal  # type: ignore[import-not-found]  # of signal, the part that is built in
import os
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence

_NOTHING_JUDGED = 2  # of a fault in this program; 1, that of the interpreter, is a verdict
_INTERRUPTED = 130
_BOARD = "board"  # exits with 0 on a signal


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line *argv* and return its exit status."""
    if _signal.getsignal(_signal.SIGINT) is _signal.SIG_IGN:  # started in the background
        return _run_after_start(argv)
    _signal.signal(_signal.SIGINT, _leave_at_start)
    try:
        return _run_after_start(argv)
    finally:
        # The verdict is printed: an interrupt now would only disturb the exit of the interpreter.
        _signal.signal(_signal.SIGINT, _signal.SIG_IGN)
        exec("")  # an interrupt that came within an exec, of dataclasses say, would be our status


def _run_after_start(argv: Sequence[str] | None) -> int:
    """Load the program, run it and return its exit status; _NOTHING_JUDGED after an error."""
    from .cli import main as run

    try:
        return run(argv)
    except Exception:
        sys.excepthook(*sys.exc_info())
        return _NOTHING_JUDGED


def _leave_at_start(*_: object) -> None:
    """Exit at once: nothing has to be closed while modules load."""
    command = " ".join(["haptogram", *sys.argv[1:2]])
    os.write(2, f"{command}: interrupted\n".encode(errors="replace"))
    os._exit(0 if sys.argv[1:2] == [_BOARD] else _INTERRUPTED)

"""``python -m sim_device``: a virtual board on a pseudo-terminal, a TCP port or a serial port."""

from __future__ import annotations

import _signal  # type: ignore[import-not-found]  # of signal, the part that is built in
import os
import sys

TYPE_CHECKING = False  # without typing: the sooner Ctrl-C is answered
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from signal import Handlers
    from sys import UnraisableHookArgs
    from typing import NoReturn

    from .backdoor.line_tap import OpenRecording

_ENDINGS = (_signal.SIGINT, _signal.SIGTERM, _signal.SIGHUP)
_AGAIN_S = 0.02
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def main(
    words: Sequence[str] | None = None,
    program: str | None = None,
    open_recording: OpenRecording | None = None,
) -> int:
    """Settle the signals and, before numpy is imported, the number of threads; run the board."""
    _answer_signals(_leave)  # until the board runs: what is open is closed
    sys.unraisablehook = _leave_after_callback
    # A real-time process that computes on two threads waits for the second one.
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    from .command.command import PROGRAM
    from .command.command import main as run

    return run(sys.argv[1:] if words is None else words, program or PROGRAM, open_recording)


def _answer_signals(handler: Handlers | Callable[..., object]) -> None:
    """Install a handler for SIGINT, SIGTERM and SIGHUP; an ignored SIGHUP stays ignored."""
    for number in _ENDINGS:
        # SIGHUP stays ignored below nohup; SIGINT ends a board that a script started beside it.
        if number != _signal.SIGHUP or _signal.getsignal(number) is not _signal.SIG_IGN:
            _signal.signal(number, handler)


def _leave(*_: object) -> NoReturn:
    """Exit on a signal; ignore further ones while the board closes."""
    _answer_signals(_signal.SIG_IGN)  # another one would cut short what the first one closes
    raise SystemExit(0)


def _leave_after_callback(unraisable: UnraisableHookArgs) -> None:
    """End the program anew if a callback of Python swallowed the exit that a signal asked for."""
    import threading

    if unraisable.exc_type is SystemExit:
        _answer_signals(_leave)
        main_thread = threading.main_thread().ident  # whose wait must end, not that of the timer
        threading.Timer(_AGAIN_S, _signal.pthread_kill, (main_thread, _signal.SIGTERM)).start()
    else:
        sys.__unraisablehook__(unraisable)


if __name__ == "__main__":
    sys.exit(main())

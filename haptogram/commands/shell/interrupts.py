"""Ctrl-C: heard whatever the program is at, and over with at once."""

from __future__ import annotations

import _thread
import atexit
import contextlib
import gc
import signal
import sys
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

_AGAIN_S: Final = 0.02


@contextlib.contextmanager
def hear_interrupts_in_callbacks() -> Iterator[None]:
    """Repeat an interrupt that came inside a callback of a library, where it is dropped.

    The loader of compiled code calls back for every function that it takes from its cache.
    """
    before = sys.unraisablehook

    def hook(unraisable: UnraisableHookArgs) -> None:
        if unraisable.exc_type is KeyboardInterrupt:
            # Later, since what is raised in here is dropped as well.
            threading.Timer(_AGAIN_S, _interrupt_main_thread).start()
        else:
            before(unraisable)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before


def _interrupt_main_thread() -> None:
    """Raise Ctrl-C in the main thread by a signal, which also ends a call that blocks there."""
    if sys.platform == "win32" or (main_thread := threading.main_thread().ident) is None:
        _thread.interrupt_main()
    else:
        signal.pthread_kill(main_thread, signal.SIGINT)


def exit_at_once() -> None:
    """Let the interpreter end without looking for cycles among all objects once more.

    Compilers and pictures make hundreds of thousands of them: a second that nobody waits for.
    """
    atexit.unregister(gc.freeze)
    atexit.register(gc.freeze)

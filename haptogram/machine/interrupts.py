"""Interrupts that wait until a step is whole: Ctrl-C, SIGTERM, SIGHUP."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any, Final

#: Signals that end a program, in the order of their handling: the handler of Ctrl-C raises.
_ENDINGS: Final = tuple(
    getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGINT") if hasattr(signal, name)
)


class DelayedInterrupts:
    """A context whose steps no interrupt cuts in two: one that comes inside is heard at the end.

    The signals keep their handlers, which are called later. A mask of signals would not do: the
    system gives a signal of the process to any other thread, and Python runs its handler in the
    main thread all the same.

    Examples
    --------
    >>> before = signal.signal(signal.SIGINT, signal.default_int_handler)
    >>> interrupts = DelayedInterrupts()
    >>> interrupts.install()
    >>> try:
    ...     with interrupts:
    ...         signal.raise_signal(signal.SIGINT)
    ...         print("whole")
    ... except KeyboardInterrupt:
    ...     print("interrupted")
    ... finally:
    ...     interrupts.remove()
    ...     _ = signal.signal(signal.SIGINT, before)
    whole
    interrupted
    """

    def __init__(self) -> None:
        self._handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
        self._came: list[int] = []
        self._is_inside = False

    def install(self) -> None:
        """Take the place of the handlers; nothing in another thread than the main one."""
        if threading.current_thread() is not threading.main_thread():
            return  # no handler runs there
        for number in _ENDINGS:
            handler = signal.getsignal(number)
            if callable(handler):  # neither ignored nor left to the system
                self._handlers[number] = handler
                signal.signal(number, self._hear)

    def remove(self) -> None:
        """Put the handlers back, unless others have taken their place since."""
        if threading.current_thread() is not threading.main_thread():
            return
        for number, handler in self._handlers.items():
            if signal.getsignal(number) == self._hear:
                signal.signal(number, handler)

    def _hear(self, number: int, frame: FrameType | None) -> None:
        """Keep a signal for later inside the critical section; else call its handler."""
        if self._is_inside:
            self._came.append(number)
        else:
            self._handlers[number](number, frame)

    def __enter__(self) -> None:
        self._is_inside = True

    def __exit__(self, *_: object) -> None:
        self._is_inside = False
        came, self._came = self._came, []
        _raise_delayed_interrupts(sorted(came, key=_ENDINGS.index))


def _raise_delayed_interrupts(numbers: list[int]) -> None:
    """Raise every signal, also where the handler of one before raises an exception."""
    if numbers:
        try:
            signal.raise_signal(numbers[0])
        finally:
            _raise_delayed_interrupts(numbers[1:])

"""Settings of process and kernel for a real-time loop, how they are restored; memory."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from .posix import posix_module

_STATM: Final = Path("/proc/self/statm")
_PROCESSES: Final = Path("/proc")  # Linux
_TERMINALS: Final = "/dev/pts/"
_STATISTICS_BYTES: Final = 128  # more than three numbers of a thread take
_PR_SET_TIMERSLACK: Final = 29  # linux/prctl.h
_PR_GET_TIMERSLACK: Final = 30
_MCL_CURRENT: Final = 1  # sys/mman.h
_MCL_FUTURE: Final = 2
_PRIORITY: Final = 50  # SCHED_FIFO: above ordinary threads of the kernel, below its watchdogs


class TerminalProcesses:
    """The threads of the processes that made a pseudo-terminal, and how long they waited.

    Without threads where *path* is no pseudo-terminal, and where the system does not say (Linux
    does, of the same user).

    Parameters
    ----------
    path : str
        The terminal, or a link to it.

    Attributes
    ----------
    threads : list of Path
        Folder of each thread.
    """

    def __init__(self, path: str) -> None:
        number = os.path.realpath(path).removeprefix(_TERMINALS)
        self.threads = _threads_behind_terminal(number) if number.isdecimal() else []
        self._stack = contextlib.ExitStack()
        self._files: list[int] = []  # open, as they are read after every wait of a host
        for thread in self.threads:
            with contextlib.suppress(OSError):
                self._files.append(os.open(thread / "schedstat", os.O_RDONLY))
                self._stack.callback(os.close, self._files[-1])

    def waited_us(self) -> int:
        """Return for how long the threads were ready, and waited for a processor, so far.

        Microseconds; without those that have ended.
        """
        waited_ns = 0
        for file in self._files:
            with contextlib.suppress(OSError, IndexError):
                waited_ns += int(os.pread(file, _STATISTICS_BYTES, 0).split()[1])
        return waited_ns // 1000

    def close(self) -> None:
        """Let the threads be: they wait no longer."""
        self._files.clear()
        self._stack.close()


def _threads_behind_terminal(number: str) -> list[Path]:
    """Return /proc folders of the threads that hold the other end of pseudo-terminal *number*."""
    wanted, threads = f"tty-index:\t{number}\n", []
    for process in _PROCESSES.glob("[0-9]*"):
        with contextlib.suppress(OSError):  # of another user, or at its end
            masters = [fd for fd in (process / "fd").iterdir() if _is_terminal_master(fd)]
            infos = [(process / "fdinfo" / fd.name).read_text("ascii") for fd in masters]
            threads += list((process / "task").iterdir()) if wanted in "".join(infos) else []
    return threads


def _is_terminal_master(descriptor: Path) -> bool:
    """Return True if a descriptor below /proc is the master of a pseudo-terminal."""
    try:
        return os.readlink(descriptor).endswith("ptmx")
    except OSError:
        return False


def resident_bytes() -> int:
    """Return the resident memory of this process; where the system does not tell, its largest."""
    try:
        return int(_STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        resource = posix_module("resource", "the memory of a soak", "a POSIX system for it")
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return int(most) if sys.platform == "darwin" else int(most) * 1024


@contextlib.contextmanager
def real_time_process(*, strict: bool = False) -> Iterator[list[str]]:
    """Keep the garbage collector out, and let timers end when they should, while inside.

    A collection of a large program takes 10 to 100 ms; the kernel groups wake-ups within 50 µs
    (the slack of a timer) unless it is told not to.  Both need no rights.

    Parameters
    ----------
    strict : bool
        Ask for more: fixed priority (SCHED_FIFO), memory that stays in memory, and a collector that
        never looks again at what is there now.

    Yields
    ------
    list of str
        Settings that the system refused, a line each; the loop runs all the same.
    """
    with contextlib.ExitStack() as stack:
        refused: list[str] = []
        if strict:
            gc.collect()
            gc.freeze()
            stack.callback(gc.unfreeze)
            refused += _fix_process_priority(stack)
            refused += _lock_process_memory(stack)
        stack.enter_context(process_without_garbage_collector())
        if (slack_ns := _prctl(_PR_GET_TIMERSLACK, 0)) > 0:
            _prctl(_PR_SET_TIMERSLACK, 1)
            stack.callback(_prctl, _PR_SET_TIMERSLACK, slack_ns)
        yield refused


@contextlib.contextmanager
def process_without_garbage_collector() -> Iterator[None]:
    """Leave cycles of objects uncollected: for a while in which many are made, and none is left."""
    collected = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collected:
            gc.enable()


def _fix_process_priority(stack: contextlib.ExitStack) -> Iterator[str]:
    """Run under SCHED_FIFO: only the kernel and higher priorities interrupt this thread.

    Yield the reason if that is impossible; *stack* restores the scheduling.
    """
    if not hasattr(os, "sched_setscheduler"):
        yield f"fixed priority: {sys.platform} has no SCHED_FIFO"
        return
    before, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
        stack.callback(os.sched_setscheduler, 0, before, parameters)
    except PermissionError:
        yield (
            f"fixed priority (SCHED_FIFO {_PRIORITY}) is not permitted: "
            "give this user rtprio in limits.conf, or CAP_SYS_NICE"
        )


def _lock_process_memory(stack: contextlib.ExitStack) -> Iterator[str]:
    """Lock all pages in memory against page faults.

    Yield the reason if that is impossible; *stack* unlocks them.
    """
    libc = ctypes.CDLL(None, use_errno=True) if os.name == "posix" else None
    if libc is None or not hasattr(libc, "mlockall"):
        yield f"memory lock: {sys.platform} has no mlockall"
    elif libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0:
        stack.callback(libc.munlockall)
    else:
        reason = os.strerror(ctypes.get_errno())
        yield f"memory lock is not permitted ({reason}): give this user memlock in limits.conf"


def _prctl(option: int, value: int) -> int:
    """Call prctl(2), of this thread; return its result, 0 elsewhere than on Linux."""
    if not sys.platform.startswith("linux"):
        return 0
    prctl: Callable[..., int] = ctypes.CDLL(None).prctl
    return int(prctl(option, ctypes.c_ulong(value), 0, 0, 0))

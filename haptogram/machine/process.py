"""Settings of process and kernel for a real-time loop, and how they are restored."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

_PRESSURE: Final = Path("/proc/pressure/cpu")  # Linux
_PR_SET_TIMERSLACK: Final = 29  # linux/prctl.h
_PR_GET_TIMERSLACK: Final = 30
_MCL_CURRENT: Final = 1  # sys/mman.h
_MCL_FUTURE: Final = 2
_PRIORITY: Final = 50  # of SCHED_FIFO: above ordinary threads of the kernel, below its watchdogs


def time_without_processor_us() -> int:
    """Return for how long any process of this machine has waited for a processor since its start.

    A program beside this one, such as an emulator, may have been held up while this one was not.
    Microseconds; 0 where the system does not say.

    Examples
    --------
    >>> before_us = time_without_processor_us()
    >>> time_without_processor_us() - before_us >= 0
    True
    """
    try:
        _, _, total = _PRESSURE.read_text("ascii").splitlines()[0].partition("total=")
        return int(total)
    except (OSError, ValueError, IndexError):
        return 0


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
            stack.enter_context(_process_with_frozen_garbage())
            for asked in (_fixed_process_priority, _locked_process_memory):
                refused += stack.enter_context(asked())
        stack.enter_context(process_without_garbage_collector())
        stack.enter_context(_exact_process_timers())
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


@contextlib.contextmanager
def _process_with_frozen_garbage() -> Iterator[None]:
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


@contextlib.contextmanager
def _exact_process_timers() -> Iterator[None]:
    slack_ns = _prctl_of_process(_PR_GET_TIMERSLACK, 0)
    _set_process_timer_slack(1)
    try:
        yield
    finally:
        _set_process_timer_slack(slack_ns)


@contextlib.contextmanager
def _fixed_process_priority() -> Iterator[list[str]]:
    """Run under SCHED_FIFO: nothing but the kernel and higher priorities interrupts this thread."""
    if not hasattr(os, "sched_setscheduler"):
        yield [f"fixed priority: {sys.platform} has no SCHED_FIFO"]
        return
    before, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    except PermissionError:
        yield [
            f"fixed priority (SCHED_FIFO {_PRIORITY}) is not permitted: "
            "give this user rtprio in limits.conf, or CAP_SYS_NICE"
        ]
        return
    try:
        yield []
    finally:
        os.sched_setscheduler(0, before, parameters)


@contextlib.contextmanager
def _locked_process_memory() -> Iterator[list[str]]:
    """Keep every page in memory: a page fault from the disk takes milliseconds."""
    libc = ctypes.CDLL(None, use_errno=True) if os.name == "posix" else None
    if libc is None or not hasattr(libc, "mlockall"):
        yield [f"memory lock: {sys.platform} has no mlockall"]
        return
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:
        reason = os.strerror(ctypes.get_errno())
        yield [f"memory lock is not permitted ({reason}): give this user memlock in limits.conf"]
        return
    try:
        yield []
    finally:
        _ = libc.munlockall()


def _set_process_timer_slack(slack_ns: int) -> None:
    if slack_ns > 0:
        _prctl_of_process(_PR_SET_TIMERSLACK, slack_ns)


def _prctl_of_process(option: int, value: int) -> int:
    """Call prctl(2), of this thread; elsewhere than on Linux do nothing and return 0."""
    if not sys.platform.startswith("linux"):
        return 0
    prctl: Callable[..., int] = ctypes.CDLL(None).prctl
    return int(prctl(option, ctypes.c_ulong(value), 0, 0, 0))

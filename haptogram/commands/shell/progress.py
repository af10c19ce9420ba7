"""The progress of every command: a bar on a terminal, and lines elsewhere for long ones."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, Final, TypeAlias

#: Takes how much is done, of how much, and optionally a text behind it.
ShowProgress: TypeAlias = Callable[..., None]
_LINES: Final = 10  # progress lines of a campaign
_MEASURED_S: Final = 5.0  # time before the first line


@contextlib.contextmanager
def progress_bar(
    what: str, *, quiet: bool, unit: str = "frames", initial: float = 0
) -> Iterator[ShowProgress | None]:
    """Show a progress bar on standard error, if that is a terminal, from the thread that works.

    *initial* is what was done before.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    # No monitor thread: it would run beside the 1 kHz loop.
    tqdm.monitor_interval = 0
    bar: Any = None  # until there is something to show

    def show(done: float, total: float, text: str = "") -> None:
        nonlocal bar
        if bar is None:
            bar = tqdm(
                desc=what,
                unit=f" {unit}",
                initial=initial,
                leave=False,
                dynamic_ncols=True,
            )
        bar.total = total
        if text:
            bar.set_postfix_str(text, refresh=False)
        bar.update(max(0, done - bar.n))

    try:
        yield show
    finally:
        if bar is not None:
            bar.close()


@contextlib.contextmanager
def campaign_progress(
    what: str, *, quiet: bool, unit: str, initial: float
) -> Iterator[ShowProgress | None]:
    """Show a bar as :func:`progress_bar`; without a terminal, a line for each tenth of the rest.

    A line tells how long the rest takes; the first one comes after some seconds.
    """
    if quiet or sys.stderr.isatty():
        with progress_bar(what, quiet=quiet, unit=unit, initial=initial) as bar:
            yield bar
        return
    began_s, printed = time.monotonic(), -1

    def show(done: float, total: float, text: str = "") -> None:
        nonlocal printed
        part = int(_LINES * (done - initial) / max(total - initial, 1e-9))
        spent_s = time.monotonic() - began_s
        if done > initial and part > printed and (part == _LINES or spent_s > _MEASURED_S):
            printed = part
            left_s = spent_s * (total - done) / (done - initial)
            line = f"{what}: {done:g} of {total:g} {unit}, {text}; the rest takes about"
            print(f"{line} {left_s / 60:.1f} min", file=sys.stderr, flush=True)

    yield show

"""The progress bar of every command."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

#: Takes how much is done, of how much, and optionally a text behind it.
ShowProgress: TypeAlias = Callable[..., None]


@contextlib.contextmanager
def progress_bar(what: str, *, quiet: bool, unit: str = "frames") -> Iterator[ShowProgress | None]:
    """Show a progress bar on standard error, if that is a terminal, from the thread that works."""
    if quiet:
        yield None
        return
    from tqdm import tqdm

    # No monitor thread: it would run beside the 1 kHz loop.
    tqdm.monitor_interval = 0
    bar: Any = None  # until there is something to show

    def show(done: float, total: float, text: str = "") -> None:
        nonlocal bar
        if bar is None:
            bar = tqdm(desc=what, unit=f" {unit}", leave=False, dynamic_ncols=True, disable=None)
        bar.total = total
        if text:
            bar.set_postfix_str(text, refresh=False)
        bar.update(max(0, done - bar.n))

    try:
        yield show
    finally:
        if bar is not None:
            bar.close()

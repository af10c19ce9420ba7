"""The progress bar of ``haptogram verify``."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from haptogram.settings.arguments import Progress


@contextlib.contextmanager
def verify_bar(what: str, *, quiet: bool, unit: str = "frames") -> Iterator[Progress | None]:
    """Show a progress bar on standard error, from the thread that works, 20 times a second."""
    if quiet:
        yield None
        return
    from tqdm import tqdm

    # No monitor thread: it would run beside the 1 kHz loop.
    tqdm.monitor_interval = 0
    bar: Any = None  # until there is something to show

    def show(done: int, total: int) -> None:
        nonlocal bar
        if bar is None:
            bar = tqdm(desc=what, unit=f" {unit}", leave=False, dynamic_ncols=True, disable=None)
        bar.total = total
        bar.update(done - bar.n)

    try:
        yield show
    finally:
        if bar is not None:
            bar.close()

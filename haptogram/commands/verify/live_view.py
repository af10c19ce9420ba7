"""The live view of the board that a run has started."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path


@contextlib.contextmanager
def live_view(*, wanted: bool) -> Iterator[Callable[[Path], None]]:
    """Give what shows the board whose records a back door gets; on a terminal it stays.

    It stays until Ctrl-C, and shows nothing unless that is *wanted*.
    """
    if not wanted:
        yield lambda _: None
        return
    from haptogram.machine.view_process import ViewProcess

    with contextlib.ExitStack() as stack:
        shown: list[ViewProcess] = []

        def show(backdoor: Path) -> None:
            shown.append(ViewProcess(str(backdoor)))
            stack.callback(shown[0].close)

        yield show
        if shown and sys.stderr.isatty():
            print("the view stays; Ctrl-C ends it", file=sys.stderr)
            shown[0].wait()

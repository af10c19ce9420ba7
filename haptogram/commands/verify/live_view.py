"""The live view of the board that a run has started, with the targets of its frames."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from haptogram.machine.view_process import ViewProcess
    from haptogram.records.frame import Intended, Observation


class VerifyLiveView:
    """Shows a board in a browser while it runs.

    Parameters
    ----------
    wanted : bool
        Whether it shows anything.

    Attributes
    ----------
    sink : callable or None
        Takes every frame that is sent; None if nothing is to be shown.
    """

    def __init__(self, *, wanted: bool) -> None:
        self.sink = self._tell if wanted else None
        self._process: ViewProcess | None = None

    def show(self, backdoor: Path) -> None:
        """Show the board whose records *backdoor* gets."""
        if self.sink is None:
            return
        from haptogram.machine.view_process import ViewProcess
        from haptogram.report.viewer.live import (
            viewer_target_line,  # now, and not between two frames
        )

        self._process, self._line_of = ViewProcess(str(backdoor)), viewer_target_line

    def _tell(self, entry: Intended | Observation) -> None:
        from haptogram.records.frame import Intended

        if self._process is not None and isinstance(entry, Intended) and entry.foci:
            self._process.tell(self._line_of(entry))

    def stay(self) -> None:
        """Keep the view on a terminal until Ctrl-C."""
        if self._process is not None and sys.stderr.isatty():
            print("the view stays; Ctrl-C ends it", file=sys.stderr)
            self._process.wait()

    def close(self) -> None:
        """End the view."""
        if self._process is not None:
            self._process.close()


@contextlib.contextmanager
def live_view(*, wanted: bool) -> Iterator[VerifyLiveView]:
    """Give the view of a run; on a terminal it stays after the run, until Ctrl-C."""
    with contextlib.closing(VerifyLiveView(wanted=wanted)) as view:
        yield view
        view.stay()

"""A latch in a line, with places in the axes of the board's own programs."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Final, TextIO

from haptogram.machine.terminal import paint_verdicts_on_terminal

if TYPE_CHECKING:
    from haptogram.evidence.dialects.watched_board import WatchedBoard
    from haptogram.verification.watch import WatchedLatch

_PERIOD_S: Final = 0.1  # time between lines on a terminal
_MOST_SAMPLES: Final = 4000  # samples of a modulation in one line: a second


class LatchLines:
    """Prints a line for each latch; on a terminal ten a second, and how many were left out.

    Parameters
    ----------
    stream : TextIO
        Where to.
    board : WatchedBoard
        The board.
    quiet : bool
        Whether to print nothing.
    """

    def __init__(self, stream: TextIO, board: WatchedBoard, *, quiet: bool) -> None:
        self._stream, self._board, self._quiet = stream, board, quiet
        self._is_terminal = stream.isatty()
        self._printed_s = -math.inf
        self._left_out = 0
        self._levels: list[float] = []  # samples of a modulation that are not printed yet
        self._cause = ""  # of these samples

    def print(self, seen: WatchedLatch) -> None:
        """Print a latch, unless one was printed a moment ago and nothing is strange about it."""
        if self._quiet:
            return
        if seen.latch.is_sample:
            self._cause = seen.latch.cause
            self._levels.append(seen.latch.level)
            if len(self._levels) < _MOST_SAMPLES:
                return
        self.print_modulation()
        if seen.latch.is_sample:
            return
        now_s = time.monotonic()
        if (
            self._is_terminal
            and now_s - self._printed_s < _PERIOD_S
            and not (seen.defects or seen.latch.torn)
        ):
            self._left_out += 1
            return
        more = f"  (+{self._left_out} more)" if self._left_out else ""
        line = latch_line(seen, self._board) + more
        print(paint_verdicts_on_terminal(line, self._stream), file=self._stream, flush=True)
        self._printed_s, self._left_out = now_s, 0

    def print_modulation(self) -> None:
        """Print what samples of a modulation or an upload had in common since the last line."""
        if levels := self._levels:
            low, high = (round(100.0 * level) for level in (min(levels), max(levels)))
            noun = "latch" if len(levels) == 1 else "latches"
            self.print_remark(f"{self._cause}  {len(levels)} {noun}, amplitude {low} to {high} %")
            self._levels = []

    def print_remark(self, text: str) -> None:
        """Print what the board says of its client."""
        if not self._quiet:
            line = paint_verdicts_on_terminal(f"{'':>6}  {text}", self._stream)
            print(line, file=self._stream, flush=True)


def latch_line(seen: WatchedLatch, board: WatchedBoard) -> str:
    """Return number, time, pattern, place, verdict and defects of a latch."""
    from haptogram.report import watch

    latch = seen.latch
    parts = [f"{latch.number:>6}"]
    if latch.t_us is not None:
        parts.append(f"{latch.t_us / 1e6:.6f} s")
    if not latch.is_of_client:
        parts.append(latch.cause)
    parts.append(watch.watched_pattern_text(seen.pattern, board))
    if seen.verdict is not None:
        parts.append(watch.watched_status_text(seen.verdict))
    return "  ".join([*parts, *watch.watched_defect_texts(seen)])

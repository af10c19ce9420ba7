"""A latch in a line, with places in the axes of the board's own programs."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Final, TextIO

from haptogram.machine.terminal import paint_terminal_verdicts

if TYPE_CHECKING:
    from haptogram.evidence.watched_board import WatchedBoard
    from haptogram.verification.watch import WatchedLatch

_PERIOD_S: Final = 0.1  # between lines on a terminal
_MM: Final = 1e3


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

    def print(self, seen: WatchedLatch) -> None:
        """Print a latch, unless one was printed a moment ago and nothing is strange about it."""
        if self._quiet:
            return
        now_s = time.monotonic()
        if self._is_terminal and now_s - self._printed_s < _PERIOD_S and not _is_strange(seen):
            self._left_out += 1
            return
        more = f"  (+{self._left_out} more)" if self._left_out else ""
        line = latch_line(seen, self._board) + more
        print(paint_terminal_verdicts(line, self._stream), file=self._stream, flush=True)
        self._printed_s, self._left_out = now_s, 0

    def print_remark(self, text: str) -> None:
        """Print what the board says of its client."""
        if not self._quiet:
            print(f"{'':>6}  {text}", file=self._stream, flush=True)


def _is_strange(seen: WatchedLatch) -> bool:
    return bool(seen.defects or seen.latch.torn)


def latch_line(seen: WatchedLatch, board: WatchedBoard) -> str:
    """Return number, time, pattern, place, verdict and defects of a latch."""
    latch = seen.latch
    parts = [f"{latch.number:>6}"]
    if latch.t_us is not None:
        parts.append(f"{latch.t_us / 1e6:.6f} s")
    if not latch.is_of_client:
        parts.append(latch.cause)
    parts.append(_pattern_text(seen, board))
    if seen.verdict is not None:
        failed = [name for name, ok in seen.verdict.criteria.items() if not ok]
        parts.append(str(seen.verdict.status) + (f" ({', '.join(failed)})" if failed else ""))
    parts += [str(defect) for defect in seen.defects]
    if latch.torn:
        parts.append(f"torn: {latch.torn_text}")
    return "  ".join(parts)


def client_places_mm(seen: WatchedLatch, board: WatchedBoard) -> list[list[float]]:
    """Return the places of a pattern in mm, in the axes of the client; empty for one without."""
    import numpy as np

    from haptogram.acoustics.reconstruct.patterns.found import Placed, SeveralFoci

    pattern = seen.pattern
    if isinstance(pattern, SeveralFoci):
        places: list[list[float]] = (board.clients_m(np.array(pattern.positions_m)) * _MM).tolist()
        return places
    if isinstance(pattern, Placed):
        return [(board.clients_m(np.array(pattern.position_m)) * _MM).tolist()]
    return []


def _pattern_text(seen: WatchedLatch, board: WatchedBoard) -> str:
    import numpy as np

    from haptogram.acoustics.reconstruct.patterns.found import Placed, SeveralFoci, Vortex

    pattern = seen.pattern
    if isinstance(pattern, SeveralFoci):
        places = board.clients_m(np.array(pattern.positions_m))
        return f"{len(places)} foci at " + ", ".join(map(_place_text, places))
    if not isinstance(pattern, Placed):
        return pattern.kind
    charge = f" of charge {pattern.charge:+d}" if isinstance(pattern, Vortex) else ""
    place = board.clients_m(np.array(pattern.position_m))
    bound = np.abs(board.clients_m(np.array(pattern.bound_m)))
    limits = "/".join(f"{_MM * b:.1f}" if np.isfinite(b) else "?" for b in bound)
    text = f"{pattern.kind}{charge} at {_place_text(place)} mm, +-{limits} mm"
    if pattern.outliers:
        text += f", {len(pattern.outliers)} elements out of step"
    return f"{text}, coherence {pattern.coherence:.4f}"


def _place_text(place_m: object) -> str:
    import numpy as np

    values = np.round(np.asarray(place_m) * _MM, 1) + 0.0
    return "(" + ", ".join(f"{value:.1f}" for value in values) + ")"

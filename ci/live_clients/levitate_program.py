"""A program of levitate's, unmodified, for :mod:`live_clients`; runs in an environment of its own.

::

    python levitate_program.py PORT     connect, set states, turn off; print what was meant, as JSON

What was meant is levitate's own: its delays and duties, for each element in the order of the wire.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np
from levitate.hardware import AcoustophoreticBoard

TARGETS_M = [(0.0, 0.0, 0.1), (0.012, -0.02, 0.12), (-0.03, 0.01, 0.09)]  # two off the planes


class Board(AcoustophoreticBoard):
    """levitate's board, at the port that is given: its own list has two of its authors' ports."""

    _ports = {0: sys.argv[-1]}  # noqa: RUF012  as in levitate


def meant(board: Any, amplitudes: Any, phases: Any) -> dict[str, Any]:
    """Return what levitate's arithmetic gives, before it is clipped to what the wire has."""
    duty, delay = board._pulse_parameters(amplitudes.copy(), phases.copy())  # noqa: SLF001  its own
    steps = np.round(delay * 128)
    return {
        "phases": np.clip(steps, 0, 127).astype(int).tolist(),
        "duties": np.clip(np.round(duty * 65), 0, 64).astype(int).tolist(),
        "clipped": int((steps > 127).sum()),
    }


def main() -> None:
    """Send a frame for every target, one of half amplitude, and the end."""
    board = Board(id=0)
    board.connect()
    everything = np.ones(board.num_transducers)
    frames = [meant(board, 0 * everything, 0 * everything) | {"name": "connect"}]
    for target in TARGETS_M:
        # levitate's k is that of its medium; its phases are leads, its delays the wire's
        phases = board.focus_phases(np.array(target))
        board.set_state(everything * np.exp(1j * phases))
        frame = meant(board, everything, np.angle(np.exp(1j * phases)))
        frames.append(frame | {"name": "focus", "target_m": target})
    board.set_state(0.5 * everything * np.exp(1j * phases))
    half = meant(board, 0.5 * everything, np.angle(np.exp(1j * phases)))
    frames.append(half | {"name": "half amplitude", "target_m": target})
    board.off()
    frames.append({"name": "off", "phases": [0] * 256, "duties": [0] * 256, "clipped": 0})
    json.dump(
        {"frames": frames, "k": board.k, "positions_m": board.positions.T.tolist()}, sys.stdout
    )


if __name__ == "__main__":
    main()

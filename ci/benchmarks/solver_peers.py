"""Multi-focus solvers of a public package next to ours: solver_peers.py OUT.json.

Runs in an interpreter that has numpy, scipy and levitate (which needs scipy below 1.17);
`ci/solver-peers` makes one. levitate has no solver of this kind by name: its users align the
states of single foci (`phase_alignment`), or minimise a cost of the pressures from there
(`minimize`). Both get the same foci as ours, and all are judged alike, on phase-only drives.
"""

import json
import sys
import time
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from solver_comparison import compare_solvers

from haptogram.acoustics import AcousticModel, solve_foci

SETS = 3


def main(arguments):
    if find_spec("levitate") is None:
        sys.exit("solver_peers: levitate is not installed in this interpreter, nothing to compare")
    board = AcousticModel.default()
    solvers = {"wgs, 50 rounds": lambda points: solve_foci(board, points)}
    solvers |= levitate_solvers(board)
    phase_only = {
        name: lambda points, solver=solver: np.exp(1j * np.angle(solver(points)))
        for name, solver in solvers.items()
    }
    rows = compare_solvers(board, phase_only, time.thread_time_ns, sets=SETS)
    packages = {name: version(name) for name in ("levitate", "numpy", "scipy")}
    Path(arguments[0]).write_text(json.dumps({"packages": packages, "rows": rows}))


def levitate_solvers(board):
    from levitate import arrays, fields, optimization, transducers

    piston = transducers.CircularPiston(
        effective_radius=board.transducer.directivity.radius_m, freq=board.frequency_hz
    )
    array = arrays.RectangularArray(shape=16, spread=0.010, transducer=piston)
    offsets = board.array.positions_m[:, None] - array.positions.T
    order = np.linalg.norm(offsets, axis=2).argmin(axis=1)  # of theirs, for each of ours
    pressure = fields.Pressure(array)

    def aligned(points):
        states = [np.exp(1j * array.focus_phases(point)) for point in points]
        together = sum(optimization.phase_alignment(*states)) if len(states) > 1 else states[0]
        return together / np.abs(together)

    def minimised(points):
        """Least squares from (|p_i| - P / sqrt(F)), with P the pressure of a single focus."""
        cost = None
        for point in points:
            single = np.exp(1j * array.focus_phases(point))
            wanted = abs((pressure @ point)(single)) / np.sqrt(len(points))
            term = ((abs(pressure) - wanted) ** 2) @ point
            cost = term if cost is None else cost + term
        return optimization.minimize(cost, array, start_values=aligned(points))

    return {
        "levitate phase_alignment": lambda points: aligned(points)[order],
        "levitate minimize": lambda points: minimised(points)[order],
    }


if __name__ == "__main__":
    main(sys.argv[1:])

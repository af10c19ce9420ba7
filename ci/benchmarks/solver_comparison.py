"""Solvers of several foci side by side: efficiency, uniformity and time for random foci."""

import numpy as np

from haptogram.acoustics import propagators


def random_foci(rng, count):
    """Return (F, 3) random foci on one plane, none within 12 mm of another, in metres."""
    foci = []
    while len(foci) < count:
        point = np.append(rng.uniform(-0.060, 0.060, 2), 0.150)
        if all(np.linalg.norm(point - other) >= 0.012 for other in foci):
            foci.append(point)
    return np.array(foci)


def compare_solvers(board, solvers, now_ns, *, counts=(1, 2, 4, 8, 16, 32), sets=5, seed=1):
    """Return a row for each number of foci and solver: medians over the *sets* of foci.

    Parameters
    ----------
    solvers : dict of str to callable
        Called with (F, 3) points in metres; returns the drive, (N,) weights.
    now_ns : callable
        The clock, in nanoseconds.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for count in counts:
        foci = [board.array.world_m(random_foci(rng, count)) for _ in range(sets)]
        rows += [_row(board, name, solver, foci, now_ns) for name, solver in solvers.items()]
    return rows


def solver_quality(board, drive, points):
    """Return efficiency and uniformity of foci (R. Di Leonardo et al., 2007, eq. 2)."""
    matrix = propagators(board, points)
    level = np.abs(matrix @ drive)
    uneven = np.ptp(level**2) / (level.max() ** 2 + level.min() ** 2)
    return ((level / np.abs(matrix).sum(axis=1)) ** 2).sum(), 1.0 - uneven


def _row(board, name, solver, sets, now_ns):
    solver(sets[0])  # code is loaded outside of the timed window
    found = []
    for points in sets:
        started = now_ns()
        drive = solver(points)
        elapsed_us = (now_ns() - started) / 1e3
        found.append((*solver_quality(board, drive, points), elapsed_us))
    efficiency, uniformity, time_us = np.median(found, axis=0).tolist()
    return {
        "method": name,
        "foci": len(sets[0]),
        "efficiency": efficiency,
        "uniformity": uniformity,
        "time_us": time_us,
    }

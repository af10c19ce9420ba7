"""The solvers of several foci as their papers state them: lists and loops, no arrays.

`gains[i][n]` is what element n at unit weight makes at focus i, `wanted[i]` its relative amplitude,
`drive[n]` where to start.  A. Marzo and B. W. Drinkwater, PNAS 116(1), 2019 (backpropagation);
R. Di Leonardo et al., Opt. Express 15(4), 2007 (Gerchberg-Saxton, weighted; the measures);
D. Martinez Plasencia et al., ACM Trans. Graph. 39(4), 2020 (GS-PAT).
"""

from typing import NamedTuple

import numpy as np

from haptogram.acoustics import propagators


def backpropagation(gains, wanted, drive, rounds):
    reach = _reach(gains, wanted)
    for _ in range(rounds):
        goals = [reach * a * _phasor(p) for a, p in zip(wanted, _heard(gains, drive), strict=True)]
        drive = [_at_most_1(w) for w in _focused(gains, goals)]
    return drive


def gerchberg_saxton(gains, wanted, drive, rounds):
    for _ in range(rounds):
        goals = [a * _phasor(p) for a, p in zip(wanted, _heard(gains, drive), strict=True)]
        drive = [_phasor(w) for w in _returned(gains, goals)]
    return drive


def weighted_gerchberg_saxton(gains, wanted, drive, rounds):
    weights, drive = list(wanted), [_phasor(w) for w in drive]
    for _ in range(rounds):
        heard = _heard(gains, drive)
        shares = [abs(p) / a for p, a in zip(heard, wanted, strict=True)]
        mean = sum(shares) / len(shares)
        weights = [w * (mean / share) ** 0.75 for w, share in zip(weights, shares, strict=True)]
        goals = [w * _phasor(p) for w, p in zip(weights, heard, strict=True)]
        drive = [_phasor(w) for w in _returned(gains, goals)]
    return drive


def gs_pat(gains, wanted, drive, rounds):
    """Rounds on the foci alone: what they ask for, and what they would hear of it."""
    reach = _reach(gains, wanted)
    goals = [reach * a for a in wanted]
    asked = _heard(gains, drive)
    for _ in range(rounds):
        heard = _heard(gains, _focused(gains, asked))
        asked = [goal * _phasor(p) for goal, p in zip(goals, heard, strict=True)]
    heard = _heard(gains, _focused(gains, asked))
    # At the end each asks for more, by how much too little it hears.
    last = [goal**2 / abs(p) * _phasor(p) for goal, p in zip(goals, heard, strict=True)]
    return [_at_most_1(w) for w in _focused(gains, last)]


def measures(gains, wanted, drive):
    """Efficiency, and uniformity of the intensities over those wanted."""
    heard = [abs(p) for p in _heard(gains, drive)]
    efficiency = sum((p / sum(map(abs, row))) ** 2 for p, row in zip(heard, gains, strict=True))
    shares = [(p / a) ** 2 for p, a in zip(heard, wanted, strict=True)]
    return efficiency, 1.0 - (max(shares) - min(shares)) / (max(shares) + min(shares))


class Quality(NamedTuple):
    efficiency: float
    uniformity: float


def solver_quality(model, drive, foci, wanted):
    """The measures of a drive of a model's array."""
    gains = propagators(model, foci).tolist()
    return Quality(*measures(gains, np.asarray(wanted).tolist(), np.asarray(drive).tolist()))


def _heard(gains, drive):
    return [sum(g * w for g, w in zip(row, drive, strict=True)) for row in gains]


def _returned(gains, goals):
    """What every element sends if the goals travel back to it."""
    return [
        sum(row[n].conjugate() * goal for row, goal in zip(gains, goals, strict=True))
        for n in range(len(gains[0]))
    ]


def _focused(gains, goals):
    """The same, so that each goal alone would be met."""
    powers = [sum(abs(g) ** 2 for g in row) for row in gains]
    return _returned(gains, [goal / power for goal, power in zip(goals, powers, strict=True)])


def _reach(gains, wanted):
    """The factor that uses the whole power if no focus disturbs another."""
    return sum((a / sum(map(abs, row))) ** 2 for a, row in zip(wanted, gains, strict=True)) ** -0.5


def _phasor(value):
    return value / abs(value)


def _at_most_1(value):
    return value / max(1.0, abs(value))

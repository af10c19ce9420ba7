"""The chance that random phases look like a pattern: it bounds the proof of few elements and steps.

N random phases fill a torus of (2 pi)^N. A pattern of k unknowns is a surface in it, and the phases
that it explains are a shell around that surface: a ball in the N - k directions across it, for each
pattern that can be told from its neighbours. Elements that are left out may be any.
"""

from __future__ import annotations

import math
from typing import Final

from haptogram.acoustics.reconstruct.patterns.explain import Explanation
from haptogram.acoustics.reconstruct.patterns.fit import pattern_residual_rms
from haptogram.acoustics.reconstruct.patterns.search import MAX_CHARGE

_CERTAIN: Final = math.log(1e-4)  # log of the largest probability that counts as impossible
_FOCUS: Final = 4  # unknowns: a place and the common phase; the speed of sound is half known
_TWIN: Final = 2  # more unknowns: the plane that splits it
_VORTEX: Final = 2  # more unknowns: the axis
_EACH_OF_SEVERAL: Final = 5  # unknowns of each of several foci: a place, a level and a phase
_TURNS: Final = 2.0  # change of an element's phase over the range of an unknown
_COARSE_RAD: Final = 2.0 * math.pi / 5.0 + 1e-9  # coarser steps make a vortex look like a focus
_SPREAD: Final = 1.0  # spread of the RMS residual of rounded phases, times the square root of N


def is_beyond_chance(found: Explanation, step_rad: float) -> bool:
    """Return True if random phases of that step would hardly be explained as well."""
    count, used = found.used.size, int(found.used.sum())
    if step_rad > _COARSE_RAD:
        rms_rad = pattern_residual_rms(found.fit.residual_rad[found.used])
        rounded_rad = step_rad / math.sqrt(12.0) * (1.0 + _SPREAD / math.sqrt(count))
        if found.normal is not None or found.charge or used < count or rms_rad > rounded_rad:
            return False
    return log_chance_of_explanation(found, step_rad) <= _CERTAIN


def log_chance_of_explanation(found: Explanation, step_rad: float) -> float:
    """Return the logarithm of the chance that random phases are explained as well."""
    unknowns, choices = _FOCUS, 1
    if found.normal is not None:
        unknowns += _TWIN
    elif found.charge:
        unknowns, choices = unknowns + _VORTEX, 2 * MAX_CHARGE
    count, used = found.used.size, int(found.used.sum())
    rms_rad = pattern_residual_rms(found.fit.residual_rad[found.used])
    return log_chance(count, used, rms_rad, step_rad, unknowns) + math.log(choices)


def are_beyond_chance(foci: int, count: int, rms_rad: float, step_rad: float) -> bool:
    """Return True if random phases would hardly be explained as well by as many foci."""
    unknowns = _EACH_OF_SEVERAL * foci
    if step_rad > _COARSE_RAD:
        return False
    return log_chance(count, count, rms_rad, step_rad, unknowns) <= _CERTAIN


def log_chance(count: int, used: int, rms_rad: float, step_rad: float, unknowns: int) -> float:
    """Return the logarithm of the chance that *used* of *count* random phases fit so well.

    Phases of a step cannot prove more than that each of them is the one that was wanted.
    """
    free = used - unknowns
    if free <= 0:
        return 0.0
    radius = max(rms_rad, step_rad / math.sqrt(2.0 * math.pi * math.e)) * math.sqrt(used)
    ball = free / 2.0 * math.log(math.pi) - math.lgamma(free / 2.0 + 1.0)
    shell = ball + free * math.log(radius / (2.0 * math.pi))
    left_out = math.log(math.comb(count, used))
    patterns = unknowns * math.log(_TURNS * math.sqrt(used))
    return shell + left_out + patterns

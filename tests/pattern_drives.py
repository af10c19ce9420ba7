"""Drives of named patterns, from the bare formulas: nothing of the program is asked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SPEED_M_S = 343.2
FREQUENCY_HZ = 40e3


@dataclass(frozen=True)
class Wanted:
    """A pattern that a drive was made for."""

    kind: str
    places_m: np.ndarray  # (F, 3)
    charge: int = 0


def k_of(speed_m_s=SPEED_M_S):
    return 2.0 * np.pi * FREQUENCY_HZ / speed_m_s


def focus(positions, place, k):
    return -k * np.linalg.norm(positions - place, axis=1)


def azimuth(positions, about):
    return np.arctan2(positions[:, 1] - about[1], positions[:, 0] - about[0])


def several(positions, places, lags, k):
    waves = [
        np.exp(1j * (focus(positions, place, k) + lag))
        for place, lag in zip(places, lags, strict=True)
    ]
    return np.angle(np.sum(waves, axis=0))


def coded(phases_rad, steps, cut_off=False):
    """The codes that a client makes: rounded, or cut off as SonicSurface's does."""
    turns = phases_rad / (2.0 * np.pi) * steps
    return (np.floor(turns) if cut_off else np.rint(turns)).astype(int) % steps


def radiated(codes, steps):
    return np.exp(2j * np.pi * np.asarray(codes) / steps)


def random_place(rng, positions):
    """A point in front of a plane array, or between two that look at each other."""
    centre, half = positions.mean(axis=0), np.ptp(positions, axis=0) / 2.0
    if half[2] > 1e-3:
        return centre + rng.uniform(-0.4, 0.4, 3) * half
    height = max(0.04, rng.uniform(0.6, 3.0) * half.max())
    return centre + np.append(rng.uniform(-0.7, 0.7, 2) * half[:2], height)


def random_pattern(rng, positions, kind, k=None):
    """Phases of a random pattern of a kind, and what was wanted."""
    k = k_of() if k is None else k
    place = random_place(rng, positions)
    phases = focus(positions, place, k)
    about = positions.mean(axis=0) if rng.random() < 0.5 else place
    charge, places = 0, place[None]
    if kind == "twin trap":
        half = _balanced_half(rng, positions, positions.mean(axis=0), about)
        phases = phases + np.pi * half
    elif kind == "vortex":
        charge = int(rng.choice([-2, -1, 1, 2]))
        phases = phases + charge * azimuth(positions, about)
    elif kind == "several foci":
        places = _apart(rng, positions, place, 2 + int(rng.integers(0, 1 + (len(positions) > 99))))
        phases = several(positions, places, rng.uniform(0, 2 * np.pi, len(places)), k)
    elif kind == "none of these":
        phases = rng.uniform(0.0, 2.0 * np.pi, len(positions))
    return phases + rng.uniform(0.0, 2.0 * np.pi), Wanted(kind, places, charge)


def _balanced_half(rng, positions, centre, about):
    """The elements beyond a line through *about*; through the middle, if that leaves too few."""
    for point in (about, centre):
        turn = rng.uniform(0.0, np.pi)
        half = np.cos(azimuth(positions, point) - turn) > 0.0
        if abs(half.mean() - 0.5) < 0.15:
            return half
    return half


def _apart(rng, positions, place, count):
    """Places that are several wavelengths apart."""
    places = [place]
    spread = 0.5 * np.ptp(positions, axis=0)[:2].max() + 0.02
    while len(places) < count:
        other = place + rng.uniform(-1.0, 1.0, 3) * [spread, spread, 0.01]
        if min(np.linalg.norm((other - seen)[:2]) for seen in places) > 0.03:
            places.append(other)
    return np.array(places)

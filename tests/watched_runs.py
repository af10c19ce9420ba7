"""Runs of a board whose client means one thing and does another, latch by latch."""

from __future__ import annotations

import numpy as np

import pattern_drives as drives
from haptogram.acoustics import AcousticModel, CircularPiston, Medium, Transducer
from haptogram.verification.watch import Expectation, SeenLatch, Watch

#: Targets off every symmetry plane, at several heights, in units of the array's half side.
TARGETS = np.array(
    [
        [0.25, 0.06, 1.5],
        [-0.44, 0.22, 1.9],
        [0.14, -0.5, 1.25],
        [0.56, 0.37, 2.1],
        [-0.2, -0.3, 1.0],
    ]
)


def model_of(array, speed=drives.SPEED_M_S):
    return AcousticModel(array, Medium(speed, 1.2), Transducer(CircularPiston(4.5e-3)))


def targets_of(array, places=TARGETS):
    half = np.ptp(array.positions_m, axis=0).max() / 2.0
    return array.centre_m + places * half


def latches(array, steps, places, speed=drives.SPEED_M_S, spoil=None, **values):
    """One latch a place; *spoil* changes the weights of each."""
    for number, place in enumerate(places, start=1):
        phases = drives.focus(array.positions_m, place, drives.k_of(speed))
        weights = drives.radiated(drives.coded(phases, steps), steps)
        yield SeenLatch(number, weights if spoil is None else spoil(weights), steps, **values)


def watched(array, seen, targets=None, channels=None):
    """The watch after a run."""
    model = model_of(array)
    expected = None if targets is None else Expectation(model, list(targets))
    watch = Watch(model, channels=channels, expectation=expected)
    for latch in seen:
        watch.take(latch)
    return watch

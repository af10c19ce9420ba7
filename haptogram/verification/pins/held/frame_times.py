"""The times of frames that carry none: each is taken for the drive that the pins hold like it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.model.drive import REGISTER_BITS
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Intended

from .drives import HeldDrives

_Ints: TypeAlias = NDArray[np.int64]

_LEAST_MATCH: Final = 0.5  # of a correlation: below, a drive is that of no frame
_TURNS: Final = 4  # phases that are tried
_MOST_PAIRS: Final = 50_000_000
_US: Final = 1e6


def frames_at_held_drives(
    held: HeldDrives, intended: Sequence[Intended]
) -> tuple[list[Intended], FloatArray]:
    """Return the frames of a run with the times at which the pins take their drives.

    With them comes, as (F, 2) periods, begin and end of the longest time for which the pins hold
    the drive of each without a change; NaN: no drive is like it.

    They are joined by their order. A frame that no drive is like lies between its neighbours; where
    no frame is like any drive, as of pins that are exchanged, the drives that sound are taken for
    the frames as they come.

    Raises
    ------
    ConfigurationError
        Nothing sounds, or more drives and frames than can be compared.
    """
    meant = _meant_at_pins(held, intended)
    firsts = np.flatnonzero(np.append(True, (meant[1:] != meant[:-1]).any(axis=1)))
    seen = np.where(np.isfinite(held.weights), held.weights, 0.0)
    if not seen.any():
        raise ConfigurationError(
            f"{held.record.name}: no captured pin holds a drive; check the probes, and that the "
            "board is on"
        )
    if len(firsts) * held.count > _MOST_PAIRS:
        raise ConfigurationError(
            f"{held.record.name}: {held.count} drives for {len(firsts)} frames are too many to be "
            f"compared, can be {_MOST_PAIRS} pairs; capture a shorter time"
        )
    found = map(_pairs_in_order, _matches_of_drives(seen, meant[firsts]))
    _, pairs = max(found, key=lambda one: one[0])
    if not len(pairs):
        pairs = _pairs_as_they_come(seen, meant[firsts])
    latched = [one.begin if one.is_steady else one.end for one in held.latches]
    begins = np.array([held.begins[0], *latched])
    starts = _starts_of_frames(
        firsts[pairs[:, 1]], begins[pairs[:, 0]], held.ends[pairs[-1, 0]], len(meant)
    )
    times_us = np.rint(starts / held.record.carrier_hz * _US).astype(np.int64).tolist()
    frames = [
        dataclasses.replace(frame, t_apply_us=t_us)
        for frame, t_us in zip(intended, times_us, strict=True)
    ]
    shown = np.full((len(firsts), 2), np.nan)
    shown[pairs[:, 1]] = np.stack([held.begins, held.ends], axis=1)[pairs[:, 0]]
    return frames, np.repeat(shown, np.diff(np.append(firsts, len(meant))), axis=0)


def _meant_at_pins(held: HeldDrives, intended: Sequence[Intended]) -> ComplexArray:
    """Return (F, E) the drives of the frames, relative to the reference as those of the pins."""
    elements = list(held.elements)
    drives = [frame.drive.in_bits(REGISTER_BITS).weights()[elements] for frame in intended]
    meant: ComplexArray = np.array(drives)
    if held.record.reference_element is not None:
        own = meant[:, [elements.index(held.record.reference_element)]]
        meant = meant * np.conj(np.exp(1j * np.angle(own)))
    return meant


def _matches_of_drives(seen: ComplexArray, meant: ComplexArray) -> Iterator[FloatArray]:
    """Yield (S, F) the correlation of drives and frames, for each likely phase that all share."""
    sizes = np.linalg.norm(seen, axis=1)[:, None] * np.linalg.norm(meant, axis=1)
    both = (seen @ np.conj(meant).T) / np.where(sizes > 0.0, sizes, 1.0)
    lags = range(1 - len(seen), len(meant))
    sums = np.array([np.trace(both, lag) for lag in lags])
    sounding = np.any(seen, axis=1)[:, None] | np.any(meant, axis=1)
    for lag in np.abs(sums).argsort()[-_TURNS:]:
        match = (both * np.exp(-1j * np.angle(sums[lag]))).real
        yield np.where(sounding, match, 1.0)


def _pairs_in_order(match: FloatArray) -> tuple[float, _Ints]:
    """Return how much drives and frames agree, and which do: (K, 2), both ascending."""
    gain = np.maximum(match - _LEAST_MATCH, 0.0)
    rows = [np.zeros(match.shape[1] + 1)]
    for row in gain:
        paired = np.append(0.0, rows[-1][:-1] + row)
        rows.append(np.maximum.accumulate(np.maximum(rows[-1], paired)))
    drive, frame = match.shape
    pairs = []
    while drive and frame:
        here = rows[drive][frame]
        if here == rows[drive - 1][frame]:
            drive -= 1
        elif here == rows[drive][frame - 1]:
            frame -= 1
        else:
            drive, frame = drive - 1, frame - 1
            pairs.append((drive, frame))
    return float(rows[-1][-1]), np.array(pairs[::-1], dtype=np.int64).reshape(-1, 2)


def _pairs_as_they_come(seen: ComplexArray, meant: ComplexArray) -> _Ints:
    sounding = np.flatnonzero(seen.any(axis=1))
    frames = np.flatnonzero(meant.any(axis=1))
    count = min(len(sounding), len(frames))
    if not count:
        return np.zeros((1, 2), dtype=np.int64)
    return np.stack([sounding[-count:], frames[-count:]], axis=1)


def _starts_of_frames(frames: _Ints, starts: FloatArray, end: float, count: int) -> FloatArray:
    """Return the (F,) starts of all frames, from those of some and the *end* of the last one."""
    knots, times = np.append(frames, count), np.append(starts, max(end, starts[-1]))
    places = np.arange(count)
    found: FloatArray = np.interp(places, knots, times)
    gap = float(np.median(np.diff(times) / np.diff(knots)))
    found += np.minimum(places - knots[0], 0.0) * gap
    return found

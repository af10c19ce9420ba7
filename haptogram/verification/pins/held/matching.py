"""Drives that pins hold and frames that are like them, in the order of both; times of frames."""

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

_LEAST_MATCH: Final = 0.5  # least correlation of a drive with a frame
_TURNS: Final = 4  # phases that are tried
_MOST_PAIRS: Final = 50_000_000


def matched_drives(held: HeldDrives, meant: ComplexArray) -> tuple[_Ints, _Ints]:
    """Return the frames at which the drive changes, and which of them the pins show.

    Parameters
    ----------
    meant : (F, E) numpy.ndarray of complex
        The drives of the frames, at the pins.

    Returns
    -------
    firsts : (G,) numpy.ndarray of int
        The first frame of each drive.
    pairs : (K, 2) numpy.ndarray of int
        Places of a held drive and of the one of *firsts* that is like it, both ascending.

    Raises
    ------
    ConfigurationError
        More drives and frames than can be compared.
    """
    if held.record.reference_element is not None:
        own = meant[:, [held.elements.index(held.record.reference_element)]]
        meant = meant * np.conj(np.exp(1j * np.angle(own)))
    firsts = np.flatnonzero(np.append(True, (meant[1:] != meant[:-1]).any(axis=1)))
    seen = np.where(np.isfinite(held.weights), held.weights, 0.0)
    if len(firsts) * held.count > _MOST_PAIRS:
        raise ConfigurationError(
            f"{held.record.name}: {held.count} drives for {len(firsts)} frames are too many to be "
            f"compared, can be {_MOST_PAIRS} pairs; capture a shorter time"
        )
    found = map(_pairs_in_order, _drive_correlations(seen, meant[firsts]))
    return firsts, max(found, key=lambda one: one[0])[1]


def _drive_correlations(seen: ComplexArray, meant: ComplexArray) -> Iterator[FloatArray]:
    """Yield (S, F) correlations, -1 to 1, of drives *seen* (S, E) and frames *meant* (F, E).

    There are 4 tables, each with another phase taken off that all drives share: that of the shifts
    between *seen* and *meant* with the greatest summed correlation.
    """
    sizes = np.linalg.norm(seen, axis=1)[:, None] * np.linalg.norm(meant, axis=1)
    both = (seen @ np.conj(meant).T) / np.where(sizes > 0.0, sizes, 1.0)
    lags = range(1 - len(seen), len(meant))
    sums = np.array([np.trace(both, lag) for lag in lags])
    sounding = np.any(seen, axis=1)[:, None] | np.any(meant, axis=1)
    for lag in np.abs(sums).argsort()[-_TURNS:]:
        match = (both * np.exp(-1j * np.angle(sums[lag]))).real
        yield np.where(sounding, match, 1.0)


def _pairs_in_order(match: FloatArray) -> tuple[float, _Ints]:
    """Return the summed agreement and (K, 2) the pairs of drive and frame that best keep the order.

    *match* (S, F) holds correlations, of which the part above 0.5 counts.
    """
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


# --- Times of frames that carry none -------------------------------------------------------------


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
    drives = [frame.drive.in_bits(REGISTER_BITS).weights() for frame in intended]
    meant = np.array(drives)[:, list(held.elements)]
    if not np.nan_to_num(held.weights).any():
        raise ConfigurationError(
            f"{held.record.name}: no captured pin holds a drive; check the probes, and that the "
            "board is on"
        )
    firsts, pairs = matched_drives(held, meant)
    if not len(pairs):
        pairs = _pair_in_order(held.weights, meant[firsts])
    latched = [one.begin if one.is_steady else one.end for one in held.latches]
    begins = np.array([held.begins[0], *latched])
    starts = _frame_starts(
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


def _pair_in_order(seen: ComplexArray, meant: ComplexArray) -> _Ints:
    """Return (K, 2) index pairs of sounding drives and frames: last with last, and so on back.

    K is the smaller number of both. Only the pair (0, 0) if one has nothing that sounds.
    """
    sounding = np.flatnonzero(seen.any(axis=1))
    frames = np.flatnonzero(meant.any(axis=1))
    count = min(len(sounding), len(frames))
    if not count:
        return np.zeros((1, 2), dtype=np.int64)
    return np.stack([sounding[-count:], frames[-count:]], axis=1)


def _frame_starts(frames: _Ints, starts: FloatArray, end: float, count: int) -> FloatArray:
    """Return (count,) start times of all frames, interpolated between the matched *frames* (K,).

    Those before the first and after the last of these follow each other as most do: a capture may
    show a part of a run. *starts* (K,) and *end* are in periods.
    """
    gap = max(end - float(starts[-1]), 1.0) / (count - float(frames[-1]))
    if len(frames) > 1:
        gap = float(np.median(np.diff(starts) / np.diff(frames)))
    places = np.arange(count)
    found: FloatArray = np.interp(places, frames, starts)
    outside = np.minimum(places - frames[0], 0.0) + np.maximum(places - frames[-1], 0.0)
    found += outside * gap
    return found

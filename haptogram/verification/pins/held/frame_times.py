"""The times of frames that carry none: each is taken for the drive that the pins hold like it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.model.drive import REGISTER_BITS
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Intended

from .drives import HeldDrives
from .matching import matched_drives

_Ints: TypeAlias = NDArray[np.int64]

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
    """Return index pairs of sounding drives and frames, from the last of both backwards."""
    sounding = np.flatnonzero(seen.any(axis=1))
    frames = np.flatnonzero(meant.any(axis=1))
    count = min(len(sounding), len(frames))
    if not count:
        return np.zeros((1, 2), dtype=np.int64)
    return np.stack([sounding[-count:], frames[-count:]], axis=1)


def _frame_starts(frames: _Ints, starts: FloatArray, end: float, count: int) -> FloatArray:
    """Return (F,) start times of all frames, interpolated between the matched ones.

    Those before the first and after the last of these follow each other as most do: a capture may
    show a part of a run.
    """
    gap = max(end - float(starts[-1]), 1.0) / (count - float(frames[-1]))
    if len(frames) > 1:
        gap = float(np.median(np.diff(starts) / np.diff(frames)))
    places = np.arange(count)
    found: FloatArray = np.interp(places, frames, starts)
    outside = np.minimum(places - frames[0], 0.0) + np.maximum(places - frames[-1], 0.0)
    found += outside * gap
    return found

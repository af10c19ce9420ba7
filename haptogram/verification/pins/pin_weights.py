"""The drive of each pin in each frame, from all of its pulses there."""

from __future__ import annotations

from typing import Final

import numpy as np

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.solvers.focus_fit import wrapped_phases
from haptogram.records.pins import PinRecord

from .run_drives import Bools, PinRunDrives, fundamentals_of_run_drives

#: Periods after a latch until no pulse of the old drive is left, and before the next one.
SETTLED: Final = 2.0
_LEAST_WINDOW: Final = 1.0
_SAMPLED: Final = 0.1  # periods by which samples and jitter may move pulses at both ends of it
_MOST_ERRORS: Final = 4.0  # standard errors of a mean that jitter may make
_FEWEST: Final = 3  # pins among which a majority tells which one is wrong


def pin_weights(
    record: PinRecord, run: PinRunDrives, lows: FloatArray, highs: FloatArray
) -> tuple[ComplexArray, FloatArray]:
    """Return the mean drive of each pin from *lows* to *highs* (F, E), in periods, and its jitter.

    The jitter is the largest error of the phase that the scatter of the pulses explains.
    """
    shape = run.count, len(run.elements)
    weights, jitter = np.full(shape, np.nan + 0j, np.complex128), np.zeros(shape)
    begin, end = lows, highs
    for place, element in enumerate(run.elements):
        lows, highs = begin[:, place], end[:, place]
        is_seen = (lows >= 0.0) & (highs <= record.end) & (highs - lows >= _LEAST_WINDOW)
        least = np.maximum(np.floor(np.where(is_seen, highs - lows, 1.0) - _SAMPLED), 1.0)
        centres, vectors = fundamentals_of_run_drives(record.pins[element])
        sums = np.concatenate([[0.0], np.cumsum(vectors.astype(np.complex128))])
        sizes = np.concatenate([[0.0], np.cumsum(np.abs(vectors).astype(np.float64))])
        begins, ends = np.searchsorted(centres, lows), np.searchsorted(centres, highs)
        ends = np.maximum(ends, begins)
        total, size = sums[ends] - sums[begins], sizes[ends] - sizes[begins]
        some = ends > begins
        spans = np.zeros(run.count)
        spans[some] = centres[ends[some] - 1] - centres[begins[some]]
        periods = np.maximum(np.rint(spans) + 1.0, least)
        weights[:, place] = np.where(is_seen, total / periods, np.nan)
        same = np.clip(np.abs(total) / np.maximum(size, 1e-12), 1e-6, 1.0)
        spread = np.sqrt(-2.0 * np.log(same))
        jitter[:, place] = _MOST_ERRORS * spread / np.sqrt(np.maximum(ends - begins, 1))
    return weights, jitter


def common_turns_of_pins(
    record: PinRecord,
    run: PinRunDrives,
    weights: ComplexArray,
    limit_rad: float,
    *,
    each: bool = True,
) -> FloatArray:
    """Return the (F,) phase that the pins of a frame share, against their drives.

    That of a carrier clock is one for the whole capture, unless most pins of a frame share
    another one: a phase that all elements have does not move the focus. With fewer than three pins
    and no clock, or unless *each* frame may have its own, the reference is taken to be right.

    Where an element is the reference, a frame whose pins share no phase has that of the nearest.
    """
    product = weights * np.conj(run.weights)
    sounding = np.isfinite(product) & (np.abs(product) > 0.0)
    errors = np.where(sounding, np.angle(product), np.nan)
    counts = sounding.sum(axis=1)
    is_majority = len(run.elements) >= _FEWEST and each
    if record.reference_element is None:
        common = np.full(run.count, pins_phase(errors[sounding], limit_rad))
    else:
        common = _filled_pin_weights(errors[:, run.elements.index(record.reference_element)])
        for frame in np.flatnonzero(counts >= _FEWEST) if is_majority else ():
            # The phase of the reference alone is known to a sample only.
            found = errors[frame][sounding[frame]]
            common[frame] = pins_phase(found, limit_rad, near=float(common[frame]))
    if not is_majority:
        return common
    agreeing = _agreeing_pins(errors, common, limit_rad).sum(axis=1)
    for frame in np.flatnonzero((2 * agreeing < counts) & (counts >= _FEWEST)):
        found = errors[frame][sounding[frame]]
        shared = pins_phase(found, limit_rad)
        if 2 * (np.abs(wrapped_phases(found - shared)) <= 2.0 * limit_rad).sum() > len(found):
            common[frame] = shared
        elif record.reference_element is not None:
            common[frame] = np.nan  # as of a frame that comes late: its mean is of two drives
    return _filled_pin_weights(common)


def _agreeing_pins(errors: FloatArray, common: FloatArray, limit_rad: float) -> Bools:
    """Return (F, E) True where *errors* are within twice *limit_rad* of the *common* (F,) one."""
    with np.errstate(invalid="ignore"):
        near: Bools = np.abs(wrapped_phases(errors - common[:, None])) <= 2.0 * limit_rad
    return near


def pins_phase(errors: FloatArray, limit_rad: float, *, near: float | None = None) -> float:
    """Return the mean of the most of *errors* (K,) that lie within *limit_rad* of one phase.

    With *near*, they lie within *limit_rad* of one phase together with this one.

    Examples
    --------
    >>> import numpy as np
    >>> phases = np.array([0.1, 3.13, -3.13, 3.14, 3.2])
    >>> round(pins_phase(phases, 0.02) % (2.0 * np.pi), 2)
    3.14
    >>> round(pins_phase(phases, 0.02, near=0.11), 2)
    0.1
    """
    width = 2.0 * limit_rad
    middle = 0.0 if near is None else near
    ordered = np.sort(wrapped_phases(errors - middle))
    if near is None:
        firsts, ordered = ordered, np.concatenate([ordered, ordered + 2.0 * np.pi])
    else:
        ordered = ordered[np.abs(ordered) <= width]
        firsts = ordered[ordered <= 0.0]
    if not len(firsts):
        return middle + float(ordered.mean()) if len(ordered) else middle
    ends = np.searchsorted(ordered, firsts + width, side="right")
    best = int((ends - np.arange(len(firsts))).argmax())
    return middle + float(ordered[best : ends[best]].mean())


def _filled_pin_weights(values: FloatArray) -> FloatArray:
    """Return *values* (F,) with NaN replaced by the nearest valid value; zeros if all are NaN."""
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return np.zeros(len(values))
    places = np.arange(len(values))
    right = np.clip(np.searchsorted(known, places), 0, len(known) - 1)
    left = np.maximum(right - 1, 0)
    nearer = np.where(
        np.abs(known[left] - places) <= np.abs(known[right] - places), known[left], known[right]
    )
    return values[nearer]

"""Stretches of a capture in which every pin holds its drive, and the latches between them.

A pin changes where a pulse moves or changes its width by more than samples and jitter explain.
Changes that follow each other belong together; where all pins hold before and behind them the same
drive, they were a carrier that is not steady, and no latch.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.records.pins import PinPulses, PinRecord

from ..run_drives import fundamentals_of_run_drives

_Ints: TypeAlias = NDArray[np.int64]

_SAMPLES: Final = 1.5  # tolerance of the distance of two edges, each seen up to one sample late
_MOST: Final = 0.8  # share of the pulses between which no latch is
_SPREADS: Final = 4.0  # tolerance, relative to the jitter of most pulses: five standard deviations
_MOST_JITTER: Final = 0.02  # largest jitter, in periods: less than one of 32 steps
_SILENT: Final = 1.6  # periods without a pulse
_LEAST: Final = 2.0  # periods for which a drive is held
_LATCH_PIN: Final = -1
_MOST_CHANGES: Final = 2  # most changes of a pin in a latch: it falls silent and sounds again
_SAME: Final = 1.5  # samples by which the mean of a drive may differ from itself
_LEAST_STEP: Final = 0.01  # least change of a drive, of full drive


@dataclass(frozen=True, slots=True)
class PinLatch:
    """A moment at which pins change; times in periods of the carrier.

    Attributes
    ----------
    begin, end : float
        Times at which the first pin has its new drive, and the last one still its old one.
    places : (K,) numpy.ndarray of int
        Places of the pins that changed, among the elements.
    late : (K,) numpy.ndarray of bool
        Which of them changed more than a period after the first.
    is_steady : bool
        Whether each pin changed once: not where the carrier jitters.
    """

    begin: float
    end: float
    places: _Ints
    late: NDArray[np.bool_]
    is_steady: bool

    @property
    def skew(self) -> float:
        """Least time between the first change and the last; 0: all may be one moment."""
        return max(0.0, self.end - self.begin)

    @property
    def is_torn(self) -> bool:
        """True if not all pins changed within one period."""
        return self.is_steady and bool(self.late.any())


@dataclass(frozen=True, eq=False)
class HeldDrives:
    """S drives that E pins hold, one after the other; times in periods of the carrier.

    Attributes
    ----------
    record : PinRecord
        The capture.
    elements : tuple of int
        Its elements, in order.
    begins, ends : (S,) numpy.ndarray
        Begin and end of the longest time for which every pin holds the drive.
    latches : list of PinLatch
        The S - 1 latches between them.
    weights : (S, E) numpy.ndarray of complex
        A e^{+j phi}, relative to the reference; 0: no pulse.
    duties, lengths, jitters : (S, E) numpy.ndarray
        Share of a period that is driven; distance of pulses in periods, and standard deviation of
        their centres.
    """

    record: PinRecord
    elements: tuple[int, ...]
    begins: FloatArray
    ends: FloatArray
    latches: list[PinLatch]
    weights: ComplexArray
    duties: FloatArray
    lengths: FloatArray
    jitters: FloatArray

    @property
    def count(self) -> int:
        """Number of drives."""
        return len(self.begins)

    def is_silent(self, place: int) -> bool:
        """Return True if no pin has a pulse in the drive at this *place*."""
        return not self.weights[place].any()


def held_pin_drives(record: PinRecord, *, window: float | None = None) -> HeldDrives:
    """Return the drives that the pins of a capture hold.

    Parameters
    ----------
    window : float, optional
        Periods within which changes that follow each other belong to one latch; by default those
        of the capture.
    """
    elements = tuple(sorted(record.pins))
    pins = [record.pins[element] for element in elements]
    found = [_changes_of_pin(pin, record) for pin in pins]
    if record.latches is not None:
        found.append((record.latches, record.latches))
    owners = np.repeat(np.arange(len(found)), [len(after) for after, _ in found])
    owners[owners == len(pins)] = _LATCH_PIN
    after, before = (np.concatenate(part) for part in zip(*found, strict=True))
    order = np.argsort(before, kind="stable")
    after, before, owners = np.minimum(after, before)[order], before[order], owners[order]
    limit = 1.0 + _SAMPLES / record.samples
    groups = [
        (_latch_of_changes(after[a:b], before[a:b], owners[a:b], limit), owners[a:b])
        for a, b in _group_bounds(before, record.latch_window if window is None else window)
    ]
    return _joined_held_drives(record, elements, pins, groups)


def _group_bounds(before: FloatArray, window: float) -> Iterator[tuple[int, int]]:
    """Yield index ranges (begin, end) of sorted values that are at most *window* from the next.

    Nothing is yielded without values.
    """
    if not len(before):
        return
    cuts = np.flatnonzero(np.diff(before) > window) + 1
    bounds = [0, *cuts.tolist(), len(before)]
    yield from itertools.pairwise(bounds)


def _changes_of_pin(pin: PinPulses, record: PinRecord) -> tuple[FloatArray, FloatArray]:
    """Return (C,) the earliest and latest time of each change of a pin's pulses, in periods."""
    rises, falls = pin.rises, pin.falls
    if not len(rises):
        return rises, falls
    due = rises[:-1] + pin.every
    off = np.abs(rises[1:] - due)
    samples = _SAMPLES / record.samples
    usual = _SPREADS * float(np.quantile(off, _MOST)) if len(off) else 0.0
    tolerance = max(samples, min(usual, _MOST_JITTER))
    silent = _SILENT * pin.every
    moved, stopped = off > tolerance, rises[1:] - rises[:-1] > silent
    wider = np.diff(falls - rises)
    bent = (np.abs(wider) > tolerance) & ~moved
    after = [
        falls[:-1][moved],
        np.maximum(due, rises[1:] - pin.every)[stopped],
        rises[1:][bent],
    ]
    before = [
        np.minimum(rises[1:], due)[moved],
        rises[1:][stopped],
        (falls[1:] - np.maximum(wider, 0.0))[bent],
    ]
    if rises[0] > silent:
        after.append(rises[:1] - pin.every)
        before.append(rises[:1])
    if record.end - rises[-1] > silent:
        after.append(falls[-1:])
        before.append(rises[-1:] + pin.every)
    return np.concatenate(after), np.concatenate(before)


def _latch_of_changes(
    after: FloatArray, before: FloatArray, owners: _Ints, limit: float
) -> PinLatch:
    """Return the latch of one group of C pin changes.

    *after* and *before* (C,) are their earliest and latest times in periods, *owners* (C,) the pin
    of each. A pin is late if it changed more than *limit* periods after the first.
    """
    places, firsts, counts = np.unique(owners, return_index=True, return_counts=True)
    begin = float(before[firsts].min())
    late = after[firsts] - begin > limit
    is_pin = places != _LATCH_PIN
    is_steady = bool((counts[is_pin] <= _MOST_CHANGES).all())
    end = float(after[firsts].max() if is_steady else before.max())
    return PinLatch(begin, end, places[is_pin], late[is_pin], is_steady)


# --- drives --------------------------------------------------------------------------------------


def _joined_held_drives(
    record: PinRecord,
    elements: tuple[int, ...],
    pins: list[PinPulses],
    groups: list[tuple[PinLatch, _Ints]],
) -> HeldDrives:
    """Return the drives between *groups* of changes, as measured on the pins.

    Neighbours that are equal within 1.5 samples and their jitter are merged.
    """
    bounds = np.array([0.0, *(max(one.begin, one.end) for one, _ in groups), record.end])
    ends = np.array([*(one.begin for one, _ in groups), record.end])
    lows = bounds[:-1] + 1.0  # the pulse that a latch cut is over
    long = np.flatnonzero(ends - bounds[:-1] >= _LEAST)
    weights, *shapes = _measured_held_drives(record, pins, lows[long], ends[long])
    jitters = shapes[-1]
    apart = _SAME * math.tau / record.samples
    lengths_of = ends[long] - lows[long]
    kept, latches = [0] if len(long) else [], list[PinLatch]()
    for place in range(1, len(long)):
        between = groups[long[place - 1] : long[place]]
        old, new = weights[kept[-1]], weights[place]
        limits = apart + np.hypot(jitters[kept[-1]], jitters[place])
        moved = np.abs(new - old) > np.maximum(limits, _LEAST_STEP)
        moved |= np.isnan(new) != np.isnan(old)
        is_told = any(_LATCH_PIN in owners for _, owners in between)
        if not (moved.any() or is_told):
            if lengths_of[place] > lengths_of[kept[-1]]:
                kept[-1] = place
        else:
            kept.append(place)
            latches.append(_joined_latch([one for one, _ in between]))
    return HeldDrives(
        record,
        elements,
        bounds[:-1][long][kept],
        ends[long][kept],
        latches,
        weights[kept],
        *(values[kept] for values in shapes),
    )


def _joined_latch(latches: list[PinLatch]) -> PinLatch:
    """Merge changes with no steady drive between them into one; that of most pins dates it."""
    if len(latches) == 1:
        return latches[0]
    last = max(latches, key=lambda one: len(one.places))
    return PinLatch(last.begin, latches[-1].end, last.places, last.late, is_steady=False)


def _measured_held_drives(
    record: PinRecord, pins: list[PinPulses], lows: FloatArray, highs: FloatArray
) -> tuple[ComplexArray, FloatArray, FloatArray, FloatArray]:
    """Return (S, E) what E pins show in S stretches, each from *lows* to *highs* (S,).

    These are weights (amplitude and phase against the reference, complex), duties (share of a
    period), distances of successive pulses in periods, and jitters of their centres in turns. Whole
    pulses count; without any the weight is 0 and the distance NaN. All times are in periods.
    """
    shape = len(lows), len(pins)
    weights = np.zeros(shape, np.complex128)
    duties, lengths, jitters = np.zeros(shape), np.full(shape, np.nan), np.zeros(shape)
    slack = _SAMPLES / record.samples
    for place, pin in enumerate(pins):
        _, vectors = fundamentals_of_run_drives(pin)
        begins = np.searchsorted(pin.rises, lows - slack)
        ends = np.maximum(np.searchsorted(pin.falls, highs - slack), begins)
        some = np.flatnonzero(ends > begins)
        if not len(some):
            continue
        a, b = begins[some], ends[some]
        spans = pin.rises[b - 1] - pin.rises[a]
        periods = np.maximum(np.rint(spans / pin.every) + 1.0, 1.0) * pin.every
        sums, sizes, widths = (
            np.concatenate([[0.0], np.cumsum(values)])
            for values in (vectors.astype(np.complex128), np.abs(vectors), pin.falls - pin.rises)
        )
        total = sums[b] - sums[a]
        weights[some, place] = total / periods
        duties[some, place] = (widths[b] - widths[a]) / periods
        with np.errstate(invalid="ignore"):
            lengths[some, place] = np.where(b - a > 1, spans / (b - a - 1), np.nan)
        same = np.clip(np.abs(total) / np.maximum(sizes[b] - sizes[a], 1e-12), 1e-9, 1.0)
        jitters[some, place] = np.sqrt(-2.0 * np.log(same)) / math.tau
    if record.reference_element is None:
        weights = weights * np.exp(-1j * record.reference_rad)
    else:
        own = weights[:, [sorted(record.pins).index(record.reference_element)]]
        size = np.abs(own)
        unit = np.divide(own, size, out=np.full_like(own, np.nan), where=size > 0.0)
        relative = weights * np.conj(unit)
        weights = np.where(weights == 0.0, 0.0, relative)
    return weights, duties, lengths, jitters

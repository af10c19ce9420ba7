"""The moments at which each pin went from the drive of one frame to that of the next.

Every pulse is nearer to the old drive or to the new one; the step between the two is where the
fewest pulses disagree, so that a glitch is no latch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.records.pins import PinRecord

from .run_drives import Bools, PinRunDrives, fundamentals_of_run_drives

#: Smallest difference of drives that single pulses show: in samples, and as a share of full drive.
_SAMPLES: Final = 8.0
_LEAST_DISTANCE: Final = 0.06
_LATCH: Final = 1.25  # periods: a pulse that begins so long before a frame is none of it
_UNCLEAR: Final = 0.1  # share of pulses on the wrong side of a step
_FAINT: Final = 4.0  # samples of a pulse: a shorter one may not be seen
_FIRST_PERIODS: Final = 3.0  # periods of a capture that begins with the run
_PRIOR_PERIODS: Final = 8.0  # periods before the run
_SETTLED: Final = 2.0  # periods after which a frame is judged that began before the capture
_LEAD: Final = 4.0  # periods by which the search begins and ends earlier


@dataclass(frozen=True, eq=False, slots=True)
class PinSteps:
    """The steps of E pins at the begin of F frames, in periods after the frame was due.

    Attributes
    ----------
    after, before : (F, E) numpy.ndarray
        Centre of the last old and of the first new pulse; NaN: the two drives look alike.
    is_inside : (F, E) numpy.ndarray of bool
        Whether there were old and new pulses.
    """

    after: FloatArray
    before: FloatArray
    is_inside: Bools

    @property
    def middle(self) -> FloatArray:
        """(F, E) the middle between the last old and the first new pulse."""
        return (self.after + self.before) / 2.0


def pin_steps(
    record: PinRecord,
    run: PinRunDrives,
    starts: FloatArray,
    ends: FloatArray,
    before: NDArray[np.int64],
    turn_rad: FloatArray,
    *,
    not_before: FloatArray | None = None,
) -> PinSteps:
    """Return the steps of every pin.

    Parameters
    ----------
    starts, ends : (F,) numpy.ndarray
        When the frames are due and over, in periods of the capture.
    before : (F,) numpy.ndarray of int
        Frame whose drive was there before each; -1: none.
    turn_rad : (F,) numpy.ndarray
        Phase of the pins against the drives.
    not_before : (F,) numpy.ndarray, optional
        Times before which the drive of the frame before was not there yet: it came late.
    """
    lead = np.full(run.count, min(_LEAD, run.gap / 4.0))
    lows, highs = starts - lead, np.append(starts[1:] - lead[1:], ends[-1] - lead[-1])
    if starts[0] >= -_SETTLED:
        lows[0] = max(lows[0], 0.0)
    if not_before is not None:
        lows = np.maximum(lows, not_before)
    is_seen = (lows >= 0.0) & (highs <= record.end)
    shape = run.count, len(run.elements)
    after, first = np.full(shape, np.nan), np.full(shape, np.nan)
    inside = np.zeros(shape, np.bool_)
    prior = sound_before_run(record, run, float(starts[0]))
    turns = np.exp(1j * turn_rad)
    faint = math.sin(math.pi * _FAINT / record.samples)
    for place, element in enumerate(run.elements):
        wanted = run.weights[:, place] * turns
        old = np.where(before >= 0, run.weights[before, place] * turns, prior[place])
        far = np.abs(wanted - old) > max(_LEAST_DISTANCE, _SAMPLES * np.pi / record.samples)
        told = is_seen & far
        centres, vectors = fundamentals_of_run_drives(record.pins[element])
        _write_pin_steps(
            centres,
            vectors,
            lows,
            highs,
            told,
            old,
            wanted,
            faint,
            (after[:, place], first[:, place], inside[:, place]),
        )
    after -= starts[:, None]
    first -= starts[:, None]
    return PinSteps(after, first, inside)


def sound_before_run(record: PinRecord, run: PinRunDrives, start: float) -> ComplexArray:
    """Return the (E,) drives that the pins show just before the run, which begins at *start*.

    They are those on the phase of the capture. A capture that begins later has them in its first
    periods, if the first frame comes late.
    """
    end = max(start - _LEAD - _LATCH, _FIRST_PERIODS)
    begin = max(0.0, end - _PRIOR_PERIODS)
    found = np.zeros(len(run.elements), np.complex128)
    for place, element in enumerate(run.elements):
        centres, vectors = fundamentals_of_run_drives(record.pins[element])
        low, high = np.searchsorted(centres, [begin, end])
        found[place] = vectors[low:high].sum() / max(float(high - low), np.floor(end - begin))
    return found


def _write_pin_steps(
    centres: FloatArray,
    vectors: ComplexArray,
    lows: FloatArray,
    highs: FloatArray,
    told: Bools,
    old: ComplexArray,
    wanted: ComplexArray,
    faint: float,
    found: tuple[FloatArray, FloatArray, Bools],
) -> None:
    """Write when one pin steps from *old* to *wanted* (F,) in each frame, and if that is certain.

    Read are its pulses, *centres* and *vectors* (P,), between *lows* and *highs* (F,) where *told*;
    written are the three arrays (F,) of *found*: last old pulse, first new one, certain. An
    amplitude up to *faint* counts as silence.
    """
    after, first, inside = found
    begins, ends = np.searchsorted(centres, lows), np.searchsorted(centres, highs)
    frames = np.flatnonzero(told & (ends > begins))
    if not len(frames):
        return
    sizes = (ends - begins)[frames]
    groups = np.repeat(np.arange(len(frames)), sizes)
    offsets = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    pulses = np.arange(len(groups)) - offsets[groups] + begins[frames][groups]
    these, meant = vectors[pulses], frames[groups]
    is_old = np.abs(these - old[meant]) < np.abs(these - wanted[meant])
    votes = np.where(is_old, 1, -1)
    sums = np.cumsum(votes)
    sums = sums - (sums[offsets] - votes[offsets])[groups]  # within each frame
    tops = np.maximum.reduceat(sums, offsets)
    is_top = sums == tops[groups]
    last = np.minimum.reduceat(np.where(is_top, np.arange(len(sums)), len(sums)), offsets)
    none = tops <= 0  # no pulse is old
    lasting = np.where(none, offsets - 1, last)
    number = lasting - offsets + 1
    some_old, some_new = number > 0, number < sizes
    after[frames] = np.where(some_old, centres[pulses[np.maximum(lasting, 0)]], lows[frames])
    following = np.minimum(lasting + 1, len(pulses) - 1)
    first[frames] = np.where(some_new, centres[pulses[following]], highs[frames])
    begun, ended = np.abs(old[frames]) <= faint, np.abs(wanted[frames]) <= faint
    after[frames[begun]] = np.maximum(after[frames], first[frames] - 1.0)[begun]
    first[frames[ended]] = (after[frames] + 1.0)[ended]
    olds = np.add.reduceat(is_old.astype(np.int64), offsets)
    olds_before = np.where(none, 0, (number + tops) // 2)
    against = (number - olds_before) + (olds - olds_before)
    is_clear = against <= 1 + _UNCLEAR * sizes
    inside[frames] = (some_old | begun) & (some_new | ended) & (after[frames] < highs[frames] - 1.5)
    inside[frames] &= is_clear

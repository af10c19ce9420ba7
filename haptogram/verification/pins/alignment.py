"""The place of a run in a capture: neither knows the clock of the other.

The drives of the run are correlated with those at the pins, over every shift; then the moments at
which pins change their drive give offset and rate of the two clocks to a fraction of a period.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import FloatArray
from haptogram.records.pins import PinRecord

from .latch_steps import pin_steps
from .pin_weights import pin_turns_of_reference
from .run_drives import Bools, PinRunDrives, fundamentals_of_run_drives

_Cells: TypeAlias = NDArray[np.complex64]

_SHARE_OF_FRAME: Final = 0.2  # of a cell in which pulses are averaged
_CELLS: Final = (2.0, 40.0)  # least and most periods of one
_MOST_CELLS: Final = 4_000_000
_MOST_ELEMENTS: Final = 32  # that are correlated
_NEAR_PERIODS: Final = 2.5  # of the line through the latches: those of one clock
_ROUNDS: Final = 3
_PLACES: Final = 3  # that are tried: wrong pins may make another one look better


@dataclass(frozen=True, slots=True)
class PinAlignment:
    """Frame at *u* periods of the run is due at ``offset + rate * u`` periods of the capture.

    Attributes
    ----------
    offset, rate : float
        Of the two clocks.
    turn_rad : float
        Phase of the pins against the drives; of a reference that is an element, a first guess.
    within : float
        Periods by which the offset may be wrong: a cell, unless changes of the drive gave it.
    """

    offset: float
    rate: float
    turn_rad: float
    within: float = 0.0

    def shifted(self, periods: float) -> PinAlignment:
        """Return the alignment of a run that begins so much later."""
        return replace(self, offset=self.offset + periods)

    def starts(self, run: PinRunDrives) -> FloatArray:
        """Return (F,) the times at which frames are due in the capture."""
        times: FloatArray = self.offset + self.rate * run.starts
        return times

    def ends(self, run: PinRunDrives) -> FloatArray:
        """Return (F,) the times at which frames are over in the capture."""
        times: FloatArray = self.offset + self.rate * run.ends
        return times


def rates_of_pin_alignment(record: PinRecord, run: PinRunDrives) -> list[float]:
    """Return the rates that the clock of the frames may have against the carrier.

    One crystal makes both; or two do, and then the analyser's own clock is the better guess.
    """
    other = 1.0 + record.drift_ppm * 1e-6
    apart = abs(other - 1.0) * float(run.ends[-1])
    return [1.0, other] if apart > _SHARE_OF_FRAME * run.gap else [1.0]


def align_pins_to_run(record: PinRecord, run: PinRunDrives, rate: float) -> Iterator[PinAlignment]:
    """Yield the places at which the run fits best, the best first, if its clock has this *rate*."""
    cell = float(np.clip(_SHARE_OF_FRAME * run.gap, *_CELLS))
    cell = max(cell, (record.end + run.ends[-1]) / _MOST_CELLS)
    seen = _cells_of_pins(record, cell, run)
    meant = _cells_of_run_for_pins(record, run, rate, cell)
    size = 1 << int(len(seen) + len(meant)).bit_length()
    total = np.zeros(size, np.complex64)
    for place in range(seen.shape[1]):
        spectrum = np.fft.fft(seen[:, place], size)
        total += np.fft.ifft(spectrum * np.conj(np.fft.fft(meant[:, place], size)))
    heights = np.abs(total)
    near = int(np.ceil(run.gap / cell))
    for _ in range(_PLACES):
        best = int(heights.argmax())
        shift = best if best < len(seen) else best - size
        found = PinAlignment(shift * cell, rate, float(np.angle(total[best])), cell)
        yield _refined_alignment(record, run, found)
        heights[np.arange(best - near, best + near + 1) % size] = 0.0


def align_pins_by_onset(record: PinRecord, run: PinRunDrives) -> PinAlignment | None:
    """Return the alignment by the first sound of the capture; None: it begins with sound."""
    firsts = sorted(float(p.rises[0]) for p in record.pins.values() if len(p.rises))
    if not firsts or firsts[len(firsts) // 2] < run.gap / 2.0 + 2.0:
        return None
    return PinAlignment(firsts[len(firsts) // 4] - 0.5, 1.0, 0.0)


# --- correlation ---------------------------------------------------------------------------------


def _cells_of_pins(record: PinRecord, cell: float, run: PinRunDrives) -> _Cells:
    """Return (C, E) the drive of each pin, averaged over cells of the capture."""
    count = int(record.end / cell) + 1
    rows = []
    for element in run.elements:
        centres, vectors = fundamentals_of_run_drives(record.pins[element])
        places = np.clip((centres / cell).astype(np.int64), 0, count - 1)
        sums = np.bincount(places, vectors.real, count) + 1j * np.bincount(
            places, vectors.imag, count
        )
        rows.append((sums / cell).astype(np.complex64))
    return _relative_cells_of_pins(np.array(rows).T, record, run)


def _cells_of_run_for_pins(
    record: PinRecord, run: PinRunDrives, rate: float, cell: float
) -> _Cells:
    """Return (C, E) the same of the run, as it was meant."""
    ends = rate * run.ends
    times = (np.arange(int(ends[-1] / cell) + 1) + 0.5) * cell
    frames = np.searchsorted(rate * run.starts, times, side="right") - 1
    cells = np.where((times < ends[-1])[:, None], run.weights[frames], 0.0)
    return _relative_cells_of_pins(cells.astype(np.complex64), record, run)


def _relative_cells_of_pins(cells: _Cells, record: PinRecord, run: PinRunDrives) -> _Cells:
    """Return *cells* relative to the reference, if that is an element, of some elements."""
    kept = np.arange(len(run.elements))
    if record.reference_element is not None:
        place = run.elements.index(record.reference_element)
        size = np.abs(cells[:, place])
        unit = np.divide(cells[:, place], size, out=np.zeros_like(cells[:, place]), where=size > 0)
        cells = cells * np.conj(unit)[:, None]
        kept = np.delete(kept, place) if len(kept) > 1 else kept
    step = max(1, len(kept) // _MOST_ELEMENTS)
    return cells[:, kept[::step]]


# --- the line through the latches ----------------------------------------------------------------


def _refined_alignment(record: PinRecord, run: PinRunDrives, found: PinAlignment) -> PinAlignment:
    """Return *found* with offset and rate from the moments at which pins change."""
    before = np.arange(-1, run.count - 1)
    for number in range(_ROUNDS):
        starts, ends = found.starts(run), found.ends(run)
        turns: float | FloatArray = found.turn_rad
        if record.reference_element is not None:
            turns = pin_turns_of_reference(record, run, starts, ends)
        steps = pin_steps(record, run, starts, ends, before, turns, early=0.5)
        late = np.where(steps.is_inside, steps.middle, np.nan)
        known = np.isfinite(late).any(axis=1)
        if not known.any():
            return _align_by_latch_pin(record, run, found)
        by_frame = np.nanmedian(late[known], axis=1)
        shift = _mode_of_alignment(by_frame, _NEAR_PERIODS)
        found = replace(found, offset=found.offset + shift, within=0.0)
        if number:
            found = _alignment_with_rate(run.starts[known], by_frame - shift, found)
    return found


def _align_by_latch_pin(record: PinRecord, run: PinRunDrives, found: PinAlignment) -> PinAlignment:
    """Return *found* with the offset of the latch pin, where no drive tells when it was latched."""
    if record.latches is None or not len(record.latches):
        return found
    starts = found.starts(run)
    places = np.clip(np.searchsorted(record.latches, starts), 1, max(1, len(record.latches) - 1))
    around = record.latches[np.stack([places - 1, np.minimum(places, len(record.latches) - 1)])]
    late = around - starts
    nearest = np.take_along_axis(late, np.abs(late).argmin(axis=0)[None], axis=0)[0]
    near = nearest[np.abs(nearest) < run.gap / 2.0]
    if not len(near):
        return found
    return replace(found, offset=found.offset + _mode_of_alignment(near, _NEAR_PERIODS), within=0.0)


def _alignment_with_rate(starts: FloatArray, late: FloatArray, found: PinAlignment) -> PinAlignment:
    near: Bools = np.abs(late) < _NEAR_PERIODS
    if near.sum() < 8:
        return found
    slope, shift = np.polyfit(starts[near], late[near], 1)
    return replace(found, offset=found.offset + float(shift), rate=found.rate + float(slope))


def _mode_of_alignment(values: FloatArray, width: float) -> float:
    """Return the middle of the densest window of *width* among *values*."""
    ordered = np.sort(values)
    ends = np.searchsorted(ordered, ordered + width, side="right")
    best = int((ends - np.arange(len(ordered))).argmax())
    return float(np.median(ordered[best : ends[best]]))

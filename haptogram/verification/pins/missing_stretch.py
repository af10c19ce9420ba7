"""A stretch of time that a capture lacks: frames that are ahead of their times behind it.

A short window of pulses shows one frame of the run. Where samples are missing, all windows on one
side show the frames that were due so much later, or earlier, and those on the other side are right.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.records.pins import PinRecord

from .pin_weights import pins_phase, wrapped_pin_angles
from .run_drives import Bools, PinRunDrives, fundamentals_of_run_drives
from .shared_phase import shared_turns_of_pins
from .shown_frames import FramesShownByPins, PinCaptureLimits

_SHARE_OF_FRAME: Final = 0.1  # of a window
_WINDOW: Final = (2.0, 8.0)  # periods of one
_LATCH: Final = (1.25, 2.25)  # periods around a latch in which pins show neither drive
_LEAST: Final = 1.25  # periods by which frames are ahead: what is less turns the pins alone
_LONGEST: Final = 4000.0  # periods of a stretch that is sought
_FRAMES: Final = 64  # of the run that are compared with a window
_ERRORS: Final = 3.0  # limits of a whole frame that one window may be off
_SMOOTHED_RAD: Final = 0.04  # by which a clock may be off beside samples that are missing
_FEWEST: Final = 2  # windows that show that frames are not in time
_IN_TIME: Final = 1.0  # periods
_BESIDE: Final = 3.0  # windows between the last one in time and a jump of the phase
_GROUPS: Final = 8  # of wrong frames that are looked at
_LOST: Final = 2  # windows that show nothing where samples are missing
_PARTS: Final = 2  # stretches that are missing next to each other


@dataclass(frozen=True, slots=True)
class MissingStretch:
    """A place of a capture at which time is missing.

    Attributes
    ----------
    at : float
        Its period in the capture.
    is_before_run : bool
        Whether the frames behind it are those that are in time.
    """

    at: float
    is_before_run: bool


def missing_stretch_of_capture(
    record: PinRecord, run: PinRunDrives, shown: FramesShownByPins, fitting: Bools
) -> MissingStretch | None:
    """Return the place at which missing samples explain frames that are wrong; None: none does.

    Parameters
    ----------
    fitting : (E,) numpy.ndarray of bool
        Pins that show the run; the others are wrong whatever is missing.
    """
    judged = shown.seen & ~shown.lost
    wrong = np.flatnonzero(judged & ~shown.right[:, fitting].all(axis=1))
    if not len(wrong) or not fitting.any():
        return None
    groups = np.split(wrong, np.flatnonzero(np.diff(wrong) > 2) + 1)
    search = _StretchSearch.of(record, run, shown, fitting)
    right = judged & shown.right[:, fitting].all(axis=1) & shown.steps.is_inside.any(axis=1)
    for group in groups[:_GROUPS]:
        first, last = int(group[0]), int(group[-1])
        # Frames in time on both sides leave room for no more than a part of a period.
        behind = bool((right & (shown.late > -_IN_TIME))[last + 1 :].any())
        before = bool((right & (shown.late < _IN_TIME))[:first].any())
        for found in search.explanations(first, last, before=before, behind=behind):
            return found
    return None


@dataclass(frozen=True, eq=False)
class _StretchSearch:
    """What the search for a stretch knows of capture and run."""

    record: PinRecord
    run: PinRunDrives
    starts: FloatArray
    places: NDArray[np.intp]
    width: float
    limit_rad: float
    limit_amplitude: float
    turn_rad: float | None
    pass_periods: float

    @classmethod
    def of(
        cls, record: PinRecord, run: PinRunDrives, shown: FramesShownByPins, fitting: Bools
    ) -> _StretchSearch:
        limits = PinCaptureLimits.of(record)
        turn = None
        if record.reference_element is None:
            turns = shared_turns_of_pins(shown)
            known = turns[np.isfinite(turns)]
            turn = pins_phase(known, limits.phase_rad) if len(known) else 0.0
        return cls(
            record,
            run,
            shown.starts,
            np.flatnonzero(fitting),
            float(np.clip(_SHARE_OF_FRAME * run.gap, *_WINDOW)),
            _ERRORS * limits.phase_rad + float(run.allowed_rad.max()) + _SMOOTHED_RAD,
            _ERRORS * limits.amplitude,
            turn,
            run.pass_periods,
        )

    def explanations(
        self, first: int, last: int, *, before: bool, behind: bool
    ) -> Iterator[MissingStretch]:
        """Yield the stretches that explain the wrong frames from *first* to *last*.

        There are frames in time *before* them, and *behind*.
        """
        run, starts = self.run, self.starts
        begin = float(starts[first - 1]) if first else float(starts[0]) - run.gap
        end = float(starts[last + 2]) if last + 2 < run.count else float(starts[-1]) + 2.0 * run.gap
        found = self._split(begin, end, 1.0, turned_only=behind)
        if found is not None:
            yield MissingStretch(found, is_before_run=False)
        if not before:
            found = self._split(begin, end, -1.0)
            if found is not None:
                yield MissingStretch(found, is_before_run=True)

    def _split(
        self, begin: float, end: float, sign: float, *, turned_only: bool = False
    ) -> float | None:
        """Return where time is missing, so that the later windows are ahead; None: nowhere.

        With the *sign* -1 it is the earlier windows that are not in time.
        """
        begin, end = max(begin, 0.0), min(end, self.record.end)
        width = self.width
        count = int((end - begin) / width)
        if count < 2 * _FEWEST:
            return None
        middles: FloatArray = begin + (np.arange(count, dtype=np.float64) + 0.5) * width
        seen = self._seen(middles)
        frames = self._frames_near(middles, sign)
        longest = min(_LONGEST, float(self.starts[-1] - self.starts[0]) + 2.0 * self.run.gap)
        if self._is_out_of_reach(middles, frames, sign, longest):
            return None
        beside = self._beside_run(seen)
        shows, turns = self._shows(seen, frames)
        order = slice(None, None, int(sign))
        in_time, told = (one[order] for one in self._explained(middles, shows, frames, beside, 0.0))
        wrong = np.flatnonzero(~in_time)
        split = int(wrong[0]) if len(wrong) else len(in_time)
        turned = self._turn_between(middles, turns, frames, seen)
        if split == len(in_time):
            return turned
        is_turned = turned is not None and abs(turned - middles[order][split]) <= _BESIDE * width
        aheads = np.zeros(0) if turned_only else np.arange(np.ceil(_LEAST), longest, 1.0)
        if self.turn_rad is None:
            aheads = np.append(0.0, aheads)
        found = [self._explained(middles, shows, frames, beside, sign * a) for a in aheads]
        if not found:
            return None
        fits = np.array([one[order] for one, _ in found])
        tells = np.array([one[order] for _, one in found])
        ahead = _ahead_in_parts(fits, tells, split)
        is_edge = end >= self.record.end if sign > 0.0 else begin <= 0.0
        if ahead is None and is_edge and count - split <= _LOST + 1:
            ahead = 0  # too little is left to tell
        elif ahead is not None and aheads[ahead] == 0.0 and not is_turned:
            ahead = _ahead_in_parts(fits[1:], tells[1:], split)
        if ahead is None:
            return None
        known = np.flatnonzero(told[:split])
        last = int(known[-1]) if len(known) else 0
        return float(middles[order][last] + sign * width / 2.0)

    def _frames_near(self, middles: FloatArray, sign: float) -> NDArray[np.intp]:
        """Return the frames that windows may show: those from a few before these times on."""
        near = np.searchsorted(self.starts, middles[0 if sign > 0.0 else -1])
        low = near - 2 if sign > 0.0 else near - _FRAMES
        return np.arange(max(0, low), max(0, min(self.run.count, max(low, 0) + _FRAMES)))

    def _is_out_of_reach(
        self, middles: FloatArray, frames: NDArray[np.intp], sign: float, longest: float
    ) -> bool:
        """Return True if no time up to *longest* explains all windows: there are too many.

        A window that is explained shows one of the *frames*, or what lies beyond the run.
        """
        if sign > 0.0:
            end = np.append(self.starts, [np.inf, np.inf])[frames[-1] + 2]
            hidden = (middles > end) & (middles + longest <= self.starts[-1] + self.run.gap / 2.0)
        else:
            hidden = (middles < self.starts[frames[0]]) & (middles - longest >= self.starts[0])
        return int(np.count_nonzero(hidden)) > _PARTS * _LOST

    def _seen(self, middles: FloatArray) -> ComplexArray:
        """Return the (W, E) mean drive of each window."""
        seen = np.zeros((len(middles), len(self.places)), np.complex128)
        for column, place in enumerate(self.places):
            pin = self.record.pins[self.run.elements[place]]
            centres, vectors = fundamentals_of_run_drives(pin)
            sums = np.concatenate([[0.0], np.cumsum(vectors.astype(np.complex128))])
            low = np.searchsorted(centres, middles - self.width / 2.0)
            high = np.searchsorted(centres, middles + self.width / 2.0)
            counts = np.maximum(high - low, np.floor(self.width - 0.1))
            seen[:, column] = (sums[high] - sums[low]) / np.maximum(counts, 1.0)
        return seen

    def _shows(self, seen: ComplexArray, frames: NDArray[np.intp]) -> tuple[Bools, FloatArray]:
        """Return (W, J) whether windows show frames, and the phase that their pins share."""
        meant = self.run.weights[np.ix_(frames, self.places)]
        product = seen[:, None] * np.conj(meant[None])
        turns = np.angle(product.sum(axis=2))
        if self.turn_rad is not None:
            turns = np.full_like(turns, self.turn_rad)
        errors = np.abs(np.angle(product * np.exp(-1j * turns)[:, :, None]))
        least = np.minimum(np.abs(seen)[:, None], np.abs(meant)[None])
        sizes = np.abs(np.abs(seen)[:, None] - np.abs(meant)[None])
        near = (errors <= self.limit_rad) | (least <= self.limit_amplitude)
        shows: Bools = (near & (sizes <= self.limit_amplitude)).all(axis=2)
        return shows, turns

    def _explained(
        self,
        middles: FloatArray,
        shows: Bools,
        frames: NDArray[np.intp],
        beside: tuple[Bools, Bools, Bools],
        ahead: float,
    ) -> tuple[Bools, Bools]:
        """Return the (W,) windows that show what is due *ahead* periods later, or tell nothing.

        The second of both are those that show it. A frame may come late: then the one before is
        still there. Of what lies *beside* the run see :meth:`_beside_run`.
        """
        before, fading, behind = beside
        times = middles + ahead
        shown = self._in_pass(times)
        due = np.searchsorted(self.starts, times, side="right") - 1
        column = np.searchsorted(self.starts, shown, side="right") - 1
        column -= frames[0] if len(frames) else 0
        inside = (column >= 0) & (column < len(frames))
        rows = np.arange(len(middles))
        tells = np.zeros(len(middles), np.bool_)
        tells[inside] = shows[rows[inside], column[inside]]
        tells |= (times > self.starts[-1] + self.run.gap / 2.0) & fading
        tells |= (due < 0) & before
        tells |= (times > self.starts[-1] + self.run.gap) & behind
        older = (column >= 1) & (column <= len(frames))
        fits = tells | self._beside_latches(shown, frames)
        fits[older] |= shows[rows[older], column[older] - 1]
        return fits, tells

    def _beside_run(self, seen: ComplexArray) -> tuple[Bools, Bools, Bools]:
        """Return the (W,) windows that may lie before the run, at its end, and behind it.

        There lies what the first and the last window show, or silence.
        """
        behind = self._alike(seen, seen[-1])
        behind |= np.convolve(behind, np.ones(5), "same") > 0.0  # pulses that are cut
        before = self._alike(seen, seen[0]) | self._alike(seen, seen[1])
        return before, self._fading(seen), behind

    def _in_pass(self, times: FloatArray) -> FloatArray:
        """Return times before the run as those of the same drives in it, if its object repeats."""
        if not self.pass_periods:
            return times
        folded = self.starts[0] + np.mod(times - self.starts[0], self.pass_periods)
        return np.where(times < self.starts[0], folded, times)

    def _beside_latches(self, times: FloatArray, frames: NDArray[np.intp]) -> Bools:
        """Return the (W,) windows in which pins may latch."""
        latches = self.starts[frames]
        before, behind = (self.width / 2.0 + periods for periods in _LATCH)
        low, high = (
            np.searchsorted(latches, times - behind),
            np.searchsorted(latches, times + before, side="right"),
        )
        beside: Bools = high > low
        return beside

    def _fading(self, seen: ComplexArray) -> Bools:
        """Return the (W,) windows that show the last frame, as it is, fading or off."""
        meant = self.run.weights[-1, self.places]
        product = seen * np.conj(meant)
        turns = np.angle(product.sum(axis=1))[:, None] if self.turn_rad is None else self.turn_rad
        is_near = np.abs(np.angle(product * np.exp(-1j * turns))) <= self.limit_rad
        is_near &= np.abs(seen) <= np.abs(meant) + self.limit_amplitude
        is_silent = (np.abs(seen) <= self.limit_amplitude).all(axis=1)
        beside: Bools = np.convolve(is_silent, np.ones(5), "same") > 0.0  # pulses that are cut
        fading: Bools = (is_near | (np.abs(seen) <= self.limit_amplitude)).all(axis=1) | beside
        return fading

    def _alike(self, seen: ComplexArray, other: ComplexArray) -> Bools:
        """Return the (W,) windows that show the drives of another one, but for a shared phase."""
        product = seen * np.conj(other)
        turns = 0.0 if self.turn_rad is not None else np.angle(product.sum(axis=1))[:, None]
        errors = np.abs(np.angle(product * np.exp(-1j * turns)))
        least = np.minimum(np.abs(seen), np.abs(other))
        near = (errors <= self.limit_rad) | (least <= self.limit_amplitude)
        alike: Bools = (near & (np.abs(np.abs(seen) - np.abs(other)) <= self.limit_amplitude)).all(
            axis=1
        )
        return alike

    def _turn_between(
        self,
        middles: FloatArray,
        turns: FloatArray,
        frames: NDArray[np.intp],
        seen: ComplexArray,
    ) -> float | None:
        """Return where the phase that all pins share jumps, while every frame is in time."""
        if self.turn_rad is not None:
            return None
        column = np.searchsorted(self.starts, middles, side="right") - 1 - frames[0]
        inside = (column >= 0) & (column < len(frames))
        inside &= (np.abs(seen) > self.limit_amplitude).any(axis=1)
        kept = np.flatnonzero(inside & ~self._beside_latches(middles, frames))
        if len(kept) < 2 * _FEWEST:
            return None
        shared = turns[kept, column[kept]]
        steps = np.abs(wrapped_pin_angles(np.diff(shared)))
        place = int(steps.argmax())
        others = np.delete(steps, [p for p in (place - 1, place, place + 1) if 0 <= p < len(steps)])
        limit = self.limit_rad + 2.0 * float(np.median(others) if len(others) else 0.0)
        return float(middles[kept[place]]) if steps[place] > limit else None


def _ahead_in_parts(fits: Bools, tells: Bools, begin: int) -> int | None:
    """Return the row of the (L, W) *fits* that reach from window *begin* to the end.

    They may do so in a few parts, of each of which some windows *tell*. None: they do not.
    """
    count = fits.shape[1]
    least = 0
    for _ in range(_PARTS):
        first = begin + _LOST
        if first >= count or least >= len(fits):
            return None
        rest = fits[least:, first:]
        reach = np.where(rest.all(axis=1), count, first + (~rest).argmax(axis=1))
        inside = np.arange(first, count) < reach[:, None]
        enough = (tells[least:, first:] & inside).sum(axis=1) >= _FEWEST
        if not enough.any():
            return None
        best = int(np.where(enough, reach, 0).argmax())
        if reach[best] == count:
            return least + best
        least, begin = least + best, int(reach[best])
    return None

"""The frames that the pins of a capture show, with their times and drives."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.records.pins import PinRecord

from .elements.faults import PinDrives
from .held.drives import held_pin_drives
from .held.matching import matched_drives
from .latch_steps import PinSteps, pin_steps, sound_before_run
from .pin_verdict import PinLimits
from .pin_weights import SETTLED, common_turns_of_pins, pin_weights
from .run_drives import Bools, PinRunDrives

#: Share of the captured drives that are right in a capture of this run.
FIT_SHARE: Final = 0.5
#: Longest time from the first to the last pin of a latch: a period, and the error of a cut pulse.
TORN_PERIODS: Final = 1.25
#: A frame is late from here on: one for the boundary that is awaited, one for its pulse in it.
LATE_PERIODS: Final = 2.0
_HALF: Final = 0.5
_SILENT: Final = 2.5  # periods without a pulse
_LAST_PERIODS: Final = 7.0  # end of a frame, in which a latch shows nothing that can be judged
_LATCH_PERIODS: Final = 1.5  # time in which all pins latch: a period, and a pulse that was cut
_EARLY_PINS: Final = 0.25  # share of the pins that may latch before a frame counts as latched
_MOST_JITTER_RAD: Final = math.pi / 256.0  # largest jitter of a mean: half a step of 8 bits
_LATCH_SLACK: Final = 2.0  # periods by which a latch may seem to be early


@dataclass(frozen=True, eq=False)
class FramesShownByPins:
    """F frames of a run at E pins; times in periods of the carrier.

    Attributes
    ----------
    starts, ends : (F,) numpy.ndarray
        When each frame is due and over in the capture.
    drives : PinDrives
        Measured drive of each pin in each frame.
    steps : PinSteps
        When each pin latched each frame.
    lost : (F,) numpy.ndarray of bool
        Frames during which the pins kept the drive of the one before, or that the latch pin lacks.
    late : (F,) numpy.ndarray
        By how much later than most a frame was latched; 0: not known.
    """

    starts: FloatArray
    ends: FloatArray
    drives: PinDrives
    steps: PinSteps
    lost: Bools
    late: FloatArray

    @cached_property
    def seen(self) -> Bools:
        """(F,) whether all pins show the frame for long enough."""
        return np.asarray(np.isfinite(self.drives.weights).all(axis=1))

    @cached_property
    def right(self) -> Bools:
        """(F, E) whether a pin does what was intended."""
        return self.drives.all_right()

    @cached_property
    def latched(self) -> Bools:
        """(F, E) whether a pin shows when it latched a frame that was not lost."""
        return self.steps.is_inside & ~self.lost[:, None]

    @cached_property
    def apart(self) -> FloatArray:
        """(F,) periods from the first new to the last old pulse of the pins that latched."""
        after = np.where(self.latched, self.steps.after, -np.inf).max(axis=1)
        before = np.where(self.latched, self.steps.before, np.inf).min(axis=1)
        apart: FloatArray = after - before
        return apart

    @cached_property
    def torn(self) -> Bools:
        """(F,) whether the pins did not latch within one period.

        Steps before the time of a frame after a lost one are the latch of that: it came in its
        last periods. Those before the first frame are of another sound.
        """
        firsts: FloatArray = np.where(self.latched, self.steps.before, np.inf).min(axis=1)
        early: Bools = firsts < -TORN_PERIODS
        early &= np.append(True, self.lost[:-1])
        torn: Bools = (self.latched.sum(axis=1) > 1) & (self.apart > TORN_PERIODS) & ~early
        return torn


def frames_shown_by_pins(
    record: PinRecord, run: PinRunDrives, offset: float | None = None
) -> FramesShownByPins:
    """Return the frames of a run that a capture shows; *offset* is when it begins, if known."""
    begin, rate = align_pins_to_run(record, run) if offset is None else (offset, 1.0)
    pins = _AlignedPins(record, run, begin + rate * run.starts, begin + rate * run.ends)
    prior = sound_before_run(record, run, float(pins.starts[0]))
    as_due = pins.drives(each=False)
    lost, before = _frames_lost_on_pins(record, as_due, prior)
    steps = pins.steps(as_due, before)
    lost |= _pins_without_latch(record, pins.starts, pins.ends) & ~steps.is_inside.any(axis=1)
    drives, late = pins.drives(steps, before), _pin_lateness(steps, lost)
    return FramesShownByPins(pins.starts, pins.ends, drives, steps, lost, late)


@dataclass(frozen=True, eq=False)
class _AlignedPins:
    """A capture beside the frames of a run, which are due and over at times of the capture."""

    record: PinRecord
    run: PinRunDrives
    starts: FloatArray
    ends: FloatArray

    @cached_property
    def _limits(self) -> PinLimits:
        """Return the largest errors in phase and amplitude that pass, by the sampling rate."""
        return PinLimits.of(self.record)

    def steps(self, as_due: PinDrives, before: NDArray[np.int64]) -> PinSteps:
        """Return the steps of all pins; *before* is the frame that was shown before each."""
        record, run, starts, ends = self.record, self.run, self.starts, self.ends
        weights = as_due.weights * np.exp(1j * as_due.turns_rad)[:, None]
        turns = common_turns_of_pins(record, run, weights, self._limits.phase_rad)
        steps = pin_steps(record, run, starts, ends, before, turns)
        latest = np.where(steps.is_inside, steps.after, 0.0).max(axis=1)[:-1]
        held = np.append(-np.inf, starts[:-1] + latest + TORN_PERIODS)
        if (held > starts - LATE_PERIODS).any():  # the search for a latch begins a little earlier
            steps = pin_steps(record, run, starts, ends, before, turns, not_before=held)
        if run.held is not None:  # what moves with a carrier that is not steady is no step
            steps = replace(steps, is_inside=np.zeros_like(steps.is_inside))
        return steps

    def drives(
        self,
        steps: PinSteps | None = None,
        before: NDArray[np.int64] | None = None,
        *,
        each: bool = True,
    ) -> PinDrives:
        """Return the drives from when each pin has latched, by *steps* or else when it is due."""
        record, run, limits = self.record, self.run, self._limits
        shape = run.count, len(run.elements)
        lows = np.broadcast_to(self.starts[:, None], shape) + SETTLED
        highs = np.broadcast_to(self.ends[:, None], shape) - 1.0
        highs[-1] = _last_frame_end(record, run, self.starts, self.ends)
        if steps is not None:
            late = np.where(steps.is_inside, np.maximum(steps.after, 0.0), 0.0)
            lows += np.where(steps.is_inside, late, late.max(axis=1, keepdims=True))
            highs[:-1] += np.where(steps.is_inside, np.minimum(steps.before, 1.0), 1.0)[1:] - 1.0
        if run.held is not None:
            lows = np.maximum(lows, run.held[:, :1])
            highs = np.minimum(highs, run.held[:, 1:])
        begins = np.array([record.pins[element].begin for element in run.elements])
        lows = np.where(lows < begins, np.nan, lows)  # a level that is not known shows nothing
        weights, jitter_rad = pin_weights(record, run, lows, highs)
        turns = common_turns_of_pins(record, run, weights, limits.phase_rad, each=each)
        jitter = np.minimum(jitter_rad, max(limits.phase_rad, _MOST_JITTER_RAD))
        return PinDrives(
            run,
            weights * np.exp(-1j * turns)[:, None],
            np.arange(-1, run.count - 1) if before is None else before,
            limits.phase_rad + jitter + run.allowed_rad[:, None],
            # The width of a pulse scatters as its centre does.
            limits.amplitude + max(0.0, float(np.median(jitter)) - limits.phase_rad),
            turns,
        )


def _last_frame_end(
    record: PinRecord, run: PinRunDrives, starts: FloatArray, ends: FloatArray
) -> float:
    """Return until when, in periods, the pins must show the last frame: its middle.

    If all fall silent before that, but after showing it, one period before they do: the host may
    have muted.
    """
    middle = float(starts[-1] + ends[-1]) / 2.0
    pins = [record.pins[element] for element in run.elements]
    silent = max((float(pin.falls[-1]) for pin in pins if len(pin.falls)), default=middle)
    is_short = float(starts[-1]) + SETTLED + 1.0 < silent < min(middle, record.end - _SILENT)
    return silent - 1.0 if is_short else middle


def _frames_lost_on_pins(
    record: PinRecord, drives: PinDrives, prior: ComplexArray
) -> tuple[Bools, NDArray[np.int64]]:
    """Return the (F,) frames that the pins do not show, and the one shown before each, -1: none.

    A frame is lost if every pin shows the drive of the one before, and not every pin its own. A
    mixture of both is no lost frame: pins that latched and pins that did not are torn. *prior* (E,)
    are the drives before the first frame.
    """
    run, weights = drives.run, drives.weights
    sound = np.array([not record.pins[element].defects for element in run.elements])
    lost = np.zeros(run.count, np.bool_)
    before = np.full(run.count, -1, np.int64)
    shown = -1
    for frame in range(run.count):
        before[frame] = shown
        if (shown >= 0 or frame == 0) and np.isfinite(weights[frame]).all() and sound.any():
            seen, old, new = weights[frame], run.weights[shown], run.weights[frame]
            if shown < 0:
                old = prior * np.exp(-1j * drives.turns_rad[frame])
            if not drives.shows(seen, new, frame)[sound].all():
                turned = _on_reference_phase(record, run, seen, old)
                lost[frame] = _pin_keeps_frame(drives, frame, turned, old)[sound].all()
                last = frame - 1  # which may have come too late to be seen itself
                if not lost[frame] and 0 <= shown < last:
                    turned = _on_reference_phase(record, run, seen, run.weights[last])
                    lost[frame] = drives.shows(turned, run.weights[last], frame)[sound].all()
                    if lost[frame]:
                        before[frame] = shown = last
        if not lost[frame]:
            shown = frame
    return lost, before


def _pin_keeps_frame(drives: PinDrives, frame: int, seen: ComplexArray, old: ComplexArray) -> Bools:
    """Return a mask (E,) of pins that show the *old* drive for over half of the frame.

    *seen* and *old* (E,) are the mean drive in the frame, and the one before it.
    """
    run = drives.run
    step = run.weights[frame] - old
    size = float((np.abs(step) ** 2).sum())
    share = float((np.conj(step) * (seen - old)).real.sum()) / size if size > 0.0 else 1.0
    kept = drives.shows(seen, old, frame)
    window = max(float(run.ends[frame] - run.starts[frame]) - SETTLED - 1.0, 1.0)
    if not kept.all() and 0.0 < share < _LAST_PERIODS / window:
        rest = np.abs(seen - old - share * step)
        errors = drives.limit_amplitude + drives.limit_rad[frame] * np.abs(old)
        kept = rest <= errors + np.abs(step) * _LATCH_PERIODS / window
    return kept & (share < _HALF)


def _on_reference_phase(
    record: PinRecord, run: PinRunDrives, seen: ComplexArray, old: ComplexArray
) -> ComplexArray:
    """Return *seen* (E,) rotated to the *old* phase of the reference element; as is without one."""
    if record.reference_element is None:
        return seen
    place = run.elements.index(record.reference_element)
    turned: ComplexArray = seen * np.exp(1j * np.angle(old[place] * np.conj(seen[place])))
    return turned


def _pins_without_latch(record: PinRecord, starts: FloatArray, ends: FloatArray) -> Bools:
    """Return the (F,) frames during which the latch pin did not rise; none if it never did."""
    if record.latches is None or not len(record.latches):
        return np.zeros(len(starts), np.bool_)
    lows, highs = starts - _LATCH_SLACK, ends - _LATCH_SLACK
    counts = np.searchsorted(record.latches, highs) - np.searchsorted(record.latches, lows)
    is_inside = (lows >= 0.0) & (highs <= record.end)
    missing: Bools = is_inside & (counts == 0)
    return missing if (is_inside & (counts > 0)).any() else np.zeros_like(missing)


def _pin_lateness(steps: PinSteps, lost: Bools) -> FloatArray:
    """Return (F,) by how many periods each frame was late; 0 if not known.

    That is when a quarter of the pins had latched.
    """
    late = np.where(steps.is_inside, steps.middle, np.nan)
    late[lost] = np.nan
    known = np.isfinite(late).any(axis=1)
    found = np.zeros(len(lost))
    found[known] = np.nanquantile(late[known], _EARLY_PINS, axis=1)
    return found


# --- The place of a run in a capture: neither knows the clock of the other -----------------------


_NEAR_PERIODS: Final = 2.5  # distance from the line through the latches of one clock
_FEWEST: Final = 8  # frames that tell the rate
_WINDOW: Final = 0.5  # part of a frame that holds the changes of one latch


def align_pins_to_run(record: PinRecord, run: PinRunDrives) -> tuple[float, float]:
    """Return the offset and rate at which most drives of the run begin in time.

    A frame at *u* periods of the run is due at ``offset + rate * u`` periods of the capture: each
    drive that the pins hold is taken for a frame that is like it, and a line goes through their
    times.

    One crystal makes the clocks of the frames and of the carrier; or two do, and then the
    analyser's own clock is the better first guess.
    """
    held = held_pin_drives(record, window=min(record.latch_window, _WINDOW * run.gap))
    firsts, pairs = matched_drives(held, run.weights)
    pairs = pairs[pairs[:, 0] > 0]  # when the first drive began is not known
    if not len(pairs):
        return 0.0, 1.0
    due = run.starts[firsts[pairs[:, 1]]]
    begins = np.array([held.latches[place - 1].begin for place in pairs[:, 0]])
    lines = [_line_through(due, begins, rate) for rate in (1.0, 1.0 + record.drift_ppm * 1e-6)]
    _, offset, rate = max(lines, key=lambda line: line[0])
    return offset, rate


def _line_through(due: FloatArray, begins: FloatArray, rate: float) -> tuple[int, float, float]:
    """Fit begins = rate x due + offset near *rate*; return count, offset and rate, in periods.

    The count is that of frames within 2.5 periods of the line; the rate is fitted from 8 on.
    """
    away = begins - rate * due
    ordered = np.sort(away)
    counts = np.searchsorted(ordered, ordered + _NEAR_PERIODS, side="right") - np.arange(len(away))
    best = int(counts.argmax())
    offset = float(np.median(ordered[best : best + counts[best]]))
    near = np.abs(away - offset) < _NEAR_PERIODS
    if near.sum() >= _FEWEST:
        slope, shift = np.polyfit(due[near], away[near] - offset, 1)
        rate, offset = rate + float(slope), offset + float(shift)
    return int(counts[best]), offset, rate

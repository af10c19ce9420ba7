"""The frames that the pins of a capture show, with their times and drives."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.model.drive import FULL_AMPLITUDE
from haptogram.records.pins import PinRecord

from .alignment import PinAlignment, align_pins_to_run
from .elements.faults import PinDrives
from .frame_latches import LATE_PERIODS, TORN_PERIODS, FrameLatch, latches_of_frames
from .held.drives import held_pin_drives
from .pin_weights import SETTLED, PinWeights, common_turns_of_pins, pin_weights
from .run_drives import Bools, PinRunDrives, fundamentals_of_run_drives

#: Share of the captured drives that are right in a capture of this run.
FIT_SHARE: Final = 0.5
_HALF: Final = 0.5
_WINDOW: Final = 2.0  # periods within which changes follow each other in one latch
_SILENT: Final = 2.5  # periods without a pulse
_LEAST_HELD: Final = 2.0  # periods: a drive that is held for less shows nothing
_LEAD: Final = 5.25  # periods before the run, in which its first latch may lie
_FIRST_PERIODS: Final = 3.0  # periods of a capture that begins with the run
_PRIOR_PERIODS: Final = 8.0  # periods before the run
_ROUNDING_RAD: Final = 1e-4
_MOST_JITTER_RAD: Final = math.pi / 256.0  # largest jitter of a mean: half a step of 8 bits
_LATCH_SLACK: Final = 2.0  # periods by which a latch may seem to be early


@dataclass(frozen=True, slots=True)
class PinCaptureLimits:
    """The largest errors that the samples of a capture may hide.

    Attributes
    ----------
    resolution_rad : float
        Phase of one sample: two edges are known to one sample together.
    phase_rad : float
        Phase error that passes, without jitter.
    amplitude : float
        Error of an amplitude that passes: half a step, and a sample of width.
    """

    resolution_rad: float
    phase_rad: float
    amplitude: float

    @classmethod
    def of(cls, record: PinRecord) -> PinCaptureLimits:
        """Return the limits of a capture."""
        resolution = math.tau / record.samples
        return cls(
            resolution,
            resolution + record.skew_rad + _ROUNDING_RAD,
            _HALF / FULL_AMPLITUDE + math.pi / record.samples,
        )


@dataclass(frozen=True, eq=False)
class FramesShownByPins:
    """F frames of a run at E pins; times in periods of the carrier.

    Attributes
    ----------
    starts, ends : (F,) numpy.ndarray
        When each frame is due and over in the capture.
    drives : PinDrives
        Measured drive of each pin in each frame.
    latches : list of FrameLatch
        When the pins took the drive of each frame.
    lost : (F,) numpy.ndarray of bool
        Frames during which the pins kept the drive of the one before, or that the latch pin lacks.
    """

    starts: FloatArray
    ends: FloatArray
    drives: PinDrives
    latches: list[FrameLatch]
    lost: Bools

    @cached_property
    def seen(self) -> Bools:
        """(F,) whether all pins show the frame for long enough."""
        return np.asarray(np.isfinite(self.drives.weights).all(axis=1))

    @cached_property
    def right(self) -> Bools:
        """(F, E) whether a pin does what was intended."""
        return self.drives.all_right()

    @cached_property
    def late(self) -> FloatArray:
        """(F,) by how many periods later than most a frame was latched; 0: not known."""
        return np.where(self.lost, 0.0, [latch.late for latch in self.latches])

    @cached_property
    def torn(self) -> Bools:
        """(F,) whether the pins did not latch within one period."""
        apart = np.array([latch.apart for latch in self.latches])
        torn: Bools = (apart > TORN_PERIODS) & ~self.lost
        return torn


def frames_shown_by_pins(
    record: PinRecord, run: PinRunDrives, offset: float | None = None
) -> FramesShownByPins:
    """Return the frames of a run that a capture shows; *offset* is when it begins, if known."""
    held = held_pin_drives(record, window=min(record.latch_window, _WINDOW))
    found = align_pins_to_run(held, run) if offset is None else PinAlignment(offset)
    starts, ends = found.starts(run), found.ends(run)
    if run.held is not None:  # what moves with a carrier that is not steady is no latch
        held = dataclasses.replace(held, latches=[])
    latches = latches_of_frames(held, run, starts, ends)
    means = _means_of_frames(record, run, starts, ends, latches)
    one_phase = _drives_of_means(record, run, means, np.arange(-1, run.count - 1), each=False)
    lost, before = _frames_lost_on_pins(record, one_phase, ends, latches)
    unmoved = np.array([not len(latch.places) for latch in latches])
    lost |= _pins_without_latch(record, starts, ends) & unmoved
    drives = _drives_of_means(record, run, means, before)
    return FramesShownByPins(starts, ends, drives, latches, lost)


def _means_of_frames(
    record: PinRecord,
    run: PinRunDrives,
    starts: FloatArray,
    ends: FloatArray,
    latches: list[FrameLatch],
) -> PinWeights:
    """Return the drives from when all pins have latched a frame until the first takes the next."""
    settled = np.array([latch.settled for latch in latches])
    following = np.array([latch.begin for latch in latches[1:]] + [math.inf])
    lows = np.maximum(starts, settled) + SETTLED
    highs = np.minimum(ends, following) - 1.0
    highs[-1] = _last_frame_end(record, run, starts, ends)
    if run.held is not None:
        lows, highs = np.maximum(lows, run.held[:, 0]), np.minimum(highs, run.held[:, 1])
    begins = np.array([record.pins[element].begin for element in run.elements])
    # A level that is not known shows nothing.
    known = np.where(lows[:, None] < begins, np.nan, lows[:, None])
    return pin_weights(record, run, known, np.broadcast_to(highs[:, None], known.shape))


def _drives_of_means(
    record: PinRecord,
    run: PinRunDrives,
    means: PinWeights,
    before: NDArray[np.int64],
    *,
    each: bool = True,
) -> PinDrives:
    """Return the drives on the phase of those that were meant; *each* frame may have its own."""
    limits = PinCaptureLimits.of(record)
    jitter = np.minimum(means.jitter_rad, max(limits.phase_rad, _MOST_JITTER_RAD))
    turns = common_turns_of_pins(record, run, means.weights, limits.phase_rad, each=each)
    return PinDrives(
        run,
        means.weights * np.exp(-1j * turns)[:, None],
        before,
        limits.phase_rad + jitter + run.allowed_rad[:, None],
        # The width of a pulse scatters as its centre does.
        limits.amplitude + max(0.0, float(np.median(jitter)) - limits.phase_rad),
        turns,
    )


def _last_frame_end(
    record: PinRecord, run: PinRunDrives, starts: FloatArray, ends: FloatArray
) -> float:
    """Return until when the last frame must be shown: half of it, or until all pins stop.

    The host may mute in its second half.
    """
    middle = float(starts[-1] + ends[-1]) / 2.0
    pins = [record.pins[element] for element in run.elements]
    silent = max((float(pin.falls[-1]) for pin in pins if len(pin.falls)), default=middle)
    is_short = float(starts[-1]) + SETTLED + 1.0 < silent < min(middle, record.end - _SILENT)
    return silent - 1.0 if is_short else middle


def _frames_lost_on_pins(
    record: PinRecord, drives: PinDrives, ends: FloatArray, latches: list[FrameLatch]
) -> tuple[Bools, NDArray[np.int64]]:
    """Return the (F,) frames that the pins do not show, and the one shown before each.

    A frame is lost if every pin shows the drive of the one before, and not every pin its own; or if
    it is latched so late that the next one follows at once. A mixture of both drives is no lost
    frame: pins that latched and pins that did not are torn.
    """
    run, weights = drives.run, drives.weights
    sound = np.array([not record.pins[element].defects for element in run.elements])
    prior = _sound_before_run(record, run, latches[0].due)
    lost = np.zeros(run.count, np.bool_)
    before = np.full(run.count, -1, np.int64)
    shown = -1
    for frame in range(run.count):
        before[frame] = shown
        latch = latches[frame]
        if latch.late > LATE_PERIODS and ends[frame] - latch.settled < SETTLED + _LEAST_HELD:
            lost[frame], shown = True, frame
            continue
        if (shown >= 0 or frame == 0) and np.isfinite(weights[frame]).all() and sound.any():
            seen, old = weights[frame], run.weights[shown]
            if shown < 0:
                old = prior * np.exp(-1j * drives.turns_rad[frame])
            turned = _pins_on_phase_of_reference(record, run, seen, old)
            lost[frame] = (
                not _pin_shows_frame(drives, frame, seen, run.weights[frame])[sound].all()
                and _pin_shows_frame(drives, frame, turned, old)[sound].all()
            )
        if not lost[frame]:
            shown = frame
    return lost, before


def _sound_before_run(record: PinRecord, run: PinRunDrives, start: float) -> ComplexArray:
    """Return the (E,) drives that the pins show just before the run, which begins at *start*.

    They are those on the phase of the capture. A capture that begins later has them in its first
    periods, if the first frame comes late.
    """
    end = max(start - _LEAD, _FIRST_PERIODS)
    begin = max(0.0, end - _PRIOR_PERIODS)
    found = np.zeros(len(run.elements), np.complex128)
    for place, element in enumerate(run.elements):
        centres, vectors = fundamentals_of_run_drives(record.pins[element])
        low, high = np.searchsorted(centres, [begin, end])
        found[place] = vectors[low:high].sum() / max(float(high - low), np.floor(end - begin))
    return found


def _pin_shows_frame(
    drives: PinDrives, frame: int, seen: ComplexArray, meant: ComplexArray
) -> Bools:
    """Return a mask (E,) of the pins whose measured drive matches that expected for a frame."""
    size = np.abs(np.abs(seen) - np.abs(meant)) <= drives.limit_amplitude
    faint = np.abs(meant) <= drives.limit_amplitude
    near = np.abs(np.angle(seen * np.conj(meant))) <= drives.limit_rad[frame]
    shown: Bools = size & (faint | near)
    return shown


def _pins_on_phase_of_reference(
    record: PinRecord, run: PinRunDrives, seen: ComplexArray, old: ComplexArray
) -> ComplexArray:
    """Return *seen* (E,) rotated to the *old* phase of the reference element."""
    if record.reference_element is None:
        return seen
    place = run.elements.index(record.reference_element)
    turned: ComplexArray = seen * np.exp(1j * np.angle(old[place] * np.conj(seen[place])))
    return turned


def _pins_without_latch(record: PinRecord, starts: FloatArray, ends: FloatArray) -> Bools:
    """Return the (F,) frames during which the latch pin did not rise, if it rose at all."""
    if record.latches is None or not len(record.latches):
        return np.zeros(len(starts), np.bool_)
    lows, highs = starts - _LATCH_SLACK, ends - _LATCH_SLACK
    counts = np.searchsorted(record.latches, highs) - np.searchsorted(record.latches, lows)
    is_inside = (lows >= 0.0) & (highs <= record.end)
    missing: Bools = is_inside & (counts == 0)
    return missing if (is_inside & (counts > 0)).any() else np.zeros_like(missing)

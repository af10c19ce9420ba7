"""The verdict by the drive pins of a capture: limits, findings, and the checks not judged."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.model.drive import FULL_AMPLITUDE
from haptogram.records.frame import Evidence
from haptogram.records.pins import CarrierPeriods, PinRecord

from ..frame.verdict import Judged, Verdict
from .elements.levels import LevelsInTime
from .elements.offsets import ElementOffsets
from .run_drives import Bools

#: Kinds of findings, and the sentence that is true if there is none.
PIN_CHECKS: Final = {
    "alignment": "the capture shows this run",
    "pins": "no captured pin is dead, stuck or inverted",
    "phases": "S1: every captured phase is the intended one, as far as samples tell",
    "amplitudes": "S5: every captured amplitude is the intended one, as far as samples tell",
    "frames": "no frame is shown by pins that most others contradict",
    "torn": "all captured pins latch within one period of the carrier",
    "mute": "all captured pins fall silent within one period of the carrier, and of MUTE where the "
    "line of the host was captured",
    "carrier": "the carrier is the one that is meant",
}
_NAMED: Final = 8
_ROUNDING_RAD: Final = 1e-4


@dataclass(frozen=True, slots=True)
class PinLimits:
    """Limits of a capture.

    Attributes
    ----------
    sample_rate_hz, samples : float
        Sampling rate, and samples in a period of the carrier.
    resolution_rad : float
        Phase error that one sample makes: no smaller one shows.
    phase_rad, amplitude : float
        Largest errors that pass (S1, S5).
    """

    sample_rate_hz: float
    samples: float
    resolution_rad: float
    phase_rad: float
    amplitude: float

    @classmethod
    def of(cls, record: PinRecord) -> PinLimits:
        """Return the largest errors that the samples of a capture may hide."""
        resolution = math.tau / record.samples
        return cls(
            record.sample_rate_hz,
            record.samples,
            resolution,
            resolution + record.skew_rad + _ROUNDING_RAD,
            0.5 / FULL_AMPLITUDE + math.pi / record.samples,
        )


@dataclass(frozen=True, slots=True)
class PinVerdict(Judged):
    """The verdict on the captured pins of a run; true if it passed, and only then.

    Attributes
    ----------
    name : str
        The capture.
    verdict : Verdict
        pass, fail or inconclusive, of the captured elements.
    reasons : tuple of str
        Why it is no pass.
    findings : dict of str to tuple of str
        Findings, by the checks of :data:`PIN_CHECKS`.
    not_judged : dict of str to str
        Checks that the capture could not answer, and why.
    elements : tuple of int
        Captured elements.
    array_count : int
        Elements of the array.
    counts : dict of str to int
        Frames: intended, captured, judged, right, lost, late, silent, torn.
    limits : PinLimits
        Resolution of the capture.
    phase_error_rad, amplitude_error : float or None
        Largest error of a pin that is right.
    mute_periods : float or None
        Time in which the pins fell silent at the end, at least; None: that was not captured.
    after_mute_periods : float or None
        From the arrival of MUTE to the begin of the last pulse; None: MUTE was not captured.
    carrier_hz, drift_ppm : float
        Carrier on the analyser's clock, and its distance from the one that is meant.
    events : tuple of str
        Frames that were lost or late, in words.
    weights : (F, E) numpy.ndarray of complex
        Drives that were seen, on the phase of those that were meant; NaN: not seen.
    right : (F, E) numpy.ndarray of bool
        Whether they are the intended ones.
    judged : (F,) numpy.ndarray of bool
        Frames that the capture shows as a whole.
    turns_rad : (F,) numpy.ndarray or None
        Phase that the pins share against the clock of the carrier; NaN: the frame is not seen.
        None: the reference of the capture is an element.
    late_us : dict of int to float
        How much later than most a frame was latched, of those that were late.
    notes : tuple of str
        Limits of the capture.
    carrier : CarrierPeriods or None
        Spread of the periods of the carrier.
    offsets : ElementOffsets or None
        Phase, gain and duty of each pin, over all frames; None: it shows none.
    levels : LevelsInTime or None
        Amplitude in time; None: the carrier is steady, and loses nothing.
    """

    name: str
    verdict: Verdict
    reasons: tuple[str, ...]
    findings: dict[str, tuple[str, ...]]
    not_judged: dict[str, str]
    elements: tuple[int, ...]
    array_count: int
    counts: dict[str, int]
    limits: PinLimits
    phase_error_rad: float | None
    amplitude_error: float | None
    mute_periods: float | None
    after_mute_periods: float | None
    carrier_hz: float
    drift_ppm: float
    weights: ComplexArray
    right: Bools
    judged: Bools
    turns_rad: FloatArray | None
    late_us: dict[int, float] = field(default_factory=dict)
    events: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    carrier: CarrierPeriods | None = None
    offsets: ElementOffsets | None = None
    levels: LevelsInTime | None = None

    @property
    def scope(self) -> str:
        """Extent of the capture, in words."""
        return captured_elements_text(len(self.elements), self.array_count)

    def as_dict(self) -> dict[str, Any]:
        """Return the verdict for JSON; angles are in degrees."""
        seen = np.isfinite(self.weights).all(axis=1)
        return {
            "capture": self.name,
            "verdict": str(self.verdict),
            "reasons": list(self.reasons),
            "evidence": str(Evidence.EXTERNAL),
            "elements": list(self.elements),
            "elements_of_array": self.array_count,
            "frames": dict(self.counts),
            "frames_seen": _ranges_in_pin_verdict(np.flatnonzero(seen)),
            "findings": {name: list(lines) for name, lines in self.findings.items()},
            "not_judged": dict(self.not_judged),
            "sample_rate_hz": self.limits.sample_rate_hz,
            "smallest_phase_error_deg": math.degrees(self.limits.resolution_rad),
            "phase_limit_deg": math.degrees(self.limits.phase_rad),
            "phase_error_deg": _degrees_in_pin_verdict(self.phase_error_rad),
            "amplitude_limit": self.limits.amplitude,
            "amplitude_error": self.amplitude_error,
            "mute_periods": self.mute_periods,
            "after_mute_periods": self.after_mute_periods,
            "carrier_hz": self.carrier_hz,
            "carrier_drift_ppm": self.drift_ppm,
            "carrier_jitter_ns": None if self.carrier is None else self.carrier.jitter_s * 1e9,
            "levels": None if self.levels is None else self.levels.as_dict(),
            "elements_shown": [] if self.offsets is None else list(self.offsets.rows()),
            "late_us": {str(frame): late for frame, late in self.late_us.items()},
            "events": list(self.events),
            "notes": list(self.notes),
        }


def captured_elements_text(captured: int, count: int) -> str:
    """Return "3 of 64 elements", and "all 64 elements" where all were captured."""
    return f"all {count} elements" if captured == count else f"{captured} of {count} elements"


def _degrees_in_pin_verdict(angle_rad: float | None) -> float | None:
    """Return an angle in degrees; None stays None."""
    return None if angle_rad is None else math.degrees(angle_rad)


def _ranges_in_pin_verdict(numbers: np.ndarray) -> list[list[int]]:
    """Return sorted whole numbers as [first, last] of each range without a gap; [] if none."""
    if not len(numbers):
        return []
    parts = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return [[int(part[0]), int(part[-1])] for part in parts]


def pin_verdict_lines(pins: PinVerdict) -> Iterator[str]:
    """Yield the verdict of a capture in lines."""
    counts, limits = pins.counts, pins.limits
    unseen = pins.array_count - len(pins.elements)
    rest = f"; the other {unseen} elements are not verified" if unseen else ""
    yield (
        f"  captured  {counts['captured']} of {counts['intended']} frames, {counts['right']} "
        f"right, {counts['lost']} lost, {counts['late']} late{rest}"
    )
    phase = (
        "not judged"
        if pins.phase_error_rad is None
        else (
            f"off by {math.degrees(pins.phase_error_rad):.2f} degrees at most where they are right"
        )
    )
    yield (
        f"  phases    {phase}; {math.degrees(limits.phase_rad):.2f} pass, and "
        f"{limits.sample_rate_hz / 1e6:.6g} Msamples/s show no error below "
        f"{math.degrees(limits.resolution_rad):.2f}"
    )
    if pins.amplitude_error is not None:
        yield (
            f"  amplitude off by {pins.amplitude_error:.4f} at most where they are right; "
            f"{limits.amplitude:.4f} pass"
        )
    if pins.mute_periods is not None:
        yield (
            f"  mute      all pins fall silent, {pins.mute_periods:.1f} periods or more apart; "
            "1 passes"
        )
    if pins.after_mute_periods is not None:
        yield (
            f"  mute      the last pulse begins {pins.after_mute_periods:+.2f} periods after MUTE "
            "arrived; 1 passes"
        )
    yield (
        f"  carrier   {pins.carrier_hz:.2f} Hz, {pins.drift_ppm:+z.1f} ppm on the analyser's clock"
    )
    lines = [line for lines in pins.findings.values() for line in lines]
    yield from _shown_pin_verdict_lines([f"  wrong     {line}" for line in lines])
    yield from _shown_pin_verdict_lines([f"  frame     {line}" for line in pins.events])
    for check, why in pins.not_judged.items():
        yield f"  not seen  {check}: {why}"
    for note in pins.notes:
        yield f"  note      {note}"


def _shown_pin_verdict_lines(lines: list[str]) -> Iterator[str]:
    """Yield the first 8 lines, and how many more there are."""
    yield from lines[:_NAMED]
    if len(lines) > _NAMED:
        yield f"  ... and {len(lines) - _NAMED} more, in the JSON file"

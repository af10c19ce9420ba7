"""The verdict on a run by a capture of its drive pins, and by the field where all were captured."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from haptogram.acoustics import AcousticModel, Drive
from haptogram.acoustics.model.drive import FULL_AMPLITUDE, REGISTER_BITS
from haptogram.records.frame import Evidence, Intended, Observation
from haptogram.records.pins import PinRecord
from haptogram.settings.arguments import Progress

from ..frame.verdict import Judged, Verdict
from ..run import verify_run
from ..run_verdict import RunVerdict
from ..tolerance import Tolerance, Uncertainty
from .judge import verify_captured_pins
from .pin_verdict import PinVerdict, pin_verdict_lines

_TURN: Final = 256


@dataclass(frozen=True, slots=True)
class CaptureVerdict(Judged):
    """The verdict by the capture of a run; true if it passed, and only then.

    Attributes
    ----------
    verdict : Verdict
        pass, fail or inconclusive: of the captured elements, and of the field where all were.
    reasons : tuple of str
        Why it is no pass.
    pins : PinVerdict
        The verdict on the pins.
    run : RunVerdict or None
        The whole verdict with field and focus; None: see *no_field*.
    no_field : str
        Why there is none.
    observations : tuple of Observation
        Drives of the whole array that the capture shows, where there is a whole verdict.
    frames : tuple of Intended
        The frames, in the order of their times.
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    pins: PinVerdict
    run: RunVerdict | None
    no_field: str = ""
    observations: tuple[Observation, ...] = ()
    frames: tuple[Intended, ...] = ()

    def frame_note(self, place: int) -> str:
        """Return the finding of the captured pins on the frame at this *place*."""
        if not self.pins.judged[place]:
            return "the capture does not show the frame"
        right = self.pins.right[place].tolist()
        wrong = [str(e) for e, ok in zip(self.pins.elements, right, strict=True) if not ok]
        what = f"{len(wrong)} are wrong: {', '.join(wrong[:8])}" if wrong else "they are right"
        return f"{self.pins.scope} were captured, and {what}"

    def as_dict(self) -> dict[str, Any]:
        """Return the verdict for JSON, without that of the field."""
        return {
            "verdict": str(self.verdict),
            "reasons": list(self.reasons),
            "evidence": str(Evidence.EXTERNAL),
            "elements": list(self.pins.elements),
            "elements_of_array": self.pins.array_count,
            "no_field": self.no_field or None,
            "captures": [self.pins.as_dict()],
        }

    def __str__(self) -> str:
        """Return a summary that fits a screen."""
        return "\n".join(_capture_verdict_summary(self))


def verify_capture(
    record: PinRecord,
    intended: Sequence[Intended],
    *,
    model: AcousticModel,
    min_verified: float = 0.9,
    tolerance: Tolerance | None = None,
    uncertainty: Uncertainty | None = None,
    incomplete: str = "",
    progress: Progress | None = None,
) -> CaptureVerdict:
    """Judge a capture of drive pins against the frames of a run.

    Parameters
    ----------
    record : PinRecord
        The capture.
    intended : sequence of Intended
        Frames of the run.
    model : AcousticModel
        Array and air.
    min_verified : float
        Share of the frames that must be judged, 0 to 1.
    tolerance : Tolerance, optional
        Misses of the focus that pass; by default none.
    uncertainty : Uncertainty, optional
        How well array and air are known.
    incomplete : str
        Why *intended* may lack frames of the run; empty: it has all. Otherwise the verdict is
        inconclusive: a frame that is missing is not judged, and pins that show it look wrong.
    progress : callable, optional
        Called with the number of frames judged and their total: those of the pins and, behind
        these, those of the field.

    Raises
    ------
    ConfigurationError
        Frames too short, or an element that the array lacks.
    """
    frames = sorted(intended, key=lambda frame: frame.t_apply_us or 0)
    count = len(frames)

    def tell(done: int, _: int = count) -> None:
        if progress is not None:
            progress(count + done, 2 * count)

    tell(-count)
    pins = verify_captured_pins(record, frames, model=model)
    tell(0)
    no_field = incomplete or _why_pins_make_no_field(pins, frames)
    run, observations = None, tuple[Observation, ...]()
    if not no_field:
        observations = tuple(_observations_of_pins(pins, frames))
        run = verify_run(
            frames,
            observations,
            model=model,
            min_verified=min_verified,
            unseen="the frame is not in the capture with all elements",
            tolerance=tolerance,
            uncertainty=uncertainty,
            progress=tell,
        )
    tell(count)
    wrong = list(pins.reasons) if pins.verdict is Verdict.FAIL else []
    missing = list(pins.reasons) if pins.verdict is Verdict.INCONCLUSIVE else []
    judged = int(pins.judged.sum())
    if not missing and judged < min_verified * count:
        missing.append(
            f"{judged} of {count} frames were judged; {100.0 * min_verified:g} % must be "
            "(--min-verified)"
        )
    if run is not None and run.verdict is not Verdict.PASS:
        (wrong if run.verdict is Verdict.FAIL else missing).extend(run.reasons)
    verdict = Verdict.FAIL if wrong else Verdict.INCONCLUSIVE if missing else Verdict.PASS
    reasons = [*wrong, *missing]
    if incomplete:
        verdict, reasons = Verdict.INCONCLUSIVE, [incomplete, *reasons]
    return CaptureVerdict(verdict, tuple(reasons), pins, run, no_field, observations, tuple(frames))


def _why_pins_make_no_field(pins: PinVerdict, frames: Sequence[Intended]) -> str:
    """Return why the field cannot be judged from the captured pins; "" if it can."""
    missing = pins.array_count - len(pins.elements)
    if missing:
        return f"{missing} of {pins.array_count} elements were not captured"
    if not pins.judged.any():
        return "the capture does not show the run"
    steps = max(frame.steps for frame in frames)
    if pins.limits.samples >= 2.0 * steps * 0.999:
        return ""
    bits = steps.bit_length() - 1
    phases = f"{bits}-bit phases" if steps == 1 << bits else f"{steps} steps of the phases"
    needed_hz = pins.limits.sample_rate_hz / pins.limits.samples * 2.0 * steps
    return (
        f"{pins.limits.sample_rate_hz / 1e6:g} Msamples/s do not tell the {phases} apart; "
        f"{needed_hz / 1e6:.4g} do"
    )


def _observations_of_pins(pins: PinVerdict, frames: Sequence[Intended]) -> Iterator[Observation]:
    """Yield an observation of each frame that the pins of the whole array show.

    A drive that was seen right, within what the samples tell, is the intended one; another one
    has the nearest codes.
    """
    order = np.argsort(pins.elements)
    for place in np.flatnonzero(pins.judged).tolist():
        meant, right = frames[place].drive, pins.right[place][order]
        weights = pins.weights[place][order]
        phases = np.rint(np.angle(weights) / (2.0 * np.pi) * _TURN).astype(np.int64) % _TURN
        amplitudes = np.clip(np.rint(np.abs(weights) * FULL_AMPLITUDE), 0, FULL_AMPLITUDE)
        wanted = meant.in_bits(REGISTER_BITS).phase_codes
        drive = Drive(
            np.where(right, wanted, phases).astype(np.uint8),
            np.where(right, meant.amplitude_codes, amplitudes).astype(np.uint8),
        )
        late_us = pins.late_us.get(place, 0.0)
        yield Observation(
            key=frames[place].key,
            t_latch_us=(frames[place].t_apply_us or 0) + round(late_us),
            late=late_us > 0.0,
            evidence=Evidence.EXTERNAL,
            drive=drive,
        )


def _capture_verdict_summary(verdict: CaptureVerdict) -> Iterator[str]:
    what = "; ".join(verdict.reasons[:2]) or "every captured pin does what was intended"
    more = len(verdict.reasons) - 2
    if more > 0:
        what += f"; and {more} more"
    yield f"{str(verdict.verdict).upper()}: {verdict.pins.scope}: {what}"
    yield from pin_verdict_lines(verdict.pins)
    if verdict.run is None:
        yield f"  field     not judged: {verdict.no_field}"
    else:
        yield from (line for line in str(verdict.run).splitlines()[1:] if "evidence" not in line)
    yield "  evidence  external: a capture of the drive pins"

"""Several captures of a repeating object, joined to drives of the whole array, and the verdict."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from haptogram.acoustics import AcousticModel, Drive
from haptogram.acoustics.arrays import ComplexArray
from haptogram.acoustics.model.drive import FULL_AMPLITUDE, REGISTER_BITS
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Evidence, Intended, Observation
from haptogram.records.pins import PinRecord
from haptogram.settings.arguments import Progress

from ..frame.verdict import Judged, Verdict, is_share_reached
from ..run import verify_run
from ..run_verdict import RunVerdict
from ..tolerance import Tolerance, Uncertainty
from .judge import verify_captured_pins
from .pin_verdict import PinVerdict, captured_elements_text, pin_verdict_lines
from .shared_phase import why_pin_phases_are_apart

_TURN: Final = 256
_NAMED: Final = 8


@dataclass(frozen=True, slots=True)
class JoinedCaptureVerdict(Judged):
    """The verdict by all captures of a run; true if it passed, and only then.

    Attributes
    ----------
    verdict : Verdict
        pass, fail or inconclusive: of the captured elements, and of the field where all were.
    reasons : tuple of str
        Why it is no pass.
    pins : tuple of PinVerdict
        One for each capture.
    array_count : int
        Elements of the array.
    run : RunVerdict or None
        The whole verdict with field and focus; None: see *no_field*.
    no_field : str
        Why there is none.
    observations : tuple of Observation
        Drives of the whole array that the captures show, where there is a whole verdict.
    frames : tuple of Intended
        The frames, in the order of their times.
    """

    verdict: Verdict
    reasons: tuple[str, ...]
    pins: tuple[PinVerdict, ...]
    array_count: int
    run: RunVerdict | None
    no_field: str = ""
    observations: tuple[Observation, ...] = ()
    frames: tuple[Intended, ...] = ()

    @property
    def elements(self) -> tuple[int, ...]:
        """Elements that were captured."""
        return tuple(sorted({element for pins in self.pins for element in pins.elements}))

    @property
    def scope(self) -> str:
        """Extent of the captures, in words."""
        return captured_elements_text(len(self.elements), self.array_count)

    def frame_note(self, place: int) -> str:
        """Return the finding of the captured pins on the frame at this *place*."""
        shown = [one for one in self.pins if one.judged[place]]
        if not shown:
            return "no capture shows the frame"
        wrong = [
            str(element)
            for one in shown
            for element, right in zip(one.elements, one.right[place], strict=True)
            if not right
        ]
        count = len({element for one in shown for element in one.elements})
        what = f"{len(wrong)} are wrong: {', '.join(wrong[:8])}" if wrong else "they are right"
        return f"{captured_elements_text(count, self.array_count)} were captured, and {what}"

    def as_dict(self) -> dict[str, Any]:
        """Return the verdict for JSON, without that of the field."""
        return {
            "verdict": str(self.verdict),
            "reasons": list(self.reasons),
            "evidence": str(Evidence.EXTERNAL),
            "elements": list(self.elements),
            "elements_of_array": self.array_count,
            "no_field": self.no_field or None,
            "captures": [pins.as_dict() for pins in self.pins],
        }

    def __str__(self) -> str:
        """Return a summary that fits a screen."""
        return "\n".join(_joined_capture_verdict_summary(self))


def verify_captures(
    records: Sequence[PinRecord],
    intended: Sequence[Intended],
    *,
    model: AcousticModel,
    min_verified: float = 0.9,
    tolerance: Tolerance | None = None,
    uncertainty: Uncertainty | None = None,
    incomplete: str = "",
    progress: Progress | None = None,
) -> JoinedCaptureVerdict:
    """Judge captures of drive pins against the frames of a run.

    Parameters
    ----------
    records : sequence of PinRecord
        The captures. Each may show other elements, and another pass of an object that repeats.
    intended : sequence of Intended
        Frames of the run.
    model : AcousticModel
        Array and air.
    min_verified : float
        Share of the frames that must be judged, of each captured element, 0 to 1.
    tolerance : Tolerance, optional
        Misses of the focus that pass; by default none.
    uncertainty : Uncertainty, optional
        How well array and air are known.
    incomplete : str
        Why *intended* may lack frames of the run; empty: it has all. Otherwise the verdict is
        inconclusive: a frame that is missing is not judged, and pins that show it look wrong.
    progress : callable, optional
        Called with the number of frames judged and their total: those of each capture and, after
        these, those of the field.

    Raises
    ------
    ConfigurationError
        Frames too short, an element that the array lacks, no capture.
    """
    if not records:
        raise ConfigurationError("no capture to judge by")
    frames = sorted(intended, key=lambda frame: frame.t_apply_us or 0)
    before = len(records) * len(frames)  # judged before the field

    def tell(done: int) -> None:
        if progress is not None:
            progress(done, before + len(frames))

    judged_pins = []
    for number, record in enumerate(records):
        tell(number * len(frames))
        judged_pins.append(verify_captured_pins(record, frames, model=model))
    pins = tuple(judged_pins)
    passes = list(_passes_over_pins(frames).values())
    apart = why_pin_phases_are_apart(pins, frames, passes) if len(pins) > 1 else ""
    no_field = incomplete or _why_no_field(pins, frames, model) or apart
    run, observations = None, tuple[Observation, ...]()
    if not no_field:
        observations = tuple(joined_observations_of_pins(pins, frames, model.array.count))
        run = verify_run(
            frames,
            observations,
            model=model,
            min_verified=min_verified,
            unseen="the frame is not in the captures with all elements",
            tolerance=tolerance,
            uncertainty=uncertainty,
            progress=lambda done, _: tell(before + done),
        )
    tell(before + len(frames))
    wrong = [line for one in pins for line in one.reasons if one.verdict is Verdict.FAIL]
    missing = [line for one in pins for line in one.reasons if one.verdict is Verdict.INCONCLUSIVE]
    judged = np.any([one.judged for one in pins], axis=0)
    if not missing and not is_share_reached(int(judged.sum()), min_verified, len(frames)):
        missing.append(
            f"{int(judged.sum())} of {len(frames)} frames were judged; {100.0 * min_verified:g} % "
            "must be (--min-verified)"
        )
    elif not missing and (text := _pins_too_rarely_seen(pins, passes, min_verified)):
        missing.append(text)
    if apart:
        missing.append(apart)
    if run is not None and run.verdict is not Verdict.PASS:
        (wrong if run.verdict is Verdict.FAIL else missing).extend(run.reasons)
    verdict = Verdict.FAIL if wrong else Verdict.INCONCLUSIVE if missing else Verdict.PASS
    reasons = [*wrong, *missing]
    if incomplete:
        verdict, reasons = Verdict.INCONCLUSIVE, [incomplete, *reasons]
    return JoinedCaptureVerdict(
        verdict,
        tuple(reasons),
        pins,
        model.array.count,
        run,
        no_field,
        observations,
        tuple(frames),
    )


def _pins_too_rarely_seen(
    pins: Sequence[PinVerdict], passes: Sequence[Sequence[int]], min_verified: float
) -> str:
    """Return as text the elements judged in a smaller share of frames than *min_verified*; else "".

    A frame counts for an element if any pass of its drive is judged in a capture of the element.
    """
    seen: dict[int, np.ndarray] = {}
    for one in pins:
        shown = np.array([one.judged[list(same)].any() for same in passes])
        for element in one.elements:
            seen[element] = seen.get(element, False) | shown
    sizes = np.array([len(same) for same in passes])
    counts = {element: int(sizes[shown].sum()) for element, shown in sorted(seen.items())}
    total = int(sizes.sum())
    rare = [e for e, count in counts.items() if not is_share_reached(count, min_verified, total)]
    if not rare:
        return ""
    names = ", ".join(map(str, rare[:_NAMED]))
    more = f" and {len(rare) - _NAMED} more" if len(rare) > _NAMED else ""
    fewest = min(counts[element] for element in rare)
    return (
        f"element{'s' if len(rare) > 1 else ''} {names}{more}: {fewest} of {total} frames were "
        f"judged{' at the fewest' if len(rare) > 1 else ''}; {100.0 * min_verified:g} % must be "
        "(--min-verified)"
    )


def _why_no_field(
    pins: Sequence[PinVerdict], frames: Sequence[Intended], model: AcousticModel
) -> str:
    """Return why captured pins cannot show the field: elements, run or samples missing; else ""."""
    count = model.array.count
    captured = {element for one in pins for element in one.elements}
    if len(captured) < count:
        return (
            f"{count - len(captured)} of {count} elements were not captured; captures of all of "
            "them, each of a pass of the object, are joined"
        )
    if not all(one.judged.any() for one in pins):
        return "a capture does not show the run"
    steps = max(frame.steps for frame in frames)
    bits = steps.bit_length() - 1
    phases = f"{bits}-bit phases" if steps == 1 << bits else f"{steps} steps of the phases"
    for one in pins:
        if one.limits.samples < 2.0 * steps * 0.999:
            needed_hz = one.limits.sample_rate_hz / one.limits.samples * 2.0 * steps
            return (
                f"{one.limits.sample_rate_hz / 1e6:g} Msamples/s do not tell the {phases} apart; "
                f"{needed_hz / 1e6:.4g} do"
            )
    return ""


def _passes_over_pins(frames: Sequence[Intended]) -> dict[tuple[Drive, Any], list[int]]:
    """Return, by drive and foci, the indices of the frames that have them."""
    passes: dict[tuple[Drive, Any], list[int]] = defaultdict(list)
    for place, frame in enumerate(frames):
        passes[frame.drive, frame.foci].append(place)
    return passes


def joined_observations_of_pins(
    pins: Sequence[PinVerdict], frames: Sequence[Intended], count: int
) -> list[Observation]:
    """Return an observation of each captured frame, elements of frames with one drive joined.

    A drive that was seen right, within what the samples tell, is the intended one; another one
    has the nearest codes.
    """
    found = []
    for same in _passes_over_pins(frames).values():
        filled = _merged_codes(pins, same, frames[same[0]], count)
        if filled is None:
            continue
        for place in same:
            codes, latches = filled.copy(), []
            for one in pins:
                if one.judged[place]:
                    _fill_codes(codes, one, place, frames[place].drive)
                    latches.append(one.late_us.get(place, 0.0))
            if latches:
                found.append(_joined_observation(frames[place], codes, max(latches)))
    return found


def _merged_codes(
    pins: Sequence[PinVerdict], same: Sequence[int], frame: Intended, count: int
) -> np.ndarray | None:
    """Return (2, N) phase and amplitude codes, merged from the frames *same* of one drive.

    None if an element was judged in no capture.
    """
    codes = np.full((2, count), -1, np.int64)
    for one in pins:
        seen = [place for place in same if one.judged[place]]
        # The worst pass counts: what is wrong once is wrong.
        for place in sorted(seen, key=lambda p: -int(one.right[p].sum())):
            _fill_codes(codes, one, place, frame.drive)
    return None if (codes < 0).any() else codes


def _fill_codes(codes: np.ndarray, one: PinVerdict, place: int, meant: Drive) -> None:
    """Write into *codes* (2, N) phase and amplitude codes of what *one* captured in frame *place*.

    Where the pin is right they are those of *meant*, else the nearest to what was measured.
    """
    elements = np.array(one.elements)
    right = one.right[place]
    phases, amplitudes = _nearest_codes(one.weights[place])
    wanted = meant.in_bits(REGISTER_BITS).phase_codes.astype(np.int64)
    codes[0, elements] = np.where(right, wanted[elements], phases)
    codes[1, elements] = np.where(right, meant.amplitude_codes[elements], amplitudes)


def _nearest_codes(weights: ComplexArray) -> tuple[np.ndarray, np.ndarray]:
    """Return the phase and amplitude codes, 0 to 255, nearest to measured weights."""
    phases = np.rint(np.angle(weights) / (2.0 * np.pi) * _TURN).astype(np.int64) % _TURN
    sizes = np.rint(np.abs(weights) * FULL_AMPLITUDE).astype(np.int64)
    return phases, np.clip(sizes, 0, FULL_AMPLITUDE)


def _joined_observation(frame: Intended, codes: np.ndarray, late_us: float) -> Observation:
    """Return a frame's observation by the pins of *codes* (2, N), late if *late_us* is over 0."""
    drive = Drive(codes[0].astype(np.uint8), codes[1].astype(np.uint8))
    due_us = frame.t_apply_us or 0
    return Observation(
        key=frame.key,
        t_latch_us=due_us + round(late_us),
        late=late_us > 0.0,
        evidence=Evidence.EXTERNAL,
        drive=drive,
    )


def _joined_capture_verdict_summary(verdict: JoinedCaptureVerdict) -> Iterator[str]:
    """Yield the verdict on all captures, and that of each."""
    what = "; ".join(verdict.reasons[:2]) or "every captured pin does what was intended"
    more = len(verdict.reasons) - 2
    if more > 0:
        what += f"; and {more} more"
    yield f"{str(verdict.verdict).upper()}: {verdict.scope}: {what}"
    for one in verdict.pins:
        if len(verdict.pins) > 1:
            yield f"  {one.name}: {one.verdict}, {one.scope}"
        yield from pin_verdict_lines(one)
    if verdict.run is None:
        yield f"  field     not judged: {verdict.no_field}"
    else:
        yield from (line for line in str(verdict.run).splitlines()[1:] if "evidence" not in line)
    yield "  evidence  external: a capture of the drive pins"

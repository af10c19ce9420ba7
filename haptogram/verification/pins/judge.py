"""From a capture of drive pins and the frames of a run to a verdict."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import AcousticModel, phase_step_rad
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.solvers.focus_fit import wrapped_phases
from haptogram.errors import ConfigurationError
from haptogram.records.frame import Intended
from haptogram.records.pins import PinRecord

from ..frame.verdict import Verdict
from ..groups import groups_of_elements
from .elements.faults import (
    CHAINS,
    PinFault,
    PinFaultKind,
    exchanged_pin_orders,
    faults_of_pins,
    grouped_pin_faults,
)
from .elements.levels import LevelsInTime, levels_of_pins_in_time
from .elements.offsets import ElementOffsets
from .held.drives import held_pin_drives
from .held.matching import frames_at_held_drives
from .pin_verdict import PinLimits, PinVerdict
from .pin_weights import pins_phase
from .run_drives import Bools, PinRunDrives, fundamentals_of_run_drives
from .shown_frames import (
    FIT_SHARE,
    LATE_PERIODS,
    TORN_PERIODS,
    FramesShownByPins,
    frames_shown_by_pins,
)
from .silence import EndOfSound, end_of_sound_on_pins

_HALF: Final = 0.5
_EDGE: Final = 2  # frames at the end of the capture, beside which samples may be missing
_NAMED: Final = 4
_BREAK_SAMPLES: Final = 2.5  # tolerance of two edges, in samples
_JITTERS: Final = 6.0  # largest jitter, relative to the median one of a pulse
_WITH_THE_CLOCK: Final = "capture the clock of the carrier, and longer than the run, to know"
_BY_DRIVE: Final = (
    "the frames carry no times: each is found by its drive, and a delay does not show"
)
_NEARLY_ALL: Final = 0.9
_NEAR_RAD: Final = 2.0 * phase_step_rad(8)  # extra phase error that still shows this run
_FITTING_SHARE: Final = 0.25  # least share of pins that show this run in nearly all frames
_FEWEST_FITTING: Final = 3
_FEWEST_DRIVES: Final = 3  # least different drives with the same error: no chance
_FEWEST_AGREEING: Final = 2  # drives, beyond those that agree by chance
_LEAST_PERIODS_OF_CARRIER: Final = 40.0  # periods that show its frequency where samples are missing


def verify_captured_pins(
    record: PinRecord,
    intended: Sequence[Intended],
    *,
    model: AcousticModel,
) -> PinVerdict:
    """Judge the pins of a capture against the frames of a run.

    Parameters
    ----------
    record : PinRecord
        The capture.
    intended : sequence of Intended
        Frames of the run, in the order of their times; those without one are found by their drives.
    model : AcousticModel
        The array.

    Raises
    ------
    ConfigurationError
        Frames too short, an element that the array lacks, or a capture in which
        nothing sounds.
    """
    for element, pin in record.pins.items():
        if element >= model.array.count:
            raise ConfigurationError(
                f"channel {pin.channel} is element {element}; the array has the elements 0 to "
                f"{model.array.count - 1}"
            )
    offset, held = None, None
    if any(frame.t_apply_us is None for frame in intended):
        intended, held = frames_at_held_drives(held_pin_drives(record), intended)
        offset = (intended[0].t_apply_us or 0) * 1e-6 * record.carrier_hz
        record = dataclasses.replace(record, notes=(*record.notes, _BY_DRIVE))
    run = PinRunDrives.of(intended, sorted(record.pins), record.carrier_hz)
    if record.carrier is not None and not record.carrier.is_steady:
        run = dataclasses.replace(run, held=held)
    shown = frames_shown_by_pins(record, run, offset)
    steps = max(frame.steps for frame in intended)
    return _PinJudge(record, run, model, shown, steps, offset).judge()


def _count_distinct_drives(weights: ComplexArray, apart: float) -> int:
    """Return how many *weights* (K,) differ by more than *apart*, counted up to 4."""
    found = 0
    while len(weights) and found < _FEWEST_AGREEING + 2:
        found += 1
        weights = weights[np.abs(weights - weights[0]) > apart]
    return found


@dataclass
class _PinJudge:
    """One capture against one run."""

    record: PinRecord
    run: PinRunDrives
    model: AcousticModel
    shown: FramesShownByPins
    steps: int
    offset: float | None  # period at which the run begins, if its frames have no times
    findings: dict[str, list[str]] = field(default_factory=dict)
    not_judged: dict[str, str] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    events: list[str] = field(default_factory=list)
    _offsets: ElementOffsets | None = None

    def judge(self) -> PinVerdict:
        """Return the verdict."""
        shown, seen = self.shown, self.shown.seen & ~self.shown.lost
        fits = self._check_fit(seen)
        alone = self._name_faults(seen) if fits else seen
        judged = seen if fits else np.zeros_like(seen)
        if fits:
            self._check_turns(seen)
        torn = self._check_torn() if fits else 0
        end = self._end() if fits else EndOfSound()
        self._check_carrier()
        levels = levels_of_pins_in_time(self.record)
        if levels is not None and levels.text:
            self._find("amplitudes", levels.text)
        self._note_events()
        inside = (shown.starts >= -1.0) & (shown.ends <= self.record.end + 1.0)
        counts = {
            "intended": self.run.count,
            "captured": int((inside | judged).sum()),
            "judged": int(judged.sum()),
            "right": int((shown.right.all(axis=1) & alone & judged).sum()),
            "lost": int(shown.lost.sum()),
            "late": len(self._late_frames),
            "torn": torn,
        }
        return self._conclude(judged, counts, end, levels)

    @cached_property
    def _late_frames(self) -> NDArray[np.intp]:
        """Return the indices of frames that the pins show over 2 periods after they are due."""
        shown = self.shown
        return np.flatnonzero((shown.late > LATE_PERIODS) & shown.seen)

    @property
    def _period_us(self) -> float:
        """Return the carrier period of the capture in µs."""
        return 1e6 / self.record.carrier_hz

    # --- frames ----------------------------------------------------------------------------------

    def _check_torn(self) -> int:
        """Add a finding for each latch over 1.25 periods apart; return how many there are.

        Where missing samples may be the cause, or nothing can be torn, that is noted instead.
        """
        steps, usable = self.shown.steps, self.shown.latched
        torn = np.flatnonzero(self.shown.torn)
        us = self._period_us
        for frame in torn:
            first = steps.before[frame][usable[frame]].min()
            behind = [
                str(self.run.elements[e])
                for e in np.flatnonzero(usable[frame])
                if steps.after[frame, e] - first > TORN_PERIODS
            ]
            shown = ", ".join(behind[:4]) + (", ..." if len(behind) > 4 else "")
            text = (
                f"frame {frame}: {len(behind)} of {int(usable[frame].sum())} pins (element "
                f"{shown}) latch {self.shown.apart[frame] * us:.0f} µs or more after the first, "
                f"may be {us:.0f} µs"
            )
            if self.record.reference_element is None or len(torn) > _EDGE:
                self._find("torn", text)
            else:
                self.missing.append(f"{text}, or samples are missing: {_WITH_THE_CLOCK}")
        if self.run.held is not None:
            self.not_judged["torn"] = "the carrier is not steady while pins change"
        elif not usable.any(axis=1).any():
            self.not_judged["torn"] = "no two drives that the pins tell apart follow each other"
        elif len(self.run.elements) < 2:
            self.not_judged["torn"] = "one pin cannot be torn"
        return len(torn)

    def _note_events(self) -> None:
        """Note frames that were lost, or late by over 2 periods, as events: they do not fail it."""
        for frame in np.flatnonzero(self.shown.lost):
            self.events.append(f"{frame}: not latched; the pins kept the drive they had")
        for frame in self._late_frames:
            late_us = self.shown.late[frame] * self._period_us
            self.events.append(f"{frame}: latched {late_us:.0f} µs after most others")

    def _end(self) -> EndOfSound:
        """Judge if the pins fall silent together after the run; add findings, or why not judged."""
        found = end_of_sound_on_pins(self.record, self.run, self.shown)
        for text in found.findings:
            self._find("mute", text)
        if found.not_judged:
            self.not_judged["mute"] = found.not_judged
        return found

    # --- pins ------------------------------------------------------------------------------------

    def _check_fit(self, judged: Bools) -> bool:
        """Return True if the pins show this run in the frames of the mask *judged*.

        Else what is missing is noted, or a mistake that all pins share is added as a finding.
        """
        drives, right = self.shown.drives, self.shown.right
        if self._has_divided_carrier():
            return False
        if not judged.any():
            self.missing.append("no frame of the run is in the capture as a whole")
            return False
        if self.record.cut and judged.sum() <= _EDGE and not right[judged].all():
            self.missing.append("too few frames are left beside missing samples to tell a fault")
            return False
        if not self._is_beyond_chance(judged):
            self.missing.append(
                "the capture does not show this run for certain: too few of its drives differ; "
                "capture more pins, or more frames"
            )
            return False
        if self._near_match_share(judged) >= FIT_SHARE or self._pins_that_fit(judged) is not None:
            if not self._fits_better_elsewhere(judged):
                return True
            self.missing.append(
                "the capture does not show for certain when the run begins: its frames hardly "
                "differ, and at another place more of them are right; capture more pins"
            )
            return False
        wrong = np.flatnonzero(~right[judged].all(axis=0)).tolist()
        kinds = [fault.kind for fault in faults_of_pins(drives, wrong, judged).values()]
        telling = {PinFaultKind.OTHER_ELEMENT, PinFaultKind.SIGN}
        if len(np.unique(self.run.phases[judged][:, self.run.elements], axis=0)) >= _FEWEST_DRIVES:
            telling |= {PinFaultKind.SHIFTED, PinFaultKind.INVERTED}  # by the same in all of them
        named = [k for k in kinds if k in telling]
        if len(named) >= FIT_SHARE * len(self.run.elements) and len(named) > 1:
            return True
        for text, phases in self._likely_mistakes():
            if self._shows_other_phases(phases):
                self._find("phases", text)
                return False
        share = 100.0 * float(right[judged].mean())
        self.missing.append(
            f"the capture does not show this run: {share:.0f} % of the drives at its pins are the "
            "intended ones; another run, another map, or nearly every pin is wrong"
        )
        return False

    def _has_divided_carrier(self) -> bool:
        """Return True, and add a finding, if over half the pins pulse in every n-th period only."""
        pins = [pin for pin in self.record.pins.values() if len(pin.rises)]
        fewer = [pin for pin in pins if pin.every > 1]
        if 2 * len(fewer) <= len(pins):
            return False
        hz, every = 1.0 / self.record.period_s, fewer[0].every
        self._find(
            "carrier",
            f"{hz / every:.0f} Hz: {len(fewer)} of {len(pins)} pins pulse in one of {every} "
            f"periods of the carrier, which has {hz:.0f} Hz",
        )
        return True

    def _is_beyond_chance(self, judged: Bools) -> bool:
        """Return True if the pins agree with the run more often than any capture would by chance.

        So it is if all are right in all frames. Else 2 agreements are needed beyond one pin and one
        drive for each pin: further pins that fit, or further drives that a pin shows.
        """
        drives, run = self.shown.drives, self.run
        frames = np.flatnonzero(judged)
        if self.shown.right[frames].all():
            return True
        reference = self.record.reference_element
        own = None if reference is None else run.elements.index(reference)
        agreeing = int((self.shown.right[frames].mean(axis=0) >= FIT_SHARE).sum()) - 1
        for place in range(len(run.elements)):
            errors = drives.errors_rad(run.weights[:, place], place)[frames]
            known = frames[np.isfinite(errors)]
            if place == own or not len(known):
                continue
            errors = errors[np.isfinite(errors)]
            limit = float(np.median(drives.limit_rad[known, place]))
            near = np.abs(wrapped_phases(errors - pins_phase(errors, limit))) <= limit
            codes = run.weights[known[near], place]
            if own is not None:
                codes = codes * np.conj(run.weights[known[near], own])
            agreeing += _count_distinct_drives(codes, 2.0 * limit) - 1
        return agreeing >= _FEWEST_AGREEING

    def _fits_better_elsewhere(self, judged: Bools) -> bool:
        """Return True if the run, begun a frame off or at the first pulse, fits the pins better.

        There every pin must be right in 90 % of the frames: a pin that is wrong wherever the run
        begins is wrong.
        """
        weights, begin, gap = self.run.weights, float(self.shown.starts[0]), self.run.gap
        if self.shown.right[judged].all() or (weights == weights[0]).all():
            return False
        rises = [float(pin.rises[0]) for pin in self.record.pins.values() if len(pin.rises)]
        for place in (begin - gap, begin + gap, math.floor(min(rises, default=begin))):
            other = frames_shown_by_pins(self.record, self.run, place)
            both = judged & other.seen
            if not both.any():
                continue
            here, there = self.shown.right[both].mean(axis=0), other.right[both].mean(axis=0)
            if there.sum() > here.sum() and (there >= _NEARLY_ALL).all():
                return True
        return False

    def _near_match_share(self, judged: Bools) -> float:
        """Return the share of pins and frames right within the limit plus two 8-bit phase steps."""
        drives = self.shown.drives
        wider = dataclasses.replace(drives, limit_rad=drives.limit_rad + _NEAR_RAD)
        return float(wider.all_right()[judged].mean())

    def _pins_that_fit(self, judged: Bools) -> Bools | None:
        """Return a mask (E,) of pins right in 90 % of the frames *judged*.

        None if they are fewer than 3, or than a quarter of all pins.
        """
        fitting: Bools = self.shown.right[judged].mean(axis=0) >= _NEARLY_ALL
        fewest = max(_FEWEST_FITTING, _FITTING_SHARE * len(fitting))
        return fitting if fitting.sum() >= fewest else None

    def _likely_mistakes(self) -> Iterator[tuple[str, NDArray[np.uint8]]]:
        """Yield mistakes that all pins may share, each with the phase codes (F, N) that it makes.

        They are the opposite sign, and chains of 8, 16 or 32 elements in reverse order.
        """
        phases = self.run.phases
        yield "every captured pin has the opposite sign of the phase", np.negative(phases)
        numbers = np.arange(phases.shape[1])
        for size in CHAINS:
            if len(numbers) % size == 0:
                order = numbers - 2 * (numbers % size) + size - 1
                yield (
                    f"the pins show the drives of other elements: each chain of {size} the other "
                    "way round",
                    phases[:, order],
                )

    def _shows_other_phases(self, phases: NDArray[np.uint8]) -> bool:
        """Return True if the pins show the run with phase codes *phases* (F, N): 90 % are right."""
        turned = dataclasses.replace(self.run, phases=phases)
        shown = frames_shown_by_pins(self.record, turned, self.offset)
        return bool(shown.seen.any()) and float(shown.right[shown.seen].mean()) >= _NEARLY_ALL

    def _name_faults(self, judged: Bools) -> Bools:
        """Add the faults of pins as findings, in the frames of the mask *judged* (F,).

        A frame in which most pins are wrong is a finding of its own. Returned is the mask (F,) of
        the other frames, in which each pin was judged alone.
        """
        drives, right = self.shown.drives, self.shown.right
        count = len(self.run.elements)
        fitting = self._pins_that_fit(judged)
        shares = (right if fitting is None else right[:, fitting]).mean(axis=1)
        mixed = judged & (shares < _HALF) & (count > 2)
        if mixed.sum() > _HALF * judged.sum():
            mixed = np.zeros_like(judged)  # most frames: then it is the pins
        doubtful = self._note_doubtful_frames(np.flatnonzero(judged), mixed)
        for frame in np.flatnonzero(mixed & ~doubtful):
            wrong = int((~right[frame]).sum())
            silent = (np.abs(drives.weights[frame]) == 0.0).all()
            what = "silent" if silent else f"{wrong} of {count} pins show another drive"
            self._find("frames", f"frame {frame}: {what}")
        alone: Bools = np.asarray(judged & ~mixed & ~doubtful)
        faults: dict[str, list[tuple[int, str, str]]] = {"phases": [], "amplitudes": []}
        others = []
        unlike: list[int] = []
        for place, element in enumerate(self.run.elements):
            pin = self.record.pins[element]
            sizes = np.abs(self.run.weights[alone, place])
            is_silent = not (sizes > drives.limit_amplitude).any()
            for text in pin.defects:
                if not (is_silent and pin.is_dead):  # then it is as it shall be
                    faults.setdefault("pins", []).append((element, pin.channel, text))
            if not right[alone, place].all() and (is_silent or not pin.defects):
                unlike.append(place)
        named_faults = faults_of_pins(drives, unlike, alone)
        told = self._name_structures(named_faults, alone)
        for place, fault in named_faults.items():
            element = self.run.elements[place]
            if element in told:
                continue
            if fault.other is not None:
                others.append((element, fault.other))
            named = element, self.record.pins[element].channel, fault.text
            faults.setdefault(fault.kind.check, []).append(named)
        order = exchanged_pin_orders(self.model.array, others, count)
        if order is not None:
            exchanged = {element for element, _ in others}
            faults["phases"] = [f for f in faults["phases"] if f[0] not in exchanged]
            self._find(
                "phases",
                f"{len(others)} of {count} pins show the drives of other elements: {order}, in the "
                "map, the wiring or the board",
            )
        for kind, found in faults.items():
            for line in grouped_pin_faults(found):
                self._find(kind, line)
        return alone

    def _name_structures(self, faults: dict[int, PinFault], alone: Bools) -> set[int]:
        """Name faults shared by a chain or group of pins; return its elements, empty if none.

        *faults* is by column of the pin, *alone* the mask (F,) of frames in which pins are judged.
        """
        self._offsets = ElementOffsets.of(self.record, self.shown.drives, alone)
        kinds = {PinFaultKind.SHIFTED, PinFaultKind.INVERTED}
        shifted = [self.run.elements[p] for p, fault in faults.items() if fault.kind in kinds]
        offsets = self._offsets
        found, explained = groups_of_elements(
            dict(zip(offsets.elements, offsets.phase_rad.tolist(), strict=True)),
            shifted,
            self._limits.phase_rad,
            self.steps,
            dict(zip(offsets.elements, offsets.channels, strict=True)),
        )
        for group in found:
            self._find("phases", group.text)
        return explained if found else set()

    def _note_doubtful_frames(self, judged: NDArray[np.intp], mixed: Bools) -> Bools:
        """Return a mask (F,) of wrong frames that missing samples of the capture may explain.

        With a carrier clock those are the last two frames, and the first one of a capture that
        begins within it. With an element as reference every frame may lack samples, and a frame
        that does may have any pin wrong. *mixed* holds the frames in which most pins are wrong.
        """
        doubtful = np.zeros_like(mixed)
        if self.record.reference_element is None:
            doubtful[judged[-_EDGE:]] = True
            doubtful |= self.shown.starts < self.run.gap  # what was there before is not known
        else:
            doubtful[judged] = True
            mixed = mixed | (self._frames_with_a_break() & ~self.shown.right.all(axis=1))
        doubtful &= mixed
        if doubtful.any():
            names = ", ".join(map(str, np.flatnonzero(doubtful)[:_NAMED]))
            self.missing.append(
                f"frames {names}: pins show another drive, or samples are missing there: "
                f"{_WITH_THE_CLOCK}"
            )
        return doubtful

    def _frames_with_a_break(self) -> Bools:
        """Return a mask (F,) of frames within which the reference element changes its drive.

        It latches only between frames, so samples are missing there. Without such an element no
        frame is True.
        """
        found = np.zeros(self.run.count, np.bool_)
        limit = _BREAK_SAMPLES * math.tau * self.record.carrier_hz / self.record.sample_rate_hz
        reference = self.record.reference_element
        if reference is None:
            return found
        centres, weights = fundamentals_of_run_drives(self.record.pins[reference])
        for frame, (start, end) in enumerate(zip(self.shown.starts, self.shown.ends, strict=True)):
            held = weights[(centres > start + 1.0) & (centres < end)]
            usual = np.median(held.real) + 1j * np.median(held.imag) if len(held) else 0.0
            jitter = np.median(np.abs(np.diff(held))) if len(held) > 1 else 0.0
            found[frame] = (np.abs(held - usual) > limit + _JITTERS * jitter).any()
        return found

    @cached_property
    def _turns_rad(self) -> FloatArray | None:
        """Return (F,) the phase common to all pins against the carrier clock; None without a clock.

        NaN where no right pin sounds.
        """
        if self.record.reference_element is not None:
            return None
        shown = self.shown
        sounding = np.abs(np.where(shown.right, shown.drives.weights, 0.0)) > 0.0
        return np.where(sounding.any(axis=1), shown.drives.turns_rad, np.nan)

    def _check_turns(self, judged: Bools) -> None:
        """Add a finding for each frame whose common phase is off the usual by twice the limit.

        A phase common to the whole array moves no focus, but pins outside the capture may lack it.
        """
        turns = self._turns_rad
        if turns is None:
            return
        in_time = self.shown.late <= LATE_PERIODS  # the mean of a late frame may hold two drives
        frames = np.flatnonzero(judged & np.isfinite(turns) & in_time)
        away = wrapped_phases(turns[frames] - pins_phase(turns[frames], self._limits.phase_rad))
        limit = 2.0 * np.median(self.shown.drives.limit_rad[frames], axis=1)
        for place in np.flatnonzero(np.abs(away) > limit):
            self._find(
                "phases",
                f"frame {frames[place]}: all pins are turned by {np.degrees(away[place]):+.1f} "
                "degrees against the clock of the carrier",
            )

    @cached_property
    def _limits(self) -> PinLimits:
        """Return the largest errors in phase and amplitude that pass, by the sampling rate."""
        return PinLimits.of(self.record)

    def _check_carrier(self) -> None:
        """Add a finding if the carrier is out of tolerance; note a capture too short to tell."""
        drift = self.record.drift_ppm
        if self.record.cut and self.record.end < _LEAST_PERIODS_OF_CARRIER:
            self.not_judged["carrier"] = (
                f"{self.record.end:.0f} periods are left beside missing samples; "
                f"{_LEAST_PERIODS_OF_CARRIER:.0f} tell"
            )
            return
        if abs(drift) > self.record.tolerance_ppm:
            hz = 1.0 / self.record.period_s
            self._find(
                "carrier",
                f"{hz:.2f} Hz on the analyser's clock, {drift:+.0f} ppm of "
                f"{self.record.carrier_hz:g} Hz; {self.record.tolerance_ppm:g} pass",
            )

    # --- the end ---------------------------------------------------------------------------------

    def _find(self, check: str, text: str) -> None:
        """Add *text* as a finding of the check named *check*: the verdict then is FAIL."""
        self.findings.setdefault(check, []).append(text)

    def _conclude(
        self,
        judged: Bools,
        counts: dict[str, int],
        end: EndOfSound,
        levels: LevelsInTime | None,
    ) -> PinVerdict:
        """Return the verdict: FAIL with findings, else INCONCLUSIVE if data is missing, else PASS.

        *judged* is the mask (F,) of judged frames, *counts* numbers of frames by kind, *end* the
        silence after the run, *levels* the amplitudes in the course of time; None: they are not
        known.
        """
        if self.record.cut:
            self.missing.append(f"the capture was cut off: {self.record.cut}")
        wrong = [line for lines in self.findings.values() for line in lines]
        reasons = (
            [wrong[0] + (f"; and {len(wrong) - 1} more" if len(wrong) > 1 else "")] if wrong else []
        )
        verdict = Verdict.FAIL if wrong else Verdict.INCONCLUSIVE if self.missing else Verdict.PASS
        record, drives, late = self.record, self.shown.drives, self.shown.late
        right = self.shown.right & self.shown.seen[:, None]
        errors, sizes = drives.every_error()
        sounding = right & np.isfinite(errors)
        limits = self._limits
        if right.any():
            limits = dataclasses.replace(limits, phase_rad=float(drives.limit_rad[right].max()))
        return PinVerdict(
            name=record.name,
            verdict=verdict,
            reasons=tuple(reasons + self.missing),
            findings={name: tuple(lines) for name, lines in self.findings.items()},
            not_judged=self.not_judged,
            elements=self.run.elements,
            array_count=self.model.array.count,
            counts=counts,
            limits=limits,
            phase_error_rad=float(np.abs(errors[sounding]).max()) if sounding.any() else None,
            amplitude_error=float(sizes[right].max()) if right.any() else None,
            mute_periods=end.spread_periods,
            after_mute_periods=end.after_mute_periods,
            carrier_hz=1.0 / record.period_s,
            drift_ppm=record.drift_ppm,
            weights=drives.weights,
            turns_rad=self._turns_rad,
            right=right,
            judged=judged,
            late_us={int(f): round(float(late[f]) * self._period_us, 1) for f in self._late_frames},
            events=tuple(self.events),
            notes=tuple(self._notes()),
            carrier=record.carrier,
            offsets=self._offsets,
            levels=levels,
        )

    def _notes(self) -> Iterator[str]:
        """Yield notes on the limits of the capture."""
        record = self.record
        yield from record.notes
        if record.reference_element is not None:
            yield (
                f"phases are relative to element {record.reference_element}: a phase that all "
                "captured pins have does not show; capture the clock of the carrier to see it"
            )
        if record.coarse_note:
            yield record.coarse_note

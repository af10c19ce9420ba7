"""The drive that the pins show after a latch, against the codes of its frame."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.records.pins import PinRecord
from haptogram.verification.pins.pin_verdict import PinLimits
from haptogram.verification.pins.pin_weights import pins_phase

from .findings import PinClauseFindings, duration_by_pins, names_of_pins, time_by_pins
from .latch_pulses import LONGEST, SHORTEST, LatchClausePulses
from .reported_latches import ReportedLatch, ShownDrive

_FULL: Final = 255
_TURN: Final = 256
_SILENT: Final = 2.5  # periods without a pulse
_FEWEST: Final = 2  # phases: one is compared with another
_ALONE: Final = "the phase of a pin shows beside another sounding pin, and none was captured"
_BY_SILENCE: Final = frozenset({"HG-7.9/2"})  # clauses that no phase is needed for


@dataclass(frozen=True, eq=False, slots=True)
class DriveAfterLatch:
    """Drives that the captured pins show after a latch.

    Attributes
    ----------
    latch : ReportedLatch
        The latch.
    shown : ShownDrive
        Drive that they have to show.
    seen, meant : (E,) numpy.ndarray of complex
        The drives that they show and those of the codes.
    gone : tuple of int
        Elements that fall silent meanwhile.
    is_sounding : bool
        Whether an element sounds that has to.
    length : float
        Periods that were looked at.
    """

    latch: ReportedLatch
    shown: ShownDrive
    seen: ComplexArray
    meant: ComplexArray
    gone: tuple[int, ...]
    is_sounding: bool
    length: float

    @property
    def turn(self) -> ComplexArray:
        """The (E,) drives that are seen, relative to those of the codes."""
        turn: ComplexArray = self.seen * np.conj(self.meant)
        return turn


@dataclass(frozen=True)
class LatchDriveClauseJudge:
    """Judges the drives of latches by the pins: clauses of every path of a drive, and HG-5.8/5."""

    pulses: LatchClausePulses

    @property
    def record(self) -> PinRecord:
        """The capture."""
        return self.pulses.record

    @cached_property
    def limits(self) -> PinLimits:
        """Errors that the samples may hide."""
        return PinLimits.of(self.record)

    def judge(
        self, latches: Iterable[ReportedLatch], settled: float, findings: PinClauseFindings
    ) -> None:
        """Compare the drives with the codes, from *settled* periods after each latch on."""
        by_boot: dict[float, list[DriveAfterLatch]] = {}
        for latch in latches:
            found = self._drive_after(latch, settled + latch.within)
            if found is not None:
                by_boot.setdefault(latch.boot, []).append(found)
        for drives in by_boot.values():
            offset, steps = self._offset(drives)
            for one in drives:
                self._judge(one, offset, steps, findings)

    def _judge(
        self, one: DriveAfterLatch, offset: float | None, steps: int, findings: PinClauseFindings
    ) -> None:
        """Compare what the pins show after one latch with the codes; add the result to *findings*.

        *offset* is the phase in rad by which all pins are ahead of their codes (None: unknown), and
        *steps* how many phase codes it may be wrong by.
        """
        record, shown, elements = self.record, one.shown, list(self.record.pins)
        where = time_by_pins(record, one.latch.at)
        lost = ""
        if one.gone:
            length = duration_by_pins(record, one.length)
            lost = f"{names_of_pins(record, list(one.gone))} fall silent within {length} of the "
            lost += f"latch {where}"
        if one.is_sounding:
            findings.add("HG-5.8/5", lost)
        bad, compared = self._wrong(one, offset, steps)
        wrong = [
            e for e, is_wrong in zip(elements, bad, strict=True) if is_wrong and e not in one.gone
        ]
        text = ""
        if wrong:
            names = names_of_pins(record, wrong)
            text = f"{names} show another drive after the latch {where} ({shown.path})"
        for clause in (shown.clause, *shown.clauses):
            if text or compared or clause in _BY_SILENCE:
                findings.add(clause, text)
            elif one.is_sounding:
                findings.missing[clause] = _ALONE
        if text or compared:
            findings.paths.add((shown.clause, shown.path))

    def _drive_after(self, latch: ReportedLatch, settled: float) -> DriveAfterLatch | None:
        """Return what the pins show from *settled* periods after a latch to the next one.

        None if that is less than 3 periods, or if it is unknown which drive is due.
        """
        shown = latch.drive
        if shown is None or latch.until - latch.at <= settled + latch.within + SHORTEST:
            return None
        elements = list(self.record.pins)
        codes = shown.codes[:, elements]
        meant = codes[1] / _FULL * np.exp(2j * math.pi / _TURN * codes[0])
        low, high = latch.at + settled, latch.until - 1.0 - latch.within
        seen = np.full(len(elements), np.nan, np.complex128)
        gone, is_sounding = [], False
        drift = self._drift(low, high)
        for place, element in enumerate(elements):
            times, vectors = self.pulses.between(element, low, high)
            pulses = vectors * np.exp(-1j * np.polyval(drift, times - low))
            seen[place] = pulses.sum() / max(1, round(high - low)) if len(times) else 0
            edges = np.concatenate([[low], times, [high]])
            has_gap = len(times) > 0 and np.diff(edges).max() > _SILENT
            is_sounding |= abs(meant[place]) > self.limits.amplitude and len(times) > 0
            if abs(meant[place]) > self.limits.amplitude and has_gap:
                gone.append(element)
            elif len(times):
                seen[place] = pulses.mean()
        return DriveAfterLatch(latch, shown, seen, meant, tuple(gone), is_sounding, high - low)

    def _drift(self, low: float, high: float) -> FloatArray:
        """Return a quadratic fit (3,) of the phase of the reference element from *low* to *high*.

        In rad over periods since *low*, highest power first; [0] without such an element, or with
        less than 40 pulses of it. Where an element replaces the carrier, it shows the analyser's
        clock error.
        """
        if self.record.reference_element is None:
            return np.zeros(1)
        times, vectors = self.pulses.between(self.record.reference_element, low, high)
        if len(times) < LONGEST:
            return np.zeros(1)
        phases = np.unwrap(np.angle(vectors))
        found: FloatArray = np.polyfit(times - low, phases - phases[0], 2)
        return found

    def _wrong(
        self, one: DriveAfterLatch, offset: float | None, steps: int
    ) -> tuple[NDArray[np.bool_], bool]:
        """Return a mask (E,) of pins that differ from their codes; True if phases were compared.

        All pins are first turned back by a common phase: that of the reference element or, without
        one, *offset* in rad, known to *steps* phase codes. If both lack, only amplitudes are
        compared.
        """
        size = self._amplitude_limit(one)
        sizes = np.abs(np.abs(one.seen) - np.abs(one.meant)) > size
        audible = self._audible(one)
        if self.record.reference_element is not None:
            place = list(self.record.pins).index(self.record.reference_element)
            offset, steps = float(np.angle(one.turn[place])), one.shown.steps
            audible &= audible[place]  # a silent reference has no phase
            is_compared = int(audible.sum()) > 1
        else:
            is_compared = offset is not None and bool(audible.any())
        errors = np.abs(np.angle(one.turn * np.exp(-1j * (offset or 0.0))))
        # The shared phase is known to a sample only, and that of a computed drive to a step.
        step_rad = (one.shown.steps + steps) * math.tau / _TURN
        limit = 2.0 * self.limits.phase_rad + step_rad
        bad: NDArray[np.bool_] = sizes | (audible & (errors > limit))
        return bad, is_compared

    def _amplitude_limit(self, one: DriveAfterLatch) -> float:
        """Return the error allowed in an amplitude (0 to 1): of the capture, and of rounding."""
        return self.limits.amplitude + one.shown.steps / _FULL

    def _audible(self, one: DriveAfterLatch) -> NDArray[np.bool_]:
        """Return a mask (E,) of pins whose phase can be compared.

        The amplitudes due and seen are both above the error allowed in one. Left out are elements
        where the waves for several points nearly cancel: their phase is free (HG-5.4/3).
        """
        audible: NDArray[np.bool_] = np.minimum(
            np.abs(one.seen), np.abs(one.meant)
        ) > self._amplitude_limit(one)
        return audible & ~one.shown.free[list(self.record.pins)]

    def _offset(self, drives: Sequence[DriveAfterLatch]) -> tuple[float | None, int]:
        """Return the phase in rad by which all pins are ahead of their codes, and its uncertainty.

        The uncertainty is in phase codes: 1 if only drives that the board computed are known, else
        0. *drives* are of one boot. (None, 0) if there is only one phase: nothing can be compared.
        """
        angles: dict[int, list[FloatArray]] = {}
        for one in drives:
            found = angles.setdefault(one.shown.steps, [])
            found.append(np.angle(one.turn[self._audible(one)]))
        known = {steps: np.concatenate(found) for steps, found in angles.items()}
        if sum(map(len, known.values())) < _FEWEST:
            return None, 0
        steps = min(steps for steps, found in known.items() if len(found))
        limit = self.limits.phase_rad + steps * math.tau / _TURN
        return pins_phase(known[steps], limit), steps

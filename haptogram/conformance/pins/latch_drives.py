"""The drive that the pins show behind a latch, against the codes of its frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.records.pins import PinRecord
from haptogram.verification.pins.shown_frames import PinCaptureLimits

from .findings import PinClauseFindings, duration_by_pins, names_of_pins, time_by_pins
from .latch_pulses import LONGEST, SHORTEST, LatchClausePulses
from .told_latches import ShownDrive, ToldLatch

_FULL: Final = 255
_TURN: Final = 256
_SILENT: Final = 2.5  # periods without a pulse
_ALONE: Final = "the phase of a pin shows beside another sounding pin, and none was captured"
_BY_SILENCE: Final = frozenset({"HG-7.9/2"})  # clauses that no phase is needed for


@dataclass
class LatchDriveClauseJudge:
    """Judges the drives of latches by the pins: clauses of every path of a drive, and HG-5.8/5."""

    pulses: LatchClausePulses
    _shared: dict[float, float] = field(default_factory=dict, init=False)

    @property
    def record(self) -> PinRecord:
        """The capture."""
        return self.pulses.record

    @cached_property
    def limits(self) -> PinCaptureLimits:
        """Errors that the samples may hide."""
        return PinCaptureLimits.of(self.record)

    def judge(self, latch: ToldLatch, settled: float, findings: PinClauseFindings) -> None:
        """Compare the drives with the codes, from *settled* periods behind the latch on."""
        settled += latch.within
        shown = latch.drive
        if shown is None or latch.until - latch.at <= settled + latch.within + SHORTEST:
            return
        record, where = self.record, time_by_pins(self.record, latch.at)
        elements = list(record.pins)
        codes = shown.codes[:, elements]
        meant = codes[1] / _FULL * np.exp(2j * math.pi / _TURN * codes[0])
        low, high = latch.at + settled, latch.until - 1.0 - latch.within
        seen = np.full(len(elements), np.nan, np.complex128)
        gone, sounding = [], False
        drift = self._drift(low, high)
        for place, element in enumerate(elements):
            times, vectors = self.pulses.between(element, low, high)
            pulses = vectors * np.exp(-1j * np.polyval(drift, times - low))
            seen[place] = pulses.sum() / max(1, round(high - low)) if len(times) else 0
            edges = np.concatenate([[low], times, [high]])
            has_gap = len(times) > 0 and np.diff(edges).max() > _SILENT
            sounding |= abs(meant[place]) > self.limits.amplitude and len(times) > 0
            if abs(meant[place]) > self.limits.amplitude and has_gap:
                gone.append(element)
            elif len(times):
                seen[place] = pulses.mean()
        lost = ""
        if gone:
            length = duration_by_pins(record, high - low)
            lost = f"{names_of_pins(record, gone)} fall silent within {length} of the latch {where}"
        if sounding:
            findings.add("HG-5.8/5", lost)
        bad, compared = self._wrong(seen, meant, shown, latch.boot)
        wrong = [e for e, is_wrong in zip(elements, bad, strict=True) if is_wrong and e not in gone]
        text = ""
        if wrong:
            names = names_of_pins(record, wrong)
            text = f"{names} show another drive after the latch {where} ({shown.path})"
        for clause in (shown.clause, *shown.clauses):
            if text or compared or clause in _BY_SILENCE:
                findings.add(clause, text)
            elif sounding:
                findings.missing[clause] = _ALONE
        if text or compared:
            findings.paths.add((shown.clause, shown.path))

    def _drift(self, low: float, high: float) -> FloatArray:
        """Return the polynomial by which the phase of the reference wanders behind *low*.

        An element counts no periods, so there the analyser's clock turns all phases slowly.
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
        self, seen: ComplexArray, meant: ComplexArray, shown: ShownDrive, boot: float
    ) -> tuple[NDArray[np.bool_], bool]:
        """Return the pins that differ, and whether any phase was compared with another one.

        Phases are compared on the one that the pins share with their drives.
        """
        limits = self.limits
        turn = seen * np.conj(meant)
        size = limits.amplitude + shown.steps / _FULL
        sizes = np.abs(np.abs(seen) - np.abs(meant)) > size
        audible = np.minimum(np.abs(seen), np.abs(meant)) > size
        audible &= ~shown.free[list(self.record.pins)]
        others = int(self.record.reference_element is None and boot in self._shared)
        if self.record.reference_element is None:
            offset = self._offset(turn, boot, is_exact=not shown.steps)
        else:
            place = list(self.record.pins).index(self.record.reference_element)
            offset = float(np.angle(turn[place]))
            audible &= audible[place]  # a silent reference has no phase
        errors = np.abs(np.angle(turn * np.exp(-1j * offset)))
        # The shared phase is known to a sample only, and that of a computed drive to a step.
        limit = 2.0 * (limits.phase_rad + shown.steps * math.tau / _TURN)
        bad: NDArray[np.bool_] = sizes | (audible & (errors > limit))
        return bad, int(audible.sum()) + others > 1

    def _offset(self, turn: ComplexArray, boot: float, *, is_exact: bool) -> float:
        """Return the phase of the pins against their codes: one from a reset to the next."""
        if boot in self._shared or not (np.abs(turn) > 0.0).any():
            return self._shared.get(boot, 0.0)
        found = _shared_angle_of_clause(np.angle(turn[np.abs(turn) > 0.0]))
        if is_exact:
            self._shared[boot] = found
        return found


def _shared_angle_of_clause(angles: FloatArray) -> float:
    """Return the angle that most of *angles* are next to."""
    apart = np.abs(np.angle(np.exp(1j * (angles[:, None] - angles[None, :]))))
    near = apart <= math.tau / _TURN
    best = near[near.sum(axis=1).argmax()]
    return float(np.angle(np.exp(1j * angles[best]).sum()))

"""Recorders of the acts of a board, and of its foci."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Hashable, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any, Final, TypeVar

from haptogram.acoustics import AcousticModel, NoFocus, Reconstruction, Reconstructor
from haptogram.acoustics.arrays import ComplexArray
from haptogram.acoustics.reconstruct.warm import DriveToFind
from haptogram.records.frame import Evidence, FrameKey, Observation
from haptogram.records.latch import LatchRecord

from ..board import events
from ..board.settings import BoardSettings
from . import records

if TYPE_CHECKING:
    from haptogram.acoustics.reconstruct.patterns.classifier import PatternClassifier
    from haptogram.acoustics.reconstruct.patterns.found import Pattern

_Estimate = TypeVar("_Estimate")

_AT_ONCE: Final = 512  # latches whose fields are rebuilt together
MEMORY_DRIVES: Final = 4096  # a few megabytes: an object of 4 s at 1 kHz, shown again and again


class BackdoorEstimator:
    """Rebuilds the field of latch after latch; a drive that was seen lately costs nothing.

    Each drive is judged by the rounding of the phases that it was commanded with: a board may
    make its pulses of finer steps (*phase_steps* a period) than its phases.

    Attributes
    ----------
    searches_left : float
        Drives whose focus may still be searched for in the whole volume, which takes as long as a
        hundred foci; one that needs it and finds none left has no field.
    """

    def __init__(self, model: AcousticModel, phase_steps: int | None = None) -> None:
        self.searches_left = math.inf
        self._reconstructor = Reconstructor(model)
        self._phase_steps = phase_steps
        self._seen: dict[Hashable, Reconstruction | None] = {}
        self._model = model
        self._classifiers: dict[int, PatternClassifier] = {}
        self._patterns: dict[Hashable, Pattern] = {}

    def estimate(self, latch: events.AnyLatch) -> Reconstruction | None:
        """Return the reconstruction of the radiated drive, which knows no target."""
        if isinstance(latch, events.Latch):
            return self.estimate_all([latch])[0]
        return _remembered(self._seen, latch, self._reconstruct)

    def estimate_all(self, latches: Sequence[events.Latch]) -> list[Reconstruction | None]:
        """Return the result of :meth:`estimate` for each; new drives are rebuilt at once."""
        keys = [_drive_key_of_latch(latch) for latch in latches]
        known = self._seen
        new = {key: latch for key, latch in zip(keys, latches, strict=True) if key not in known}
        step_rad = functools.cache(self._reconstructor.step_rad)
        asked = [
            DriveToFind(latch.radiated, step_rad(latch.radiated.phase_bits, latch.commanded_bits))
            for latch in new.values()
            if not latch.ramping
        ]
        quickly = self._reconstructor.reconstruct_all_quickly(asked)
        foci = iter(
            [
                self._searched(one.drive.weights(), one.step_rad) if found is None else found
                for one, found in zip(asked, quickly, strict=True)
            ]
        )
        for key, latch in new.items():
            known[key] = NoFocus("ramping") if latch.ramping else next(foci)
        found = [known[key] for key in keys]
        _forget_oldest(known)
        return found

    def warm_up(self) -> None:
        """Do now what the first drive would wait for."""
        self._reconstructor.warm_up()

    def pattern(self, latch: events.PulseLatch) -> Pattern:
        """Return the pattern of the radiated drive, without knowledge of the intended focus."""
        return _remembered(self._patterns, latch, self._classified)

    def _classified(self, latch: events.PulseLatch) -> Pattern:
        """Return the pattern (class of field) that a latch forms, judged in its coarsest steps."""
        from haptogram.acoustics.reconstruct.patterns.classifier import PatternClassifier

        steps = self._coarsest_steps(latch)
        if steps not in self._classifiers:
            self._classifiers[steps] = PatternClassifier(self._model, steps)
        return self._classifiers[steps].classify(latch.weights())

    def _coarsest_steps(self, latch: events.PulseLatch) -> int:
        """Return the smallest number of phase steps in a period that is known for a latch.

        It is that of its pulses, of the board, or of the drive from which the pulses were made.
        """
        known = (latch.pulses.steps, self._phase_steps, latch.phase_steps)
        return min(steps for steps in known if steps is not None)

    def _reconstruct(self, latch: events.PulseLatch) -> Reconstruction | None:
        """Return the field that the pulses of a latch form: its focus, or that there is none.

        None if a search of the whole volume was needed, and none is left.
        """
        weights, step_rad = latch.weights(), math.tau / self._coarsest_steps(latch)
        found = self._reconstructor.reconstruct_quickly(weights, step_rad=step_rad)
        return self._searched(weights, step_rad) if found is None else found

    def _searched(self, weights: ComplexArray, step_rad: float) -> Reconstruction | None:
        """Return the result of a search of the whole volume, of which a limited number is allowed.

        None if none is left. *step_rad* is the phase step of *weights*.
        """
        if self.searches_left <= 0:
            return None
        self.searches_left -= 1
        return self._reconstructor.reconstruct_weights(weights, step_rad=step_rad)


def _remembered(
    known: dict[Hashable, _Estimate],
    latch: events.PulseLatch,
    estimate: Callable[[events.PulseLatch], _Estimate],
) -> _Estimate:
    """Return the estimate for the drive of a latch from *known*, or made by *estimate* and kept."""
    key = _drive_key_of_latch(latch)
    if key not in known:
        _forget_oldest(known)
        known[key] = estimate(latch)
    return known[key]


def _forget_oldest(known: dict[Hashable, Any]) -> None:
    """Remove the oldest of the *known* estimates, so that no more than 4096 are left."""
    for key in list(islice(known, max(0, len(known) - MEMORY_DRIVES))):
        del known[key]


def _drive_key_of_latch(latch: events.AnyLatch) -> tuple[Hashable, ...]:
    """Return a key that is equal for latches whose latched and radiated drives are equal."""
    if isinstance(latch, events.PulseLatch):
        return latch.weights().tobytes(), latch.pulses.steps
    drives = [latch.radiated] if latch.radiated is latch.drive else [latch.radiated, latch.drive]
    codes = [part.tobytes() for one in drives for part in (one.phase_codes, one.amplitude_codes)]
    return *codes, latch.radiated.phase_bits, latch.commanded_bits, latch.ramping


def _latch_observation(latch: events.Latch, estimate: Reconstruction | None) -> Observation:
    """Return a latch as the observation that a reader of its back-door record would get.

    *estimate* is the reconstructed field; None if it was not reconstructed.
    """
    key = FrameKey(latch.session, latch.key.sequence, latch.key.loop, latch.key.index)
    return Observation(
        key,
        latch.t_latch_us,
        latch.late,
        Evidence.EXTERNAL,
        latch.drive,
        latch.drive.digest(),
        estimate,
        None if latch.is_unchanged else latch.radiated,
        latch.t_received_us,
    )


class InlineReconstructionWorker:
    """A recorder that makes every record at once.

    Parameters
    ----------
    settings : BoardSettings
        The board.
    write : callable
        Takes each record: a list's ``append``, for example.
    reconstruct : bool, keyword-only
        Whether the field is rebuilt.
    told : list of Observation, keyword-only, optional
        Takes the latches as a verdict has them, many at a time, at the latest with :meth:`settle`:
        their fields take a tenth of the time so. The records of latches then lack the drive
        until :meth:`complete`.
    direct : callable, keyword-only, optional
        Takes the latches of Haptogram's own wire in place of their records.
    """

    def __init__(
        self,
        settings: BoardSettings,
        write: Callable[[records.Record], object],
        *,
        reconstruct: bool = True,
        told: list[Observation] | None = None,
        direct: Callable[[LatchRecord], object] | None = None,
    ) -> None:
        self._write, self._direct = write, direct
        self._told = told
        self._owed: list[tuple[events.Latch, records.Record]] = []
        self._brief: list[tuple[events.Latch, records.Record, Reconstruction | None]] = []
        wiring = settings.wiring
        steps = None if wiring is None else wiring.steps
        self._estimator = BackdoorEstimator(settings.truth, steps) if reconstruct else None
        self._latched = self._reconstructed = 0
        # Of drives seen lately, as their records have them; and whether those have a field.
        self._texts: dict[Hashable, tuple[str, bool]] = {}
        self._counted: dict[str, events.Counted] = {}
        self._modulation: events.Modulation | None = None
        write(records.backdoor_board_record(settings))

    def warm_up(self) -> None:
        """Make ready, so that the first latch takes no longer than the next one."""
        if self._estimator is not None:
            self._estimator.warm_up()

    def latch(self, latch: events.AnyLatch) -> None:
        """Take down a latch."""
        self._latched += 1
        if self._direct is not None and isinstance(latch, events.Latch):
            self._direct(latch.record())
            return
        if self._told is not None and isinstance(latch, events.Latch):
            self._defer_reconstruction(latch)
            return
        estimator = self._estimator  # once: a signal may take it away at any time
        estimate = estimator.estimate(latch) if estimator else None
        self._reconstructed += estimate is not None
        if isinstance(latch, events.PulseLatch):
            changed, self._modulation = latch.modulation != self._modulation, latch.modulation
            pattern = estimator.pattern(latch) if estimator else None
            self._write(
                records.backdoor_pulse_record(latch, estimate, pattern, modulation_changed=changed)
            )
        else:
            self._write(records.backdoor_latch_record(latch, estimate))

    def lines_of_latches(self, latches: Sequence[events.Latch]) -> bytes:
        """Take down latches at once; return their records as lines.

        The text of a drive is remembered: it takes most of the time.
        """
        known, estimator = self._texts, self._estimator
        keys = [(estimator is None, *_drive_key_of_latch(latch)) for latch in latches]
        new = {key: latch for key, latch in zip(keys, latches, strict=True) if key not in known}
        estimates: Sequence[Reconstruction | None] = [None] * len(new)
        if estimator is not None:
            estimates = estimator.estimate_all([*new.values()])
        for (key, latch), estimate in zip(new.items(), estimates, strict=True):
            known[key] = records.backdoor_drive_text(latch, estimate), estimate is not None
        self._latched += len(latches)
        self._reconstructed += sum(known[key][1] for key in keys)
        lines = map(records.backdoor_latch_line, latches, [known[key][0] for key in keys])
        text = "".join(lines).encode()
        _forget_oldest(known)
        return text

    def _defer_reconstruction(self, latch: events.Latch) -> None:
        """Write a latch's record without its field, which follows with up to 512 others."""
        record = records.backdoor_brief_record(latch)
        self._write(record)
        self._owed.append((latch, record))
        if len(self._owed) >= _AT_ONCE:
            self.settle()

    def settle(self) -> None:
        """Reconstruct the fields of all latches so far."""
        owed, told = self._owed, self._told
        if not owed or told is None:
            return
        latches = [latch for latch, _ in owed]
        estimates: Sequence[Reconstruction | None] = [None] * len(latches)
        if self._estimator is not None:
            estimates = self._estimator.estimate_all(latches)
            self._reconstructed += sum(estimate is not None for estimate in estimates)
        seen = [*map(_latch_observation, latches, estimates)]
        pairs = zip(owed, estimates, strict=True)
        brief = [(latch, record, estimate) for (latch, record), estimate in pairs]
        # Without a call, at which an interrupt is heard: no latch is told twice, or never.
        told += seen
        self._brief += brief
        self._owed = []

    def complete(self) -> None:
        """Complete the records of all latches so far."""
        self.settle()
        for latch, record, estimate in self._brief:
            record.update(records.backdoor_latch_record(latch, estimate))
        self._brief = []

    def limit_searches(self, count: int) -> None:
        """From now on search the whole volume for the foci of *count* more drives at most."""
        if self._estimator is not None:
            self._estimator.searches_left = count

    def skip_fields(self) -> None:
        """Leave the field out from now on: there is no time left for it."""
        self.limit_searches(0)  # of the latches at hand
        self._estimator = None

    def notice(self, notice: events.Notice) -> None:
        """Take down a change of the output; counts belong to the last record."""
        if isinstance(notice, events.Counted):
            self._counted[notice.what] = notice
        else:
            self._write(records.backdoor_output_record(notice))

    def finish(self, *, dropped: int = 0, notices_dropped: int = 0, clean: bool = True) -> None:
        """Write the totals; *dropped* latches and *notices_dropped* notices never came here."""
        self.settle()
        self._write(
            records.backdoor_end_record(
                latched=self._latched + dropped,
                reconstructed=self._reconstructed,
                dropped=dropped,
                notices_dropped=notices_dropped,
                clean=clean,
                counted=self._counted,
            )
        )

"""A board watched latch by latch."""

from __future__ import annotations

import statistics
import time
from collections import Counter, OrderedDict, deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.reconstruct.patterns.classifier import PatternClassifier
from haptogram.acoustics.reconstruct.patterns.found import OneFocus, Pattern, Unnamed
from haptogram.records.remark import About
from haptogram.settings.arguments import check_whole

from ..frame.verdict import WRONG, FrameStatus, FrameVerdict
from .conjugate import ConjugateFociOfClient
from .defect import Diagnosis
from .diagnosis import DefectFinder
from .expectation import Expectation
from .latch import SeenLatch
from .mistakes import Aim, hint_at_mistaken_speed, name_client_mistake
from .result import WatchedLatch, WatchResult

_REMEMBERED: Final = 1024  # drives; clients show the same ones again and again
_TIMED: Final = 4096
_MOST_AIMS: Final = 64  # targets that a mistake must explain
_FOCUSED: Final = 0.8  # of the latches that were expected to be a focus, for a mistake to be named
_MOST_NOTES: Final = 4
_LEAST_ELEMENTS: Final = 12  # that prove a focus, with 16 steps
_SILENT_KINDS: Final = ("off", "uniform")


class Watch:
    """Tells what a board radiates, latch by latch, and what is wrong with it.

    Parameters
    ----------
    model : AcousticModel
        Array and air of the board.
    channels : int, optional
        Channels of one board; by default the elements of the array.
    expectation : Expectation, optional
        The foci that are expected. A latch that radiates nothing, or all in phase, is not one of
        the frames that are expected: clients begin and end so.

    Examples
    --------
    >>> watch = Watch(model, expectation=Expectation(model, [(0.0, 0.0, 0.15)]))
    >>> seen = watch.take(SeenLatch(1, weights, steps=256))
    >>> seen.pattern.kind, str(seen.verdict.status)
    ('one focus', 'on target')
    >>> str(watch.result().verdict)
    'pass'
    """

    def __init__(
        self,
        model: AcousticModel,
        *,
        channels: int | None = None,
        expectation: Expectation | None = None,
    ) -> None:
        count = model.array.count if channels is None else channels
        check_whole("channels", count, 1, 4096)
        self._model = model
        self._expectation = expectation
        self._finder = DefectFinder(model.array.positions_m, count)
        self._classifiers: dict[int, PatternClassifier] = {}
        self._seen: OrderedDict[tuple[int, bytes], Pattern] = OrderedDict()
        self._kinds: Counter[str] = Counter()
        self._statuses: Counter[FrameStatus] = Counter()
        self._times_ms: deque[float] = deque(maxlen=_TIMED)
        self._aims: dict[tuple[float, ...], Aim] = {}
        self._conjugates = ConjugateFociOfClient(model)
        self._latches = self._frames = self._focused = self._missed = 0
        self._only_phases = 0  # wrong frames whose focus is right
        self._notes: dict[str, None] = {}  # why frames are not verified

    def take(self, latch: SeenLatch) -> WatchedLatch:
        """Return a latch with its pattern, verdict and defects."""
        self._latches += 1
        pattern, took_ms = self._pattern(latch)
        defects = self._finder.take(latch, pattern)
        verdict = None
        if latch.is_of_client:
            self._kinds[pattern.kind] += 1
            verdict = self._judged(latch, pattern)
        return WatchedLatch(latch, pattern, verdict, defects, took_ms)

    def remark(self, about: About, text: str) -> None:
        """Take down what the board says of its client."""
        self._finder.frames.remark(about, text)

    def wire_compared(self, *, is_own: bool) -> None:
        """Learn that the bytes of the client look like no other wire, and whether like its own."""
        self._finder.frames.wire_compared(is_own=is_own)

    @property
    def waits_for_wire(self) -> bool:
        """True if frames of the client are torn, and the board has not told their wire yet."""
        return self._finder.frames.waits_for_wire

    def cut_short(self) -> None:
        """Learn that the board will tell nothing more."""
        self._finder.frames.cut_short()

    def client_left(self) -> None:
        """Learn that the client has left: the next one is judged by itself."""
        self._finder.frames.client_left()

    def result(self, missing: str | None = None) -> WatchResult:
        """Return the numbers so far; *missing* says why latches may be missing."""
        times, mistakes = self._times_ms, self._mistakes()
        return WatchResult(
            latches=self._latches,
            kinds=dict(self._kinds),
            statuses=dict(self._statuses),
            diagnoses=(*self._finder.diagnoses(), *mistakes),
            hints=() if mistakes else tuple(self._hints()),
            torn=tuple(self._finder.frames.torn),
            missing=missing or self._finder.frames.undecided,
            remarks=tuple(self._finder.frames.remarks),
            search_ms=(statistics.median(times), max(times)) if times else (0.0, 0.0),
            expected=self._expectation is not None,
        )

    def _pattern(self, latch: SeenLatch) -> tuple[Pattern, float]:
        """Return the pattern of a drive, and how long the search for it took."""
        weights = np.asarray(latch.weights, dtype=np.complex128)
        key = latch.steps, weights.tobytes()
        if key in self._seen:
            self._seen.move_to_end(key)
            return self._seen[key], 0.0
        if latch.steps not in self._classifiers:
            self._classifiers[latch.steps] = PatternClassifier(self._model, latch.steps)
            self._classifiers[latch.steps].warm_up()
        start_s = time.perf_counter()
        pattern = self._classifiers[latch.steps].classify(weights, self._expected_m())
        took_ms = 1e3 * (time.perf_counter() - start_s)
        self._times_ms.append(took_ms)
        self._seen[key] = pattern
        if len(self._seen) > _REMEMBERED:
            self._seen.popitem(last=False)
        return pattern, took_ms

    def _expected_m(self) -> FloatArray | None:
        """Return the one focus of the frame that is expected next."""
        if self._expectation is None:
            return None
        foci = self._expectation.frame(self._frames)
        return foci[0] if len(foci) == 1 else None

    def _judged(self, latch: SeenLatch, pattern: Pattern) -> FrameVerdict | None:
        if self._expectation is None or pattern.kind in _SILENT_KINDS:
            return None
        index = self._frames
        self._frames += 1
        verdict = self._expectation.judge(index, latch, pattern)
        self._statuses[verdict.status] += 1
        foci = self._expectation.frame(index)
        if len(foci) > 1 or latch.torn:
            return verdict
        if verdict.status is FrameStatus.NOT_VERIFIED and len(self._notes) < _MOST_NOTES:
            self._notes.setdefault(verdict.note)
        if verdict.status in WRONG:
            self._missed += 1
            self._only_phases += [n for n, ok in verdict.criteria.items() if not ok] == ["S1"]
            self._conjugates.take(latch, pattern, foci[0])
        if isinstance(pattern, OneFocus):
            self._focused += 1
            key = tuple(foci[0].tolist())
            if key not in self._aims and len(self._aims) < _MOST_AIMS:
                place, std = np.array(pattern.position_m), np.array(pattern.std_m)
                self._aims[key] = Aim(foci[0], place, std)
        return verdict

    def _mistakes(self) -> list[Diagnosis]:
        """Return the one mistake that explains where the foci are, if they are not on target."""
        found = None
        if self._are_off_target:
            found = name_client_mistake(self._model, list(self._aims.values()))
        if found is None and self._missed >= max(1, _FOCUSED * self._frames):
            found = self._conjugates.diagnosis()
        return [] if found is None else [found]

    def _hints(self) -> Iterator[str]:
        """Yield what may explain where the foci are and is not proven, and why others are not."""
        yield from (f"not verified: {note}" for note in self._notes)
        count = self._model.array.count
        if count < _LEAST_ELEMENTS and self._expectation is None and Unnamed.kind in self._kinds:
            yield f"{count} elements prove no pattern: with --expect their phases are judged"
        if self._are_off_target and (
            text := hint_at_mistaken_speed(self._model, [*self._aims.values()])
        ):
            yield f"the foci are where they would be if {text}"
        elif self._only_phases and self._only_phases == sum(self._statuses[s] for s in WRONG):
            yield (
                "every focus is where it was expected; single phases are off by more than half a "
                "step (S1), as of codes that are cut off or of air that differs a little: "
                "--tolerance-mm and --tolerance-c allow for that"
            )

    @property
    def _are_off_target(self) -> bool:
        """True if some latch is wrong, and nearly all are foci."""
        wrong = any(self._statuses[status] for status in WRONG)
        return wrong and self._focused >= _FOCUSED * self._frames

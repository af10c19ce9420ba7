"""A board watched latch by latch."""

from __future__ import annotations

import math
import statistics
import time
from collections import Counter, OrderedDict, deque
from collections.abc import Iterator
from typing import Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.model.boards.layout import Z_UP, Rows
from haptogram.acoustics.model.model import AcousticModel
from haptogram.acoustics.reconstruct.patterns.classifier import PatternClassifier
from haptogram.acoustics.reconstruct.patterns.found import OneFocus, Pattern, Unnamed
from haptogram.settings.arguments import check_whole

from ..frame.verdict import WRONG, FrameStatus, FrameVerdict
from .diagnosis import DefectFinder
from .expectation import Expectation, ExpectedOrder
from .latch import SeenLatch
from .mistakes import Aim, ClientMistakes
from .out_of_step import CommonLosses, ElementMistakes
from .rearrangements import client_rearrangements
from .result import WatchedLatch, WatchResult

_REMEMBERED: Final = 1024  # drives; clients show the same ones again and again
_TIMED: Final = 4096
_MOST_AIMS: Final = 64  # targets that a mistake must explain
_SOUNDING: Final = 1e-6
_MOST_NOTES: Final = 4
_LEAST_ELEMENTS: Final = 12  # least elements that prove a focus, with 16 steps
_SILENT_KINDS: Final = ("off", "uniform")


class Watch:
    """Tells what a board radiates, latch by latch, and what is wrong with it.

    Parameters
    ----------
    model : AcousticModel
        Array and air of the board.
    channels : int, optional
        Channels of one board; by default the elements of the array.
    client_axes : rows, optional
        Our axes in those of the client, in which defects speak; by default they are the same.
    expectation : Expectation, optional
        The foci that are expected. A latch that radiates nothing, or all in phase, is not one of
        the frames that are expected: clients begin and end so.

    Attributes
    ----------
    frames : FrameDefects
        What codecs count, and what the board says of its client and of its end.

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
        client_axes: Rows = Z_UP,
        expectation: Expectation | None = None,
    ) -> None:
        count = model.array.count if channels is None else channels
        check_whole("channels", count, 1, 4096)
        self._model = model
        self._channels, self._axes = count, client_axes
        self._expectation = expectation
        self._order = None if expectation is None else ExpectedOrder(expectation)
        self._finder = DefectFinder(model.array.positions_m, count)
        self.frames = self._finder.frames
        self._classifiers: dict[int, PatternClassifier] = {}
        self._seen: OrderedDict[tuple[int, bytes], Pattern] = OrderedDict()
        self._kinds: Counter[str] = Counter()
        self._statuses: Counter[FrameStatus] = Counter()
        self._times_ms: deque[float] = deque(maxlen=_TIMED)
        self._aims: dict[tuple[float, ...], Aim] = {}
        self._elements = ElementMistakes(model)
        self._common = CommonLosses(model)
        self._latches = 0
        self._only_phases = 0  # wrong frames whose focus is right
        self._notes: dict[str, None] = {}  # why frames are not verified

    def take(self, latch: SeenLatch) -> WatchedLatch:
        """Return a latch with its pattern, verdict and defects."""
        self._latches += 1
        pattern, took_ms = self._pattern(latch)
        defects = self._finder.take(latch, pattern)
        self._common.take(latch, pattern)
        verdict = None
        if latch.is_of_client:
            self._kinds[pattern.kind] += 1
            verdict = self._judged(latch, pattern)
        return WatchedLatch(latch, pattern, verdict, defects, took_ms)

    def result(self, missing: str | None = None) -> WatchResult:
        """Return the numbers so far; *missing* says why latches may be missing."""
        times, found = self._times_ms, self._client_mistakes()
        mistakes = [] if found is None or (named := found.diagnosis()) is None else [named]
        if self._order is not None:
            mistakes += self._order.diagnoses()
        reversed_elements = self._finder.reversed_elements
        groups, members = self._common.groups(reversed_elements)
        if not mistakes:
            known = reversed_elements | members
            mistakes = groups + self._elements.diagnoses(known)
        mistakes += self._common.levels()
        return WatchResult(
            latches=self._latches,
            kinds=dict(self._kinds),
            statuses=dict(self._statuses),
            diagnoses=(*self._finder.diagnoses(), *mistakes),
            hints=() if mistakes else tuple(self._hints(found)),
            torn=tuple(self.frames.torn),
            missing=missing or self.frames.undecided,
            remarks=tuple(self.frames.remarks),
            search_ms=(statistics.median(times), max(times)) if times else (0.0, 0.0),
            expected=self._expectation is not None,
        )

    def _pattern(self, latch: SeenLatch) -> tuple[Pattern, float]:
        """Return the pattern of a drive, and how many ms the search took: 0 if it is remembered."""
        weights = np.asarray(latch.weights, dtype=np.complex128)
        key = latch.steps, weights.tobytes()
        if key in self._seen:
            self._seen.move_to_end(key)
            return self._seen[key], 0.0
        if latch.steps not in self._classifiers:
            self._classifiers[latch.steps] = PatternClassifier(self._model, latch.steps)
            self._classifiers[latch.steps].warm_up()
        start_s = time.perf_counter()
        foci = None if self._order is None else self._order.next_foci
        expected_m = foci[0] if foci is not None and len(foci) == 1 else None
        pattern = self._classifiers[latch.steps].classify(weights, expected_m)
        took_ms = 1e3 * (time.perf_counter() - start_s)
        self._times_ms.append(took_ms)
        self._seen[key] = pattern
        if len(self._seen) > _REMEMBERED:
            self._seen.popitem(last=False)
        return pattern, took_ms

    def _judged(self, latch: SeenLatch, pattern: Pattern) -> FrameVerdict | None:
        """Return the verdict on a latch; None without an expected order, or for a silent output."""
        if self._order is None or pattern.kind in _SILENT_KINDS:
            return None
        verdict, foci = self._order.judge(latch, pattern)
        self._statuses[verdict.status] += 1
        if foci is None or len(foci) > 1 or latch.torn:
            return verdict
        if verdict.status is FrameStatus.NOT_VERIFIED and len(self._notes) < _MOST_NOTES:
            self._notes.setdefault(verdict.note)
        aim = self._aim(latch, pattern, foci[0])
        if verdict.status in WRONG:
            self._only_phases += [n for n, ok in verdict.criteria.items() if not ok] == ["S1"]
            self._elements.take(latch.number, aim)
        if len(self._aims) < _MOST_AIMS:
            self._aims.setdefault(tuple(foci[0].tolist()), aim)
        return verdict

    def _aim(self, latch: SeenLatch, pattern: Pattern, target_m: FloatArray) -> Aim:
        """Return the target, the radiated phases, and the found focus's place (None: no focus)."""
        weights = np.where(np.isfinite(latch.weights), latch.weights, 0.0)
        radiated = self._model.radiated(weights)
        phases = np.where(np.abs(radiated) > _SOUNDING, np.angle(radiated), np.nan)
        found = np.array(pattern.position_m) if isinstance(pattern, OneFocus) else None
        return Aim(target_m, phases, 2.0 * math.pi / latch.steps, found)

    def _client_mistakes(self) -> ClientMistakes | None:
        """Return the search for a client's coordinate mistake; None if no latch is wrong."""
        if not self._aims or not any(self._statuses[status] for status in WRONG):
            return None
        made = client_rearrangements(self._model, self._channels, self._axes)
        axes = np.array(self._axes)
        return ClientMistakes(self._model, made, axes, [*self._aims.values()])

    def _hints(self, mistakes: ClientMistakes | None) -> Iterator[str]:
        """Yield explanations of wrong foci that are likely but not proven.

        *mistakes* None: there was no wrong latch to search.
        """
        yield from (f"not verified: {note}" for note in self._notes)
        count = self._model.array.count
        if count < _LEAST_ELEMENTS and self._expectation is None and Unnamed.kind in self._kinds:
            yield f"{count} elements prove no pattern: with --expect their phases are judged"
        if mistakes is not None and (text := mistakes.hint()):
            yield f"the phases are as of {text}"
        elif self._only_phases and self._only_phases == sum(self._statuses[s] for s in WRONG):
            yield (
                "every focus is where it was expected; single phases are off by more than half a "
                "step (S1), as of codes that are cut off or of air that differs a little: "
                "--tolerance-mm and --tolerance-c allow for that"
            )

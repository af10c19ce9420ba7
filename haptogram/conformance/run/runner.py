"""Runs cases one after the other; every wait ends, and an interrupted run keeps its results."""

from __future__ import annotations

import dataclasses
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self, TypeAlias

from haptogram.errors import HaptogramError, LinkError, LinkLostError
from haptogram.records.frame import Evidence
from haptogram_protocol import messages as m
from haptogram_protocol.state import MuteReason

from ..case import Case, Depth
from ..clauses import Clause, Level, load_clauses
from ..client.board_client import BoardClient
from ..client.wire import DELAYED_LEAD_FACTOR, HELD_UP_US
from ..judge.recovery import recover_board
from ..outcome import CaseEndedError, HeldUpError
from ..verdict import NO_RESET, Behaviour, CaseResult, Recovery, SuiteResult
from .access import Access
from .connection import SuiteConnection

#: Called before every case with its number from 0, the number of cases, and its id.
CaseProgress: TypeAlias = Callable[[int, int, str], None]

_DOUBTFUL: Final = (Behaviour.FAILED, Behaviour.INCONCLUSIVE)
_TRIES: Final = 3
_LEAST_BAUD: Final = 115_200  # slowest line that every case allows for
_MEASURED_SHARE: Final = 0.95  # least measured rate of a line, relative to the true one
_EARLY_US: Final = 1_800_000  # how long a case may wait for the wrap of the clock


@dataclass(frozen=True, slots=True, kw_only=True)
class SuiteOptions:
    """Options of a run.

    Attributes
    ----------
    timeout_s : float
        How long an answer may take.
    seed : int
        Seed of nonces and contents.
    repeat : int
        Number of times that each case runs.
    strict : bool
        Whether a SHOULD that is not met is a failure.
    expected : dict of str to str
        Baseline: the failures that are expected, as verdict by case or clause.
    depth : Depth
        How thoroughly the board is judged: deeper cases are NOT-OBSERVED.
    explore_s : float
        How long random dialogues go on; 0: as many as the depth has time for.
    """

    timeout_s: float = 1.0
    seed: int = 0
    repeat: int = 1
    strict: bool = False
    expected: dict[str, str] = dataclasses.field(default_factory=dict)
    depth: Depth = Depth.DEFAULT
    explore_s: float = 0.0


@dataclass(frozen=True, slots=True)
class _Outcome:
    """Result of one attempt at a case, or of several that differ."""

    behaviour: Behaviour
    detail: str = ""
    recovery: Recovery | None = None
    transcript: tuple[str, ...] = ()
    traceback: str = ""
    held_up_us: int = 0
    attempts: tuple[Behaviour, ...] = ()


class SuiteRunner:
    """Runs cases against the board behind *access*; as a context, keeps the port open.

    Raises
    ------
    HaptogramError
        From :meth:`run` and on entry, if the port does not open.
    """

    def __init__(
        self, access: Access, options: SuiteOptions, progress: CaseProgress | None = None
    ) -> None:
        self._access, self._options = access, options
        self._progress: CaseProgress = progress or (lambda *_: None)
        self._lead_factor = 1
        self._connection = SuiteConnection(
            access,
            timeout_s=options.timeout_s,
            seed=options.seed,
            depth=options.depth,
            explore_s=options.explore_s,
        )
        self._clauses = load_clauses()

    def __enter__(self) -> Self:
        """Open the port and find out which board answers."""
        self._connection.open()
        return self

    def __exit__(self, *_: object) -> None:
        """Mute the board, and close the port."""
        self._connection.close()

    def session(self) -> BoardClient:
        """Return the client in a new session, with the board DISARMED and quiet.

        Raises
        ------
        LinkError
            If there is no board.
        """
        return self._connection.session()

    def run(self, cases: Sequence[Case]) -> SuiteResult:
        """Run *cases* in order and return their results; Ctrl-C keeps those so far."""
        results: dict[int, CaseResult] = {}
        cut_short, is_interrupted = "", False
        try:
            with self:
                for place in self._places(cases):
                    self._progress(len(results), len(cases), cases[place].id)
                    results[place] = self.result(cases[place])
        except KeyboardInterrupt:
            cut_short = f"interrupted after {len(results)} of {len(cases)} cases"
            is_interrupted = True
        for place, case in enumerate(cases):
            if place not in results:
                results[place] = _not_run_result(case, self._clauses[case.clause], cut_short)
        connection = self._connection
        why = cut_short or connection.lost
        ordered = tuple(results[place] for place in range(len(cases)))
        return SuiteResult(
            ordered,
            connection.device,
            self._settings(),
            why,
            is_interrupted,
            frozenset(connection.nonces),
        )

    def _places(self, cases: Sequence[Case]) -> Iterator[int]:
        """Yield case indices in run order; cases that judge the whole run are last.

        At a wall clock, cases that need the wrap of the clock run where a reset has brought it
        near; the others wait for it last, 10 s each.
        """
        waiting: deque[int] = deque()
        for place, case in enumerate(cases):
            if waiting and self._is_wrap_near(cases[waiting[0]]):
                yield waiting.popleft()
            if case.before_wrap_us and not self._access.virtual:
                waiting.append(place)
            elif not case.judges_all:
                yield place
        yield from waiting
        yield from (place for place, case in enumerate(cases) if case.judges_all)

    def _is_wrap_near(self, case: Case) -> bool:
        """Return True if the device clock's wrap is near enough to run a case that needs it.

        That is the time before the wrap that the case names, to 1.8 s more. On a slow line or host
        three times that time, which it takes longer to get there.
        """
        until_us = self._connection.until_wrap_us
        is_slow = self._lead_factor > 1 or self._connection.baudrate < 10 * _LEAST_BAUD
        before_us = case.before_wrap_us * (3 if is_slow else 1)
        return before_us <= until_us < before_us + _EARLY_US

    def _settings(self) -> dict[str, object]:
        """Return the options of the run for the report."""
        options = self._options
        return {
            "port": self._access.url,
            "virtual_time": self._access.virtual,
            "seed": options.seed,
            "repeat": options.repeat,
            "strict": options.strict,
            "timeout_s": options.timeout_s,
            "explore_s": options.explore_s,
            "depth": options.depth.name.lower(),
            "baudrate": self._access.baudrate,
            "measured_baudrate": self._connection.baudrate,
        }

    # --- one case ------------------------------------------------------------------------------

    def result(self, case: Case) -> CaseResult:
        """Run one case, as often as it is to be repeated, and return its result."""
        begin_us = self._connection.elapsed_us
        outcomes = [self._attempt(case) for _ in range(self._options.repeat if case.body else 1)]
        seen = [behaviour for o in outcomes for behaviour in o.attempts or (o.behaviour,)]
        judged = [outcome for outcome in outcomes if not outcome.traceback]
        broken = next((outcome for outcome in outcomes if outcome.traceback), None)
        failed = next((o for o in judged if o.behaviour is Behaviour.FAILED), None)
        unclear = next((o for o in judged if o.behaviour is Behaviour.INCONCLUSIVE), None)
        last = failed or broken or unclear or outcomes[-1]
        unclean = [o.recovery for o in outcomes if o.recovery is not None and not o.recovery.clean]
        behaviour, detail = last.behaviour, last.detail
        if len({outcome.behaviour for outcome in judged} - {Behaviour.INCONCLUSIVE}) > 1:
            behaviour = Behaviour.FLAKY
            detail = " then ".join(f"{o.behaviour.value}" for o in outcomes) + f": {detail}"
        expected = self._options.expected
        return CaseResult(
            case=case.id,
            clause=case.clause,
            requirement=self._clauses[case.clause].text,
            summary=case.summary,
            behaviour=behaviour,
            evidence=case.evidence,
            detail=detail,
            recovery=unclean[0] if unclean else last.recovery,
            transcript=last.transcript,
            expected=expected.get(case.id, expected.get(case.clause)),
            seen=tuple(seen) if len(seen) > 1 else (),
            traceback=broken.traceback if broken is not None else "",
            seconds=(self._connection.elapsed_us - begin_us) / 1e6,
        )

    def _attempt(self, case: Case) -> _Outcome:
        """Run a case, with up to two retries if it did not pass while the host was delayed.

        Delayed is over 5 ms. A retry, and each case after it, leaves more time between a frame and
        its t_apply.
        """
        tried: list[_Outcome] = []
        for number in range(_TRIES):
            self._connection.extend_lead(self._lead_factor * (1 + number))
            tried.append(self._try(case))
            if number and tried[-1].behaviour is Behaviour.NOT_OBSERVED:
                tried.pop()  # the horizon has no room for more time
                break
            if tried[-1].behaviour not in _DOUBTFUL or tried[-1].held_up_us <= HELD_UP_US:
                break
            self._lead_factor = DELAYED_LEAD_FACTOR
        return _combined_attempts(tried)

    def _try(self, case: Case) -> _Outcome:
        """Run a case once; NOT_OBSERVED without a run if it is beyond the selected depth."""
        if case.body is None:
            return _Outcome(Behaviour.NOT_OBSERVED, case.summary)
        depth = case.least_depth(virtual=self._access.virtual)
        if depth > self._options.depth:
            return _Outcome(Behaviour.NOT_OBSERVED, left_out_of_suite(depth))
        if case.needs_reset and not self._access.can_reset:
            return _Outcome(Behaviour.NOT_OBSERVED, NO_RESET)
        connection = self._connection
        found = bool(connection.device)  # a reset may bring back a board that answered before
        if connection.lost and case.needs_session and not (case.needs_reset and found):
            return _Outcome(Behaviour.INCONCLUSIVE, connection.lost)
        try:
            is_fresh = case.before_wrap_us and self._is_wrap_near(case)
            is_fresh = is_fresh or not case.needs_reset
            board = connection.board if is_fresh else connection.reset()
        except HaptogramError as error:
            why = connection.lost = f"the board did not come back after a reset: {error}"
            if not self._access.boots:  # the board may answer all the same
                connection.revive(may_reset=False)
            return _Outcome(Behaviour.INCONCLUSIVE, why)
        return self._experiment(case, board)

    def _experiment(self, case: Case, board: BoardClient) -> _Outcome:
        """Prepare the board, run the case and judge how it ended."""
        board.wire.begin_case()
        self._connection.rules.begin_case(case.id)
        if self._connection.lost and not case.needs_reset:
            return self._without_board(case, board)
        try:
            if case.needs_session and not case.needs_reset:
                board.prepare()
        except CaseEndedError as error:
            why = f"at its start: {error}"
            return self._afterwards(case, board, _Outcome(Behaviour.INCONCLUSIVE, why))
        except LinkLostError as error:
            return self._lost(_Outcome(Behaviour.INCONCLUSIVE, str(error)), board)
        except Exception as error:
            return self._afterwards(case, board, _broken_case_outcome(error))
        board.wire.begin_case()
        try:
            outcome = self._judge(case, board)
        except LinkError as error:
            return self._lost(_Outcome(Behaviour.FAILED, str(error)), board)
        board = self._connection.board  # the case may have restarted it
        held_up_us = board.wire.delay_us
        outcome = self._afterwards(case, board, outcome)
        return dataclasses.replace(outcome, held_up_us=held_up_us)

    def _without_board(self, case: Case, board: BoardClient) -> _Outcome:
        """Run a case although the board was lost; skip recovery."""
        try:
            outcome = self._judge(case, board)
        except LinkError as error:
            outcome = _Outcome(Behaviour.INCONCLUSIVE, str(error))
        return dataclasses.replace(outcome, transcript=board.wire.recording.transcript())

    def _judge(self, case: Case, board: BoardClient) -> _Outcome:
        """Run the body of a case and return its verdict."""
        assert case.body is not None  # _attempt has seen to it
        try:
            if case.needs and not case.needs_reset:
                board.need(case.needs)
            case.body(board)
        except CaseEndedError as ended:
            return self._verdict(case, board, ended)
        except LinkError:
            raise
        except Exception as error:  # a defect of the case is no verdict on the board
            return _broken_case_outcome(error)
        return _Outcome(Behaviour.OK)

    def _verdict(self, case: Case, board: BoardClient, ended: CaseEndedError) -> _Outcome:
        """Return the outcome of a case that ended with *ended*.

        FAILED is excused by a slow line, a late host or a timer that expired; for a SHOULD clause
        it is NON_STRICT, unless the options are strict.
        """
        clause = self._clauses[case.clause]
        if ended.behaviour is Behaviour.FAILED and board.wire.was_held_up_beyond_reckoning():
            ended = HeldUpError(f"for {board.wire.held_up_us / 1000:.0f} ms, and then: {ended}")
        if ended.behaviour is Behaviour.FAILED and self._is_slow:
            return _Outcome(Behaviour.INCONCLUSIVE, self._on_slow_line(str(ended)))
        if ended.behaviour is Behaviour.FAILED:
            ended = CaseEndedError(ended.behaviour, f"{ended}{self._side_effects(board, ended)}")
        if ended.behaviour is Behaviour.FAILED and (timer := self._expired_timer(board, ended)):
            ended = self._timer_outcome(board, timer, ended)
        lenient = clause.level is Level.SHOULD and not self._options.strict
        if ended.behaviour is Behaviour.FAILED and lenient:
            return _Outcome(Behaviour.NON_STRICT, str(ended))
        return _Outcome(ended.behaviour, str(ended))

    def _expired_timer(self, board: BoardClient, ended: CaseEndedError) -> str:
        """Return the name of a timer that expired unasked where timers cannot be set, else ''.

        A lease counts at a wall clock only: in virtual time every frame renews it.
        """
        reasons = {event.reason for _, event in board.link.events(m.StateChanged, 0)}
        timers = {MuteReason.HOLD_EXPIRED: "hold"}
        if not self._access.virtual:
            timers[MuteReason.HOST_SILENT] = "lease"
        told = str(ended).partition(" (meanwhile")[0]
        ends = (timers[one] for one in timers if one in reasons and one.name not in told)
        timer = next(ends, "")
        return "" if not timer or board.has(m.Feature.CONFIG) else timer

    def _timer_outcome(
        self, board: BoardClient, timer: str, ended: CaseEndedError
    ) -> CaseEndedError:
        """Return how a case ends that takes longer than *timer*, which cannot be extended.

        NOT_OBSERVED in virtual time; else inconclusive, as if the host was held up. The text of
        *ended* is kept.
        """
        config = board.config
        length_ms = config.hold_ms if timer == "hold" else config.host_timeout_ms
        board.wire.note_held_up(1000 * length_ms)
        text = f"longer than the {timer} of {length_ms} ms, which nothing extends: {ended}"
        if self._access.virtual:
            return CaseEndedError(Behaviour.NOT_OBSERVED, f"this line takes {text}")
        return HeldUpError(f"for {text}")

    def _side_effects(self, board: BoardClient, ended: CaseEndedError) -> str:
        """Return the side effects of a case that its *ended* text leaves out, as text; '' if none.

        They are changes of state that the host did not ask for, and standing rules that were
        broken.
        """
        events = [event for _, event in board.link.events(m.StateChanged, 0)]
        told = {event.reason.name: f"{event.state.name}, {event.reason.name}" for event in events}
        told.pop(MuteReason.MUTE.name, None)  # which the host asked for
        new = [text for name, text in told.items() if name not in str(ended)]
        also = [f"meanwhile the board told {'; '.join(new)}"] if new else []
        if found := self._connection.rules.found_in_case:
            also.append(f"in its frames: {found}")
        return f" ({'; '.join(also)})" if also else ""

    def _afterwards(self, case: Case, board: BoardClient, outcome: _Outcome) -> _Outcome:
        """Recover the board after a case, and add the transcript to its outcome."""
        if _is_shown(outcome.behaviour):
            transcript = board.wire.recording.transcript()
            outcome = dataclasses.replace(outcome, transcript=transcript)
        if outcome.behaviour is Behaviour.UNIMPLEMENTED:
            return outcome
        try:
            recovery = recover_board(board)
            if not recovery.clean and board.wire.held_up_us > HELD_UP_US:
                recovery = recover_board(board)
        except LinkLostError as error:
            detail = outcome.detail or str(error)
            return self._lost(dataclasses.replace(outcome, detail=detail), board)
        except Exception as error:
            # It has a verdict of its own, or an error.
            if _is_shown(outcome.behaviour):
                return outcome
            transcript = board.wire.recording.transcript()
            return dataclasses.replace(_broken_case_outcome(error), transcript=transcript)
        if recovery.frames is None and not self._connection.lost:
            self._connection.lost = "the board does not answer any more"
            self._connection.revive()
        elif recovery.clean and case.needs_reset:
            self._connection.lost = ""
        if self._is_slow and not recovery.clean:
            detail = outcome.detail or self._on_slow_line(str(recovery))
            return dataclasses.replace(outcome, behaviour=Behaviour.INCONCLUSIVE, detail=detail)
        return dataclasses.replace(outcome, recovery=recovery)

    @property
    def _is_slow(self) -> bool:
        """Return True if the line carries under 95 % of 115 200 Bd: too slow to measure times."""
        return self._connection.baudrate < _MEASURED_SHARE * _LEAST_BAUD

    def _on_slow_line(self, found: str) -> str:
        """Return a text that the line is too slow for a verdict, followed by what was *found*."""
        return (
            f"a line of {self._connection.baudrate} Bd is too slow for a verdict, "
            f"{_LEAST_BAUD} Bd are enough: {found}"
        )

    def _lost(self, outcome: _Outcome, board: BoardClient) -> _Outcome:
        """Return the outcome of a case that lost the port, and try to revive the board."""
        transcript, text = board.wire.recording.transcript(), outcome.detail
        self._connection.lost = f"the board is gone: {text}"
        self._connection.revive()
        return dataclasses.replace(outcome, recovery=Recovery(None, text), transcript=transcript)


def _combined_attempts(tried: Sequence[_Outcome]) -> _Outcome:
    """Return the last outcome; INCONCLUSIVE if it passed after an earlier attempt FAILED.

    Such a failure may be of the host, which was held up, or of a board that fails now and then.
    """
    last = tried[-1]
    failed = next((o for o in tried if o.behaviour is Behaviour.FAILED), None)
    if failed is None or last.behaviour is Behaviour.FAILED:
        return last
    away_ms = failed.held_up_us / 1000
    then = f"{last.behaviour.value}: {last.detail}" if last.detail else last.behaviour.value
    return dataclasses.replace(
        failed,
        behaviour=Behaviour.INCONCLUSIVE,
        detail=f"FAILED while the host was held up for {away_ms:.0f} ms ({failed.detail}), "
        f"then {then}",
        recovery=next((o.recovery for o in tried if o.recovery and not o.recovery.clean), None)
        or last.recovery,
        attempts=tuple(o.behaviour for o in tried),
    )


def left_out_of_suite(depth: Depth) -> str:
    """Return the reason of a case that only a deeper run holds."""
    how = "--full" if depth is Depth.FULL else "a run without --quick"
    return f"takes longer than this depth allows: {how} holds it"


def _broken_case_outcome(error: Exception) -> _Outcome:
    """Return the outcome of an error in the case itself, which is no verdict on the board."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{Path(place.filename).name}:{place.lineno}, in {place.name}"
    text = " ".join(f"{type(error).__name__}: {error}".split())
    trace = "".join(traceback.format_exception(error))
    detail = f"error in the case itself, no verdict on the board: {text} ({where})"
    return _Outcome(Behaviour.INCONCLUSIVE, detail, traceback=trace)


def _is_shown(behaviour: Behaviour) -> bool:
    """Return True if a result needs a transcript: FAILED, NON_STRICT or INCONCLUSIVE."""
    return behaviour in (Behaviour.FAILED, Behaviour.NON_STRICT, Behaviour.INCONCLUSIVE)


def _not_run_result(case: Case, clause: Clause, why: str) -> CaseResult:
    """Return the inconclusive result of a case that did not run; *why* is its text."""
    evidence = case.evidence if case.body else Evidence.WIRE
    return CaseResult(
        case.id, case.clause, clause.text, case.summary, Behaviour.INCONCLUSIVE, evidence, why
    )

"""Runs cases one after the other, and never hangs: every wait ends, and results so far are kept."""

from __future__ import annotations

import contextlib
import dataclasses
import random
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self, TypeAlias

from haptogram.driver.line.port import Transport
from haptogram.errors import HaptogramError, LinkError, LinkLostError
from haptogram_protocol.export.tables import description_hash
from haptogram_protocol.messages import HelloReply

from ..case import Case
from ..clauses import Clause, Level, load_clauses
from ..client.board_client import BoardClient
from ..client.introduction import (
    describe_device,
    explain_silence,
    greet,
    is_version_error,
    learn_wraps,
)
from ..client.wire import Limits, Wire
from ..judge.recovery import farewell, recover
from ..outcome import CaseEndedError
from ..verdict import Behaviour, Evidence, Recovery, Result, SuiteResult
from .access import Access

#: Called before every case with its number, how many there are, and its id.
Progress: TypeAlias = Callable[[int, int, str], None]

_HELD_UP_S: Final = 1.0  # a host that was away that long may have missed a timer of the board
_GREETINGS: Final = 3  # the first one may drown in what the board says while it starts


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """How a run is done.

    Attributes
    ----------
    timeout_s : float
        How long an answer may take.
    seed : int
        Of nonces and contents.
    repeat : int
        How often every case is run.
    strict : bool
        Whether a SHOULD that is not met is a failure.
    expected : dict of str to str
        Baseline: verdicts that are expected to be failures, by case or clause.
    """

    timeout_s: float = 1.0
    seed: int = 0
    repeat: int = 1
    strict: bool = False
    expected: dict[str, str] = dataclasses.field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class _Outcome:
    """What one run of a case came to."""

    behaviour: Behaviour
    detail: str = ""
    recovery: Recovery | None = None
    transcript: tuple[str, ...] = ()
    traceback: str = ""


class Runner:
    """Runs cases against the board behind *access*.

    Raises
    ------
    HaptogramError
        From :meth:`run`, if the port does not open at all.
    """

    def __init__(self, access: Access, options: Options, progress: Progress | None = None) -> None:
        self._access, self._options = access, options
        self._progress: Progress = progress or (lambda *_: None)
        self._limits = Limits.of(options.timeout_s, virtual=access.virtual)
        self._random = random.Random(options.seed)
        self._hash = description_hash()
        self._clauses = load_clauses()
        self._transport: Transport | None = None
        self._board: BoardClient | None = None
        self._dead = ""  # why no case that needs a session can be run
        self._device: dict[str, object] = {}

    def run(self, cases: Sequence[Case]) -> SuiteResult:
        """Run *cases* in order and return their results; Ctrl-C keeps those so far."""
        results: list[Result] = []
        cut_short = ""
        try:
            with self:
                for number, case in enumerate(cases):
                    self._progress(number, len(cases), case.id)
                    results.append(self.result(case))
        except KeyboardInterrupt:
            cut_short = f"interrupted after {len(results)} of {len(cases)} cases"
        rest = (_not_run(case, self._clauses[case.clause], cut_short) for case in cases)
        results += list(rest)[len(results) :]
        return SuiteResult(tuple(results), self._device, self._settings(), cut_short or self._dead)

    def _settings(self) -> dict[str, object]:
        options = self._options
        return {
            "port": self._access.url,
            "virtual_time": self._access.virtual,
            "seed": options.seed,
            "repeat": options.repeat,
            "strict": options.strict,
            "timeout_s": options.timeout_s,
        }

    # --- the board -----------------------------------------------------------------------------

    def __enter__(self) -> Self:
        """Open the port and find out what is there."""
        try:
            self._connect(self._access.open(), booted=self._access.boots)
        except BaseException:
            self._access.close()
            raise
        if self._greet() is None and self._access.can_reset and not self._access.boots:
            self._revive(self._reset)  # it may have hung before we came
        if not self._dead and self._board is not None:
            with contextlib.suppress(CaseEndedError, LinkLostError):
                learn_wraps(self._board)
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the board silent, and close the port."""
        if self._board is not None and self._transport is not None and not self._dead:
            try:
                farewell(self._board)
            except HaptogramError:
                pass
            except Exception as error:  # it must not cost the results
                self._dead = f"the board was not muted at the end: {type(error).__name__}: {error}"
        self._drop()
        self._access.close()

    def session(self) -> BoardClient:
        """Return a board with a new session and a board that is DISARMED and quiet.

        Raises
        ------
        LinkError
            If there is no board.
        """
        if self._dead or self._board is None:
            raise LinkError(self._dead or "the port is not open")
        self._board.wire.begin_case()
        self._board.prepare()
        return self._board

    def _connect(self, transport: Transport, *, booted: bool) -> BoardClient:
        self._transport = transport
        wire = Wire(transport, self._limits, baudrate=self._access.baudrate)
        self._board = BoardClient(wire, self._random, self._hash, booted=booted)
        return self._board

    def _greet(self) -> BoardClient | None:
        """Find out whether a board of this version is there; note why not."""
        board = self._board
        assert board is not None  # _connect came first
        self._dead = ""
        try:
            for _ in range(_GREETINGS):
                reply = greet(board)
                if isinstance(reply, HelloReply):
                    self._device = describe_device(reply)
                    return board
                if is_version_error(reply):
                    self._dead = f"the board speaks another major version: {reply}"
                    return None
            self._dead = explain_silence(board)
        except (LinkError, CaseEndedError) as error:
            self._dead = f"the board is gone: {error}" if self._device else str(error)
        return None

    def _reset(self) -> BoardClient:
        before = self._board
        self._drop()
        board = self._connect(self._access.reset(), booted=True)
        identity = getattr(before, "identity", None)
        board.last_boot_id = identity.boot_id if identity else None
        board.last_config = getattr(before, "config", None)
        return board

    def _reopen(self) -> BoardClient:
        self._drop()
        return self._connect(self._access.open(), booted=False)

    def _drop(self) -> None:
        if self._transport is not None:
            self._transport.close()
        self._transport = None

    # --- one case ------------------------------------------------------------------------------

    def result(self, case: Case) -> Result:
        """Run one case, as often as it is to be repeated, and return its result."""
        outcomes = [self._attempt(case) for _ in range(self._options.repeat if case.body else 1)]
        judged = [outcome for outcome in outcomes if not outcome.traceback]
        broken = next((outcome for outcome in outcomes if outcome.traceback), None)
        failed = next((o for o in judged if o.behaviour is Behaviour.FAILED), None)
        last = failed or broken or outcomes[-1]
        unclean = [o.recovery for o in outcomes if o.recovery is not None and not o.recovery.clean]
        behaviour, detail = last.behaviour, last.detail
        if len({outcome.behaviour for outcome in judged}) > 1:
            behaviour = Behaviour.FLAKY
            detail = " then ".join(f"{o.behaviour.value}" for o in outcomes) + f": {detail}"
        expected = self._options.expected
        return Result(
            case=case.id,
            clause=case.clause,
            requirement=self._clauses[case.clause].text,
            what=case.what,
            behaviour=behaviour,
            evidence=case.evidence,
            detail=detail,
            recovery=unclean[0] if unclean else last.recovery,
            transcript=last.transcript,
            expected=expected.get(case.id, expected.get(case.clause)),
            seen=tuple(outcome.behaviour for outcome in outcomes) if len(outcomes) > 1 else (),
            traceback=broken.traceback if broken is not None else "",
        )

    def _attempt(self, case: Case) -> _Outcome:
        if case.body is None:
            return _Outcome(Behaviour.NOT_OBSERVED, case.what)
        if case.needs_reset and not self._access.can_reset:
            return _Outcome(
                Behaviour.NOT_OBSERVED, "no way to restart the board (--spawn, --reset-cmd, --dtr)"
            )
        found = bool(self._device)  # a board that was there may be so again after a reset
        if self._dead and case.needs_session and not (case.needs_reset and found):
            return _Outcome(Behaviour.INCONCLUSIVE, self._dead)
        try:
            board = self._reset() if case.needs_reset else self._board
        except HaptogramError as error:
            why = self._dead = f"the board did not come back after a reset: {error}"
            if not self._access.boots:  # it may be there all the same
                self._revive(self._reopen)
            return _Outcome(Behaviour.INCONCLUSIVE, why)
        assert board is not None  # _begin has connected
        return self._experiment(case, board)

    def _experiment(self, case: Case, board: BoardClient) -> _Outcome:
        board.wire.begin_case()
        if self._dead and not case.needs_reset:
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
            return self._afterwards(case, board, _broke_off(error))
        board.wire.begin_case()
        try:
            outcome = self._judge(case, board)
        except LinkError as error:
            return self._lost(_Outcome(Behaviour.FAILED, str(error)), board)
        return self._afterwards(case, board, outcome)

    def _without_board(self, case: Case, board: BoardClient) -> _Outcome:
        """Run a case that may tell why nothing answers; what was never there cannot recover."""
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
        except Exception as error:  # what no case foresaw is no verdict on the board
            return _broke_off(error)
        return _Outcome(Behaviour.OK)

    def _verdict(self, case: Case, board: BoardClient, ended: CaseEndedError) -> _Outcome:
        clause = self._clauses[case.clause]
        away_s = board.wire.held_up_us / 1e6
        if ended.behaviour is Behaviour.FAILED and away_s > _HELD_UP_S:
            text = f"the host was held up for {away_s:.1f} s, and then: {ended}"
            return _Outcome(Behaviour.INCONCLUSIVE, text)
        lenient = clause.level is Level.SHOULD and not self._options.strict
        if ended.behaviour is Behaviour.FAILED and lenient:
            return _Outcome(Behaviour.NON_STRICT, str(ended))
        return _Outcome(ended.behaviour, str(ended))

    def _afterwards(self, case: Case, board: BoardClient, outcome: _Outcome) -> _Outcome:
        if _is_shown(outcome.behaviour):
            transcript = board.wire.recording.transcript()
            outcome = dataclasses.replace(outcome, transcript=transcript)
        if outcome.behaviour is Behaviour.UNIMPLEMENTED:
            return outcome
        try:
            recovery = recover(board)
        except LinkLostError as error:
            detail = outcome.detail or str(error)
            return self._lost(dataclasses.replace(outcome, detail=detail), board)
        except Exception as error:
            if _is_shown(outcome.behaviour):  # it has a verdict of its own, or an error
                return outcome
            transcript = board.wire.recording.transcript()
            return dataclasses.replace(_broke_off(error), transcript=transcript)
        if recovery.frames is None and not self._dead:
            self._dead = "the board does not answer any more"
            self._revive(self._reset if self._access.can_reset else self._reopen)
        elif recovery.clean and case.needs_reset:
            self._dead = ""
        return dataclasses.replace(outcome, recovery=recovery)

    def _lost(self, outcome: _Outcome, board: BoardClient) -> _Outcome:
        """Keep the outcome of a case after which the port was gone."""
        transcript, text = board.wire.recording.transcript(), outcome.detail
        self._dead = f"the board is gone: {text}"
        self._revive(self._reset if self._access.can_reset else self._reopen)
        return dataclasses.replace(outcome, recovery=Recovery(None, text), transcript=transcript)

    def _revive(self, connect: Callable[[], BoardClient]) -> None:
        """Try once to bring a board back that does not answer; if it does it is not dead."""
        why = self._dead
        try:
            connect()
        except HaptogramError as error:
            self._dead = f"{why} ({error})"
            return
        if self._greet() is None:
            self._dead = why


def _broke_off(error: Exception) -> _Outcome:
    """Return what an error of the case itself comes to: nothing is said of the board."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{Path(place.filename).name}:{place.lineno}, in {place.name}"
    text = " ".join(f"{type(error).__name__}: {error}".split())
    told = "".join(traceback.format_exception(error))
    detail = f"error in the case itself, no verdict on the board: {text} ({where})"
    return _Outcome(Behaviour.INCONCLUSIVE, detail, traceback=told)


def _is_shown(behaviour: Behaviour) -> bool:
    return behaviour in (Behaviour.FAILED, Behaviour.NON_STRICT, Behaviour.INCONCLUSIVE)


def _not_run(case: Case, clause: Clause, why: str) -> Result:
    evidence = case.evidence if case.body else Evidence.WIRE
    return Result(
        case.id, case.clause, clause.text, case.what, Behaviour.INCONCLUSIVE, evidence, why
    )

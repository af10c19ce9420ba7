"""From a capture of the pins, and of the lines of the UART, to results of clauses."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Sequence
from typing import Final

from haptogram.errors import ConfigurationError
from haptogram.records.pins import PinRecord
from haptogram_protocol import messages as m

from ..clauses import load_clauses
from ..verdict import Behaviour, CaseResult, SuiteResult
from .cases import PIN_CASES
from .dialogue import PinDialogue
from .findings import PinClauseFindings
from .latch_drives import LatchDriveClauseJudge
from .latch_moments import LatchMomentClauseJudge
from .latch_pulses import SETTLED, LatchClausePulses
from .ramps import judge_ramp_clauses
from .reported_drives import DRIVE_CLAUSES, advertised_drive_paths
from .reported_latches import latches_of_pin_dialogue
from .silences import judge_silence_clauses

_LATE: Final = 20.0  # periods after a latch until the old drive is gone, where pins latch late
_LATCH_CLAUSES: Final = ("HG-5.8/1", "HG-5.8/2", "HG-5.8/5", "HG-8.3/1", "HG-7.9/1", "HG-7.9/2")
_NAMED: Final = 3  # findings that are shown
_LINE_TELLS: Final = {
    "to_board": "what the board was told is not known",
    "to_host": "what the board says, and its clock, are not known",
}
#: Clauses that can be judged without a line, and the occasions that are left; empty: all.
_BY_ONE_LINE: Final = {
    "to_host": {"HG-6.3/1": "", "HG-6.6/1": "MUTE", "HG-6.6/2": "the time after MUTE"},
    "to_board": {
        "HG-5.8/2": "",
        "HG-6.6/1": "a fault",
        "HG-6.6/2": "the time up to the answer before that to ARM",
        "HG-6.10/1": "",
        "HG-6.12/2": "",
        "HG-8.3/1": "",
        "HG-12.1/1": "",
        "HG-12.2/1": "",
    },
}
_NEVER: Final = "the capture shows no occasion for it: no captured pin sounded then, or none came"


def judge_clauses_by_pins(
    records: Sequence[PinRecord], expected: dict[str, str] | None = None
) -> tuple[CaseResult, ...]:
    """Judge clauses by captures of the drive pins and of the lines of the UART.

    One line alone shows a part: the commands, or the words of the board.

    Parameters
    ----------
    records : sequence of PinRecord
        Captures of one run of the suite, or of anything else that a host did with the board.
    expected : dict of str to str, optional
        Baseline: the failures that are expected, by case or clause.

    Returns
    -------
    tuple of CaseResult
        One for each of :data:`~haptogram.conformance.pins.cases.PIN_CASES`; evidence external.

    Raises
    ------
    ConfigurationError
        A capture without any line of the UART, or an element that the board lacks.
    """
    findings = PinClauseFindings()
    cut = ""
    for record in records:
        dialogue = _dialogue_before_lost_samples(record)
        record = dialogue.record
        _check_elements(dialogue)
        _note_missing_line(dialogue, findings)
        judge_silence_clauses(dialogue, findings)
        judge_latch_clauses(dialogue, findings)
        judge_ramp_clauses(dialogue, findings)
        cut = cut or (record.cut and f"{record.name} was cut off: {record.cut}")
    expected = expected or {}
    return tuple(_clause_result_by_pins(clause, findings, cut, expected) for clause in PIN_CASES)


def judge_latch_clauses(dialogue: PinDialogue, findings: PinClauseFindings) -> None:
    """Judge every latch that the board reported."""
    for _, identity in dialogue.said(m.HelloReply):
        findings.offered.update(advertised_drive_paths(identity))
    if dialogue.missing == "to_host":
        return
    if not dialogue.clocks:
        for clause in (*_LATCH_CLAUSES, *DRIVE_CLAUSES.values()):
            findings.missing.setdefault(
                clause, "no PING was answered: the device clock is not known"
            )
        return
    latches = list(latches_of_pin_dialogue(dialogue))
    pulses = LatchClausePulses(dialogue.record)
    moments, drives = LatchMomentClauseJudge(pulses), LatchDriveClauseJudge(pulses)
    for number, latch in enumerate(latches):
        moments.judge(latch, latches[number - 1].at if number else -math.inf, findings)
    # Pins that latch at another time than the board tells show an old drive for a while.
    is_late = any(findings.broken.get(clause) for clause in ("HG-5.8/1", "HG-5.8/2", "HG-8.3/1"))
    drives.judge(latches, _LATE if is_late else SETTLED, findings)


def _dialogue_before_lost_samples(record: PinRecord) -> PinDialogue:
    """Return the dialogue of a capture, up to where samples are missing; all if none are."""
    dialogue = PinDialogue(record)
    end = dialogue.end_before_lost_samples
    if end is None:
        return dialogue
    why = (
        f"samples are missing behind {end * record.period_s * 1e3:.0f} ms, where the device clock "
        "leaps ahead: capture at a lower rate, fewer channels, or with another cable"
    )
    return PinDialogue(record.between(0.0, end, why))


def _note_missing_line(dialogue: PinDialogue, findings: PinClauseFindings) -> None:
    """Note the clauses that a capture of one line cannot show; nothing if it has both lines."""
    if not dialogue.missing:
        return
    shown = _BY_ONE_LINE[dialogue.missing]
    for clause in PIN_CASES:
        if clause not in shown:
            findings.missing[clause] = (
                f"{dialogue.record.name} has no line {dialogue.missing} (name it in the map): "
                f"{_LINE_TELLS[dialogue.missing]}"
            )
        elif shown[clause]:
            findings.partial[clause] = f"; without {dialogue.missing} {shown[clause]} alone"


def _check_elements(dialogue: PinDialogue) -> None:
    """Raise ConfigurationError if the channel map has an element beyond those of the board."""
    count = next((reply.transducers for _, reply in dialogue.said(m.HelloReply)), None)
    for element, pin in dialogue.record.pins.items():
        if count is not None and element >= count:
            raise ConfigurationError(
                f"channel {pin.channel} is element {element}; the board has the elements 0 to "
                f"{count - 1}"
            )


def _clause_result_by_pins(
    clause: str, findings: PinClauseFindings, cut: str, expected: dict[str, str]
) -> CaseResult:
    """Return the result of a clause: FAILED if broken, else unclear, kept (OK), or NOT_OBSERVED.

    Unclear is INCONCLUSIVE. *cut* says why the capture ends early ('' if not): then all but FAILED
    is INCONCLUSIVE. *expected*: texts of known failures, by case or clause.
    """
    case = PIN_CASES[clause]
    broken, held = findings.broken.get(clause, []), findings.held[clause]
    unclear = findings.unclear.get(clause, [])
    every = held + len(broken) + len(unclear)
    if broken:
        behaviour, detail = Behaviour.FAILED, _findings_text(broken, every)
    elif unclear:
        behaviour, detail = Behaviour.INCONCLUSIVE, _findings_text(unclear, every)
    elif held:
        left = findings.paths_left_out(clause)
        part = findings.partial.get(clause, "")
        behaviour, detail = Behaviour.OK, f"seen {held} times{part}{left}"
    else:
        behaviour, detail = Behaviour.NOT_OBSERVED, findings.missing.get(clause, _NEVER)
    if cut and behaviour is not Behaviour.FAILED:
        behaviour, detail = Behaviour.INCONCLUSIVE, f"{cut}; {detail}"
    return CaseResult(
        case=case.id,
        clause=clause,
        requirement=load_clauses()[clause].text,
        summary=case.summary,
        behaviour=behaviour,
        evidence=case.evidence,
        detail=detail,
        expected=expected.get(case.id, expected.get(clause)),
    )


def _findings_text(texts: Sequence[str], every: int) -> str:
    """Return findings as one text: how many of *every* judgements they are, and the first 3.

    The number of the others follows.
    """
    more = f"; and {len(texts) - _NAMED} times more" if len(texts) > _NAMED else ""
    return f"{len(texts)} of {every} times: " + "; ".join(texts[:_NAMED]) + more


def suite_with_clauses_by_pins(
    suite: SuiteResult, pins: Sequence[CaseResult], shares: Sequence[str] = ()
) -> SuiteResult:
    """Return a run with the results of its pins, and the *shares* of it that captures show.

    A clause that nothing on the line shows has a result that says so; where the pins show it,
    theirs takes its place.
    """
    shown = {r.clause for r in pins if r.behaviour is not Behaviour.NOT_OBSERVED}
    kept = [
        result
        for result in suite.results
        if not (
            result.clause in shown
            and result.case == result.clause
            and result.behaviour is Behaviour.NOT_OBSERVED
        )
    ]
    order = {number: place for place, number in enumerate(load_clauses())}
    results = sorted([*kept, *pins], key=lambda result: order[result.clause])
    captured = {"captured": "; ".join(shares)} if shares else {}
    return dataclasses.replace(suite, results=tuple(results), settings=suite.settings | captured)


def captured_share_of_run(record: PinRecord, nonces: Collection[int], run: str) -> str:
    """Return the share of a run, whose sessions have these *nonces*, that a capture shows.

    A nonce has 16 bits, and two runs of hundreds of sessions share some by chance. So half of the
    sessions must be those of the other: of the capture, or of the run, whichever has fewer.

    Raises
    ------
    ConfigurationError
        It shows another run.
    """
    dialogue = PinDialogue(record)
    frames = dialogue.to_board or dialogue.to_host
    hellos = [
        frame.message for frame in frames if isinstance(frame.message, m.Hello | m.HelloReply)
    ]
    shown = {hello.nonce for hello in hellos}
    shown = shown or {frame.header.session for frame in frames} - {0}
    shared = len(shown & set(nonces))
    if not shared or 2 * shared < min(len(shown), len(nonces)):
        raise ConfigurationError(
            f"{record.name} shows another run than {run}: {shared} of its {len(shown)} sessions "
            f"are of that run, which has {len(nonces)}; take the capture of the same run"
        )
    share = f"{shared} of {len(nonces)} sessions of the run"
    return f"{record.name} shows {share}, in {record.duration_s:.3g} s"

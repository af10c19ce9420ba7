"""One run of the conformance suite as text for a terminal."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from haptogram.conformance.causes import CommonFinding, common_finding, failures_by_cause
from haptogram.conformance.verdict import FAIL, MEANINGS, Behaviour, CaseResult, SuiteResult

from .wording import case_finding, common_finding_line, evidence_text, suite_counts, suite_verdict

_LEFT_OUT: Final = "takes longer than this depth"  # begin of the reason of such cases
_CAUSES: Final = 3  # failures with their bytes; the others may follow from these
_IN_FULL = (Behaviour.FAILED, Behaviour.FLAKY, Behaviour.INCONCLUSIVE, Behaviour.NON_STRICT)
_FAILURES: Final = 12  # most failures that one line names
_NAMED: Final = 3  # cases that are named where they have a reason in common
_NEXT_FRAME: Final = "\n" + 17 * " "  # line break before the next frame of a dialogue
_LONG_HEX: Final = re.compile(r"\b([0-9a-f]{64})[0-9a-f]{9,}")
_CUT_HEX: Final = r"\1 ..."


def suite_text(suite: SuiteResult, *, verbose: bool = False) -> str:
    """Return a summary of the run, and in full every case that needs a look.

    Parameters
    ----------
    verbose : bool
        Print every case in full.
    """
    return "\n".join(_conformance_suite_lines(suite, verbose=verbose))


def _conformance_suite_lines(suite: SuiteResult, *, verbose: bool) -> Iterator[str]:
    """Yield findings of cases, failures by cause, summary and verdict; if *verbose*, all cases."""
    common = {case for cases in _common_reasons(suite).values() for case in cases}
    failures = failures_by_cause(suite.results)
    alike = common_finding(failures)
    for result in suite.results:
        if result.is_failure or (not verbose and result.case in common):
            continue  # below, by cause; or named once, in the summary
        if verbose or (result.behaviour in _IN_FULL and not failures):
            yield from _conformance_case_lines(result)
        elif result.behaviour in _IN_FULL:  # a failure may be the reason
            yield f"{result.case}  {case_finding(result)}"
        elif result.is_unexpected_pass:
            yield f"{result.case}  {result.behaviour}: {result.expected} was expected"
    for number, result in enumerate(failures):
        if verbose or number < _CAUSES or not result.is_new_failure:
            yield from _conformance_case_lines(result)
        elif MEANINGS[result.behaviour].exit_status == FAIL and (
            alike is None or result.case not in alike.cases
        ):
            yield f"{result.case}  {case_finding(result)}"
    yield from () if verbose else _conformance_unclean_lines(failures[_CAUSES:])
    yield from _conformance_summary_lines(suite)
    yield from _conformance_failure_lines(failures, alike)
    unseen = suite.unseen_without_reset
    more = f"; --reset-cmd would add {', '.join(unseen)}" if unseen else ""
    yield f"verdict      {suite_verdict(suite)} (exit status {suite.exit_status}){more}"


def _conformance_failure_lines(
    failures: Sequence[CaseResult], alike: CommonFinding | None
) -> Iterator[str]:
    """Yield the first 12 failures in a line, the likeliest cause first, and what they share.

    *alike* is that finding, None without one; nothing is said of a single failure.
    """
    if len(failures) > 1:
        first = ", ".join(result.case for result in failures[:_FAILURES])
        more = len(failures) - _FAILURES
        rest = f", and {more} more, in --json and --html" if more > 0 else ""
        yield f"failures     the likeliest cause first: {first}{rest}"
    if alike is not None:
        yield f"in common    {common_finding_line(alike, len(failures))}"


def _conformance_unclean_lines(failures: Sequence[CaseResult]) -> Iterator[str]:
    """Yield a line for each failed recovery, with cases before it that did not fail themselves.

    A case failed if its result alone gives exit status 1.
    """
    found: dict[str, list[str]] = {}
    for result in failures:
        if MEANINGS[result.behaviour].exit_status != FAIL:
            found.setdefault(str(result.recovery), []).append(result.case)
    for text, cases in found.items():
        yield f"{_named_cases(cases)}  not failed; recovery {text}"


def _conformance_case_lines(result: CaseResult) -> Iterator[str]:
    """Yield the lines of one case: requirement, summary, findings and transcript."""
    known = f" (expected: {result.expected})" if result.expected and result.is_failure else ""
    yield f"{result.case}  {result.behaviour} [{evidence_text(result.evidence)}]{known}"
    yield f"    requirement  {result.requirement}"
    yield f"    case         {result.summary}"
    if result.detail:
        first, *others = result.detail.split(" || ")  # differences in dialogues
        yield f"    found        {_LONG_HEX.sub(_CUT_HEX, first.replace(' | ', _NEXT_FRAME))}"
        yield from (f"    also         {other.partition('; dialogue ')[0]}" for other in others)
    if result.recovery is not None and not result.recovery.clean:
        yield f"    recovery     {result.recovery}"
    yield from (f"    {line}" for line in folded_transcript(result))


def _named_cases(cases: Sequence[str]) -> str:
    """Return up to 3 names of cases, joined by commas; of more cases only their number."""
    return ", ".join(cases) if len(cases) <= _NAMED else f"{len(cases)} cases"


def _cases_by_reason(suite: SuiteResult, behaviour: Behaviour) -> dict[str, list[str]]:
    """Return the cases that ended in *behaviour*, by their reason; {} if none did."""
    reasons: dict[str, list[str]] = {}
    for result in suite.results:
        if result.behaviour is behaviour:
            reasons.setdefault(result.detail, []).append(result.case)
    return reasons


def _common_reasons(suite: SuiteResult) -> dict[str, list[str]]:
    """Return the reasons that made more than 3 cases inconclusive, with the cases."""
    reasons = _cases_by_reason(suite, Behaviour.INCONCLUSIVE)
    return {reason: cases for reason, cases in reasons.items() if len(cases) > _NAMED}


def _conformance_summary_lines(suite: SuiteResult) -> Iterator[str]:
    """Yield the lines of the summary: board, port, cases, and reasons of those not judged."""
    device = suite.device
    if device:
        yield (
            f"board        {device['firmware']}, protocol {device['protocol']}, "
            f"{device['transducers']} transducers"
        )
    time = "virtual time" if suite.settings.get("virtual_time") else "wall time"
    yield f"port         {suite.settings.get('port')} ({time}, seed {suite.settings.get('seed')})"
    if depth := suite.settings.get("depth"):
        left = sum(r.detail.startswith(_LEFT_OUT) for r in suite.results)
        cases_are = "1 case is" if left == 1 else f"{left} cases are"
        yield f"depth        {depth}" + (f"; {cases_are} left out" if left else "")
    measured, stated = (suite.settings.get(n) for n in ("measured_baudrate", "baudrate"))
    if measured != stated:
        yield f"line         {measured} Bd as measured, {stated} Bd as stated"
    if captured := suite.settings.get("captured"):
        yield f"captured     {captured}"
    yield f"cases        {suite_counts(suite)}"
    # With the reasons: a number alone would look like a gap.
    for reason, cases in _cases_by_reason(suite, Behaviour.NOT_OBSERVED).items():
        yield f"not observed {_named_cases(cases)}: {reason}"
    for reason, cases in _common_reasons(suite).items():
        yield f"inconclusive {_named_cases(cases)}: {reason}"
    unclean = sum(not result.recovers for result in suite.results)
    if unclean:
        yield f"recovery     not clean after {unclean} cases"
    known = sum(result.is_failure and not result.is_new_failure for result in suite.results)
    if known:
        yield f"baseline     {known} failures were expected"
    if broken := [result.case for result in suite.results if result.traceback]:
        yield (
            f"case errors  {_named_cases(broken)}: not the board; tracebacks are in --json, "
            "--junit and --html"
        )
    if suite.cut_short:
        yield f"cut short    {suite.cut_short}"


_HEAD: Final = re.compile(r"^(\s*[+-][\d.]+ s) (host|board) ?")
_WORDS: Final = re.compile(r"0x[0-9a-f]+|\d{4,}|[A-Z]{3,}(?:_[A-Z]+)*|[a-z]+(?:_[a-z]+)+")
_SEQ: Final = re.compile(r"\w+ seq (\d+) ")
#: Parts of a finding that are no deed of the board: what is due, what is missing, what came before.
_NOT_DONE: Final = re.compile(
    r"; (?:sent (?:before|between): .*?(?= \((?:meanwhile|in its)|$)|dialogue \d+.*)"
    r"|should [^;]*; |(?:[A-Z_]+: )?no [A-Z_]+ within [^;]*|\bdue (?:is|are) [^;,:]*",
    re.DOTALL,
)
_READINGS: Final = ("PING", "GET_STATUS", "GET_CONFIG", "READ_DRIVE", "READ_TRACE")
_ZEROS: Final = re.compile(r"\b\w+=0(?:, |(?=\)))")  # counters that say nothing
_MOST: Final = 9  # frames of a folded transcript
_WIDTH: Final = 110  # columns of a frame that decides nothing


class _Frame(NamedTuple):
    """A frame of a transcript: its lines, its sender and what it says."""

    lines: range
    head: str
    sender: str
    text: str

    @property
    def name(self) -> str:
        """Type of the frame."""
        return self.text.partition(" ")[0]


def marked_transcript(result: CaseResult) -> list[str]:
    """Return the whole transcript; lines of the frames that decide begin with ``>``."""
    deciding = {line for frame in _cited_frames(result) for line in frame.lines}
    lines = enumerate(result.transcript)
    return [f"{'>' if number in deciding else ' '} {line}" for number, line in lines]


def folded_transcript(result: CaseResult) -> Iterator[str]:
    """Yield the frames that decide, marked and with their bytes, and those near them in short."""
    frames, deciding = _frames_of(result.transcript), _cited_frames(result)
    if not frames:
        yield from result.transcript[-_MOST:]
        return
    last = max(frames.index(frame) for frame in deciding)
    near = sorted(frames, key=lambda frame: abs(last - frames.index(frame)))[:_MOST]
    shown = [place for place, frame in enumerate(frames) if frame in near or frame in deciding]
    before = shown[0] - 1
    for place in shown:
        if place != before + 1:
            yield f"  ... {place - before - 1} frames"
        before, frame = place, frames[place]
        text = f"{frame.head} {frame.sender:<5} {frame.text}"
        if frame not in deciding:
            yield f"  {text if len(text) <= _WIDTH else text[: _WIDTH - 4] + ' ...'}"
            continue
        yield f"> {_ZEROS.sub('', text)}"
        rows = [result.transcript[line] for line in frame.lines][:-1]
        yield from (f"  {row}" for row in rows[:1])
    if len(shown) < len(frames):
        yield f"  all {len(frames)} frames, and their bytes, are in --json and --html"


def _cited_frames(result: CaseResult) -> list[_Frame]:
    """Return the frames behind a finding: the board's frame, its request, and the likely cause.

    Frame of the board and cause are those that share most words with the finding.  They are in the
    order of the transcript; what that lacks is left out.
    """
    frames = _frames_of(result.transcript)
    done = _NOT_DONE.sub("", result.detail)
    words_found = {"STATUS_REPLY"} if "counted " in done else set(_WORDS.findall(done))

    def place(frame: _Frame) -> tuple[int, int]:
        words = set(_WORDS.findall(frame.text))
        alike = sum(1 if word.islower() else 3 for word in words & words_found)
        is_named = bool(words_found & {frame.name, frame.name.removesuffix("_REPLY")})
        return alike + 4 * is_named, frame.lines.start

    board = [frame for frame in frames if frame.sender == "board"]
    host = [frame for frame in frames if frame.sender == "host"]
    causes = [frame for frame in host if frame.name not in _READINGS] or host
    found = [max(some, key=place) for some in (board, causes) if some]
    found += _request_of(board and found[0], host)
    return sorted(set(found), key=lambda frame: frame.lines.start)


def _request_of(answer: _Frame | list[_Frame], host: Sequence[_Frame]) -> list[_Frame]:
    """Return the last host frame before *answer* with its sequence number, in a list.

    [] if there is none, or if *answer* is the empty list that stands for no frame.
    """
    seq = _SEQ.match(answer.text) if isinstance(answer, _Frame) else None
    if seq is None or not isinstance(answer, _Frame):
        return []
    before = [
        frame
        for frame in host
        if frame.lines.start < answer.lines.start and f" seq {seq[1]} " in frame.text
    ]
    return before[-1:]


def _frames_of(transcript: Sequence[str]) -> list[_Frame]:
    """Return the frames in the lines of a transcript, in their order."""
    found: list[_Frame] = []
    start, head, sender = 0, "", ""
    for number, line in enumerate(transcript):
        if match := _HEAD.match(line):
            start, head, sender = number, match[1].strip(), match[2]
        if (text := line.strip()).startswith("= "):
            span = range(start, number + 1)
            found.append(_Frame(span, head, sender, text.removeprefix("= ")))
            start = number + 1
    return found

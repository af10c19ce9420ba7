"""A run of the conformance suite as JSON, without a date or a duration, and read back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from haptogram.conformance.causes import common_finding, failures_by_cause
from haptogram.conformance.verdict import Behaviour, CaseResult, Recovery, SuiteResult
from haptogram.errors import ConfigurationError
from haptogram.machine import files
from haptogram.records.frame import Evidence
from haptogram.settings import text_file

FORMAT: Final = "haptogram-conformance/1"


def suite_dict(suite: SuiteResult) -> dict[str, Any]:
    """Return a run as JSON types, with everything that is known of it."""
    failures = failures_by_cause(suite.results)
    alike = common_finding(failures)
    return {
        "format": FORMAT,
        "device": suite.device,
        "settings": suite.settings,
        "exit_status": suite.exit_status,
        "cut_short": suite.cut_short,
        "failures": [result.case for result in failures],
        "in_common": None if alike is None else alike._asdict(),
        "counts": {behaviour.value: suite.count(behaviour) for behaviour in Behaviour},
        "results": [_conformance_case_dict(result) for result in suite.results],
    }


def _conformance_case_dict(result: CaseResult) -> dict[str, Any]:
    recovery = result.recovery
    return {
        "case": result.case,
        "clause": result.clause,
        "requirement": result.requirement,
        "what": result.summary,
        "behaviour": result.behaviour.value,
        "evidence": result.evidence.upper(),
        "detail": result.detail,
        "recovery": None
        if recovery is None
        else {"clean": recovery.clean, "frames": recovery.frames, "text": recovery.text},
        "expected": result.expected,
        "seen": [behaviour.value for behaviour in result.seen],
        "transcript": list(result.transcript),
        "traceback": result.traceback,
    }


def write_suite_json(path: Path, suite: SuiteResult) -> None:
    """Write a run as JSON.

    Raises
    ------
    ConfigurationError
        If *path* cannot be written.
    """
    files.write_json_file(path, suite_dict(suite))


def read_suite_json(path: Path) -> SuiteResult:
    """Return a run that was written before.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, or is no result of the conformance suite.
    """
    found = text_file.read_json_file(path, "compare")
    try:
        return suite_of_conformance_json(found)
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigurationError(
            f"compare '{path}' is no result of conform: name a file that --json wrote"
        ) from error


def suite_of_conformance_json(found: Mapping[str, Any]) -> SuiteResult:
    """Return the run that :func:`suite_dict` made *found* of.

    Raises
    ------
    ValueError, KeyError, TypeError
        If it made something else.
    """
    if found["format"] != FORMAT:
        raise ValueError(f"format is {found['format']!r}, known is {FORMAT!r}")
    results = tuple(_conformance_case_from_json(item) for item in found["results"])
    return SuiteResult(results, found["device"], found["settings"], found["cut_short"])


def _conformance_case_from_json(item: Mapping[str, Any]) -> CaseResult:
    recovery = item["recovery"]
    return CaseResult(
        case=item["case"],
        clause=item["clause"],
        requirement=item["requirement"],
        summary=item["what"],
        behaviour=Behaviour(item["behaviour"]),
        evidence=Evidence(item["evidence"].lower()),
        detail=item["detail"],
        recovery=None if recovery is None else Recovery(recovery["frames"], recovery["text"]),
        transcript=tuple(item["transcript"]),
        expected=item["expected"],
        seen=tuple(Behaviour(name) for name in item["seen"]),
        traceback=item.get("traceback", ""),  # results before it lack it
    )

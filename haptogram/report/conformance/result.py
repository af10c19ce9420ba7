"""A run of the conformance suite as JSON, without a date or a duration, and read back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from haptogram.conformance.causes import common_finding, failures_by_cause
from haptogram.conformance.verdict import Behaviour, CaseResult, Recovery, SuiteResult
from haptogram.errors import refusing_other_content
from haptogram.machine import files
from haptogram.records.frame import Evidence
from haptogram.settings import text_file

FORMAT: Final = "haptogram-conformance/1"


def _recovery_as_json(recovery: Recovery | None) -> dict[str, Any] | None:
    """Return a recovery (clean, frames, text) as JSON object; None stays None."""
    if recovery is None:
        return None
    return {"clean": recovery.clean, "frames": recovery.frames, "text": recovery.text}


def _recovery_of_json(found: dict[str, Any] | None) -> Recovery | None:
    """Return the recovery that a JSON object holds; None stays None."""
    return None if found is None else Recovery(found["frames"], found["text"])


def _unchanged(value: Any) -> Any:
    """Return *value*: JSON holds this column as it is."""
    return value


#: The fields of a case in JSON: the field of its result, how it is written, and how it is read.
_FIELDS: Final[Mapping[str, tuple[str, Callable[[Any], Any], Callable[[Any], Any]]]] = {
    "case": ("case", _unchanged, _unchanged),
    "clause": ("clause", _unchanged, _unchanged),
    "requirement": ("requirement", _unchanged, _unchanged),
    "what": ("summary", _unchanged, _unchanged),
    "behaviour": ("behaviour", str, Behaviour),
    "evidence": ("evidence", str.upper, lambda text: Evidence(text.lower())),
    "detail": ("detail", _unchanged, _unchanged),
    "recovery": ("recovery", _recovery_as_json, _recovery_of_json),
    "expected": ("expected", _unchanged, _unchanged),
    "seen": ("seen", lambda seen: [*map(str, seen)], lambda seen: tuple(map(Behaviour, seen))),
    "transcript": ("transcript", list, tuple),
    "traceback": ("traceback", _unchanged, _unchanged),
}


def _case_as_json(result: CaseResult) -> dict[str, Any]:
    """Return the result of a case as JSON object, a field for each column."""
    return {key: write(getattr(result, name)) for key, (name, write, _) in _FIELDS.items()}


def _case_of_json(item: Mapping[str, Any]) -> CaseResult:
    """Return the result of a case that a JSON object holds; a missing traceback is ""."""
    known = {"traceback": "", **item}  # results before it lack it
    return CaseResult(**{name: read(known[key]) for key, (name, _, read) in _FIELDS.items()})


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
        "results": [_case_as_json(result) for result in suite.results],
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
    refusal = f"compare '{path}' is no result of conform: name a file that --json wrote"
    with refusing_other_content(refusal):
        return suite_of_conformance_json(found)


def suite_of_conformance_json(found: Mapping[str, Any]) -> SuiteResult:
    """Return the run that :func:`suite_dict` made *found* of.

    Raises
    ------
    AttributeError, LookupError, TypeError, ValueError
        If it made something else.
    """
    if found["format"] != FORMAT:
        raise ValueError(f"format is {found['format']!r}, known is {FORMAT!r}")
    results = tuple(_case_of_json(item) for item in found["results"])
    return SuiteResult(results, {**found["device"]}, {**found["settings"]}, found["cut_short"])

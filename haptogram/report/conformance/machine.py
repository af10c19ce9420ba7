"""The result for machines: JSON and JUnit XML.  Nothing here adds a date or a duration."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

from haptogram.conformance.verdict import (
    MEANINGS,
    Behaviour,
    Evidence,
    Recovery,
    Result,
    SuiteResult,
)
from haptogram.errors import ConfigurationError
from haptogram.machine.files import write_atomically

FORMAT: Final = "haptogram-conformance/1"
_SUITE: Final = "haptogram.conformance"
_ILLEGAL: Final = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


# --- JSON --------------------------------------------------------------------------------------


def as_dict(suite: SuiteResult) -> dict[str, Any]:
    """Return everything that is known of a run."""
    return {
        "format": FORMAT,
        "device": suite.device,
        "settings": suite.settings,
        "exit_status": suite.exit_status,
        "cut_short": suite.cut_short,
        "counts": {behaviour.value: suite.count(behaviour) for behaviour in Behaviour},
        "results": [_result_dict(result) for result in suite.results],
    }


def _result_dict(result: Result) -> dict[str, Any]:
    recovery = result.recovery
    return {
        "case": result.case,
        "clause": result.clause,
        "requirement": result.requirement,
        "what": result.what,
        "behaviour": result.behaviour.value,
        "evidence": result.evidence.value,
        "detail": result.detail,
        "recovery": None
        if recovery is None
        else {"clean": recovery.clean, "frames": recovery.frames, "text": recovery.text},
        "expected": result.expected,
        "seen": [behaviour.value for behaviour in result.seen],
        "transcript": list(result.transcript),
        "traceback": result.traceback,
    }


def write_json(path: Path, suite: SuiteResult) -> None:
    """Write a run as JSON."""
    text = json.dumps(as_dict(suite), indent=2, ensure_ascii=False)
    write_atomically(path, text.encode() + b"\n")


def read_json(path: Path) -> SuiteResult:
    """Return a run that was written before.

    Raises
    ------
    ConfigurationError
        If the file cannot be read or is something else.
    """
    try:
        found = json.loads(path.read_text("utf-8"))
        if found["format"] != FORMAT:
            raise ValueError(f"format is {found['format']!r}, known is {FORMAT!r}")
        results = tuple(_result_from(item) for item in found["results"])
        return SuiteResult(results, found["device"], found["settings"], found["cut_short"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigurationError(f"{path}: not a result of conform: {error}") from error


def _result_from(item: Mapping[str, Any]) -> Result:
    recovery = item["recovery"]
    return Result(
        case=item["case"],
        clause=item["clause"],
        requirement=item["requirement"],
        what=item["what"],
        behaviour=Behaviour(item["behaviour"]),
        evidence=Evidence(item["evidence"]),
        detail=item["detail"],
        recovery=None if recovery is None else Recovery(recovery["frames"], recovery["text"]),
        transcript=tuple(item["transcript"]),
        expected=item["expected"],
        seen=tuple(Behaviour(name) for name in item["seen"]),
        traceback=item.get("traceback", ""),  # results before it lack it
    )


# --- JUnit -------------------------------------------------------------------------------------


def write_junit(path: Path, suite: SuiteResult) -> None:
    """Write a run as JUnit XML, by the table of :mod:`..verdict`."""
    kinds = Counter(_element(result) for result in suite.results)
    totals = {
        "tests": str(len(suite.results)),
        "failures": str(kinds["failure"]),
        "errors": str(kinds["error"]),
    }
    root = ElementTree.Element("testsuites", {"name": _SUITE} | totals)
    skipped = {"skipped": str(kinds["skipped"])}
    node = ElementTree.SubElement(root, "testsuite", {"name": _SUITE} | totals | skipped)
    properties = ElementTree.SubElement(node, "properties")
    for name, value in {**suite.device, **suite.settings, "cut_short": suite.cut_short}.items():
        ElementTree.SubElement(properties, "property", name=name, value=_legal(str(value)))
    for result in suite.results:
        _add_case(node, result)
    ElementTree.indent(root)
    write_atomically(
        path, ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"
    )


def _element(result: Result) -> str | None:
    if result.is_new_failure:
        return "failure"
    if result.is_failure:
        return "skipped"  # the baseline expects it
    return MEANINGS[result.behaviour].junit


def _add_case(node: ElementTree.Element, result: Result) -> None:
    name = f"{result.case} {result.what}"
    chapter = result.clause.partition(".")[0]
    item = ElementTree.SubElement(
        node, "testcase", classname=f"{_SUITE}.{chapter}", name=_legal(name)
    )
    message = f"{result.behaviour} [{result.evidence}] {result.detail}".strip()
    if not result.recovers:
        message += f"; recovery {result.recovery}"
    if result.expected is not None:
        message += f" (baseline: {result.expected})"
    kind = _element(result)
    text = "\n".join([message, f"requirement: {result.requirement}", *result.transcript])
    if kind is None:
        ElementTree.SubElement(item, "system-out").text = _legal(text)
        return
    element = ElementTree.SubElement(item, kind, message=_legal(message))
    if kind != "skipped":
        element.set("type", result.behaviour.value)
        element.text = _legal(text)
    if result.traceback:
        ElementTree.SubElement(item, "system-out").text = _legal(result.traceback)


def _legal(text: str) -> str:
    """Return *text* with what XML cannot hold replaced by U+FFFD."""
    return _ILLEGAL.sub("\ufffd", text)

"""The result as JUnit XML, for CI servers: one test case for each way in which a run can fail.

A fault that was proved is a ``failure``.  What was inconclusive is an ``error``, not ``skipped``:
CI servers count skipped cases as fine, and a run that shows nothing must not turn green.
``skipped`` is what could not be judged because nothing was seen that it could have shown in; lost
and late frames that decide nothing pass, and are named in the case's ``system-out``.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

from haptogram.machine.files import write_atomically
from haptogram.verification import RunVerdict

from .checks import Check, Outcome, checks

_SUITE: Final = "haptogram.verify"
_ILLEGAL: Final = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_ELEMENT: Final = {
    Outcome.FAILED: "failure",
    Outcome.INCONCLUSIVE: "error",
    Outcome.NOT_JUDGED: "skipped",
}


def write_junit(path: Path, run: RunVerdict, result: Mapping[str, Any]) -> None:
    """Write the result as JUnit XML.

    Parameters
    ----------
    run : RunVerdict
        What was found.
    result : mapping
        What :func:`result_dict` made of it.

    Raises
    ------
    ConfigurationError
        If *path* cannot be written.
    """
    document = _document(run, result)
    ElementTree.indent(document)
    content: bytes = ElementTree.tostring(document, encoding="utf-8", xml_declaration=True)
    write_atomically(path, content + b"\n")


def _document(run: RunVerdict, result: Mapping[str, Any]) -> ElementTree.Element:
    answers = checks(run, result["cut_short"])
    totals = _totals(answers)
    root = ElementTree.Element("testsuites", {"name": _SUITE} | totals)
    skipped = {"skipped": str(sum(check.outcome is Outcome.NOT_JUDGED for check in answers))}
    suite = ElementTree.SubElement(root, "testsuite", {"name": _SUITE} | totals | skipped)
    _add_properties(suite, result)
    for check in answers:
        _add_case(suite, check)
    ElementTree.SubElement(suite, "system-out").text = _legal(str(run))
    return root


def _totals(answers: list[Check]) -> dict[str, str]:
    outcomes = Counter(check.outcome for check in answers)
    return {
        "tests": str(len(answers)),
        "failures": str(outcomes[Outcome.FAILED]),
        "errors": str(outcomes[Outcome.INCONCLUSIVE]),
    }


def _add_properties(suite: ElementTree.Element, result: Mapping[str, Any]) -> None:
    properties = ElementTree.SubElement(suite, "properties")
    names = ("verdict", "evidence", "seed", "frames", "faults")
    named = {name: result[name] for name in names if name in result}
    asked = {f"configuration.{name}": value for name, value in result["configuration"].items()}
    made_by = {"board": result["board"], "environment": result.get("environment", {})}
    for name, value in _flat("", named | asked | made_by):
        ElementTree.SubElement(properties, "property", name=_legal(name), value=_legal(value))


def _flat(prefix: str, value: Any) -> Iterator[tuple[str, str]]:
    """Yield dotted names and texts of nested settings."""
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield from _flat(f"{prefix}.{name}" if prefix else str(name), item)
    else:
        yield prefix, value if isinstance(value, str) else json.dumps(value)


def _add_case(suite: ElementTree.Element, check: Check) -> None:
    case = ElementTree.SubElement(
        suite, "testcase", classname=f"{_SUITE}.{check.name}", name=check.statement
    )
    text = _legal("\n".join([check.message, *check.details]))
    kind = _ELEMENT.get(check.outcome)
    if kind is None:
        ElementTree.SubElement(case, "system-out").text = text
        return
    outcome = ElementTree.SubElement(case, kind, message=_legal(check.message))
    if check.outcome is not Outcome.NOT_JUDGED:  # the schema gives skipped no type
        outcome.set("type", check.name)
        outcome.text = text


def _legal(text: str) -> str:
    """Return *text* with what XML cannot hold replaced by U+FFFD."""
    return _ILLEGAL.sub("\ufffd", text)

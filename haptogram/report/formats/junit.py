"""JUnit XML, the format that CI servers read: one suite of cases in a file.

A fault that was proved is a ``failure``.  An inconclusive answer is an ``error``, not ``skipped``:
CI servers count skipped cases as fine, and a run that shows nothing must not turn green.
``skipped`` is a question that could not be judged.  What decides nothing passes.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Final
from xml.etree import ElementTree

from haptogram.machine.files import write_file_atomically

from .document import Check, Document, Outcome

if TYPE_CHECKING:
    from haptogram.machine.provenance import Provenance

_ILLEGAL: Final = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_PASSED: Final = "system-out"
#: The element that JUnit has for each outcome.
_ELEMENTS: Final = {
    Outcome.PASSED: _PASSED,
    Outcome.NOTED: _PASSED,
    Outcome.FAILED: "failure",
    Outcome.INCONCLUSIVE: "error",
    Outcome.NOT_JUDGED: "skipped",
}


def write_document_junit(path: Path, document: Document, provenance: Provenance) -> None:
    """Write *document* as JUnit XML; a character that XML cannot hold becomes U+FFFD.

    Raises
    ------
    ConfigurationError
        If *path* cannot be written.
    """
    root = _junit_root(document, provenance)
    ElementTree.indent(root)
    content: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    write_file_atomically(path, content + b"\n")


def _junit_root(document: Document, provenance: Provenance) -> ElementTree.Element:
    """Return the XML of all checks, with their counts, time and properties."""
    name = f"haptogram.{document.command}"
    elements = Counter(_ELEMENTS[check.outcome] for check in document.checks)
    totals = {
        "tests": str(len(document.checks)),
        "failures": str(elements["failure"]),
        "errors": str(elements["error"]),
    }
    time = _junit_time(document.seconds)
    root = ElementTree.Element("testsuites", {"name": name} | totals | time)
    own = {"skipped": str(elements["skipped"])} | time
    own |= {} if provenance.timestamp is None else {"timestamp": provenance.timestamp}
    node = ElementTree.SubElement(root, "testsuite", {"name": name} | totals | own)
    properties = ElementTree.SubElement(node, "properties")
    for title, value in {**document.properties, **dict(provenance.rows())}.items():
        ElementTree.SubElement(
            properties, "property", name=_legal_junit_text(title), value=_legal_junit_text(value)
        )
    for check in document.checks:
        _add_junit_case(node, name, check)
    log = "\n".join([document.heading, *document.lead])
    ElementTree.SubElement(node, "system-out").text = _legal_junit_text(log)
    return root


def _add_junit_case(suite: ElementTree.Element, name: str, check: Check) -> None:
    """Add a check to a suite as testcase, with outcome, message and log."""
    group = f"{name}.{check.group}"
    known = {"classname": group, "name": _legal_junit_text(check.name)} | _junit_time(check.seconds)
    node = ElementTree.SubElement(suite, "testcase", known)
    element = _ELEMENTS[check.outcome]
    outcome = ElementTree.SubElement(node, element)
    if element != _PASSED:
        outcome.set("message", _legal_junit_text(check.message))
    if check.decisive:  # the schema gives the others no type
        outcome.set("type", check.kind or check.group)
    if check.outcome is not Outcome.NOT_JUDGED:
        outcome.text = _legal_junit_text("\n".join([check.message, *check.details]))
    if check.log:
        ElementTree.SubElement(node, "system-out").text = _legal_junit_text(check.log)


def _junit_time(seconds: float | None) -> dict[str, str]:
    """Return the attribute "time" in seconds; {} if they are not known."""
    return {} if seconds is None else {"time": f"{seconds:.3f}"}


def _legal_junit_text(text: str) -> str:
    """Replace characters that XML forbids by U+FFFD."""
    return _ILLEGAL.sub("\ufffd", text)

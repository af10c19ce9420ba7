"""JUnit XML, the format that CI servers read: one suite of cases in a file."""

from __future__ import annotations

import enum
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final
from xml.etree import ElementTree

from haptogram.machine.files import write_file_atomically

if TYPE_CHECKING:
    from haptogram.machine.provenance import Provenance

    from .document import Document

_ILLEGAL: Final = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


class JUnit(enum.StrEnum):
    """Outcome of a case; the value is the element that JUnit has for it."""

    PASSED = "system-out"
    FAILURE = "failure"
    ERROR = "error"
    SKIPPED = "skipped"


@dataclass(frozen=True, slots=True)
class JUnitCase:
    """One test case.

    Attributes
    ----------
    group : str
        Name of its group within the suite.
    name : str
        Name of the case.
    outcome : JUnit
        How it ended.
    message : str
        The outcome in one line; not written for a case that passed.
    kind : str
        Type of a failure or an error.
    text : str
        The outcome in full; not written for a case that was skipped.
    log : str
        Further output, empty for none.
    seconds : float or None
        How long it took; None: it took no time of its own.
    """

    group: str
    name: str
    outcome: JUnit
    message: str
    kind: str
    text: str
    log: str = ""
    seconds: float | None = None


@dataclass(frozen=True, slots=True)
class JUnitSuite:
    """All cases of a run.

    Attributes
    ----------
    name : str
        Name of the suite.
    cases : tuple of JUnitCase
        The cases, in order.
    properties : mapping of str to str
        What is known of the run.
    log : str
        Output of the whole run, empty for none.
    timestamp : str or None
        When it began: a date of ISO 8601 in UTC, without a zone; None: not stated.
    seconds : float or None
        How long it took; None: not stated.
    """

    name: str
    cases: tuple[JUnitCase, ...]
    properties: Mapping[str, str] = field(default_factory=dict)
    log: str = ""
    timestamp: str | None = None
    seconds: float | None = None


def write_junit(path: Path, suite: JUnitSuite) -> None:
    """Write *suite* as JUnit XML; a character that XML cannot hold becomes U+FFFD.

    Raises
    ------
    ConfigurationError
        If *path* cannot be written.
    """
    root = _junit_root(suite)
    ElementTree.indent(root)
    content: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    write_file_atomically(path, content + b"\n")


def write_document_junit(path: Path, document: Document, provenance: Provenance) -> None:
    """Write the cases of *document*; the errors are those of :func:`write_junit`."""
    suite = JUnitSuite(
        f"haptogram.{document.command}",
        tuple(document.cases),
        {**document.properties, **dict(provenance.rows())},
        "\n".join([document.heading, *document.lead]),
        provenance.timestamp,
        document.seconds,
    )
    write_junit(path, suite)


def _junit_root(suite: JUnitSuite) -> ElementTree.Element:
    outcomes = Counter(case.outcome for case in suite.cases)
    totals = {
        "tests": str(len(suite.cases)),
        "failures": str(outcomes[JUnit.FAILURE]),
        "errors": str(outcomes[JUnit.ERROR]),
    }
    time = _junit_time(suite.seconds)
    root = ElementTree.Element("testsuites", {"name": suite.name} | totals | time)
    own = {"skipped": str(outcomes[JUnit.SKIPPED])} | time
    own |= {} if suite.timestamp is None else {"timestamp": suite.timestamp}
    node = ElementTree.SubElement(root, "testsuite", {"name": suite.name} | totals | own)
    properties = ElementTree.SubElement(node, "properties")
    for name, value in suite.properties.items():
        ElementTree.SubElement(
            properties, "property", name=_legal_junit_text(name), value=_legal_junit_text(value)
        )
    for case in suite.cases:
        _add_junit_case(node, suite.name, case)
    if suite.log:
        ElementTree.SubElement(node, "system-out").text = _legal_junit_text(suite.log)
    return root


def _add_junit_case(suite: ElementTree.Element, name: str, case: JUnitCase) -> None:
    group = f"{name}.{case.group}"
    known = {"classname": group, "name": _legal_junit_text(case.name)} | _junit_time(case.seconds)
    node = ElementTree.SubElement(suite, "testcase", known)
    outcome = ElementTree.SubElement(node, case.outcome)
    if case.outcome is not JUnit.PASSED:
        outcome.set("message", _legal_junit_text(case.message))
    if case.outcome in (JUnit.FAILURE, JUnit.ERROR):  # the schema gives the others no type
        outcome.set("type", case.kind)
    if case.outcome is not JUnit.SKIPPED:
        outcome.text = _legal_junit_text(case.text)
    if case.log:
        ElementTree.SubElement(node, "system-out").text = _legal_junit_text(case.log)


def _junit_time(seconds: float | None) -> dict[str, str]:
    return {} if seconds is None else {"time": f"{seconds:.3f}"}


def _legal_junit_text(text: str) -> str:
    """Return *text* with U+FFFD in place of what XML cannot hold."""
    return _ILLEGAL.sub("\ufffd", text)

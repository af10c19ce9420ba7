"""HTML without a script or a file beside it: one run, or several devices side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import Final

from haptogram.conformance.verdict import Behaviour, Result, SuiteResult
from haptogram.machine.files import write_atomically

_COLOURS: Final = {
    Behaviour.OK: "#2e7d32",
    Behaviour.NON_STRICT: "#9e7700",
    Behaviour.INFORMATIONAL: "#1565c0",
    Behaviour.UNIMPLEMENTED: "#616161",
    Behaviour.NOT_OBSERVED: "#757575",
    Behaviour.INCONCLUSIVE: "#8e4600",
    Behaviour.FLAKY: "#ad1457",
    Behaviour.FAILED: "#b71c1c",
}
_STYLE: Final = """\
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 90em; padding: 0 1em }
table { border-collapse: collapse; width: 100% }
th, td { border: 1px solid #ccc; padding: .3em .6em; text-align: left; vertical-align: top }
th { background: #f3f3f3; position: sticky; top: 0 }
td.v { color: #fff; font-weight: 600; white-space: nowrap }
pre { overflow-x: auto; font-size: 12px; background: #f7f7f7; padding: .6em }
small { color: #555 }
"""


def write_page(path: Path, suite: SuiteResult) -> None:
    """Write a run as one HTML page."""
    _write(path, "Conformance", "\n".join(_run(suite)))


def write_matrix(path: Path, suites: Sequence[SuiteResult]) -> None:
    """Write several runs side by side: a row per case, a column per device."""
    _write(path, "Conformance of several devices", "\n".join(_matrix(suites)))


def _write(path: Path, title: str, body: str) -> None:
    page = (
        f'<!doctype html>\n<html lang="en"><meta charset="utf-8"><title>{title}</title>\n'
        f"<style>\n{_STYLE}</style>\n<h1>{title}</h1>\n{body}\n</html>\n"
    )
    write_atomically(path, page.encode())


def _name(suite: SuiteResult) -> str:
    firmware = str(suite.device.get("firmware", "no board"))
    return f"{firmware} ({suite.settings.get('port', '')})"


def _counts(suite: SuiteResult) -> str:
    return ", ".join(f"{suite.count(b)} {b}" for b in Behaviour if suite.count(b))


def _run(suite: SuiteResult) -> Iterator[str]:
    yield f"<p><b>{escape(_name(suite))}</b>: {escape(_counts(suite))}. "
    yield f"Exit status {suite.exit_status}. {escape(suite.cut_short)}</p>"
    yield "<table><tr><th>case<th>verdict<th>evidence<th>recovery<th>requirement, found"
    for result in suite.results:
        yield _row(result)
    yield "</table>"


def _row(result: Result) -> str:
    recovery = "" if result.recovery is None else str(result.recovery)
    found = f"<br>{escape(result.detail)}" if result.detail else ""
    more = _details("traceback of the case", result.traceback)
    more += _details("bytes exchanged", "\n".join(result.transcript))
    return (
        f'<tr id="{escape(result.case)}"><td>{escape(result.case)}{_verdict(result)}'
        f"<td>{result.evidence}<td>{escape(recovery)}"
        f"<td>{escape(result.requirement)}<br><small>{escape(result.what)}</small>{found}{more}"
    )


def _details(summary: str, text: str) -> str:
    if not text:
        return ""
    return f"<details><summary>{summary}</summary><pre>{escape(text)}</pre></details>"


def _verdict(result: Result | None) -> str:
    if result is None:
        return "<td>"
    colour = _COLOURS[result.behaviour] if result.recovers else _COLOURS[Behaviour.FAILED]
    mark = "" if result.recovers else " (not recovered)"
    title = escape(result.detail, quote=True)
    return f'<td class="v" style="background:{colour}" title="{title}">{result.behaviour}{mark}'


def _matrix(suites: Sequence[SuiteResult]) -> Iterator[str]:
    yield "<table><tr><th>case" + "".join(f"<th>{escape(_name(suite))}" for suite in suites)
    columns = [{result.case: result for result in suite.results} for suite in suites]
    cases = {result.case: result for suite in suites for result in suite.results}
    for case, any_result in cases.items():
        what = escape(any_result.what)
        cells = "".join(_verdict(column.get(case)) for column in columns)
        yield f"<tr><td>{escape(case)}<br><small>{what}</small>{cells}"
    yield "<tr><th>all" + "".join(f"<th>{escape(_counts(suite))}" for suite in suites)
    yield "</table>"

"""A case that breaks off by an error of its own: told as such, with its traceback, everywhere."""

import json
from xml.etree import ElementTree

import boards
import pytest

from haptogram.conformance.case import case
from haptogram.conformance.outcome import fail
from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner
from haptogram.conformance.verdict import Behaviour
from haptogram.errors import ConfigurationError, DeviceError
from haptogram.machine.provenance import UNSTATED
from haptogram.report.conformance.document import suite_document
from haptogram.report.conformance.result import read_suite_json, write_suite_json
from haptogram.report.conformance.text import suite_text
from haptogram.report.formats.html import write_document_page
from haptogram.report.formats.junit import write_document_junit

ERRORS = [
    TypeError("no <b>such\nthing"),
    ZeroDivisionError(),
    AssertionError("a helper was wrong"),
    ConfigurationError("the case asked for what there is not"),
    DeviceError("a case of somebody else", code=1),
    RecursionError("too deep"),
    KeyError("x"),
]


def broken(error, *, times=99):
    left = [times]

    @case("HG-2.3/1", "breaks off")
    def breaks_off(_):
        left[0] -= 1
        if left[0] >= 0:
            raise error

    return breaks_off


def run(*cases, **options):
    return SuiteRunner(boards.virtual(array="2x2"), SuiteOptions(**options)).run(cases)


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_it_is_no_verdict_on_the_board_and_keeps_its_traceback(tmp_path, error):
    suite = run(broken(error), broken(error, times=0))
    result, after = suite.results
    assert (result.behaviour, after.behaviour) == (Behaviour.INCONCLUSIVE, Behaviour.OK)
    assert suite.exit_status == 3
    assert result.detail.startswith("error in the case itself")
    assert "(test_broken_cases.py:" in result.detail
    assert "\n" not in result.detail
    assert result.traceback.startswith("Traceback (most recent call last)")
    assert "in breaks_off" in result.traceback
    assert result.recovers

    files = [tmp_path / name for name in ("a.json", "a.xml", "a.html")]
    write_suite_json(files[0], suite)
    write_document_junit(files[1], suite_document(suite), UNSTATED)
    write_document_page(files[2], suite_document(suite), UNSTATED)
    assert json.loads(files[0].read_text())["results"][0]["traceback"] == result.traceback
    assert read_suite_json(files[0]).results == suite.results
    item = ElementTree.parse(files[1]).getroot().find("testsuite/testcase")
    assert item.find("error").get("type") == "INCONCLUSIVE"
    assert "in breaks_off" in item.find("system-out").text
    assert "traceback of the case" in files[2].read_text()
    assert "in breaks_off" in files[2].read_text()
    told = suite_text(suite)
    assert f"found        {result.detail}" in told
    assert "case errors  HG-2.3/1: not the board" in told


def test_results_written_before_there_were_tracebacks_are_read(tmp_path):
    path = tmp_path / "a.json"
    write_suite_json(path, run(broken(TypeError(), times=0)))
    old = json.loads(path.read_text())
    del old["results"][0]["traceback"]
    path.write_text(json.dumps(old))
    assert read_suite_json(path).results[0].traceback == ""


def test_one_error_among_repetitions_is_not_flaky():
    (result,) = run(broken(TypeError(), times=1), repeat=3).results
    assert result.behaviour is Behaviour.INCONCLUSIVE
    assert result.traceback
    assert result.seen == (Behaviour.INCONCLUSIVE, Behaviour.OK, Behaviour.OK)


def test_a_failure_beside_an_error_is_still_a_failure():
    left = [1]

    @case("HG-2.3/1", "fails, then breaks off")
    def fails_then_breaks_off(_):
        left[0] -= 1
        if left[0] < 0:
            raise TypeError
        fail("as it should not be")

    suite = run(fails_then_breaks_off, repeat=2)
    (result,) = suite.results
    assert result.behaviour is Behaviour.FAILED
    assert result.traceback
    assert suite.exit_status == 1


@pytest.mark.parametrize("writes", range(6, 30))
def test_an_error_before_or_after_a_case_ends_that_case_and_not_the_run(writes):
    wrong = TypeError("the program is wrong")
    access = boards.virtual(array="2x2", wrap=lambda inner: boards.Dying(inner, writes, wrong))
    cases = [broken(TypeError(), times=0) for _ in range(4)]
    suite = SuiteRunner(access, SuiteOptions()).run(cases)
    assert len(suite.results) == 4
    assert suite.exit_status == 3
    errors = [result for result in suite.results if result.traceback]
    assert errors
    assert all("the program is wrong" in result.detail for result in errors)
    assert all(result.behaviour is not Behaviour.FAILED for result in suite.results)


def test_a_board_that_does_not_answer_is_told_without_a_traceback():
    suite = SuiteRunner(boards.port(), SuiteOptions()).run([broken(TypeError())])
    (result,) = suite.results
    assert result.behaviour is Behaviour.INCONCLUSIVE
    assert not result.traceback
    assert "error in the case" not in result.detail
    assert "case errors" not in suite_text(suite)

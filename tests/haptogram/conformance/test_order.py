"""Cases that wait for 2^32 µs run when others have used up the waiting time; failures by cause."""

import dataclasses

import pytest
import serial

import sim_device
from haptogram.conformance.case import Case
from haptogram.conformance.cases import all_cases
from haptogram.conformance.causes import BROAD, common_finding, failures_by_cause
from haptogram.conformance.clauses import load_clauses
from haptogram.conformance.run.access import VirtualAccess
from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner
from haptogram.conformance.verdict import Behaviour, CaseResult, Recovery, SuiteResult
from haptogram.driver.line.port import PyserialTransport
from haptogram.machine.provenance import UNSTATED
from haptogram.records.frame import Evidence
from haptogram.report.conformance.document import suite_document
from haptogram.report.conformance.result import suite_dict
from haptogram.report.conformance.text import suite_text
from haptogram.report.formats.html import write_document_page

BAUD = 3_000_000
WAITING = [case for case in all_cases() if case.before_wrap_us]


def resets_for(wrap_case, others):
    """Run a case about the wrap, then *others* of half a second; return results and resets."""
    sim_device.register_url_handler()
    starts = []

    def start(number):
        starts.append(number)
        url = f"haptogram://?clock=virtual&array=3x2&baud={BAUD}&seed={number}"
        return PyserialTransport(serial.serial_for_url(url, timeout=0), url)

    access = VirtualAccess("haptogram://order", start, baudrate=BAUD, virtual=False)
    other = Case("HG-2.3/1", "half a second passes", lambda board: board.wire.idle(500_000))
    suite = SuiteRunner(access, SuiteOptions()).run([wrap_case, *[other] * others])
    assert [result.case for result in suite.results] == [wrap_case.id] + ["HG-2.3/1"] * others
    assert {result.behaviour for result in suite.results} == {Behaviour.OK}
    return len(starts) - 1


@pytest.mark.sampled(1)
@pytest.mark.parametrize("case", WAITING, ids=lambda case: case.id)
def test_a_case_about_the_wrap_runs_while_the_clock_of_another_reset_passes_it(case):
    assert resets_for(case, others=18) == 0


def test_it_has_a_reset_of_its_own_where_the_others_took_too_long_or_too_little_time():
    assert resets_for(WAITING[0], others=2) == 1
    case = dataclasses.replace(WAITING[0], before_wrap_us=0)
    assert resets_for(case, others=18) == 1


def failure_of(case, why="why"):
    clause = "-".join(case.split("-")[:2])
    return CaseResult(case, clause, "text", "asks", Behaviour.FAILED, Evidence.WIRE, why)


def test_failures_stand_from_the_ground_up_and_cases_of_many_clauses_behind_them():
    due = ["HG-2.1/1", "HG-4.6/1-fields", "HG-5.7/2-immediate", "HG-10.1/1", "HG-3.9/1-alone"]
    found = failures_by_cause(map(failure_of, [due[-1], *reversed(due[:-1])]))
    assert [result.case for result in found] == due


def test_a_clause_that_two_of_its_cases_find_broken_stands_before_lower_ones():
    due = [
        "HG-4.3/2",
        "HG-7.9/2-paths",
        "HG-7.9/2",
        "HG-7.1/3-speed",
        "HG-7.1/3-same",
        "HG-7.1/3-alone",
    ]
    found = failures_by_cause(map(failure_of, [*due[3:], *due[:3]]))
    assert [result.case for result in found] == due


def test_what_many_failures_find_alike_is_told_in_the_plainest_words():
    whys = {
        "HG-3.6/1": "while a sequence plays, PLAY was answered by ERROR(BAD_VALUE), detail 0x4",
        "HG-4.6/1": "PLAY was answered by ERROR(BAD_VALUE), detail 0xc",
        "HG-7.6/3": "with frames queued, PLAY was answered by ERROR(BAD_VALUE), detail 0x8",
        "HG-9.1/1": "no STATUS within 100 ms",
    }
    failures = [failure_of(*item) for item in whys.items()]
    alike = common_finding(failures)
    assert alike.text == whys["HG-4.6/1"]
    assert alike.cases == ("HG-3.6/1", "HG-4.6/1", "HG-7.6/3")
    assert failures_by_cause(failures)[0].detail == alike.text  # of three in four
    always = failure_of("HG-7.6/4-always", "PLAY was answered by ERROR(BAD_VALUE)")
    assert failures_by_cause([*failures, always])[0].detail == alike.text  # however plain
    assert common_finding(failures[1:]) is None  # two are no pattern
    others = [failure_of(f"HG-5.1/{n}", f"{'more ' * n}findings") for n in range(3, 9)]
    assert common_finding([*failures, *others]) is None  # nor is less than a third
    assert common_finding([]) is None
    numbers = [failure_of(f"HG-5.1/{n}", f"{'more ' * n}traces; due is {n}") for n in range(3, 9)]
    assert common_finding(numbers) is None  # a number that is due is none


def test_each_variant_of_many_clauses_is_one_of_some_case():
    assert {case.variant for case in all_cases()} >= BROAD


def test_every_report_says_once_what_many_failures_find_and_how_many_there_are(tmp_path):
    refused = "UPLOAD_BEGIN was answered by ERROR(BAD_STATE)"
    clauses = [clause for clause in load_clauses() if clause.startswith(("HG-7.", "HG-8."))][:20]
    failures = [failure_of(clause, refused) for clause in clauses]
    failures.append(failure_of("HG-9.1/1", "no STATUS within 100 ms"))
    suite = SuiteResult(tuple(failures))
    line = f"20 of 21 failures find much the same: {refused}"
    lines = suite_text(suite).splitlines()
    assert f"in common    {line}" in lines
    assert sum(refused in told for told in lines) == 4  # three in full, and what is in common
    assert sum(told.startswith("HG-9.1/1  FAILED") for told in lines) == 1
    named = next(told for told in lines if told.startswith("failures"))
    assert named.count("HG-") == 12
    assert named.endswith("and 9 more, in --json and --html")
    assert suite_dict(suite)["in_common"] == {"text": refused, "cases": tuple(clauses)}
    assert line in suite_document(suite).lead
    write_document_page(tmp_path / "page.html", suite_document(suite), UNSTATED)
    assert line in (tmp_path / "page.html").read_text("utf-8")
    unclean = [
        dataclasses.replace(result, behaviour=Behaviour.OK, detail="", recovery=Recovery(9, "mute"))
        for result in failures
    ]
    lines = suite_text(SuiteResult((failures[0], *unclean))).splitlines()
    assert sum("recovery" in told for told in lines) == 4  # two in full, all others, how many
    alone = SuiteResult((failures[0],))
    assert "in common" not in suite_text(alone)
    assert suite_dict(alone)["in_common"] is None

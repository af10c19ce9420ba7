"""Cases that wait for 2^32 µs run when others have used up the waiting time; failures by cause."""

import dataclasses

import pytest
import serial

import sim_device
from haptogram.conformance.case import Case
from haptogram.conformance.cases import all_cases
from haptogram.conformance.causes import BROAD, failures_by_cause
from haptogram.conformance.run.access import VirtualAccess
from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner
from haptogram.conformance.verdict import Behaviour, CaseResult
from haptogram.driver.line.port import PyserialTransport
from haptogram.records.frame import Evidence

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


@pytest.mark.parametrize("case", WAITING, ids=lambda case: case.id)
def test_a_case_about_the_wrap_runs_while_the_clock_of_another_reset_passes_it(case):
    assert resets_for(case, others=18) == 0


def test_it_has_a_reset_of_its_own_where_the_others_took_too_long_or_too_little_time():
    assert resets_for(WAITING[0], others=2) == 1
    case = dataclasses.replace(WAITING[0], before_wrap_us=0)
    assert resets_for(case, others=18) == 1


def failure_of(case):
    clause = "-".join(case.split("-")[:2])
    return CaseResult(case, clause, "text", "asks", Behaviour.FAILED, Evidence.WIRE, "why")


def test_failures_stand_from_the_ground_up_and_cases_of_many_clauses_behind_them():
    due = ["HG-2.1/1", "HG-4.6/1-fields", "HG-5.7/2-immediate", "HG-10.1/1", "HG-3.9/1-alone"]
    found = failures_by_cause(map(failure_of, [*reversed(due[:-1]), due[-1], due[0]]))
    assert [result.case for result in found] == [due[0], *due]


def test_each_variant_of_many_clauses_is_one_of_some_case():
    assert {case.variant for case in all_cases()} >= BROAD

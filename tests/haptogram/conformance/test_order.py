"""At a wall clock, cases that wait for 2^32 µs run when others have used up the waiting time."""

import dataclasses

import pytest
import serial

import sim_device
from haptogram.conformance.case import Case
from haptogram.conformance.cases import all_cases
from haptogram.conformance.run.access import VirtualAccess
from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner
from haptogram.conformance.verdict import Behaviour
from haptogram.driver.line.port import PyserialTransport

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

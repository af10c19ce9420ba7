"""The suite bites: the healthy board passes every case, every mutant fails its own clause.

The back door stays closed: what judges is what a firmware engineer has, the line.
"""

from __future__ import annotations

import pytest

from haptogram.cli import access_in_program
from haptogram.conformance.cases import all_cases
from haptogram.conformance.runner import Options, Runner, select
from haptogram.conformance.verdict import Behaviour, Result
from sim_device.mutants import MUTANTS, Evidence

OPTIONS = Options(timeout_s=1.0, seed=0, repeat=1, strict=True, expected={})
ON_THE_LINE = [name for name, mutant in MUTANTS.items() if mutant.evidence != Evidence.EXTERNAL]
NOT_ON_THE_LINE = sorted(set(MUTANTS) - set(ON_THE_LINE))


def _judge(url: str, *clauses: str) -> tuple[Result, ...]:
    access = access_in_program(url, baudrate=3_000_000, seed=0)
    cases = tuple(select(all_cases(), list(clauses)))
    return tuple(Runner(access, OPTIONS, lambda *_: None).run(cases).results)


def test_the_healthy_board_passes_everything_that_a_line_can_show() -> None:
    found = _judge("haptogram://?clock=virtual")
    assert {result.behaviour for result in found} == {Behaviour.OK, Behaviour.NOT_OBSERVED}
    assert all(result.recovery is None or result.recovery.clean for result in found)


@pytest.mark.parametrize("name", ON_THE_LINE)
def test_a_mutant_fails_the_clause_that_it_breaks(name: str) -> None:
    found = _judge(f"haptogram://?clock=virtual&mutant={name}", MUTANTS[name].clause)
    # Failed, not merely inconclusive: a crash alone would prove nothing about the clause.
    assert Behaviour.FAILED in {result.behaviour for result in found}


@pytest.mark.parametrize("name", NOT_ON_THE_LINE)
def test_what_only_a_measurement_shows_is_not_claimed_to_be_seen(name: str) -> None:
    found = _judge(f"haptogram://?clock=virtual&mutant={name}", MUTANTS[name].clause)
    assert Behaviour.FAILED not in {result.behaviour for result in found}


def test_there_are_forty_mutants_or_more_that_the_line_shows() -> None:
    assert len(ON_THE_LINE) >= 40

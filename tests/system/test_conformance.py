"""The conformance suite on the healthy board, whole; mutants have a test of their own."""

from __future__ import annotations

import pytest

from haptogram.cli.boards import access_in_program
from haptogram.conformance.case import Depth
from haptogram.conformance.cases import all_cases
from haptogram.conformance.run.runner import SuiteOptions, SuiteRunner
from haptogram.conformance.verdict import Behaviour

OPTIONS = SuiteOptions(timeout_s=1.0, seed=0, repeat=1, strict=True, expected={}, depth=Depth.QUICK)


@pytest.mark.nightly
@pytest.mark.slow
def test_the_healthy_board_passes_everything_that_a_line_can_show() -> None:
    access = access_in_program("haptogram://?clock=virtual", baudrate=3_000_000, seed=0)
    found = SuiteRunner(access, OPTIONS, lambda *_: None).run(tuple(all_cases())).results
    assert {result.behaviour for result in found} == {Behaviour.OK, Behaviour.NOT_OBSERVED}
    assert all(result.recovery is None or result.recovery.clean for result in found)

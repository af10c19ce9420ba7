"""Signals that come inside a step are heard behind it, every one."""

import contextlib
import signal

import pytest

from haptogram.machine.interrupts import DelayedInterrupts


class EndedError(Exception):
    """What a handler raises that ends the program."""


@pytest.mark.parametrize("ending", ["SIGTERM", "SIGINT"])
def test_a_handler_that_raises_hides_no_other_signal(ending):
    heard = []

    def hear(number, _):
        heard.append(signal.Signals(number).name)
        if heard[-1] == ending:
            raise EndedError

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, hear) for number in numbers}
    interrupts = DelayedInterrupts()
    interrupts.install()
    try:
        with contextlib.suppress(EndedError), interrupts:
            for number in numbers:
                signal.raise_signal(number)
            assert heard == []
    finally:
        interrupts.remove()
        for number in numbers:
            signal.signal(number, before[number])
    assert heard == ["SIGTERM", "SIGINT"]

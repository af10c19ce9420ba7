"""Faults between registers and air: the latched drive is right, the field is not."""

from __future__ import annotations

import contextlib

import pytest
import serial

import sim_device
from haptogram import Driver, Focus, verify_run
from haptogram.driver.line.port import PyserialTransport
from haptogram.evidence.backdoor import observations_of_backdoor, observations_on_clock_of
from haptogram.verification import RunVerdict, Verdict

ONE = [Focus((0.01, 0.02, 0.1))]
TWO = [[Focus((0.02, 0.01, 0.1)), Focus((-0.02, 0.0, 0.1))]]


def _run(fault: str, reconstruct: int, targets: list) -> RunVerdict:
    sim_device.register_url_handler()
    query = f"clock=virtual&array=8x8&reconstruct={reconstruct}&fault={fault}"
    url = f"haptogram://?{query}".rstrip("=").removesuffix("&fault")
    with contextlib.closing(serial.serial_for_url(url, timeout=0)) as port:
        driver = Driver(PyserialTransport(port, url), seed=1)
        driver.arm()
        driver.stream(targets * 4, 100, mode="drives")
        observations = observations_of_backdoor(port.records, driver.session)
        driver.close()
    seen = observations_on_clock_of(driver.intended, observations)
    return verify_run(driver.intended, seen, model=driver.model)


@pytest.mark.parametrize("reconstruct", [0, 1])
@pytest.mark.parametrize("targets", [ONE, TWO], ids=["one focus", "two foci"])
class TestOutput:
    def test_a_healthy_one_passes(self, reconstruct, targets):
        assert _run("", reconstruct, targets).verdict is Verdict.PASS

    @pytest.mark.parametrize("kind", ["dead", "stuck"])
    def test_a_faulty_column_fails_by_name(self, kind, reconstruct, targets):
        run = _run(f"device.{kind}+column=3", reconstruct, targets)
        assert run.verdict is Verdict.FAIL
        assert all("at the output" in frame.faults[0] for frame in run.frames)

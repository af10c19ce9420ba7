"""The driver on other URLs than a device's name: a board in this program, and one over TCP."""

import re
import subprocess
import sys

import numpy as np
import pytest

import sim_device
from haptogram.driver.driver import Driver
from haptogram.errors import ConfigurationError
from haptogram.evidence.backdoor import BackdoorReader, observations_of_backdoor
from haptogram.verification import verify_run
from haptogram_protocol.messages import TraceMode

ANGLE = np.linspace(0.0, 6.0, 400)
CIRCLE = np.column_stack((0.03 * np.cos(ANGLE), 0.03 * np.sin(ANGLE), np.full(400, 0.12)))


@pytest.fixture(autouse=True)
def _handler():
    sim_device.register_url_handler()


def run(backdoor, seed, points=CIRCLE, rate_hz=1000):
    url = f"haptogram://?clock=virtual&baud=3000000&seed={seed}&backdoor={backdoor}"
    with Driver(url, seed=seed, trace=TraceMode.CRC) as driver:
        driver.arm()
        report = driver.stream(points, rate_hz)
    with BackdoorReader(str(backdoor)) as file:
        return driver, report, observations_of_backdoor(file.read(), driver.session)


def test_a_run_in_virtual_time_is_exact_and_passes(tmp_path):
    driver, report, observations = run(tmp_path / "records", seed=1)
    assert (report.skipped, report.late_ticks) == ((), 0)
    assert [o.t_latch_us for o in observations] == [i.t_apply_us for i in driver.intended]
    assert [o.drive_crc for o in driver.observations] == [o.drive_crc for o in observations]
    verdict = verify_run(driver.intended, observations, model=driver.model)
    assert (str(verdict.verdict), verdict.reasons) == ("pass", ())


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    runs = [run(tmp_path / str(number), seed, CIRCLE[::4]) for number, seed in enumerate((5, 5, 6))]
    records = [(tmp_path / str(number)).read_bytes() for number in range(3)]
    assert records[0] == records[1] != records[2]
    assert runs[0][0].intended == runs[1][0].intended


def test_an_unknown_parameter_is_one_clear_line():
    with pytest.raises(ConfigurationError, match="colour"):
        Driver("haptogram://?colour=red")


def test_a_board_over_tcp():
    command = [sys.executable, "-m", "sim_device", "--tcp", "127.0.0.1:0", "--array", "4x4"]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={"PYTHONPATH": ":".join(sys.path)},
    )
    try:
        port = re.search(r"127\.0\.0\.1:(\d+)", process.stdout.readline()).group(1)
        for _ in range(2):  # and again, once the first has gone
            with Driver(f"socket://127.0.0.1:{port}") as driver:
                driver.arm()
                assert driver.play(CIRCLE[:50], 1000).latched == 50
    finally:
        process.terminate()
        process.communicate()
    assert process.returncode == 0

"""What the page of a run shows of each frame: drives that were seen, or known by their CRC."""

import dataclasses

import pytest

import sim_device
from haptogram import Driver, Evidence
from haptogram.commands.verify.results import verify_seen_by_number


@pytest.fixture(scope="module")
def run():
    """Return an intended frame and what the trace of a board tells of its latch."""
    sim_device.register_url_handler()
    with Driver("haptogram://?clock=virtual&array=4x4&seed=1", seed=1) as driver:
        driver.arm()
        intended = driver.focus((0.0, 0.0, 0.1))
        driver.hold(0.01)
        seen = driver.read_drive()
    return intended, dataclasses.replace(seen, key=intended.key, drive=None, radiated=None)


def test_the_crc_of_the_intended_drive_makes_the_drive_known(run):
    intended, seen = run
    assert seen.drive_crc == intended.drive.digest()
    assert verify_seen_by_number([intended], [seen])[0].output == intended.drive


@pytest.mark.parametrize(
    ("of_intended", "of_seen"),
    [
        ({}, {"drive_crc": None}),
        ({}, {"drive_crc": 1}),
        ({}, {"evidence": Evidence.WIRE}),
        ({"board_computed": True}, {}),
    ],
)
def test_what_nobody_saw_is_not_shown(run, of_intended, of_seen):
    intended, seen = run
    frame = dataclasses.replace(intended, **of_intended)
    assert verify_seen_by_number([frame], [dataclasses.replace(seen, **of_seen)]) == {}

"""The two sets of registers of the firmware's drivers, and the timer interrupt between them."""

import pytest

from protocol_c.building import FOLDER, compiler, run


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    """What the transducers get after each step, of the port's code on this computer."""
    program = tmp_path_factory.mktemp("port") / "transducers_steps"
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-Wshadow", "-Wconversion"]
    source = FOLDER / "tools" / "transducers_steps.c"
    ports = FOLDER / "ports" / "stm32f405"
    status, output = run(compiler(), *flags, "-I", ports, source, "-o", program)
    assert status == 0, output

    def told(*steps):
        status, output = run(program, input="".join(f"{step}\n" for step in steps))
        assert status == 0, output
        return output.split()

    return told


def test_the_timer_takes_what_is_loaded_a_period_ahead_and_the_latch_leaves_it(drives):
    steps = ("radiate 1000 1", "load 2000 2", "at 1975", "at 1976", "radiate 2000 2", "off")
    assert drives("at 1000", *steps) == ["-", "1", "1", "1", "2", "2", "-"]


def test_the_timer_comes_again_for_a_drive_that_is_further_than_it_reaches(drives):
    """The alarm is set where the drive is loaded: the main loop may compute from then on."""
    steps = ("radiate 1000 1", "load 300000 2", "at 299975", "at 299976")
    assert drives("at 1000", *steps) == ["-", "1", "1", "1", "2"]


def test_a_latch_that_does_not_come_is_taken_back(drives):
    """STOP, between the timer and the time that the next frame of a playback is due."""
    steps = ("radiate 1000 1", "load 2000 2", "at 1980", "unload", "at 2100")
    assert drives("at 1000", *steps) == ["-", "1", "1", "2", "1", "1"]


def test_a_first_latch_that_does_not_come_leaves_the_gate_shut(drives):
    assert drives("load 2000 2", "at 1980", "unload", "at 2100") == ["-", "2", "-", "-"]


def test_a_frame_that_takes_the_place_of_one_that_was_taken_is_radiated_when_it_is_due(drives):
    steps = ("radiate 1000 1", "load 2000 2", "at 1980", "load 3000 3", "at 2100", "at 2980")
    assert drives("at 1000", *steps) == ["-", "1", "1", "2", "1", "1", "3"]

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest

from haptogram.driver import Driver
from haptogram.errors import ConfigurationError, LinkLostError
from haptogram.records import FrameKey
from haptogram.virtual_board import VirtualBoard

pytestmark = pytest.mark.pty
POINTS = np.column_stack((np.linspace(-0.03, 0.03, 100), np.zeros(100), np.full(100, 0.12)))


@pytest.fixture
def board():
    with VirtualBoard("8x8") as board:
        yield board


def test_a_board_comes_up_shows_what_it_latched_and_leaves_nothing_behind():
    with VirtualBoard("8x8", pitch_mm=11, seed=3) as board:
        folder = Path(board.url).parent
        with Driver(board.url) as driver:
            assert driver.model.array.digest() == board.model.array.digest()
            driver.arm()
            driver.play(POINTS, 500)
        verdict = board.verify(driver.intended)
        assert (verdict.verdict.value, verdict.exit_status) == ("pass", 0)
        observations = board.observations(driver.session)
        assert [o.drive for o in observations] == [i.drive for i in driver.intended]
        assert {o.reconstruction is None for o in observations} == {False}
        assert board.observations(session=(driver.session % 0xFFFF) + 1) == []
        assert board.wait_for(100)
        assert board.records()[0]["seed"] == 3
        assert board.stop() == 0
        assert board.records()[-1]["kind"] == "end"
        assert not board.wait_for(101)
    assert not folder.exists()


def test_what_was_never_latched_does_not_keep_settle_waiting(board):
    with Driver(board.url) as driver:
        driver.arm()
        driver.focus((0, 0, 0.1))
    board.kill()
    unseen = dataclasses.replace(driver.intended[0], key=FrameKey(driver.session, 0, 0, 7))
    board.settle([unseen])
    board.settle([])


def test_a_killed_board_is_a_lost_link(board):
    driver = Driver(board.url)
    driver.arm()
    board.kill()
    with pytest.raises(LinkLostError, match="board"):
        driver.status()
    with pytest.raises(Exception, match="did not confirm"):
        driver.close()


def test_a_board_that_cannot_be_says_why_and_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(ConfigurationError, match="neither NXxNY nor a readable file"):
        VirtualBoard("nonsense")
    with pytest.raises(ConfigurationError, match=r"the virtual board ended with status 2: .*baud"):
        VirtualBoard(baudrate=0)
    assert os.listdir(tmp_path) == []


def test_two_boards_do_not_meet():
    with VirtualBoard("4x4") as one, VirtualBoard("4x4") as other:
        assert one.url != other.url
        with Driver(one.url) as first, Driver(other.url) as second:
            first.arm()
            assert second.status().state.name == "DISARMED"

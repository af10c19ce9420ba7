import dataclasses
import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from haptogram.driver.driver import Driver
from haptogram.errors import ConfigurationError, LinkError, LinkLostError
from haptogram.evidence.virtual_board import BoardRecords, VirtualBoard
from haptogram.records.frame import FrameKey

pty = pytest.mark.pty
POINTS = np.column_stack((np.linspace(-0.03, 0.03, 100), np.zeros(100), np.full(100, 0.12)))


@pytest.fixture
def board():
    with VirtualBoard("8x8", reconstruct=False, clock="wall") as board:
        yield board


@pty
def test_a_board_comes_up_shows_what_it_latched_and_leaves_nothing_behind():
    with VirtualBoard("8x8", pitch_mm=11, seed=3, clock="wall") as board:
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


@pty
def test_what_was_never_latched_does_not_keep_settle_waiting(board):
    with Driver(board.url) as driver:
        driver.arm()
        driver.focus((0, 0, 0.1))
    board.kill()
    unseen = dataclasses.replace(driver.intended[0], key=FrameKey(driver.session, 0, 0, 7))
    board.wait_idle([unseen])
    board.wait_idle([])


@pty
def test_a_killed_board_is_a_lost_link(board):
    driver = Driver(board.url)
    driver.arm()
    board.kill()
    with pytest.raises(LinkLostError, match="board"):
        driver.status()
    with pytest.raises(Exception, match="did not confirm"):
        driver.close()


@pty
def test_a_board_that_cannot_be_says_why_and_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(ConfigurationError, match="'nonsense'"):
        VirtualBoard("nonsense")
    with pytest.raises(ConfigurationError, match="baudrate is 0, must be 1"):
        VirtualBoard(baudrate=0)
    assert os.listdir(tmp_path) == []


@pytest.mark.nightly
@pty
def test_two_boards_do_not_meet():
    with VirtualBoard("4x4", clock="wall") as one, VirtualBoard("4x4", clock="wall") as other:
        assert one.url != other.url
        with Driver(one.url) as first, Driver(other.url) as second:
            first.arm()
            assert second.status().state.name == "DISARMED"


OWNER = """
import sys
from haptogram.evidence.virtual_board import BoardRecords, VirtualBoard
board = VirtualBoard("4x4", reconstruct=False, clock="wall")
print(board.url, flush=True)
sys.stdin.read()
"""


@pty
def test_a_board_ends_with_a_host_that_was_killed(tmp_path):
    paths = os.pathsep.join(path for path in sys.path if path)
    owner = subprocess.Popen(
        [sys.executable, "-c", OWNER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": paths, "TMPDIR": str(tmp_path)},
    )
    with owner:
        link = Path(owner.stdout.readline().decode().strip())
        assert link.exists()
        owner.kill()
    end_s = time.monotonic() + 60.0
    while link.is_symlink() and time.monotonic() < end_s:
        time.sleep(0.02)
    assert not link.is_symlink()  # it takes its name away when it ends in order


@pytest.mark.nightly
@pty
def test_faults_are_counted_at_the_end(monkeypatch, tmp_path):
    faults = ["device.dead column=2", "line.delay us=1"]
    with VirtualBoard("4x4", faults=faults, clock="wall") as board:
        with Driver(board.url) as driver:
            driver.arm()
            driver.focus((0, 0, 0.05))
            assert board.wait_for(1)
        assert board.fault_counts is None
        board.finish()
        assert board.fault_counts["device.dead"] == 1
        assert board.fault_counts["line.delay"] > 2
        run = board.verify(driver.intended)
    assert run.frames[0].faults[0].startswith("column 2 dead")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(ConfigurationError, match=r"'line\.magic' is no fault"):
        VirtualBoard(faults=["line.magic"])


class _SlowBoard:
    """A board on a busy machine: its last record comes *end_s* after it was told to end."""

    def __init__(self, path, end_s):
        self.path, self.end_s, self.at_s = path, end_s, 0.0

    def now_s(self):
        return self.at_s

    def sleep(self, _):
        self.at_s += 0.5
        if self.at_s == self.end_s:
            self.path.write_text('{"kind": "end"}\n')

    def is_running(self):
        return self.at_s < self.end_s

    def terminate(self):
        """It is told, and does not answer."""


def test_a_board_that_was_told_to_end_is_waited_for_until_it_has(tmp_path):
    path = tmp_path / "backdoor"
    slow = _SlowBoard(path, 119.0)
    records = BoardRecords(path, slow)
    records.read_until(lambda: False)  # one that was not: it may have lost what is waited for
    assert (records.records, slow.at_s < 20.0) == ([], True)
    VirtualBoard.finish(SimpleNamespace(_process=slow, _records=records))
    assert [record["kind"] for record in records.records] == ["end"]
    records.close()


@pty
def test_a_killed_board_shows_what_it_had_told_and_says_that_there_may_be_more(board):
    driver = Driver(board.url)
    driver.arm()
    driver.focus((0, 0, 0.1))
    assert board.wait_for(1)
    board.kill()
    with pytest.raises(LinkError, match="did not confirm"):
        driver.close()
    unseen = dataclasses.replace(driver.intended[0], key=FrameKey(driver.session, 0, 0, 7))
    assert "killed" in board.wait_idle([*driver.intended, unseen])
    run = board.verify([*driver.intended, dataclasses.replace(unseen, number=1)])
    assert [frame.status.value for frame in run.frames] == ["on target", "not verified"]


# --- in virtual time ------------------------------------------------------------------------------


def test_in_virtual_time_every_session_of_a_board_is_judged_in_this_program():
    with VirtualBoard("8x8", seed=3) as board:
        for number in (1, 2):
            with Driver(board.url, nonce=number) as driver:
                driver.arm()
                driver.stream(POINTS, 500)
                driver.focus(POINTS[0])
                verdict = board.verify(driver.intended)
                assert verdict, str(verdict)
                assert verdict.min_verified == 1.0
            assert len(board.observations(number)) == len(POINTS) + 1
        assert board.wait_for(2 * len(POINTS) + 2)
        assert not board.wait_for(2 * len(POINTS) + 3, timeout_s=100)
        assert board.how_it_ended() is None
        board.sleep(1.0)
        board.finish()
        assert board.records()[-1]["kind"] == "end"
        assert "MUTED" in {record.get("state") for record in board.records()}
        with pytest.raises(ConfigurationError, match=r"the board was ended.*clock=\"wall\""):
            Driver(board.url)
    assert not board.backdoor.parent.exists()


def test_in_virtual_time_a_board_loses_frames_and_ends_under_its_driver():
    with VirtualBoard("4x4", faults=["frame.crc p=0.1 from=60ms"]) as board:
        driver = Driver(board.url)
        driver.arm()
        driver.stream(POINTS, 1000)
        verdict = board.verify(driver.intended)
        assert verdict.reasons[0].startswith(f"{verdict.counts['lost']} of 100 frames were lost by")
        board.stop()
        with pytest.raises(LinkLostError):
            driver.status()
        with pytest.raises(LinkError, match="did not confirm"):
            driver.close()
        assert board.fault_counts["frame.crc"] >= verdict.counts["lost"]


def test_which_clock_a_board_has():
    with VirtualBoard("4x4", clock="virtual", reconstruct=False) as board:
        assert board.is_virtual
    with pytest.raises(ConfigurationError, match=r"clock is 'sundial'.*; known are virtual, wall"):
        VirtualBoard(clock="sundial")

"""ci/timing-goals for real, and short: the C programs, the exchanges, the table."""

import json
import shutil
import time

import pytest

from haptogram.errors import ConfigurationError
from haptogram.evidence.virtual_board import VirtualBoard
from timing_goals.__main__ import main
from timing_goals.c_programs import c_programs
from timing_goals.exchange import exchanger
from timing_goals.measure import measure_goals

pytestmark = [pytest.mark.pty, pytest.mark.realtime]

needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


@pytest.fixture(scope="module")
def board():
    with VirtualBoard("4x4", reconstruct=False, clock="wall") as board:
        yield board


def test_every_frame_of_a_closed_loop_is_confirmed_and_verified(board):
    with exchanger(board.url) as session:
        assert len(session.round_trips_us(20)) == 20
        found = session.closed_loop(100)
        assert found.verified == found.frames == len(found.trips_us) == 100
        assert (found.trips_us > 0).all()
        full = session.pipelined(300, 16)
        assert 0 < full.verified <= full.frames == 300
        paced = session.streamed(100, 200)
        assert 0 < paced.verified <= paced.frames == 100


@needs_cc
def test_the_c_programs_measure_what_they_say():
    with c_programs() as programs:
        trips = programs.round_trips_us(there=276, back=28, count=50)
        assert trips.shape == (50,)
        assert (trips > 0).all()
        begin_s = time.monotonic()
        paced = programs.round_trips_us(there=276, back=28, count=50, period_ns=2_000_000)
        assert paced.shape == (50,)
        assert (paced > 0).all()
        assert time.monotonic() - begin_s >= 0.1
        with programs.running_loop(period_ns=1_000_000, count=60, spin_ns=100_000) as lateness:
            pass
        assert lateness[0].shape == (60,)
        assert (lateness[0] >= 0).all()


def test_a_compiler_that_fails_is_one_line(monkeypatch):
    monkeypatch.setenv("CC", "false")
    with pytest.raises(ConfigurationError, match=r"false does not compile loop\.c"), c_programs():
        pass


def test_the_command_says_it_too(monkeypatch, capsys):
    monkeypatch.setenv("CC", "false")
    monkeypatch.setattr("sys.argv", ["timing-goals", "--seconds", "0.1"])
    assert main() == 2
    said = capsys.readouterr().err
    assert said.startswith("ci/timing-goals: false does not compile loop.c: ")
    assert "CC" in said


@pytest.mark.nightly
def test_without_a_compiler_there_is_nothing_beside(monkeypatch):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    with c_programs() as programs:
        assert programs is None


@pytest.mark.nightly
def test_the_goals_are_measured_and_said_to_be_met_or_not():
    found = measure_goals(seconds=0.3, trips=50, step_s=0.05)
    text = found.as_text()
    assert len(found.lines) >= 7
    for line in found.lines:
        assert line.figure in text
        assert line.measured in text
    assert text.count("met") + text.count(" -") >= len(found.lines)
    json.dumps(found.as_dict())

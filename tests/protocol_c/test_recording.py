"""The command that records the dialogues, with the C board that it builds."""

import pytest

from haptogram.conformance.cases import all_cases, select
from haptogram.conformance.run.stepping import NO_LINE_BAUD
from protocol_c.building import compiler, make
from protocol_vectors.vector_files import read
from vector_recorder import __main__ as command
from vector_recorder.boards import CBoard
from vector_recorder.recorder import LIMITS, spoken

NEEDS_TIME = {"latch_lead_us": 230, "point_time_us": 310}
ABOUT_TIME = ("HG-5.7", "HG-5.8", "HG-5.9", "HG-7.6/2", "HG-9.1/3", "HG-9.3")


def test_the_command_records_what_was_frozen(tmp_path, monkeypatch, capsys):
    compiler()
    monkeypatch.setenv("CFLAGS", "-O0")
    monkeypatch.setattr(command, "all_cases", lambda: select(all_cases(), ["HG-12"]))
    path = tmp_path / "dialogues.json"
    assert command.main([str(path)]) == 0
    frozen = [v for v in read("dialogues.json")["vectors"] if v["flags"] == ["timers"]]
    assert read(path)["vectors"] == frozen
    assert capsys.readouterr().out == f"{path}: {len(frozen)} dialogues\n"


@pytest.mark.parametrize(
    "clauses", [ABOUT_TIME[1:], pytest.param(ABOUT_TIME[:1], marks=pytest.mark.nightly)]
)
def test_boards_that_need_time_to_make_a_frame_ready_live_alike(clauses, tmp_path, monkeypatch):
    monkeypatch.setattr("vector_recorder.recorder._BAUDRATE", NO_LINE_BAUD)  # for bursts
    defines = " ".join(f"-DBOARD_{name.upper()}={us}" for name, us in NEEDS_TIME.items())
    program = tmp_path / "board_steps"
    status, output = make(tmp_path, program, CC=compiler(), CFLAGS=f"-O0 {defines}")
    assert (status, output) == (0, "")
    some = [c for c in select(all_cases(), clauses) if c.body is not None and not c.judges_all]
    cases = [case for case in some if case.variant != "fault"]  # no hardware of theirs fails
    with CBoard(tmp_path) as board:
        found = {case.id: spoken(case, LIMITS | NEEDS_TIME, board) for case in cases}
    assert [name for name, steps in found.items() if steps is None] == []

"""ci/clients without its clients: skips, failures, and negative controls of the judges."""

import base64
import dataclasses
import sys
import types

import numpy as np
import pytest

from live_clients import __main__ as command
from live_clients import checks
from live_clients.board import Latch, VirtualBoard, powered_up
from live_clients.environments import ENVIRONMENTS, Environment, EnvironmentMissing, find_python
from live_clients.results import Result, exit_status, report

PYAUTD3, LEVITATE = ENVIRONMENTS["pyautd3"], ENVIRONMENTS["levitate"]
NOWHERE = Environment("nobody", "1.0", ("2.1",), ("nobody==1.0",))
OFF = {"period": 0, "phases": base64.b64encode(bytes(249)).decode(), "widths": 0}
ON = {"period": 4, "phases": base64.b64encode(bytes(range(249))).decode(), "widths": 256}
CASE = {"changes": [OFF, ON], "refusals": [], "periods": 8}
TOLD = {"refusals": [], "firmware": []}


def drive(phases, width=256, cause="gain"):
    rises = (2 * np.asarray(phases) - width // 2) % 512
    return Latch(cause, 0, 512, rises.astype("<u2"), np.full(249, width, "<u2"), {})


SILENT = Latch("power-up", 0, 512, np.zeros(249, "<u2"), np.zeros(249, "<u2"), {})
BOARD = types.SimpleNamespace(positions_m=lambda: np.zeros((249, 3)))


def verdict(latches, case=CASE, told=TOLD):
    return checks._autd3_result(PYAUTD3, "every_code", case, told, latches, BOARD)  # noqa: SLF001


def test_drives_of_the_emulator_pass_and_others_fail() -> None:
    right = verdict([SILENT, drive(range(249))])
    assert (right.verdict, right.right, right.codes) == ("pass", 498, 498)
    off_by_one = np.arange(249)
    off_by_one[17] += 1
    wrong = verdict([SILENT, drive(range(249)), drive(off_by_one)])
    assert (wrong.verdict, wrong.right, wrong.codes) == ("fail", 498, 747)
    assert verdict([SILENT]).verdict == "fail"  # a drive that was never shown
    assert verdict([]).verdict == "fail"


def test_refusals_are_compared_word_for_word() -> None:
    case = CASE | {"refusals": ["Miss transition time"]}
    assert verdict([SILENT, drive(range(249))], case).verdict == "fail"
    told = TOLD | {"refusals": ["Miss transition time"]}
    assert verdict([SILENT, drive(range(249))], case, told).verdict == "pass"


def test_codes_of_levitate_are_compared_one_by_one() -> None:
    meant = {"name": "connect", "phases": [5] * 256, "duties": [64] * 256, "clipped": 2}
    latch = Latch("frame", 0, 128, np.full(256, 5, "<u2"), np.full(256, 64, "<u2"), {})
    found = checks._levitate_result(LEVITATE, meant, latch, 1.0, BOARD)  # noqa: SLF001
    assert (found.verdict, found.right) == ("pass", 256)
    assert "2 phases were clipped" in found.note
    other = dataclasses.replace(latch, widths=np.array([64] * 250 + [63] * 6, "<u2"))
    found = checks._levitate_result(LEVITATE, meant, other, 1.0, BOARD)  # noqa: SLF001
    assert (found.verdict, found.right, found.note) == (
        "fail",
        250,
        "6 codes are not those of levitate",
    )


def test_coherence_is_1_where_all_arrive_in_phase_and_less_elsewhere() -> None:
    source = np.random.default_rng(1)
    places, target, wave_number = source.uniform(-0.1, 0.1, (249, 3)), np.array([0, 0, 0.2]), 733.0
    turns = wave_number * np.linalg.norm(places - target, axis=1) / (2 * np.pi)
    latch = drive(np.round(-turns * 256).astype(int) % 256)
    assert latch.coherence(places, target, wave_number) > 0.999
    assert latch.coherence(places, target + np.array([0.02, 0, 0]), wave_number) < 0.5


def test_a_client_without_its_python_is_skipped_by_name(monkeypatch, capsys) -> None:
    with pytest.raises(EnvironmentMissing, match=r"it needs Python 2\.1; none is here"):
        find_python(("2.1",))
    monkeypatch.setitem(ENVIRONMENTS, "pyautd3", NOWHERE)
    monkeypatch.setattr(sys, "argv", ["ci/clients", "pyautd3"])
    assert command.main() == 3
    assert "skip: it needs Python 2.1" in capsys.readouterr().out


def test_an_unknown_client_is_a_usage_error(monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys, "argv", ["ci/clients", "nobody"])
    with pytest.raises(SystemExit) as ended:
        command.main()
    assert ended.value.code == 2
    assert "nobody is no client; known are pyautd3, levitate" in capsys.readouterr().err


def test_the_exit_status_says_the_worst(tmp_path) -> None:
    rows = [Result(PYAUTD3, "autd3", word, word, note="why") for word in ("pass", "fail", "skip")]
    assert exit_status(rows) == 1
    assert exit_status(rows[:1] + rows[2:]) == 0
    assert exit_status(rows[2:]) == 3
    report(tmp_path / "clients.xml", rows)
    text = (tmp_path / "clients.xml").read_text()
    assert 'tests="3" failures="1"' in text
    assert "<skipped" in text


@pytest.mark.pty
def test_a_board_is_started_told_apart_and_stopped(tmp_path) -> None:
    with powered_up(tmp_path, "interactlab", "--link", str(tmp_path / "board")) as board:
        assert isinstance(board, VirtualBoard)
        assert board.positions_m().shape == (256, 3)
        assert board.latches()[0].cause == "power-up"
    assert not (tmp_path / "board").exists()

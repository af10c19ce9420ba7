"""The main job, whole: over a real pty and a board in its own process, and in virtual time."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from haptogram.acoustics import Reconstruction, Reconstructor
from haptogram.cli import main
from haptogram.errors import ConfigurationError
from haptogram.evidence.boards import PortBoardUnderTest, ProcessBoardUnderTest
from haptogram.evidence.run_record import measure_run
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram.settings.run.verify import VerifyConfig
from haptogram.verification import FrameStatus, Verdict
from haptogram_protocol.messages import Feature
from sim_device.board.settings import ALL_FEATURES
from virtual_ports import BAUD, BoardPort

_CIRCLE = ["--object", "circle", "--radius-mm", "20", "--resolution-mm", "4", "--quiet"]
_FRAMES = 31


def _verify(tmp_path: Path, *words: str) -> tuple[int, dict[str, Any]]:
    path = tmp_path / "result.json"
    status = main(["verify", *words, "--json", str(path)])
    return status, json.loads(path.read_text(encoding="utf-8"))


@pytest.mark.pty
def test_over_a_pty_every_frame_that_is_latched_is_verified(tmp_path: Path) -> None:
    # A slow rate and a long lead: this test is about the chain, on a machine that may be busy.
    pace = ["--rate-hz", "200", "--lead-ms", "600"]
    status, result = _verify(tmp_path, *_CIRCLE, *pace, "--min-verified", "0.5")
    assert (status, result["verdict"]) == (0, "pass")
    frames = result["frames"]
    assert frames["sent"] == _FRAMES
    assert frames["latched"] == frames["verified"] == frames["on_target"]
    assert frames["latched"] + frames["lost"] == frames["sent"]
    assert result["evidence"] == "external"
    assert result["lateral_error_mm"]["max"] < 0.15
    assert result["environment"]["python"]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "words",
    [["points"], ["phases"], ["sequence"]],
    ids=" ".join,
)
def test_in_virtual_time_every_frame_is_on_target(tmp_path: Path, words: list[str]) -> None:
    status, result = _verify(tmp_path, *_CIRCLE, "--virtual-time", "--mode", *words)
    assert (status, result["verdict"]) == (0, "pass")
    assert result["frames"]["verified"] == result["frames"]["sent"] == _FRAMES
    assert result["lateness_us"]["max"] < 25.0
    assert result["troubles"] == {}


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("foci", "words"), [(4, ["--solver", "wgs"]), (2, ["--mode", "points"])], ids=["host", "board"]
)
def test_every_one_of_several_foci_is_verified(tmp_path: Path, foci: int, words: list[str]) -> None:
    more = ["--virtual-time", "--foci", str(foci), *words]
    status, result = _verify(tmp_path, *_CIRCLE, *more)
    assert (status, result["verdict"]) == (0, "pass")
    assert result["frames"]["on_target"] == result["frames"]["sent"] == _FRAMES
    assert result["balance"]["min"] > 0.9
    assert result["efficiency"]["min"] > 0.4


def test_the_fields_of_several_foci_are_searched_for_where_they_are_recorded_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The verdict on several foci reads none of them: its result is the same without."""
    searched, search = [], Reconstructor.reconstruct_weights

    def counted(*arguments: Any, **named: Any) -> Reconstruction:
        searched.append(arguments)
        return search(*arguments, **named)

    monkeypatch.setattr(Reconstructor, "reconstruct_weights", counted)
    words = [*_CIRCLE, "--virtual-time", "--foci", "2", "--seed", "7"]
    words += ["--fault", "device.stuck column=3 from=20ms"]
    assert _verify(tmp_path, *words)[0] == 1
    result = (tmp_path / "result.json").read_bytes()
    assert not searched
    assert _verify(tmp_path, *words, "--record", str(tmp_path / "run.mcap"))[0] == 1
    assert (tmp_path / "result.json").read_bytes() == result
    assert searched


def test_in_virtual_time_the_result_repeats_byte_for_byte(tmp_path: Path) -> None:
    texts = []
    for name in ("first.json", "second.json"):
        path = tmp_path / name
        words = ["--virtual-time", "--seed", "7", "--repeat", "2", "--json", str(path)]
        assert main(["verify", *_CIRCLE, *words]) == 0
        texts.append(path.read_bytes())
    assert texts[0] == texts[1]


def test_air_that_the_host_does_not_know_puts_the_focus_off_target(tmp_path: Path) -> None:
    status, result = _verify(tmp_path, *_CIRCLE, "--virtual-time", "--board-temperature-c", "21")
    assert (status, result["verdict"]) == (1, "fail")
    assert result["frames"]["off_target"] == _FRAMES
    # In faster air the same phases curve the waves more: they meet nearer to the array.
    assert all(frame["axial_error_mm"] < -0.2 for frame in result["not_on_target"])


_PATHS = {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.pty
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_keeps_what_it_measured_and_leaves_nothing_behind(
    tmp_path: Path, ending: signal.Signals
) -> None:
    path = tmp_path / "result.json"
    words = ["--rate-hz", "100", "--repeat", "1000", "--json", str(path)]
    environment = os.environ | _PATHS | {"TMPDIR": str(tmp_path)}
    run = subprocess.Popen(
        [sys.executable, "-m", "haptogram", "verify", *_CIRCLE, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env=environment,
    )
    _wait_for_latches(tmp_path, 20)
    run.send_signal(ending)
    said, complaints = run.communicate(timeout=60)
    assert run.returncode == 130, (said, complaints)
    assert b"interrupted after" in said
    result = json.loads(path.read_text(encoding="utf-8"))
    assert result["verdict"] == "inconclusive"
    frames = result["frames"]
    assert frames["verified"] >= 20
    assert frames["sent"] + frames["not_sent"] == 1000 * _FRAMES
    assert frames["cancelled"] == len(result["cancelled"])
    assert [entry.name for entry in tmp_path.iterdir()] == ["result.json"]


def _wait_for_latches(folder: Path, count: int) -> None:
    end_s = time.monotonic() + 60.0
    while time.monotonic() < end_s:
        for backdoor in folder.glob("haptogram-*/backdoor.jsonl"):
            if backdoor.read_bytes().count(b'"latch"') >= count:
                return
        time.sleep(0.02)
    raise AssertionError(f"no {count} latches within 60 s")


@pytest.mark.nightly
@pytest.mark.pty
def test_a_board_that_dies_in_mid_run_ends_it_with_what_was_seen() -> None:
    config = VerifyConfig.of(object="circle", radius_mm=20, resolution_mm=2, rate_hz=200, repeat=20)
    with VirtualBoard(baudrate=None, clock="wall") as board:

        def kill_at_half(done: int, total: int) -> None:
            if done * 2 >= total:
                board.kill()

        found = measure_run(config, ProcessBoardUnderTest(board), kill_at_half)
    assert found.cut is not None
    run = found.verdict()
    assert run.verdict is Verdict.INCONCLUSIVE
    assert run.counts["verified"] > 0
    assert found.cut.reason in run.reasons


@pytest.mark.sampled(1)
@pytest.mark.pty
@pytest.mark.parametrize("mode", ["phases", "points", "sequence"])
def test_a_board_at_a_port_is_judged_by_its_own_word(tmp_path: Path, mode: str) -> None:
    with VirtualBoard(baudrate=None, reconstruct=False, clock="wall") as board:
        words = ["--port", board.url, "--rate-hz", "100", "--lead-ms", "1000", "--mode", mode]
        status, result = _verify(tmp_path, *_CIRCLE, *words, "--min-verified", "0.5")
    assert (status, result["evidence"]) == (0, "self-reported")
    assert result["frames"]["verified"] == result["frames"]["latched"]


def test_a_board_without_trace_is_read_back_and_the_rest_is_not_verified() -> None:
    traces = Feature.TRACE | Feature.TRACE_DRIVE | Feature.TRACE_RING
    config = VerifyConfig.of(object="circle", radius_mm=20, resolution_mm=4, seed=3)
    board = PortBoardUnderTest("virtual://", baudrate=BAUD, rate_hz=1000, board_computes=False)
    board.port = BoardPort(features=ALL_FEATURES & ~traces)
    found = measure_run(config, board, None)
    run = found.verdict()
    assert run.verdict is Verdict.INCONCLUSIVE
    assert run.counts["sent"] == _FRAMES
    assert run.counts["verified"] == run.counts["on_target"] == 1
    assert run.frames[-1].status is FrameStatus.ON_TARGET
    assert run.counts["not_verified"] == _FRAMES - 1
    assert run.counts["lost"] == 0
    assert "no trace" in run.frames[0].note


def test_a_board_that_can_show_nothing_is_refused() -> None:
    config = VerifyConfig.of(object="point")
    board = PortBoardUnderTest("virtual://", baudrate=BAUD, rate_hz=1000, board_computes=False)
    board.port = BoardPort(features=Feature.AMPLITUDE)
    with pytest.raises(ConfigurationError, match="neither trace nor read-back"):
        measure_run(config, board, None)

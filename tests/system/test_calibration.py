"""Elements that differ, from file to verdict: the board radiates with them, the judge knows them.

Whole runs with real bytes, in virtual time but for one.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
import pytest
import serial

import sim_device
from haptogram.acoustics import Calibration, TransducerArray
from haptogram.cli import main
from haptogram.driver.driver import Driver
from haptogram.driver.line.port import PyserialTransport
from haptogram.errors import ConfigurationError
from haptogram.evidence.boards import PortBoardUnderTest
from haptogram.evidence.run_record import measure_run
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram.settings.run.verify import VerifyConfig
from virtual_ports import BAUD, BoardPort

pytestmark = pytest.mark.sampled(1)

CIRCLE = ["--object", "circle", "--radius-mm", "20", "--resolution-mm", "12", "--quiet"]
FRAMES = 10
ARRAYS = {"8x8": TransducerArray.grid(8, 8), "16x16": TransducerArray.grid(16, 16)}


def equal(array: TransducerArray) -> Calibration:
    return Calibration(np.ones(array.count), np.zeros(array.count), array.positions_m)


def unequal(array: TransducerArray, seed: int = 0, phase_rad: float = 0.4) -> Calibration:
    rng = np.random.default_rng(seed)
    return Calibration(
        rng.uniform(0.7, 1.3, array.count),
        rng.uniform(-phase_rad, phase_rad, array.count),
        array.positions_m + rng.uniform(-0.3e-3, 0.3e-3, (array.count, 3)),
    )


def file_of(folder: Path, calibration: Calibration) -> Path:
    path = folder / "elements of one array.csv"
    calibration.to_file(path)
    return path


def bad_file(folder: Path, rows: str) -> Path:
    path = folder / "bad.csv"
    path.write_text(f"element,gain,phase_rad,x_mm,y_mm,z_mm\n{rows}", encoding="utf-8")
    return path


def verify(folder: Path, *words: str) -> tuple[int, dict[str, Any]]:
    path = folder / "result.json"
    status = main(["verify", *CIRCLE, *words, "--json", str(path)])
    return status, json.loads(path.read_text(encoding="utf-8"))


@pytest.mark.nightly
@pytest.mark.parametrize(
    "words",
    [
        ["--mode", "drives", "--rate-hz", "400"],
        ["--mode", "points"],
        ["--mode", "sequence"],
        ["--foci", "2"],
        ["--board-temperature-c", "26"],
        ["--fault", "device.stuck column=3"],
    ],
    ids=lambda words: " ".join(words),
)
def test_equal_elements_in_their_places_change_no_verdict(tmp_path: Path, words: list[str]) -> None:
    path = str(file_of(tmp_path, equal(ARRAYS["16x16"])))
    plain = verify(tmp_path, "--virtual-time", *words)
    for more in ([], ["--compensate"]):
        if "points" in words and more:
            continue
        found = verify(tmp_path, "--virtual-time", "--calibration", path, *words, *more)
        assert found[0] == plain[0]
        for key in ("verdict", "frames"):
            assert found[1][key] == plain[1][key]


@pytest.mark.parametrize(
    ("array", "words"),
    [
        ("16x16", []),
        ("8x8", []),
        ("16x16", ["--mode", "drives", "--rate-hz", "400"]),
        ("8x8", ["--mode", "sequence"]),
        ("16x16", ["--foci", "2", "--solver", "gradient"]),
        ("8x8", ["--temperature-c", "31"]),
    ],
    ids=lambda value: value if isinstance(value, str) else " ".join(value),
)
def test_a_host_that_compensates_is_on_target_and_one_that_does_not_is_told(
    tmp_path: Path, array: str, words: list[str]
) -> None:
    path = str(file_of(tmp_path, unequal(ARRAYS[array])))
    words = ["--virtual-time", "--array", array, "--calibration", path, *words]
    status, result = verify(tmp_path, *words, "--compensate")
    assert (status, result["verdict"]) == (0, "pass")
    assert result["frames"]["on_target"] == result["frames"]["sent"] == FRAMES
    assert result["warnings"] == []
    if "--foci" in words:
        return  # the pressures at the foci, which is what they are judged by, are within limits
    status, result = verify(tmp_path, *words)
    assert (status, result["verdict"]) == (1, "fail")
    assert result["frames"]["on_target"] == 0
    assert result["frames"]["off_target"] == FRAMES
    (warning,) = result["warnings"]
    assert warning.startswith(path)
    assert "gains from 0.7" in warning
    assert "rad, elements up to 0.4" in warning
    assert warning.endswith("the host does not compensate for that")


@pytest.mark.nightly
def test_the_board_computes_drives_without_knowing_its_elements(tmp_path: Path) -> None:
    path = str(file_of(tmp_path, unequal(ARRAYS["16x16"])))
    status, result = verify(tmp_path, "--virtual-time", "--mode", "points", "--calibration", path)
    assert (status, result["verdict"]) == (1, "fail")
    assert result["frames"]["off_target"] == FRAMES


def test_a_dead_element_weakens_the_focus_and_is_no_fault_of_the_drive(tmp_path: Path) -> None:
    found = equal(ARRAYS["16x16"])
    gain = np.where(np.arange(256) == 100, 0.0, found.gain)
    path = file_of(tmp_path, Calibration(gain, found.phase_rad, found.positions_m))
    pressures = []
    for words in ([], ["--calibration", str(path)]):
        status, result = verify(tmp_path, "--virtual-time", *words)
        assert (status, result["frames"]["on_target"]) == (0, FRAMES)
        pressures.append(result["pressure_rms_pa"]["mean"])
    assert pressures[1] == pytest.approx(pressures[0] * 255 / 256, rel=5e-3)


@pytest.mark.nightly
def test_the_file_may_be_named_in_the_settings(tmp_path: Path) -> None:
    path = file_of(tmp_path, unequal(ARRAYS["16x16"]))
    settings = tmp_path / "run.toml"
    settings.write_text(
        f'[verify]\ncalibration = "{path}"\ncompensate = true\nvirtual_time = true\n',
        encoding="utf-8",
    )
    status, result = verify(tmp_path, "--config", str(settings))
    assert (status, result["verdict"]) == (0, "pass")
    assert result["configuration"]["calibration"] == str(path)
    status, result = verify(tmp_path, "--config", str(settings), "--no-compensate")
    assert (status, result["verdict"]) == (1, "fail")


# --- a board at a port: the judge alone knows the elements -------------------------------------


@pytest.mark.nightly
@pytest.mark.parametrize("compensate", [False, True])
def test_a_board_at_a_port_is_judged_by_the_calibration(tmp_path: Path, compensate: bool) -> None:
    path = file_of(tmp_path, unequal(ARRAYS["16x16"]))
    config = VerifyConfig.of(
        object="circle", radius_mm=20, resolution_mm=12, port="virtual://", calibration=path,
        compensate=compensate,
    )  # fmt: skip
    board = PortBoardUnderTest("virtual://", baudrate=BAUD, rate_hz=1000, board_computes=False)
    board.port = BoardPort()  # of equal elements: it shows what it latched, nothing else counts
    found = measure_run(config, board, None)
    run = found.verdict()
    assert run.counts["on_target"] == (FRAMES if compensate else 0)
    assert run.counts["off_target"] == (0 if compensate else FRAMES)
    assert found.model.calibration is not None
    assert len(found.warnings) == (not compensate)


def test_a_calibration_of_another_array_leaves_the_port_closed(tmp_path: Path) -> None:
    path = file_of(tmp_path, equal(ARRAYS["8x8"]))
    for compensate in (False, True):
        board = PortBoardUnderTest("virtual://", baudrate=BAUD, rate_hz=1000, board_computes=False)
        board.port = port = BoardPort()
        config = VerifyConfig.of(port="virtual://", calibration=path, compensate=compensate)
        with pytest.raises(ConfigurationError, match="element 64 is missing; the array has the"):
            measure_run(config, board, None)
        assert port.closed


# --- in Python ---------------------------------------------------------------------------------


def board_by_url(**options: object) -> Any:
    sim_device.register_url_handler()
    return serial.serial_for_url(
        f"haptogram://?{urlencode({'clock': 'virtual', 'reconstruct': 1} | options)}", timeout=0
    )


def test_a_driver_compensates_for_phases_and_places_and_the_board_keeps_its_word(
    tmp_path: Path,
) -> None:
    calibration = unequal(ARRAYS["8x8"])
    path = file_of(tmp_path, calibration)
    for known in (None, calibration, path):
        port = board_by_url(array="8x8", calibration=path)
        settings = port.simulation.dialect.board.settings
        with Driver(PyserialTransport(port, "board"), calibration=known) as driver:
            assert driver.warnings == []  # the nominal array is compared with the board's
            driver.arm()
            sent = driver.focus((0.01, -0.005, 0.11))
            driver.hold(0.02)
            read = driver.read_drive()
        assert read.drive == sent.drive  # what was latched is what was sent, whatever radiates it
        latch = next(record for record in port.records if record["kind"] == "latch")
        board = next(record for record in port.records if record["kind"] == "board")
        assert latch["reconstruction"]["kind"] == (
            "not_single" if known is None else "single_focus"
        )
        assert board["positions_m"] == settings.model.array.positions_m.tolist()
        assert board["calibration"]["gain"] == calibration.gain.tolist()
        assert board["calibration"]["phase_rad"] == calibration.phase_rad.tolist()
        assert settings.truth.calibration is not None
        assert settings.model.calibration is None


def test_frames_that_the_board_computes_are_refused_with_a_calibration() -> None:
    port = board_by_url(array="8x8")
    with Driver(PyserialTransport(port, "board"), calibration=equal(ARRAYS["8x8"])) as driver:
        with pytest.raises(ConfigurationError, match=r"mode points: .* without the calibration"):
            driver.frames([(0.0, 0.0, 0.1)], mode="points")
        assert len(driver.frames([(0.0, 0.0, 0.1)], mode="drives")) == 1


@pytest.mark.nightly
@pytest.mark.pty
def test_a_board_in_a_process_of_its_own_has_its_elements_too(tmp_path: Path) -> None:
    calibration = unequal(ARRAYS["8x8"])
    points = [(0.0, 0.005, 0.1), (0.004, 0.0, 0.1)]
    for given, knows, passes in (
        (calibration, True, True),
        (file_of(tmp_path, calibration), False, False),
    ):
        with VirtualBoard("8x8", calibration=given, clock="wall") as board:
            assert board.model.response == pytest.approx(calibration.response)
            with Driver(board.url, calibration=calibration if knows else None) as driver:
                driver.arm()
                driver.stream(points, rate_hz=50)
            run = board.verify(driver.intended, min_verified=0.0)
            assert run.counts["on_target"] == (2 if passes else 0)


# --- what is refused ---------------------------------------------------------------------------


@pytest.mark.parametrize("words", [["--virtual-time"], [], ["--port", "/dev/null"]], ids=str)
@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("0,nan,0,0,0,0\n", ":2: gain is nan, must be 0 to 10"),
        ("1,1,0,0,0,0\n", ": element 0 is missing; each from 0 to 1 must be there once"),
        ("0,1,0,0,0,0\n0,1,0,9,0,0\n", ":3: element 0 is given twice, first in line 2"),
    ],
)
def test_a_bad_file_is_one_line_and_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rows: str, told: str, words: list[str]
) -> None:
    path = bad_file(tmp_path, rows)
    assert main(["verify", *CIRCLE, *words, "--calibration", str(path)]) == 2
    assert capsys.readouterr().err == f"haptogram verify: {path}{told}\n"


@pytest.mark.parametrize("words", [["--virtual-time"], []], ids=str)
@pytest.mark.parametrize(
    ("rows", "told"),
    [
        ("0,1,0,-5,0,0\n", ": element 1 is missing; the array has the elements 0 to 1\n"),
        ("0,1,0,-5,0,20\n1,1,0,5,0,0\n", ":2: element 0 is 20 mm from its place in the array, "),
    ],
)
def test_a_file_of_another_array_is_one_line_and_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rows: str, told: str, words: list[str]
) -> None:
    path = bad_file(tmp_path, rows)
    assert main(["verify", *CIRCLE, *words, "--array", "2x1", "--calibration", str(path)]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"haptogram verify: {path}{told}")
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--compensate"], "--compensate needs to know how the elements are"),
        (["--mode", "points"], "--compensate is for drives that the host computes; in the mode po"),
        (["--mode", "sequence", "--modulation", "am"], "--compensate is for drives that the host"),
    ],
)
def test_what_cannot_be_compensated_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], told: str
) -> None:
    path = str(file_of(tmp_path, equal(ARRAYS["16x16"])))
    more = [] if words == ["--compensate"] else ["--calibration", path, "--compensate"]
    assert main(["verify", *CIRCLE, "--virtual-time", *more, *words]) == 2
    assert told in capsys.readouterr().err


def test_the_virtual_board_refuses_a_bad_file_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "absent.csv"
    assert main(["board", "--link", str(tmp_path / "b"), "--calibration", str(path)]) == 2
    complaint = capsys.readouterr().err
    assert complaint.count("\n") == 1
    assert f"calibration '{path}' cannot be read" in complaint
    with pytest.raises(ConfigurationError, match=r"absent\.csv"):
        VirtualBoard(calibration=path)
    with pytest.raises(ConfigurationError, match="element 64 is missing"):
        VirtualBoard(calibration=equal(ARRAYS["8x8"]))
    with pytest.raises(ConfigurationError, match="must be a Calibration or the name of a file"):
        VirtualBoard(calibration=5)  # type: ignore[arg-type]

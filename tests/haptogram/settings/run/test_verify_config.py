"""Settings: every limit is named, and the command line wins over the file."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from haptogram.acoustics.solvers.several import METHODS
from haptogram.errors import ConfigurationError
from haptogram.settings.option import SettingError
from haptogram.settings.run.frames import SOLVERS
from haptogram.settings.run.verify import VerifyConfig, load_verify_config


def _file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "run.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_command_line_wins_over_file_wins_over_default(tmp_path: Path) -> None:
    path = _file(tmp_path, "[verify]\nrate_hz = 500\nresolution_mm = 10\n")
    config = load_verify_config(path, {"rate_hz": 250.0, "seed": None})
    assert (config.pace.rate_hz, config.shape.resolution_mm, config.limits.seed) == (250.0, 10.0, 0)


def test_file_converts_to_the_type_of_the_setting(tmp_path: Path) -> None:
    path = _file(
        tmp_path,
        '[verify]\ncenter_mm = [1, 2, 120]\njson = "a.json"\nvirtual_time = true\nfoci = 6\n'
        "min_verified = 1\nboard_temperature_c = 25\n",
    )
    config = load_verify_config(path, {})
    assert config.shape.center_mm == (1.0, 2.0, 120.0)
    assert config.outputs.json == Path("a.json")
    assert (
        config.link.virtual_time,
        config.drive.foci,
        config.limits.min_verified,
    ) == (True, 6, 1.0)
    assert config.elements.board_temperature_c == 25.0


def test_the_solvers_are_those_that_there_are() -> None:
    assert SOLVERS == METHODS
    assert VerifyConfig().solver_of_host == "wgs"
    assert VerifyConfig.of(mode="points").solver_of_host == "naive"


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"rate_hz": math.nan}, "--rate-hz is nan, must be 1 to 40000"),
        ({"rate_hz": 0.0}, "--rate-hz is 0, must be 1 to 40000"),
        ({"resolution_mm": -1.0}, "--resolution-mm is -1, must be 0.1 to 100"),
        ({"mode": "morse"}, "--mode is 'morse'; known are phases, drives, points"),
        ({"foci": 33}, "--foci is 33, must be 1 to 32"),
        ({"solver": "best"}, "--solver is 'best'; known are naive, ibp"),
        ({"solver": "wgs", "mode": "points"}, "the board solves frames of points"),
        ({"modulation": "fm"}, "--modulation is 'fm'; known are am, lm, stm"),
        ({"modulation": "am"}, "--modulation is 'am', whose frames have amplitudes"),
        (
            {"modulation": "lm", "modulation_hz": 501.0},
            "--modulation-hz is 501; at 1000 frames/s it can be 500 at most",
        ),
        ({"depth": 1.5}, "--depth is 1.5, must be 0 to 1"),
        ({"dwell_ms": 0.0}, "--dwell-ms is 0, must be 0.01 to 60000"),
        ({"object": "teapot"}, "--object is 'teapot'; known are hemisphere"),
        ({"virtual_time": True, "port": "/dev/ttyUSB0"}, "has a clock of its own"),
        ({"fault": ["line.drop"], "port": "/dev/ttyUSB0"}, "--fault is for the virtual board"),
        ({"fault_plan": Path("x"), "port": "/dev/ttyUSB0"}, "--fault-plan is for the virtual"),
    ],
)
def test_a_bad_value_is_named_with_its_limit(values: dict[str, object], told: str) -> None:
    with pytest.raises(ConfigurationError, match=told.replace("(", r"\(")):
        load_verify_config(None, values)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[verify]\nspeed = 3\n", "'speed' is not a setting; did you mean seed"),
        ("[verify]\nrate_hz = 'fast'\n", "rate_hz is 'fast', must be a number"),
        ("[verify]\nrate_hz = 0\n", r"run\.toml: rate_hz is 0, must be 1 to 40000"),
        ("[verify]\nseed = -1\n", "seed is -1, must be 0 to 4294967295"),
        ("[verify]\nfault = 'line.drop'\n", "fault is 'line.drop', must be a list of texts"),
        ("[verify]\nfault = [3]\n", r"fault is \[3\], must be a list of texts"),
        ("[verify]\nrepeat = true\n", "repeat is True, must be a whole number"),
        ("[verify]\ncenter_mm = [1, 2]\n", r"center_mm is \[1, 2\]"),
        (
            "[verify]\nrate-hz = 500\n",
            "'rate-hz' is not a setting; did you mean rate_hz",
        ),
        ("[verify]\nxyzzy = 500\n", "'xyzzy' is not a setting; known are object, resolution_mm"),
        ("[verify]\nmode = 'morse'\n", r"run\.toml: mode is 'morse'; known are phases, drives"),
        ("[verify]\njson = ''\n", r"run\.toml: json is '', must be the name of a file"),
        ("[verfy]\n", r"\[verfy\] is not read; .* one table \[verify\]; did you mean verify"),
        ("[other]\n", r"\[other\] is not read; all settings are in one table \[verify\]"),
        ("rate_hz = 5\n", r"\[rate_hz\] is not read"),
        ("", r"must have one table \[verify\]"),
        ("a=" + "[" * 5000, r"^config '.*run\.toml' is no TOML: it is nested too deeply$"),
        ("a=" + "1" * 5000, r"^config '.*run\.toml' is no TOML: "),
        ("not toml", r"^config '.*run\.toml' is no TOML: .*line 1"),
    ],
)
def test_a_bad_file_is_named(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(ConfigurationError, match=told):
        load_verify_config(_file(tmp_path, text), {})


def test_faults_are_a_list_in_the_file_and_the_command_line_has_its_own(tmp_path: Path) -> None:
    path = _file(tmp_path, '[verify]\nfault = ["line.drop p=0.1", "clock.ppm"]\n')
    assert load_verify_config(path, {}).faults.fault == ("line.drop p=0.1", "clock.ppm")
    assert load_verify_config(path, {"fault": ["line.flip"]}).result_options()["fault"] == [
        "line.flip"
    ]


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"absent\.toml"):
        load_verify_config(tmp_path / "absent.toml", {})


def test_least_verified_depends_on_the_clock() -> None:
    assert VerifyConfig().least_verified == 0.9
    assert VerifyConfig.of(virtual_time=True).least_verified == 1.0
    assert VerifyConfig.of(min_verified=0.25).least_verified == 0.25


def test_job_holds_what_decides_the_result_and_no_path() -> None:
    job = VerifyConfig.of(json=Path("x.json")).result_options()
    assert "json" not in job
    assert job["center_mm"] == [0.0, 0.0, 100.0]


def test_the_air_over_a_virtual_board_is_none_of_a_board_at_a_port():
    with pytest.raises(SettingError, match="virtual board that is started here"):
        VerifyConfig.of(port="/dev/ttyUSB0", board_temperature_c=21.0)

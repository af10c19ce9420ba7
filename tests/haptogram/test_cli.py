"""The command line: what it refuses, in one line and with exit status 2."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from haptogram.cli import main


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--rate-hz", "nan"], "--rate-hz nan: out of range; give 1 to 40000 Hz"),
        (["--rate-hz", "2000"], "carry 1086 frames/s, 2000 Hz asked"),
        (["--baud", "115200"], "bytes a frame at 115200 baud carry 41 frames/s"),
        (["--resolution-mm", "0"], "--resolution-mm 0: out of range; give 0.1 to 100 mm"),
        (["--center-mm", "0,0,-100"], "must be at least"),
        (["--object", "absent.stl"], "absent.stl"),
        (["--object", "teapot"], "--object is 'teapot'; known are hemisphere"),
        (["--array", "0x16"], "side of the grid is 0, must be 1 to 1024"),
        (["--config", "absent.toml"], "absent.toml"),
        (["--min-verified", "2"], "--min-verified 2: out of range; give 0 to 1"),
    ],
)
def test_a_wrong_argument_is_one_line_and_status_2(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", "--virtual-time", "--quiet", *words]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert told in said.err
    assert said.err.startswith("haptogram verify: ")
    assert said.err.count("\n") == 1


def test_a_port_that_is_not_there_is_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", "--quiet", "--port", "/dev/absent"]) == 2
    assert capsys.readouterr().err == "haptogram verify: /dev/absent: there is no such port\n"


def test_a_word_that_is_no_number_is_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", "--rate-hz", "fast"]) == 2
    said = capsys.readouterr().err
    assert said == "haptogram verify: --rate-hz fast: not a number; give 1 to 40000 Hz\n"


@pytest.mark.parametrize("words", [["--help"], ["verify", "--help"]])
def test_help_names_the_exit_status(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 0
    assert "3  inconclusive" in capsys.readouterr().out


def test_help_is_quick_and_imports_nothing_heavy() -> None:
    code = "import sys, haptogram.cli as c\ntry: c.main(['--help'])\nexcept SystemExit: pass\n"
    code += "sys.exit(sorted({'numpy', 'scipy', 'serial', 'sim_device'} & set(sys.modules)) != [])"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert ended.returncode == 0


def test_a_file_that_cannot_be_written_costs_neither_the_result_nor_the_other_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    blocked, junit = tmp_path / "file", tmp_path / "result.xml"
    blocked.write_text("")
    words = ["--json", str(blocked / "result.json"), "--junit", str(junit)]
    assert main(["verify", "--virtual-time", "--object", "point", "--quiet", *words]) == 2
    said = capsys.readouterr()
    assert str(blocked) in said.err
    assert said.out.startswith("PASS")
    assert junit.exists()

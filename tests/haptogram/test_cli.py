"""The command line: what it refuses, in one line and with exit status 2."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from haptogram import start
from haptogram.cli import COMMANDS, command_parser, main


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--rate-hz", "nan"], "--rate-hz is nan, must be 1 to 40000 Hz"),
        (
            ["--rate-hz", "2000"],
            "--rate-hz is 2000; 274 bytes a frame at 3000000 baud carry",
        ),
        (["--baud", "115200"], "bytes a frame at 115200 baud carry 42 frames/s"),
        (["--resolution-mm", "0"], "--resolution-mm is 0, must be 0.1 to 100 mm"),
        (["--center-mm", "0,0,-100"], "must be at least"),
        (["--object", "absent.stl"], "absent.stl"),
        (["--object", "teapot"], "--object is 'teapot'; known are hemisphere"),
        (["--object", "hemispere"], "did you mean hemisphere?"),
        (["--array", "0x16"], "--array is '0x16', must be a grid of 1 to 1024 elements"),
        (["--config", "absent.toml"], "absent.toml"),
        (["--min-verified", "2"], "--min-verified is 2, must be 0 to 1"),
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


def test_a_fault_of_the_program_is_no_verdict(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("haptogram.cli.main", lambda _: 1 // 0)
    assert start._run_after_start([]) == 2  # noqa: SLF001
    assert "ZeroDivisionError: " in capsys.readouterr().err


def test_a_word_that_is_no_number_is_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", "--rate-hz", "fast"]) == 2
    said = capsys.readouterr().err
    assert said == "haptogram verify: --rate-hz is 'fast', must be a number, 1 to 40000 Hz\n"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--help"], "  3    inconclusive: too little could be observed for a verdict\n"),
        (["verify", "--help"], "  3  inconclusive: too few frames could be verified"),
    ],
)
def test_help_names_the_exit_status(
    words: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 0
    assert line in capsys.readouterr().out


def test_the_help_of_all_commands_says_nothing_of_one(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    statuses = capsys.readouterr().out.partition("exit status, of every command:\n")[2]
    assert [line[:5].strip() for line in statuses.splitlines()[:5]] == ["0", "1", "2", "3", "130"]
    assert "frame" not in statuses
    assert "focus" not in statuses


def test_help_is_quick_and_imports_nothing_heavy() -> None:
    code = "import sys, haptogram.cli as c\ntry: c.main(['--help'])\nexcept SystemExit: pass\n"
    code += "sys.exit(sorted({'numpy', 'scipy', 'serial', 'sim_device'} & set(sys.modules)) != [])"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert ended.returncode == 0


def test_a_file_that_cannot_be_written_at_the_end_costs_neither_the_result_nor_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    blocked, junit = tmp_path / "file", tmp_path / "result.xml"
    blocked.write_text("")  # as if somebody had put it there while the command was at work
    monkeypatch.setattr("haptogram.machine.files.check_files_writable", lambda _: None)
    words = ["--json", str(blocked / "result.json"), "--junit", str(junit)]
    assert main(["verify", "--virtual-time", "--object", "point", "--quiet", *words]) == 2
    said = capsys.readouterr()
    assert str(blocked) in said.err
    assert said.out.startswith("PASS")
    assert junit.exists()


@pytest.mark.parametrize(
    ("edge", "unit", "told"),
    [
        (0.05, "mm", "is 0.05 mm long with --unit mm; it can be 1 to 2000 mm long; the file may"),
        (0.05, "m", None),
        (50.0, "mm", None),
        (5.0, "cm", None),
        (2.0, "in", None),
        (50.0, "m", "is 5e+04 mm long with --unit m; it can be 1 to 2000 mm long; the file may be"),
    ],
)
def test_a_mesh_in_another_unit_is_recognised(
    edge: float, unit: str, told: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "triangle.obj"
    path.write_text(f"v 0 0 0\nv {edge} 0 0\nv 0 {edge} 0\nf 1 2 3\n")
    words = ["modulation", "dwell", "--object", str(path), "--unit", unit, "--array", "6x6"]
    assert main(words) == (2 if told else 0)
    assert (told or "") in capsys.readouterr().err


@pytest.mark.parametrize("words", [["soak"], ["soak", "--virtual-time", "--hours", "1"]])
def test_a_soak_begins_no_day_unasked(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("command", ["verify", "conform"])
def test_one_word_writes_a_recording_and_another_reads_one(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "--recording", "run.mcap"]) == 2
    assert "did you mean --from-recording?" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_the_short_help_is_a_page(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*name.split(), "-h"])
    assert ended.value.code == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 45
    assert all(len(line) <= 100 for line in lines)
    assert f"  haptogram {name}" in "\n".join(lines)
    if not name:
        return
    parser = command_parser(name)
    options = {word for word in parser.option_actions if word.startswith("--") and word != "--help"}
    main_options = {f"--{option.replace('_', '-')}" for option in parser.main_options.split()}
    shown = {line.split()[0].rstrip(",") for line in lines if line.startswith("  --")}
    assert main_options <= options
    assert len(shown) <= 10
    assert shown == main_options or not main_options
    assert lines[-1].startswith(f"haptogram {name} --help ")


HEAVY = {"numpy", "scipy", "serial", "matplotlib", "tqdm"}


def test_help_imports_no_heavy_part() -> None:
    """One process asks for all: what one help imported would be seen from it on."""
    code = "import sys\nfrom haptogram.cli import main\nfor name in sys.argv[1:]:\n"
    code += "    try: main(name.split())\n    except SystemExit: pass\n"
    code += f"    print('\\nimported', name, sorted({HEAVY!r} & set(sys.modules)))"
    words = [f"{name} {wish}" for wish in ("-h", "--help") for name in ("", *COMMANDS)]
    ended = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True)
    told = [line for line in ended.stdout.splitlines() if line.startswith("imported")]
    assert told == [f"imported {name} []" for name in words]


def test_the_list_of_commands_imports_the_options_of_none() -> None:
    code = "import sys\nfrom haptogram.cli import main\ntry: main(['--help'])\n"
    code += "except SystemExit: pass\nprint(sorted(m for m in sys.modules if 'settings' in m))"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    loaded = ended.stdout.splitlines()[-1]
    assert (
        loaded
        == "['haptogram.settings', 'haptogram.settings.arguments', 'haptogram.settings.parser']"
    )


@pytest.mark.parametrize("name", COMMANDS)
def test_every_help_has_a_sentence_examples_and_the_exit_status(name: str) -> None:
    parser = command_parser(name)
    assert parser.description
    assert parser.epilog
    assert f"haptogram {name} " in parser.epilog
    assert "exit status:\n" in parser.epilog
    assert name == "board" or "\n  130  interrupted" in parser.epilog
    for action in parser.option_actions.values():
        assert action.help, action.option_strings

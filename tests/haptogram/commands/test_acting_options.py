"""An option that does nothing in a mode is refused, as its command says."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from haptogram.cli import COMMANDS, command_parser, main

ACTING = {name: command_parser(name).acting for name in COMMANDS if name != "board"}
RECORDED = "--from-recording run.mcap --capture pins.vcd --channels map.toml"
#: For every option that does not always act: a command line where it acts and one where not.
CASES = {
    "verify": dict.fromkeys(
        ACTING["verify"],
        ("", RECORDED),
    )
    | {
        "resolution_mm": ("--object circle", "--object point"),
        "radius_mm": ("--object line", "--object shape.stl"),
        "unit": ("--object shape.stl", "--object circle"),
        "modulation_hz": ("--modulation lm", ""),
        "depth": ("--modulation am --mode points", "--modulation lm"),
        "shift_mm": ("--modulation lm", "--modulation am --mode points"),
        "dwell_ms": ("", "--modulation stm"),
        "solver": ("--foci 2", ""),
        "pitch_mm": ("--array 8x8", "--array array.csv"),
        "mode": ("", "--dialect sonicsurface"),
        "lead_ms": ("", "--dialect sonicsurface"),
        "dialect_option": ("--dialect sonicsurface", ""),
        "simulator": ("--dialect sonicsurface --virtual-time", "--dialect sonicsurface"),
        "backdoor": ("--port /dev/absent", ""),
        "seed": ("", "--port /dev/absent"),
        "view": ("", "--virtual-time"),
        "compensate": ("--calibration elements.csv", RECORDED),
    },
    "view": {
        "http": ("board.jsonl", "board.jsonl --html a.html"),
        "open": ("board.jsonl", "board.jsonl --html a.html"),
        "until_eof": ("board.jsonl", "board.jsonl --html a.html"),
    },
    "conform": dict.fromkeys(ACTING["conform"], ("--port /dev/absent", "--list"))
    | {
        "capture": ("--port /dev/absent --channels a.toml", "--list"),
        "channels": ("--port /dev/absent --capture a.vcd", "--list"),
        "from_recording": ("--capture a.vcd --channels a.toml", "--list"),
        "spawn": ("", "--list"),
        "port": ("", "--list"),
        "port_regex": ("--spawn true", "--compare a.json --html b.html"),
        "boot_timeout": ("--port /dev/absent", "--port haptogram://"),
        "clause": ("--list", "--compare a.json"),
        "html": ("--compare a.json", "--list"),
        "list": ("", "--compare a.json"),
    },
    "sweep": {"jobs": ("a.toml --scheduler local", "a.toml --scheduler tcp://127.0.0.1:1")},
    "budget": {
        "boards": ("--dialect ultraino", ""),
        "transducers": ("", "--dialect ultraino-mega64"),
    },
    "decode": {"verbose": ("dump.bin", "dump.bin --json")},
    "replay": {
        "baud": ("run.mcap --port a", "run.mcap"),
        **dict.fromkeys(("healthy", "mutant", "array"), ("run.mcap", "run.mcap --port a")),
    },
    "watch": {
        **dict.fromkeys(
            (
                *("dialect", "dialect_option", "simulator", "slow_down"),
                *("array", "temperature_c", "calibration"),
            ),
            ("--link board --dialect sonicsurface", "unix:board.sock"),
        ),
        **dict.fromkeys(
            ("tolerance_mm", "tolerance_c", "tolerance_humidity"),
            ("capture.bin --expect 0,0,100", "unix:board.sock"),
        ),
    },
    "modulation": {
        "modulation_hz": ("am", "dwell"),
        "depth": ("am", "lm"),
        "shift_mm": ("lm", "stm"),
        "dwell_ms": ("dwell", "stm"),
        "radius_mm": ("stm", "am"),
        "resolution_mm": ("am --object circle", "am"),
        "unit": ("stm --object shape.stl", "stm"),
        "pitch_mm": ("am --array 8x8", "am --array array.csv"),
    },
    "field": {
        "resolution_mm": ("--object circle", "--object point"),
        "radius_mm": ("--object circle", ""),
        "unit": ("--object shape.stl", ""),
        "center_mm": ("--object point", ""),
        "rate_hz": ("--ear-mm", "--drive drive.csv"),
        "modulation": ("--ear-mm", "--ear-mm --object circle"),
        "modulation_hz": ("--ear-mm", ""),
        "pitch_mm": ("--array 8x8", "--array array.csv"),
        "ear_mm": ("", "--quiet --picture a.png"),
        "quiet": ("--picture a.png", ""),
        "quantity": ("--picture a.png", ""),
        "decibels": ("--picture a.png", "--picture a.png --quantity phase"),
        "half_width_mm": ("--picture a.png", ""),
        "plane": ("--picture a.png", ""),
        "step_mm": ("--picture a.png", ""),
    },
}
CASES["soak"], CASES["bench"] = {}, {}
for _command, _words in {
    "verify": "",
    "conform": "",
    "soak": "--hours 0.1 ",
    "bench": "",
    "watch": "unix:board.sock ",
}.items():
    CASES[_command]["stamp"] = (f"{_words}--summary a.md", _words.strip())
#: Values of the options that do not take 5.
VALUES = {
    "depth": "0.5",
    "object": "circle",
    "fault": "line.drop",
    "http": "127.0.0.1:0",
    "baud": "9600",
    "clause": "HG-2.3",
    "stamp": "2026-11-22",
    "dialect_option": "boards=1",
}
ROWS = [
    (command, name, *lines) for command, options in CASES.items() for name, lines in options.items()
] + [
    ("conform", "boot_timeout", "--spawn true", ""),
    ("field", "rate_hz", "--object circle", "--object point"),
]


def actions_of(command: str) -> dict[str, argparse.Action]:
    actions = command_parser(command).option_actions.values()
    return {action.dest: action for action in actions if action.dest != "help"}


def option_words(command: str, name: str) -> list[str]:
    """Return the option with a value that it takes."""
    action = actions_of(command)[name]
    word = action.option_strings[0]
    if action.nargs == 0 or action.const is not None:
        return [word]
    if action.choices:
        return [word, str(list(action.choices)[-1])]
    if str(action.metavar).startswith("{"):
        return [word, str(action.metavar).strip("{}").rpartition(",")[2]]
    return [word, VALUES.get(name, "1,1,100" if action.metavar == "X,Y,Z" else "5")]


@pytest.mark.parametrize("command", ACTING)
def test_only_options_that_are_there_say_when_they_act(command: str) -> None:
    assert set(ACTING[command]) <= set(actions_of(command))


def test_every_option_that_does_not_always_act_is_tried_in_both_kinds_of_modes() -> None:
    sometimes = {(command, name) for command, rows in ACTING.items() for name in rows}
    sometimes |= {(command, "stamp") for command in ACTING if "stamp" in actions_of(command)}
    assert {(command, name) for command, name, *_ in ROWS} == sometimes


@pytest.mark.sampled(30)
@pytest.mark.parametrize(("command", "name", "acts", "idle"), ROWS)
def test_an_idle_option_is_one_line_and_status_2_before_any_work(
    command: str,
    name: str,
    acts: str,
    idle: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    words = option_words(command, name)
    refused = f"haptogram {command}: {words[0]} acts only "
    assert main([command, *idle.split(), *words]) == 2
    said = capsys.readouterr()
    assert said.err.startswith(refused)
    assert said.err.endswith("; leave it out\n")
    assert said.err.count("\n") == 1
    assert said.out == ""

    class Passed(Exception):
        pass

    def stop(*_: object, **__: object) -> None:
        raise Passed

    # What comes after the check is no matter here.
    monkeypatch.setattr("haptogram.commands.shell.output_files.CommandOutputs.__init__", stop)
    monkeypatch.setattr("haptogram.commands.budget._run_dialect_budget", stop)
    monkeypatch.setattr("haptogram.commands.budget._run_own_budget", stop)
    monkeypatch.setattr("haptogram.commands.recordings.decode.open_recorded_source", stop)
    monkeypatch.setattr("haptogram.commands.conform.command._list_conform_cases", stop)
    monkeypatch.setattr("haptogram.commands.conform.command._compare_conform_results", stop)
    monkeypatch.setattr("haptogram.commands.conform.command.recorded_suite", stop)
    with pytest.raises(Passed):
        raise SystemExit(main([command, *acts.split(), *words]))


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("", "job.toml: depth acts only with the modulation am; leave it out"),
        ("--depth 0.5", "--depth acts only with the modulation am; leave it out"),
    ],
)
def test_an_idle_key_of_a_file_is_refused_as_an_idle_option_is(
    words: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "job.toml"
    path.write_text('[verify]\nobject = "point"\ndepth = 0.5\narray = "6x6"\n')
    config = ["--config", str(path)]
    assert main(["verify", "--virtual-time", "--quiet", *config, *words.split()]) == 2
    said = capsys.readouterr().err
    assert said.endswith(f"{told}\n")
    assert said.count("\n") == 1
    acting = ["--modulation", "am", "--mode", "points", "--repeat", "10"]
    assert main(["verify", "--virtual-time", "--quiet", *config, *acting]) == 0

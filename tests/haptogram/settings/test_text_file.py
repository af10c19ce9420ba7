"""Every TOML and JSON file that a command reads: bounded in size and depth, refused in one line."""

from pathlib import Path

import pytest

from haptogram.cli import main

#: Command lines that end with the name of a file.
READERS = {
    "toml": {
        "config": "verify --virtual-time --config",
        "fault plan": "verify --virtual-time --fault-plan",
        "fault plan of a board": "board --link board --fault-plan",
        "map of a capture": "capture pins.vcd --map",
        "baseline": "conform --quick --baseline",
    },
    "json": {
        "results of boards": "conform --html page.html --compare",
        "result of bench": "bench --compare",
        "checkpoint of a soak": "soak --hours 1 --resume",
    },
}
DEEP = "is nested too deeply"
LONG = "it has more than 262144 characters"
HOSTILE = {
    "toml": {
        "a = " + "[" * 100_000: DEEP,
        "a = " + "[" * 40 + "]" * 40: DEEP,
        ".".join("a" * 100_000) + " = 1": DEEP,
        " . ".join(["'a.b'"] * 40_000): LONG,
        "[" + " . ".join(['"a"'] * 20_000) + "]": DEEP,
        '[[fault]]\nname = "line.drop"\n' * 200_000: LONG,
    },
    "json": {
        "[" * 100_000: DEEP,
        "[" * 40 + "]" * 40: DEEP,
        '{"a":' * 40 + "1" + "}" * 40: DEEP,
        "5": "",
        '{"key": }': "is no JSON: Expecting value: line 1 column 9",
        '{"format": "haptogram-bench", "version": 1}': "",
        '{"kind": "haptogram soak", "version": 3}': "",
    },
}
ROWS = [
    pytest.param(line, text, told, id=f"{name}-{number}")
    for kind, lines in READERS.items()
    for name, line in lines.items()
    for number, (text, told) in enumerate(HOSTILE[kind].items())
]


@pytest.mark.parametrize(("line", "text", "told"), ROWS)
def test_a_hostile_file_is_refused_in_one_line(
    line: str,
    text: str,
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("pins.vcd").write_text("")
    Path("hostile").write_text(text)
    assert main([*line.split(), "hostile"]) == 2
    said = capsys.readouterr().err
    assert "hostile" in said
    assert told in said
    assert said.count("\n") == 1


def test_a_plan_has_a_number_of_faults(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "plan").write_text('[[fault]]\nname = "line.drop"\n' * 1001)
    assert main(["verify", "--virtual-time", "--fault-plan", str(tmp_path / "plan")]) == 2
    assert "1001 faults; a plan takes 1000" in capsys.readouterr().err


def test_a_file_without_an_end_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", "--virtual-time", "--config", "/dev/zero"]) == 2
    assert "it has more than" in capsys.readouterr().err

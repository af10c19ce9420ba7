"""A wrong value is told by the name of its source: the key of a file, of a URL, or the option."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from haptogram.cli import main
from haptogram.errors import HaptogramError
from haptogram.settings.board import BoardConfig
from haptogram.settings.option import Option, options_of
from haptogram.settings.run.files import OutputConfig
from haptogram.settings.run.verify import VerifyConfig
from sim_device.protocol_haptogram import Serial

#: Wrong values of options whose type does not tell one.
_WRONG = {"stamp": '"yesterday"', "port": "3", "array": '"nowhere.csv"', "object": '"nowhere.stl"'}
#: Output files are refused by their folder: a folder that is a file.
_OUTPUT = '"config.toml/out"'


def wrong_value(option: Option) -> str:
    """Return a value for TOML that the option does not take."""
    if option.name in _WRONG:
        return _WRONG[option.name]
    if option.name in options_of(OutputConfig):
        return _OUTPUT
    one = {int: "1.5", float: "nan", bool: '"maybe"'}.get(option.kind, '"nowhere"')
    if option.count is None:
        return one
    return f"[{', '.join([one] * (option.count or 1))}]"


def test_a_pipe_is_read_once(capsys: pytest.CaptureFixture[str]) -> None:
    """A shell gives one for ``--config <(...)``; a dialect settles its rates in a second pass."""
    reader, writer = os.pipe()
    os.write(writer, b'[verify]\nobject = "point"\ndialect = "sonicsurface"\nvirtual_time = true\n')
    os.close(writer)
    assert main(["verify", "--quiet", "--config", f"/dev/fd/{reader}"]) == 0
    assert "1 sent, 1 latched" in capsys.readouterr().out
    os.close(reader)


@pytest.mark.sampled(16)
@pytest.mark.parametrize(
    "option",
    [o for o in options_of(VerifyConfig).values() if o.name != "capture"],
    ids=lambda option: option.name,
)
def test_a_wrong_value_in_a_file_is_told_by_its_key(
    option: Option,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    lines = {"virtual_time": "true"} | {option.name: wrong_value(option)}
    text = "\n".join(f"{name} = {value}" for name, value in lines.items())
    Path("config.toml").write_text(f"[verify]\n{text}\n", encoding="utf-8")
    assert main(["verify", "--config", "config.toml", "--quiet"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"haptogram verify: config.toml: {option.name} "), said
    assert f"--{option.name.replace('_', '-')} " not in said


def test_the_same_value_on_the_command_line_is_told_by_its_option(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "config.toml"
    path.write_text('[verify]\nstamp = "2026-11-22"\nvirtual_time = true\n', encoding="utf-8")
    assert main(["verify", "--config", str(path), "--stamp", "yesterday", "--html", "-"]) == 2
    assert capsys.readouterr().err.startswith("haptogram verify: --stamp is 'yesterday', must be")


@pytest.mark.parametrize(
    "option", list(options_of(BoardConfig).values()), ids=lambda option: option.name
)
def test_a_wrong_value_in_a_url_is_told_by_its_key(option: Option) -> None:
    value = {int: "1.5", float: "nan", bool: "maybe"}.get(option.kind, "nowhere")
    with pytest.raises(HaptogramError) as refused:
        Serial(f"haptogram://?clock=virtual&{option.name}={value}")
    assert option.name in str(refused.value)
    assert "--" not in str(refused.value)

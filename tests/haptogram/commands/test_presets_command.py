"""``haptogram presets``, run as its command module runs it."""

import json

import pytest

from haptogram.cli import command_parser
from haptogram.errors import ConfigurationError


def run(*words):
    arguments = command_parser("presets").parse_args([*map(str, words)])
    return arguments.run(arguments)


def test_a_preset_is_shown_with_its_published_figures_next_to_ours(capsys):
    assert run("tactile-display", "autd3") == 0
    out = capsys.readouterr().out
    assert "tactile-display: 18 x 18" in out
    assert "sonicsurface" not in out
    (force,) = [line for line in out.splitlines() if "force at the focus" in line]
    assert force.split()[-4:] == ["16", "mN", "18.56", "mN"]
    (count,) = [line for line in out.splitlines() if "324" in line and "number" in line]
    assert count.split()[-2:] == ["324", "324"]
    assert "recollection" in out
    assert max(map(len, out.splitlines())) <= 100


def test_the_same_figures_go_to_json(tmp_path, capsys):
    assert run("autd3", "--json", tmp_path / "presets.json") == 0
    assert capsys.readouterr().out == ""
    rows = json.loads((tmp_path / "presets.json").read_text())["presets"]
    assert {row["preset"] for row in rows} == {"autd3"}
    assert rows[0]["ours"] == 249.0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("nothing",), "known are paper, tactile-display"),
        (("autd",), "did you mean autd3?"),
        (("autd3", "--json", "."), "it is a folder"),
    ],
)
def test_what_cannot_be_shown_is_refused(words, message):
    with pytest.raises(ConfigurationError, match=message):
        run(*words)


def test_a_file_that_cannot_be_written_is_said(capsys):
    assert run("autd3", "--json", "/dev/full") == 2
    assert "the disk is full" in capsys.readouterr().err

"""``python -m haptogram_paper``: text, JSON, page and pictures."""

import functools
import json
import re

import pytest

from haptogram.errors import ConfigurationError
from haptogram_paper import __main__


@pytest.fixture(scope="module", autouse=True)
def computed_once():
    """Every test asks for the same seconds of work; the first does it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(__main__, "reproduce_paper", functools.cache(__main__.reproduce_paper))
        patch.setattr(__main__, "compare_preset", functools.cache(__main__.compare_preset))
        yield


def run(*words):
    return __main__.main([*map(str, words)])


@pytest.mark.nightly
def test_the_text_names_every_cell_and_hides_no_deviation(capsys):
    assert run("--presets") == 0
    out = capsys.readouterr().out
    cells = re.findall(r"^ +(\d+x\d+) +(20|10|5|2) .*", out, re.MULTILINE)
    assert len(set(cells)) == 16
    assert out.count("NOT reproduced") == 16
    assert "averages within 7%: 16 of 16" in out
    assert "standard deviations within 7%: 0 of 16" in out
    assert all(f"({number})" in out for number in range(1, 10))
    assert "dimension: Pa^2 m^3 = N^2/m, not N" in out
    assert "bent along y, target (0, 60, 75) mm" in out
    assert "16 mN" in out
    assert "recollection" in out
    assert max(len(line) for line in out.splitlines() if "corrected" not in line) <= 100


@pytest.mark.nightly
def test_json_goes_to_a_file(tmp_path, capsys):
    assert run("--json", tmp_path / "paper.json") == 0
    assert "Table 1" in capsys.readouterr().out
    written = json.loads((tmp_path / "paper.json").read_text())
    assert len(written["table_1"]["cells"]) == 16
    assert written["table_1"]["averages_reproduced"] == 16
    assert written["table_1"]["deviations_reproduced"] == 0
    assert len(written["equations"]) == 9
    assert {row["preset"] for row in written["presets"]} >= {"tactile-display", "autd3"}


@pytest.mark.nightly
@pytest.mark.slow
def test_the_report_is_one_page_or_a_folder_of_pictures(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("haptogram_paper.pictures._STEP_M", 4e-3)
    monkeypatch.setattr("haptogram.report.figures.style.DPI", 40)
    assert run("--html", tmp_path / "out", "--stamp", "2026-11-22") == 0
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"index.html", "table1.png", "hemispheres.svg", "figure4_2_bent_x_xz.svg"} <= names
    page = (tmp_path / "out" / "index.html").read_text()
    assert page.count(">not reproduced</span>") == 16
    assert page.count("<img ") == 2 + 8
    assert not re.search(r'(src|href)="(?!data:)', page)
    assert "Reproduced in part: 16 of 16 averages of Table 1, 0 of 16 standard" in page
    assert "PASS" not in page
    assert "2026-11-22 00:00:00 UTC" in page
    capsys.readouterr()


@pytest.mark.parametrize("words", [("--html", "x.pdf"), ("--json", ".")])
def test_a_place_that_cannot_be_written_is_refused_before_the_work(words, monkeypatch):
    monkeypatch.setattr(__main__, "reproduce_paper", None)
    with pytest.raises(ConfigurationError):
        run(*words)

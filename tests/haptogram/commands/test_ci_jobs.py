"""What the commands leave for a CI job: summaries, annotations, dates, and results that repeat."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from haptogram.cli import main
from sim_device import blueprint

VERIFY = ["verify", "--object", "point", "--array", "4x4", "--virtual-time", "--quiet"]
CONFORM = ["conform", "--clause", "HG-2.3", "--clause", "HG-4.1/1", "--quiet"]
FAILING = [
    *("conform", "--quiet", "--clause", "HG-2.4/2"),
    *("--port", "haptogram://?clock=virtual&array=4x4&mutant=crc-unchecked"),
]
HOSTILE = "\n::error::<b>|`"  # 15 of the 16 bytes that HELLO has for it
FORMS = ("html", "junit", "summary")


def written(folder: Path, words: list[str], status: int = 0) -> dict[str, bytes]:
    """Run a command and return its files by form."""
    folder.mkdir()
    files = {form: folder / f"result.{form}" for form in (*FORMS, "json")}
    options = [word for form, path in files.items() for word in (f"--{form}", str(path))]
    assert main([*words, *options]) == status
    return {form: path.read_bytes() for form, path in files.items()}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("words", [VERIFY, CONFORM], ids=lambda words: words[0])
def test_in_virtual_time_every_file_repeats_byte_for_byte(tmp_path: Path, words: list[str]) -> None:
    first, second = (written(tmp_path / name, words) for name in ("first", "second"))
    assert first == second
    # A stamp brings the date, the machine and the command line.
    stamped = written(tmp_path / "stamped", [*words, "--stamp", "2026-11-22T15:00"])
    assert stamped["json"] == first["json"]
    for form in FORMS:
        assert stamped[form] != first[form]
        assert b"--stamp 2026-11-22T15:00" in stamped[form]
    (suite,) = ElementTree.fromstring(stamped["junit"])
    assert suite.get("timestamp") == "2026-11-22T15:00:00"
    assert suite.get("time") == ElementTree.fromstring(first["junit"])[0].get("time") is not None
    assert "timestamp" not in ElementTree.fromstring(first["junit"])[0].attrib


def test_cases_of_conform_take_the_time_of_the_port(tmp_path: Path) -> None:
    (suite,) = ElementTree.fromstring(written(tmp_path / "a", CONFORM)["junit"])
    times = [float(case.get("time", "nan")) for case in suite.iter("testcase")]
    assert all(time >= 0.0 for time in times)
    assert float(suite.get("time", "nan")) == pytest.approx(sum(times), abs=1e-3 * len(times))
    assert sum(times) > 0.0


def test_a_run_on_the_wall_clock_is_dated(tmp_path: Path) -> None:
    path = tmp_path / "soak.md"
    assert main(["soak", "--hours", "0.0003", "--quiet", "--summary", str(path)]) == 0
    text = path.read_text("utf-8")
    assert text.startswith("## haptogram soak: PASS: no damaged frame")
    assert "date: 20" in text
    assert "command: haptogram soak --hours 0.0003" in text


@pytest.mark.parametrize("words", [VERIFY, CONFORM], ids=lambda words: words[0])
def test_without_github_nothing_is_annotated(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 0
    assert "::" not in capsys.readouterr().out


def test_a_job_of_github_is_told_of_every_failure(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    assert main(FAILING) == 1
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("::")]
    title, _, text = lines[0].removeprefix("::error title=haptogram conform%3A ").partition("::")
    assert title.startswith("HG-2.4/2")  # whichever of its cases comes first
    assert text.startswith("FAILED [")


def test_annotations_leave_standard_output_to_a_file_that_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    assert main([*FAILING, "--summary", "-"]) == 1
    out, err = capsys.readouterr()
    assert out.startswith("## haptogram conform: FAIL: ")
    assert "\n::error " in err


@pytest.fixture
def hostile_firmware(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let virtual boards name themselves by what a page, a job or a terminal might obey."""
    plain = blueprint.BoardSettings.of

    def of(config: Any) -> Any:
        return dataclasses.replace(plain(config), firmware=HOSTILE)

    monkeypatch.setattr(blueprint.BoardSettings, "of", of)


@pytest.mark.usefixtures("hostile_firmware")
@pytest.mark.parametrize("words", [VERIFY, FAILING], ids=lambda words: words[0])
def test_the_name_of_a_firmware_is_text_everywhere(
    tmp_path: Path,
    words: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("GITHUB_ACTIONS", "true")
    files = written(tmp_path / "a", words, status=0 if words is VERIFY else 1)
    out, err = capsys.readouterr()
    commands = [line for line in (out + err).splitlines() if line.lstrip().startswith("::")]
    assert all(line.startswith("::error title=haptogram ") for line in commands)
    assert HOSTILE not in out + err
    assert HOSTILE.encode() not in b"".join(files.values())
    shown = "\ufffd::error::<b>|`"
    assert b"<b>|" not in files["html"]
    assert "\ufffd::error::&lt;b&gt;|`" in files["html"].decode()
    junit = ElementTree.fromstring(files["junit"])
    assert shown in {item.get("value") for item in junit.iter("property")}
    summary = files["summary"].decode()
    assert "<b>" not in summary
    if words is FAILING:
        assert "\ufffd::error::&lt;b&gt;\\|\\`" in summary

"""Outputs: refused before the work if they cannot be written; - is standard output."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from haptogram.cli import main
from process_limits import run_with_full_disk

ROOT = Path(__file__).resolve().parents[3]
CIRCLE = ["--object", "point", "--array", "6x6", "--virtual-time", "--quiet"]
#: Every command that writes, with words that make it quick, and its options that name a file.
WRITERS = {
    "verify": (CIRCLE, ("--json", "--junit", "--html", "--frames", "--summary")),
    "conform": (
        ["--clause", "HG-2.3/1", "--quiet"],
        ("--json", "--junit", "--html", "--summary", "--write-baseline"),
    ),
    "soak": (
        ["--hours", "0.0001", "--quiet"],
        ("--json", "--junit", "--html", "--summary", "--resume"),
    ),
    "bench": (["--seconds", "0.1"], ("--json", "--html", "--summary", "--picture")),
    "field": (["--array", "4x4"], ("--picture",)),
    "modulation": (
        ["am", "--array", "4x4", "--center-mm", "0,0,80"],
        ("--csv", "--json"),
    ),
    "presets": (["autd3"], ("--json",)),
    "sweep": ([str(ROOT / "tests/data/sweep.toml"), "--quiet"], ("--rows", "--html")),
}
OPTIONS = [(command, option) for command, (_, options) in WRITERS.items() for option in options]
SUFFIX = {"--picture": ".png", "--html": ".html", "--rows": ".csv"}


def everything_in(folder: Path) -> dict[str, str]:
    return {str(path): path.read_text() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(("command", "option"), OPTIONS)
@pytest.mark.parametrize("kind", ["folder", "below a file", "no permission"])
def test_what_cannot_be_written_is_refused_before_the_work(
    command: str,
    option: str,
    kind: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / f"there{SUFFIX.get(option, '')}"
    if kind == "folder":
        path.mkdir()
    elif kind == "below a file":
        path.write_text("kept")
        path = path / f"result{SUFFIX.get(option, '')}"
    else:
        monkeypatch.setattr(Path, "touch", _forbidden)
    before = everything_in(tmp_path)
    words, _ = WRITERS[command]
    assert main([command, *words, option, str(path)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith(f"haptogram {command}: {option} '{path}' cannot be written: ")
    assert said.err.count("\n") == 1
    assert everything_in(tmp_path) == before


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("command", "option"),
    [*OPTIONS, *((name, "--record") for name in ("verify", "conform", "soak", "bench"))],
)
def test_a_disk_that_takes_no_byte_is_one_line_and_keeps_the_older_result(
    command: str, option: str, tmp_path: Path
) -> None:
    """The older recording is kept only until the run begins."""
    path = tmp_path / f"result{SUFFIX.get(option, '')}"
    if option not in ("--resume", "--write-baseline"):  # they read what is there
        path.write_text("old")
    before = everything_in(tmp_path)
    words = [command, *WRITERS[command][0], option, str(path)]
    done = run_with_full_disk(words, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"haptogram {command}: ")
    assert done.stderr.count("\n") == 1
    assert option == "--record" or everything_in(tmp_path) == before
    assert everything_in(tmp_path).keys() == before.keys()


def _forbidden(*_: object, **__: object) -> None:
    raise PermissionError(13, "Permission denied")


@pytest.mark.parametrize(
    ("command", "first", "second"),
    [(command, *options[:2]) for command, (_, options) in WRITERS.items() if len(options) > 1],
)
@pytest.mark.parametrize("name", ["same", "-"])
def test_two_outputs_with_one_name_are_refused(
    command: str,
    first: str,
    second: str,
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    name = f"{name}.png" if name == "same" and "--picture" in (first, second) else name
    other = name if name == "-" else f"./{name}"
    words, _ = WRITERS[command]
    assert main([command, *words, first, name, second, other]) == 2
    said = capsys.readouterr()
    assert f"{first} and {second} are both" in said.err
    assert said.out == ""
    assert not list(tmp_path.iterdir())


@pytest.mark.sampled(5)
@pytest.mark.parametrize(
    ("command", "option"),
    [row for row in OPTIONS if row[1] != "--resume" and row[0] != "bench"],
)
def test_a_minus_is_standard_output_and_nothing_else_is_written_there(
    command: str, option: str, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    words, _ = WRITERS[command]
    assert main([command, *words, option, "-"]) == 0
    written = capfdbinary.readouterr().out
    if option == "--picture":
        assert written.startswith(b"\x89PNG")
        assert written.endswith(b"IEND\xaeB`\x82")
    elif option == "--json":
        assert json.loads(written)
    elif option == "--junit":
        assert ElementTree.fromstring(written) is not None
    elif option == "--html":
        assert written.lower().startswith(b"<!doctype html>")
        assert written.rstrip().endswith(b"</html>")
    elif option == "--csv":
        assert written.startswith(b"time_s,x_mm,")
    else:
        assert written
    assert not Path("-").exists()


def test_the_text_goes_to_standard_error_then(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", *CIRCLE, "--json", "-"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["verdict"] == "pass"
    assert said.err.startswith("PASS")
    assert "wrote" not in said.err


def test_a_file_that_is_there_is_kept_until_the_result_is(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_text("old")
    assert main(["verify", *CIRCLE, "--port", "/dev/absent", "--json", str(path)]) == 2
    assert path.read_text() == "old"


def test_a_checkpoint_is_no_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["soak", "--hours", "0.001", "--resume", "-"]) == 2
    assert "--resume -: a checkpoint is read again; name a file" in capsys.readouterr().err


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        assert main(["presets", "--json", str(tmp_path / "x.json")]) == 2
    finally:
        tmp_path.chmod(0o700)


@pytest.mark.nightly
@pytest.mark.parametrize("is_pipe", [False, True])
def test_standard_output_by_its_other_name_holds_the_result_alone(
    is_pipe: bool, tmp_path: Path
) -> None:
    words = ["verify", *CIRCLE, "--json", "/dev/stdout"]
    out = tmp_path / "out"
    with out.open("wb") as file:
        done = subprocess.run(
            [sys.executable, "-m", "haptogram", *words],
            stdout=subprocess.PIPE if is_pipe else file,
            stderr=subprocess.PIPE,
            check=True,
        )
    assert json.loads(done.stdout if is_pipe else out.read_bytes())["verdict"] == "pass"
    assert done.stderr.startswith(b"PASS")
    assert b"wrote" not in done.stderr


@pytest.mark.parametrize(
    "words",
    [
        ["verify", "--port=/dev/no-such-port"],
        ["verify", "--virtual-time", "--object=circle", "--radius-mm=450"],
        ["verify", "--virtual-time", "--object=point", "--rate-hz=40000"],
        ["verify", "--virtual-time", "--object=point", "--dialect=ultraino", "--rate-hz=40000"],
        ["verify", "--virtual-time", "--object=point", "--lead-ms=9000"],
        ["bench", "--port=/dev/no-such-port"],
        ["bench", "--seconds=1", "--baud=9600"],
        ["conform", "--port=/dev/no-such-port"],
        ["board", "--serial=/dev/no-such-port"],
    ],
    ids=" ".join,
)
@pytest.mark.parametrize("was_there", [True, False])
def test_a_run_that_is_refused_leaves_the_recording_that_was_there(words, was_there, tmp_path):
    path = tmp_path / "run.mcap"
    if was_there:
        path.write_bytes(b"an older run")
    assert main([*words, "--record", str(path)]) != 0
    assert path.exists() == was_there
    assert not was_there or path.read_bytes() == b"an older run"


def test_a_run_replaces_the_whole_recording_that_was_there(tmp_path):
    paths = [tmp_path / "new.mcap", tmp_path / "old.mcap"]
    paths[1].write_bytes(b"an older run" * 100_000)
    for path in paths:
        main(["verify", "--virtual-time", "--object=point", "--record", str(path), "--quiet"])
    assert paths[0].read_bytes() == paths[1].read_bytes()

"""``haptogram conform --capture``: a board in a process of its own, its pins, and bad input."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest

pytest.importorskip("mcap")

from haptogram.cli import main
from haptogram.commands.conform.command import conform_by_captures
from haptogram.commands.conform.options import PinConfig
from haptogram.commands.shell.captures import judge_captures_at_port
from haptogram.conformance.verdict import SuiteResult
from haptogram.evidence.recordings.writer import RecordingWriter

MAP = """reference = "carrier"
to_board = "to_board"
to_host = "to_host"
elements = "e{}"
"""
BOARD = (
    "board --link ./board --array 4x4 --baud 3000000 --seed 1 --quiet --capture pins.vcd "
    "--capture-ms 60000 --capture-elements 0,5,10"
)
RUN = "--clause HG-8.3/1 --clause HG-6.11/1 --quiet"
ANOTHER = "conform --clause HG-8.3/1 --quiet --record run.mcap"
JUDGED = "conform --from-recording run.mcap --capture pins.vcd --channels map.toml"


def run_of_a_board(*options):
    """Run cases against a board in another process, which writes its capture when it ends."""
    words = [*BOARD.split(), *options]
    board = subprocess.Popen([sys.executable, "-m", "haptogram", *words])
    try:
        deadline_s = time.monotonic() + 60.0
        while not Path("board").is_symlink() and time.monotonic() < deadline_s:
            time.sleep(0.05)
        status = main([*f"conform --port ./board {RUN} --record run.mcap".split()])
    finally:
        board.send_signal(signal.SIGTERM)
        board.wait(60.0)
    return status


@pytest.fixture(scope="module")
def lying(tmp_path_factory):
    """A folder with the run of a board whose pins sound on for 2 ms, whatever it says."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("lying")
        patch.chdir(folder)
        assert run_of_a_board("--capture-lingers", "all=2000") == 0
    return folder


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, lying):
    monkeypatch.chdir(tmp_path)
    Path("map.toml").write_text(MAP)
    for name in ("run.mcap", "pins.vcd"):
        shutil.copy(lying / name, name)


@pytest.mark.pty
@pytest.mark.realtime
def test_pins_that_sound_on_fail_beside_words_that_pass(capsys):
    files = "--json c.json --junit c.xml --html c.html"
    assert main([*f"{JUDGED} {files}".split()]) == 1
    said = capsys.readouterr().out
    assert "HG-6.6/1-pins  FAILED [EXTERNAL: seen from outside" in said
    assert "captured     pins.vcd shows " in said
    found = json.loads(Path("c.json").read_text())
    by_case = {result["case"]: result for result in found["results"]}
    assert by_case["HG-6.11/1"]["behaviour"] == "OK"
    pins = [result for name, result in by_case.items() if name.endswith("-pins")]
    assert {result["evidence"] for result in pins} == {"EXTERNAL"}
    assert "OK" in {result["behaviour"] for result in pins}
    assert by_case["HG-6.6/1-pins"]["behaviour"] == "FAILED"
    assert "go on sounding" in by_case["HG-6.6/1-pins"]["detail"]
    failed = [
        case.get("name").split()[0]
        for case in ElementTree.parse("c.xml").getroot().iter("testcase")
        if case.find("failure") is not None
    ]
    assert failed == [name for name in by_case if by_case[name]["behaviour"] == "FAILED"]
    assert "[EXTERNAL]" in Path("c.xml").read_text()
    assert "HG-6.6/1-pins" in Path("c.html").read_text()


@pytest.mark.pty
@pytest.mark.realtime
def test_failures_of_pins_can_be_expected(capsys):
    assert main([*f"{JUDGED} --write-baseline known.toml".split()]) == 1
    assert main([*f"{JUDGED} --baseline known.toml".split()]) == 0
    assert "were expected" in capsys.readouterr().out


BAD = {
    "conform --capture pins.vcd --channels map.toml": "--capture is of a run at --port",
    "conform --from-recording run.mcap": "name the --capture",
    "conform --port x --capture pins.vcd": "--channels is missing",
    f"{JUDGED} --port x": "--port acts only where cases are run",
    JUDGED.replace("map.toml", "blind.toml"): "neither line of the UART",
    JUDGED.replace("map.toml", "mute.toml"): "to_host carries",
    JUDGED.replace("map.toml", "slow.toml"): "in a bit of to_board at 9000000 baud",
    JUDGED.replace("run.mcap", "verify.mcap"): "(of verify) holds no result",
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("words", BAD)
def test_bad_input_is_one_line(words, capsys):
    lines = (line for line in MAP.splitlines() if not line.startswith("to_"))
    Path("blind.toml").write_text("\n".join(lines))
    Path("mute.toml").write_text(MAP.replace('"to_host"', '"carrier"'))
    Path("slow.toml").write_text(f"baud = 9000000\n{MAP}")
    RecordingWriter(Path("verify.mcap"), command="verify").close()
    assert main([*words.split()]) == 2
    said = capsys.readouterr()
    assert BAD[words] in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""


@pytest.mark.pty
def test_a_capture_of_another_run_is_no_evidence(capsys):
    assert main([*ANOTHER.split()]) == 0
    capsys.readouterr()
    assert main([*JUDGED.split()]) == 2
    assert "pins.vcd shows another run than run.mcap" in capsys.readouterr().err


def test_a_capture_of_another_run_is_no_evidence_at_a_port_either(capsys):
    os.utime("pins.vcd", (1.0, 1.0))
    config = PinConfig.of(capture=(Path("pins.vcd"),), channels=(Path("map.toml"),))

    def judge():
        return conform_by_captures(config, SuiteResult(()), {1, 2}, "the one at the port", {})

    program = "haptogram conform"
    assert judge_captures_at_port(program, config, 0.0, judge, interrupted=False) is None
    said = capsys.readouterr().err
    assert "pins.vcd shows another run than the one at the port: 0 of its" in said
    assert said.count("\n") == 1

"""``verify`` and ``watch`` by captures of the pins of boards of other makers."""

import json
import re
import shutil
import threading
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mcap")

from board_pins import CapturedBoard, frames_of, model_of
from haptogram.acoustics import Calibration
from haptogram.cli import main
from haptogram.driver.frames.dialect_frames import DialectFrame
from haptogram.evidence.recordings.reader import Recording
from haptogram.evidence.recordings.recorded_run import record_intended, recorded_run
from haptogram.evidence.recordings.writer import RecordingWriter

LATE = tuple(range(3, 256, 8))
JUDGED = "verify --from-recording run.mcap --capture pins.sr --channels map.toml"
SURFACE = "--dialect sonicsurface --object circle --radius-mm 20 --resolution-mm 40 --quiet"
PORT = "--port haptogram://?clock=virtual&dialect=sonicsurface"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("map.toml").write_text('reference = "sync"\nelements = "p{}"\n')
    Path("few.toml").write_text('reference = "sync"\n[elements]\np0 = 0\np1 = 1\np9 = 9\n')


GAP_S = 4e-3  # from frame to frame
_KEPT = {}


def captured(count=3, **defects):
    """Write pins.sr and run.mcap of one run, which is made once."""
    if (run := (count, repr(defects))) not in _KEPT:
        frames = frames_of("sonicsurface", count)
        board = CapturedBoard("sonicsurface", frames, gap_s=GAP_S, **defects)
        board.capture(Path("pins.sr"))
        with RecordingWriter(Path("run.mcap"), command="verify") as writer:
            record_intended(writer, model_of("sonicsurface"), board.intended)
        _KEPT[run] = board, [Path(name).read_bytes() for name in ("pins.sr", "run.mcap")]
    board, files = _KEPT[run]
    for name, content in zip(("pins.sr", "run.mcap"), files, strict=True):
        Path(name).write_bytes(content)
    return board


def test_a_recorded_run_keeps_the_steps_of_its_board():
    board = captured()
    assert recorded_run(Recording(Path("run.mcap"))).intended == board.intended


def test_late_channels_become_a_calibration_and_the_verdict_says_what_is_left(capsys):
    captured(late_step=LATE)
    words = f"{JUDGED} --json run.json --html run.html --pin-calibration known.csv"
    assert main(words.split()) == 1
    said = capsys.readouterr().out
    assert "elements n mod 8 = 3 (32 of 256 pins): one step of 32 late, +11.2 degrees" in said
    result = json.loads(Path("run.json").read_text())
    rows = result["captures"]["captures"][0]["elements_shown"]
    assert [row["element"] for row in rows] == list(range(256))
    assert rows[3]["phase_deg"] == pytest.approx(11.25, abs=0.3)
    assert rows[4]["phase_deg"] == pytest.approx(0.0, abs=0.3)
    assert rows[4]["duty"] == pytest.approx(0.5, abs=0.01)
    assert "Elements at their pins" in Path("run.html").read_text()
    known = Calibration.from_file("known.csv")
    lags = np.degrees(known.phase_rad)
    assert lags[list(LATE)] == pytest.approx(11.25, abs=0.3)
    assert known.gain == pytest.approx(1.0, abs=0.01)

    Path("map.toml").write_text('reference = "sync"\ncalibration = "known.csv"\nelements = "p{}"\n')
    assert main([*JUDGED.split(), "--pin-calibration", "again.csv"]) == 0
    assert "PASS: all 256 elements" in capsys.readouterr().out
    again = Calibration.from_file("again.csv")  # what was known is in it
    assert np.degrees(again.phase_rad) == pytest.approx(lags, abs=0.3)
    captured(late_us={9: 2.0}, late_step=LATE)
    assert main(JUDGED.split()) == 1
    assert "element 9 (p9): phase off by +28.8 degrees in every frame" in capsys.readouterr().out


def test_a_run_at_a_port_is_judged_by_its_pins(capsys):
    """The board in this program has no pins: those of one that got the same codes are judged."""
    line = f"verify {SURFACE} {PORT} --record run.mcap"
    assert main(line.split()) == 0
    capsys.readouterr()
    intended = recorded_run(Recording(Path("run.mcap"))).intended
    frames = [
        DialectFrame(
            f.foci,
            tuple(int(c) * 32 // 256 for c in f.drive.phase_codes),
            tuple(range(f.drive.count)),
            f.drive,
            32,
        )
        for f in intended
    ]
    CapturedBoard("sonicsurface", frames, gap_s=GAP_S).capture(Path("pins.sr"))
    assert main(JUDGED.split()) == 0
    assert "PASS: all 256 elements" in capsys.readouterr().out
    analyser = threading.Timer(1.0, shutil.copyfile, ("pins.sr", "new.sr"))
    analyser.start()
    assert main(f"verify {SURFACE} {PORT} --capture new.sr --channels map.toml".split()) == 0
    analyser.join()
    said = capsys.readouterr()
    assert "waiting for new.sr: end the capture" in said.err
    assert "drive pins\nPASS: all 256 elements" in said.out
    few = "verify --from-recording run.mcap --capture pins.sr --channels few.toml"
    assert main(few.split()) == 0
    assert "PASS: 3 of 256 elements" in capsys.readouterr().out


def test_a_watch_tells_what_pins_radiate(capsys):
    board = captured()
    words = "watch --dialect sonicsurface --capture pins.sr --channels map.toml --json w.json"
    x, y, z = 1e3 * np.array(board.frames[0].foci[0].position_m)
    assert main([*words.split(), "--html", "w.html"]) == 0
    said = capsys.readouterr().out
    lines = [line for line in said.splitlines() if "one focus at" in line]
    assert len(lines) == 3
    place = re.search(r"\((.*?)\) mm", lines[0])[1].split(", ")
    assert [float(v) for v in place] == pytest.approx([x, z, -y], abs=0.4)  # in its own axes
    assert "pins of all 256 elements were captured" in said
    assert json.loads(Path("w.json").read_text())["verdict"] == "pass"
    assert main([*words.replace("map.toml", "few.toml").split()]) == 3
    assert "pins of 3 of 256 elements were captured" in capsys.readouterr().out


def test_a_capture_alone_tells_the_carrier(capsys):
    board = CapturedBoard("ultraino-mega64", frames_of("ultraino-mega64", 2), every=2)
    board.capture(Path("half.sr"), range(8))
    assert main(["capture", "half.sr", "--map", "map.toml", "--quiet"]) == 1
    (line,) = (text for text in capsys.readouterr().out.splitlines() if "wrong" in text)
    assert line.endswith("p7): 20000 Hz: a pulse in every 2 periods of the carrier of 40000 Hz")
    board = CapturedBoard(
        "ultraino-mega64", frames_of("ultraino-mega64", 2), busy_s=4e-3, gap_s=12e-3
    )
    board.capture(Path("busy.sr"), range(8))
    assert main(["capture", "busy.sr", "--map", "map.toml", "--json", "busy.json"]) == 0
    said = capsys.readouterr().out
    assert "note: the carrier is not steady: periods of 25.00 to " in said
    assert "note: amplitude for " in said
    latches = json.loads(Path("busy.json").read_text())["latches"]
    assert [latch["silent"] for latch in latches] == [
        True,
        False,
        False,
        True,
    ]  # off, 2 frames, off
    assert not any(latch["torn"] for latch in latches)


BAD = {
    "watch --dialect sonicsurface --capture pins.sr": "--capture needs the map of its --channels",
    "watch --capture pins.sr --channels map.toml": "--capture needs --dialect",
    "watch --dialect ultraino-mega64 --capture pins.sr --channels map.toml": "elements 0 to 63",
    f"{JUDGED.replace('map', 'known')}": "element 1 (p1) is missing, which known.toml names",
    "verify --object point --pin-calibration a.csv": "is of captured pins: name the --capture",
    f"{JUDGED} --pin-calibration map.toml": "map.toml",
}


@pytest.mark.parametrize("words", BAD)
def test_bad_input_is_one_line(words, capsys):
    captured(1)
    Path("known.toml").write_text(f'calibration = "one.csv"\n{Path("map.toml").read_text()}')
    Calibration(np.ones(1), np.zeros(1), np.zeros((1, 3))).to_file("one.csv")
    assert main(words.split()) == 2
    said = capsys.readouterr().err
    assert BAD[words] in said
    assert said.count("\n") == 1

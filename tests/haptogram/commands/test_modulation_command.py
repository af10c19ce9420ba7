"""``haptogram modulation``, and the same frames sent by ``haptogram verify``."""

import csv
import json
import re

import numpy as np
import pytest

from haptogram.cli import main
from haptogram.objects.modulation import Modulation

SMALL = ("--array", "8x8", "--center-mm", "0,0,80")


def run(*words):
    return main(["modulation", *map(str, words), *SMALL])


def test_the_text_names_levels_lines_and_images(capsys):
    assert run("am") == 0
    out = capsys.readouterr().out
    assert "AM at 200 Hz, depth 100% of the force; point" in out
    assert "frames: 5 of 1 ms at 1000 frames/s, 1 period, 5 in each" in out
    lines = {
        float(line.split()[0]): (float(line.split()[2]), line)
        for line in out.splitlines()
        if re.match(r" +\d+ +[\d.]+ +-?[\d.]+ +\S", line)
    }
    assert lines[200.0][0] == 0.0
    assert "image: frame rate - modulation" in lines[800.0][1]
    # The hold alone would make it -12.0 dB; transducers of 2 kHz take off some more.
    hold_db = 20 * np.log10(np.sinc(0.8) / np.sinc(0.2))
    assert hold_db - 6.0 < lines[800.0][0] < hold_db
    assert "warning: 3% of the power" in out
    assert max(map(len, out.splitlines())) <= 100


def test_a_faster_loop_has_no_images_where_skin_feels(capsys):
    assert run("am", "--rate-hz", "8000", "--depth", "0.5") == 0
    out = capsys.readouterr().out
    assert "warning" not in out
    assert "depth 50% of the force" in out


def test_a_path_that_leaves_gaps_is_told_until_fewer_rounds_close_them(capsys):
    assert run("stm", "--modulation-hz", "100", "--radius-mm", "30") == 0
    told = " ".join(capsys.readouterr().out.split())
    step, width = map(
        float,
        re.search(
            r"warning: ([\d.]+) mm from frame to frame, and a focus is ([\d.]+) mm wide: the path "
            r"has gaps; fewer rounds",
            told,
        ).groups(),
    )
    assert step > width
    assert run("stm", "--modulation-hz", 90.0 * width / step, "--radius-mm", "30") == 0
    assert "gaps" not in capsys.readouterr().out


def test_frames_and_json_say_the_same(tmp_path, capsys):
    places = [tmp_path / name for name in ("lm.csv", "lm.json")]
    words = zip(("--csv", "--json"), places, strict=True)
    assert run("lm", "--shift-mm", "0,2,0", *(word for pair in words for word in pair)) == 0
    frames, document = (place.read_text() for place in places)
    expected = Modulation("lm", shift_m=(0.0, 2e-3, 0.0)).frames([(0.0, 0.0, 0.08)], 1000.0)
    rows = np.array(list(csv.reader(frames.splitlines()))[1:], dtype=float)
    assert rows[:, 1:4] == pytest.approx(expected.points_m * 1e3, abs=1e-4)
    assert rows[:, 0] == pytest.approx(np.arange(expected.count) / 1000.0)
    found = json.loads(document)
    assert (found["modulation"], found["frequency_hz"], found["depth"]) == ("lm", 200.0, None)
    assert f"mean {found['mean_pa']:.1f} Pa" in capsys.readouterr().out
    assert run("dwell", "--object", "point", "--json", "-") == 0
    assert json.loads(capsys.readouterr().out)["spectrum"] == []


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            ("am", "--modulation-hz", "501"),
            "--modulation-hz is 501; at 1000 frames/s it can be 500",
        ),
        (("am", "--depth", "2"), "--depth is 2, must be 0 to 1"),
        (("am", "--dwell-ms", "0.1"), "a dwell of 0.1 ms is 0.1 frames at 1000 Hz"),
        (("stm", "--object", "point"), "number of points on the path is 1, must be 2"),
        (("lm", "--shift-mm", "0,0,0"), "the shift is 0 mm long"),
        (("lm", "--shift-mm", "0,0,-90"), "height"),
        (("am", "--bandwidth-hz", "0"), "--bandwidth-hz is 0, must be 1 to 1000000 Hz"),
        (("am", "--preset", "none"), "known are paper"),
        (("am", "--preset", "autd3", "--pitch-mm", "8"), "--pitch-mm is 8; --preset autd3 brings"),
        (("am", "--csv", "/dev/full"), "'/dev/full' cannot be written: the disk is full"),
        (("am", "--json", "/dev/full"), "'/dev/full' cannot be written: the disk is full"),
    ],
)
def test_what_cannot_be_is_one_line_with_value_and_limit(words, told, capsys):
    small = ("--center-mm", "0,0,80") if "--preset" in words else SMALL
    assert main(["modulation", *words, *small]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    "words",
    [
        ("--object", "point", "--modulation", "am", "--mode", "points", "--modulation-hz", "250"),
        ("--object", "point", "--modulation", "am", "--mode", "sequence", "--depth", "0.5"),
        ("--object", "point", "--modulation", "am", "--mode", "drives", "--rate-hz", "500"),
        ("--object", "point", "--modulation", "lm", "--shift-mm", "-2,1,0"),
        ("--object", "circle", "--radius-mm", "10", "--modulation", "stm"),
        ("--object", "line", "--radius-mm", "5", "--dwell-ms", "3"),
    ],
)
def test_a_board_is_sent_every_frame_of_a_modulation_and_latches_it(words, tmp_path, capsys):
    found = tmp_path / "found.json"
    status = main(["verify", *SMALL, "--virtual-time", "--quiet", *words, "--json", str(found)])
    said = capsys.readouterr()
    assert status == 0, said.out + said.err
    result = json.loads(found.read_text())
    assert result["configuration"]["modulation"] in (None, *words)
    assert result["frames"]["on_target"] == result["frames"]["sent"] >= 2

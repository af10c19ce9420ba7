"""``haptogram field``, run as its command module runs it."""

import re

import numpy as np
import pytest

from haptogram.acoustics import (
    AcousticModel,
    Drive,
    NumpyEngine,
    Resonator,
    Transducer,
    TransducerArray,
    exposure_at,
    focus_phases,
)
from haptogram.acoustics.field.engines.engine import why_not_compiled
from haptogram.cli import command_parser, main
from haptogram.commands.field.scene import FieldScene
from haptogram.errors import ConfigurationError
from haptogram.objects.modulation import Modulation

pytestmark = pytest.mark.sampled(3)


def parse(*words):
    return command_parser("field").parse_args([*map(str, words)])


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("haptogram.report.figures.style.DPI", 40)

    def run(*words):
        arguments = parse(*words)
        return arguments.run(arguments)

    return run


def test_a_focus_is_drawn_and_described(run, tmp_path, capsys):
    assert run("--focus-mm", "20,0,120", "--picture", "field.png", "--step-mm", "3") == 0
    assert (tmp_path / "field.png").read_bytes().startswith(b"\x89PNG")
    out = capsys.readouterr().out
    level, db = re.search(r"target \(20, 0, 120\) mm: (\d+) Pa RMS, ([\d.]+) dB SPL", out).groups()
    assert float(level) == pytest.approx(4132, abs=5)
    assert float(db) == pytest.approx(20 * np.log10(float(level) / 20e-6), abs=0.1)
    assert "mm from the target" in out
    assert "shock lengths from the array" in out
    assert "mN" in out
    (tmp_path / "field.png").unlink()
    assert run("--focus-mm", "20,0,120") == 0
    assert capsys.readouterr().out == out
    assert not list(tmp_path.iterdir())  # no picture unasked
    assert "no judgement" in " ".join(out.split())


@pytest.mark.parametrize(
    ("array", "focus", "said"),
    [
        ("16x16", "0,0,200", r"7\.\d\d mm from the target \(expected about 8\.\d\d mm, by diff"),
        ("16x16", "0,0,400", r"52\.\d\d mm from the target \(by diffraction; too far for a pred"),
        ("6x6", "0,0,400", r"285\.\d\d mm from the target \(the aperture is too small to focus"),
        ("5x5", "0,0,400", r"\(the aperture is too small|no focus: no maximum of \|p\|"),
    ],
)
def test_a_focal_shift_that_cannot_be_predicted_is_said_to_be_so(run, capsys, array, focus, said):
    assert run("--array", array, "--focus-mm", focus) == 0
    out = capsys.readouterr().out
    assert re.search(said, out)
    assert "reflecting disc of 20 mm diameter, parallel to the array's face" in out


MOVED = {
    "sideways": (np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]), [0.1, 0.0, -0.2]),
    "down": (np.diag([1.0, -1.0, -1.0]), [0.0, 0.3, 0.5]),
    "moved": (np.eye(3), [0.3, -0.2, 0.5]),
}


@pytest.mark.nightly
@pytest.mark.parametrize("where", MOVED)
def test_an_array_that_is_turned_and_moved_is_described_by_the_same_figures(
    run, tmp_path, capsys, where
):
    turn, shift_m = MOVED[where]
    here = TransducerArray.grid(10, 8)
    there, target = here.moved(turn, shift_m), np.array([0.02, 0.01, 0.12])
    text = {}
    for name, array, focus in (
        ("here", here, target),
        ("there", there, turn @ target + shift_m),
    ):
        rows = np.column_stack([array.positions_m * 1e3, array.normals]) + 0.0
        lines = [",".join(f"{value:.9g}" for value in row) for row in rows]
        (tmp_path / name).write_text("\n".join(["x,y,z,nx,ny,nz", *lines]))
        place = ",".join(f"{value * 1e3:.9g}" for value in focus)
        assert (
            run(
                "--array",
                tmp_path / name,
                f"--focus-mm={place}",
                "--picture",
                "a.png",
                "--step-mm",
                "3",
            )
            == 0
        )
        out = capsys.readouterr().out
        text[name] = re.sub(r"\([-\d., e]+\)", "(place)", out)
    assert text["there"] == text["here"]


@pytest.mark.parametrize("where", MOVED)
def test_a_drive_of_a_turned_array_is_looked_at_where_it_is_loudest(tmp_path, where):
    turn, shift_m = MOVED[where]
    array = TransducerArray.grid(10, 8).moved(turn, shift_m)
    focus = turn @ np.array([0.02, 0.01, 0.08]) + shift_m
    rows = np.column_stack([array.positions_m * 1e3, array.normals]) + 0.0
    lines = ["x,y,z,nx,ny,nz", *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    (tmp_path / "array.csv").write_text("\n".join(lines))
    model = AcousticModel(array, AcousticModel.default().medium, Transducer())
    codes = Drive.from_weights(np.exp(1j * focus_phases(model, focus))).phase_codes
    lines = ["phase,amplitude", *(f"{code},255" for code in codes)]
    (tmp_path / "drive.csv").write_text("\n".join(lines))
    scene = FieldScene.from_arguments(
        parse("--array", tmp_path / "array.csv", "--drive", tmp_path / "drive.csv")
    )
    assert np.linalg.norm(np.array(scene.look_m) - focus) < 8e-3


@pytest.mark.parametrize(
    ("array", "said"), [("1x1", "rises up to the array"), ("2x2", "too small to focus there")]
)
def test_an_array_too_small_to_focus_is_described_as_such(run, capsys, array, said):
    assert run("--array", array) == 0
    out = capsys.readouterr().out
    assert said in out
    assert "nan" not in out


@pytest.mark.parametrize(
    "words",
    [
        ("--plane", "xy", "--quantity", "phase", "--picture", "a.svg"),
        ("--plane", "yz", "--quantity", "force", "--picture", "a.svg"),
        ("--preset", "sonicsurface", "--picture", "a.svg"),
        ("--object", "circle", "--radius-mm", "15", "--plane", "xy", "--picture", "a.svg"),
        ("--array", "8x8", "--pitch-mm", "8", "--picture", "a.svg"),
    ],
)
def test_every_view_is_written_as_a_picture_with_axes_in_mm(run, tmp_path, words, capsys):
    assert run(*words, "--step-mm", "3", "--quiet") == 0
    picture = (tmp_path / "a.svg").read_text()
    assert "<svg" in picture
    assert "(mm)" in picture or "(Hz)" in picture
    assert capsys.readouterr().out == ""


@pytest.mark.nightly
def test_a_drive_from_a_file_is_drawn_around_its_focus(run, tmp_path, capsys):
    drive = Drive.from_weights(
        np.exp(1j * focus_phases(AcousticModel.default(), (0.02, 0.0, 0.12)))
    )
    rows = zip(drive.phase_codes, drive.amplitude_codes, strict=True)
    (tmp_path / "drive.csv").write_text(
        "phase,amplitude\n" + "".join(f"{phase},{amplitude}\n" for phase, amplitude in rows)
    )
    assert run("--drive", "drive.csv", "--picture", "drive.svg", "--step-mm", "3") == 0
    picture = (tmp_path / "drive.svg").read_text()
    assert "peak" in picture
    assert "target" not in picture
    assert "focus (20, 0, 120) mm: 4132 Pa RMS" in capsys.readouterr().out
    place = ("--at-mm", "20,0,125")
    assert run("--drive", "drive.csv", *place, "--picture", "a.svg", "--step-mm", "3") == 0
    there = NumpyEngine(AcousticModel.default()).pressure(drive.weights(), [(0.02, 0.0, 0.125)])
    said = f"at (20, 0, 125) mm: {abs(there[0]) / np.sqrt(2):.0f} Pa RMS"
    assert said in capsys.readouterr().out
    assert FieldScene.from_arguments(parse("--drive", "drive.csv", *place)).look_m[2] == 0.125
    scene = FieldScene.from_arguments(parse("--drive", "drive.csv"))
    assert np.linalg.norm(np.subtract(scene.look_m, (0.02, 0.0, 0.12))) < 0.02


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("phase\n1\n", "first line"),
        ("phase,amplitude\n1,2\n", "1 elements"),
        ("phase,amplitude\n" + "1,x\n" * 256, ":2:"),
        ("phase,amplitude\n" + "1,256\n" * 256, "256"),
        ("phase,amplitude\n" + f"1,{10**20}\n" * 256, ":2:"),
        ("phase,amplitude\n\n1," + "0" * 140_000, ":3: field larger than"),
    ],
)
def test_a_bad_drive_is_refused_with_its_place(run, tmp_path, text, message):
    (tmp_path / "drive.csv").write_text(text)
    with pytest.raises(ConfigurationError, match=message):
        run("--drive", "drive.csv")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--focus-mm", "0,0,5"), "height"),
        (("--focus-mm", "nan,0,100"), "must be X,Y,Z, each"),
        (("--object", "circle", "--quantity", "phase", "--picture", "field.png"), "no phase"),
        (("--object", "dodecahedron"), "known are"),
        (("--preset", "unknown"), "known are"),
        (("--drive", "missing.csv"), "cannot be read"),
        (("--at-mm", "0,0,-100"), "--at-mm: point 0 is 100 mm behind the baffle"),
        (("--picture", "field.gif"), "possible are"),
        (("--object", "circle", "--rate-hz", "0"), "1 to 40000"),
        (("--ear-mm", "--modulation-hz", "900"), "half of"),
        (("--ear-mm", "--modulation-hz", "0"), "must be 0.01 to"),
        (("--temperature-c", "90"), "--temperature-c is 90, must be -20 to 50 degrees Celsius"),
        (("--half-width-mm", "1e4", "--picture", "field.png"), "samples, must be"),
    ],
)
def test_what_cannot_be_drawn_is_refused_with_the_reason(
    tmp_path, monkeypatch, capsys, words, message
):
    monkeypatch.chdir(tmp_path)
    assert main(["field", *words]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "field.png").exists()


def test_a_place_that_is_no_triple_is_a_usage_error(capsys):
    assert main(["field", "--focus-mm", "1,2"]) == 2
    assert capsys.readouterr().err == (
        "haptogram field: --focus-mm is 1,2, must be X,Y,Z, each -10000 to 10000 mm\n"
    )


def test_the_levels_at_an_ear_are_those_of_the_library(run, capsys):
    assert run("--array", "6x6", "--focus-mm", "0,0,80", "--ear-mm") == 0
    out = " ".join(capsys.readouterr().out.split())
    model = AcousticModel.default(6, 6)
    frames = Modulation("am").frames([(0.0, 0.0, 0.08)], 1000.0)
    engine, weights, lag = NumpyEngine(model), frames.weights(model), Resonator.from_bandwidth()
    ear_m = (0.0, -0.3, 0.4)
    heard = exposure_at(engine, weights, [ear_m], 1e-3, lag)[0]
    assert "at an ear at (0, -300, 400) mm, 500 mm from the centre; AM at 200 Hz, 1000" in out
    found = re.search(
        r"ultrasound: ([\d.]+) dB SPL at most, ([\d.]+) dB SPL on average .* 110 dB SPL", out
    )
    assert [float(value) for value in found.groups()] == pytest.approx(
        [heard.maximum_db_spl, heard.equivalent_db_spl], abs=0.1
    )


def test_one_line_says_that_numba_is_missing(run, monkeypatch, capsys):
    words = ("--array", "4x4")
    monkeypatch.setattr("haptogram.acoustics.field.engines.numba_engine.load_kernels", lambda: None)
    assert run(*words) == 0
    assert capsys.readouterr().out.count("since numba is not installed") == 1
    monkeypatch.undo()
    assert why_not_compiled(AcousticModel.default(4, 4)) is None


def test_an_ear_hears_a_sequence_and_a_steady_drive(run, tmp_path, capsys):
    words = ("--array", "4x4", "--ear-mm", "100,-200,300")
    assert run(*words, "--object", "circle", "--resolution-mm", "20") == 0
    sequence = " ".join(capsys.readouterr().out.split())
    assert re.search(r"\(100, -200, 300\) mm.*; 16 drives of 1 ms: ultrasound: [\d.]+ dB", sequence)
    (tmp_path / "steady.csv").write_text("phase,amplitude\n" + "0,255\n" * 16)
    assert run(*words, "--drive", "steady.csv") == 0
    steady = " ".join(capsys.readouterr().out.split())
    assert "a steady drive:" in steady


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--ear-mm", "0,0,-100"), "^--ear-mm: point 0 is 100 mm behind the baffle"),
        (
            ("--ear-mm", "0,0,0"),
            "within the array, 0.0 mm from .*; it can be from 20 mm on",
        ),
        (("--ear-mm", "--modulation-hz", "900"), "half of"),
        (("--ear-mm", "--modulation-hz", "-1"), "must be 0.01 to"),
    ],
)
def test_an_ear_out_of_the_field_is_refused_before_the_picture(run, tmp_path, words, message):
    with pytest.raises(ConfigurationError, match=message):
        run(*words)
    assert not (tmp_path / "field.png").exists()

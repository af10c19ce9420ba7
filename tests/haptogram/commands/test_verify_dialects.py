"""``haptogram verify --dialect``: our objects on boards of other makers."""

import json
import re
from xml.etree import ElementTree

import numpy as np
import pytest

from haptogram import DialectDriver
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.cli import main
from haptogram.evidence.dialects.latches import dialect_run_observations
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram.verification import verify_run
from haptogram_protocol.dialects.table import DIALECTS
from swallowing_port import SwallowingPort

pytestmark = pytest.mark.sampled(2)

every_dialect = pytest.mark.parametrize("name", DIALECTS)
SERIAL = [name for name, dialect in DIALECTS.items() if dialect.bauds]
HIGHEST_M, LOWEST_M, ABOVE_A_CAVITY_M = 0.15, 0.03, 0.022


def short_line(name):
    """Return the options of a line of three points that suits the boards' own array."""
    array = LAYOUTS[DIALECTS[name].layout].array()
    width, depth, height = np.ptp(array.positions_m, axis=0)
    up = (
        ABOVE_A_CAVITY_M if height > 0.01 else np.clip(0.9 * max(width, depth), LOWEST_M, HIGHEST_M)
    )
    center_mm = 1e3 * array.world_m(np.array([0.13 * width, -0.21 * depth, up]))
    length_mm = 1e3 * 0.1 * width
    where = ",".join(f"{value:.3f}" for value in center_mm)
    return [
        *("--object", "line", f"--center-mm={where}"),
        *(f"--radius-mm={length_mm}", f"--resolution-mm={length_mm}"),
    ]


def verify(capsys, *words):
    """Run the command; return status, standard output and standard error."""
    status = main(["verify", "--quiet", *words])
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    return status, said.out, said.err


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("words", "center_mm"),
    [
        (("sonicsurface", "--dialect-option", "boards=2"), "10,-20,30"),
        (("sonicsurface", "--dialect-option", "boards=2"), "0,0,121.5"),
        (("ultraino-fpga-128",), "0,0,0"),
        (("ultraino-fpga-128",), "2,1,-9"),
    ],
)
def test_boards_that_face_each_other_focus_anywhere_between_them(words, center_mm, capsys):
    """In their lower half, and in the very middle, which is a height of 0 for both together."""
    place = ("--object", "point", f"--center-mm={center_mm}")
    status, out, _ = verify(capsys, "--dialect", *words, "--virtual-time", *place)
    assert (status, out.splitlines()[0]) == (0, "PASS: every focus is on target")


def test_outside_of_boards_that_face_each_other_there_is_no_target(capsys):
    words = ("--dialect", "sonicsurface", "--dialect-option", "boards=2", "--virtual-time")
    for center_mm, told in (
        ("0,0,270", "height z is 148.5 mm, must be at most 121.5 mm"),
        ("0,0,230", "distance from an element is 14.3918 mm, must be at least 20 mm"),
    ):
        status, _, err = verify(capsys, *words, "--object", "point", "--center-mm", center_mm)
        assert (status, told in err) == (2, True)
        assert "--center-mm puts a focus out of reach: target: " in err


@every_dialect
def test_a_short_object_is_verified_on_every_board(name, capsys, tmp_path):
    result = tmp_path / "result.json"
    words = ("--dialect", name, "--virtual-time", *short_line(name), f"--json={result}")
    status, out, _ = verify(capsys, *words)
    assert status == 0, out
    found = json.loads(result.read_text())
    assert found["evidence"] == "external"
    assert found["frames"]["verified"] == found["frames"]["sent"] == 3
    assert found["board"]["dialect"] == name
    assert found["board"]["phase_steps"] == DIALECTS[name].display(1).steps


FOUND = {  # in the firmware of boards: dialect, exit status, and what is told
    "last_bit=late": (
        "sonicsurface",
        1,
        r"elements n mod 8 = 3 \(32 of 256\): one step of 32 late, .* mm along; \d+ Pa at",
    ),
    "ports=staggered": ("ultraino-mega64", 1, r"off target; .* mm along; \d+ Pa at the target"),
    "carrier=20kHz": ("ultraino-mega64", 1, r"by up to -127/255, at the output: .* \d+ Pa at"),
    "upload=drawn-out": ("ultraino-mega64", 0, r"while bytes arrive: -6\.0 dB \(0\.50 of every"),
}


@pytest.mark.parametrize("option", FOUND)
def test_what_was_found_in_firmware_is_told_with_what_it_costs(option, capsys):
    name, expected, told = FOUND[option]
    words = ("--dialect", name, "--virtual-time", "--dialect-option", option, *short_line(name))
    status, out, _ = verify(capsys, *words)
    assert status == expected
    assert "3 latched, 3 verified, 0 lost" in out
    assert re.search(told, out)


@pytest.mark.sampled(1)
@every_dialect
def test_a_silent_element_fails(name, capsys):
    fault = ("--fault", "device.off transducer=2")
    status, out, _ = verify(capsys, "--dialect", name, "--virtual-time", *short_line(name), *fault)
    assert status == 1
    assert "element 2 " in out
    assert "device.off" in out


@pytest.mark.nightly
@pytest.mark.pty
def test_a_board_in_a_process_of_its_own(capsys, tmp_path):
    page = tmp_path / "page.html"
    words = ("--dialect", "sonicsurface", *short_line("sonicsurface"), f"--html={page}")
    status, out, _ = verify(capsys, *words)
    assert status == 0, out
    assert "sonicsurface" in page.read_text()


def test_a_board_behind_a_url_is_seen_through_its_back_door(capsys):
    """The 2 mm between SonicSurface's own rows and those of Ultraino's file are found."""
    port = "haptogram://?dialect=sonicsurface&clock=virtual"
    words = ("--port", port, *short_line("sonicsurface"))
    assert verify(capsys, "--dialect", "sonicsurface", *words)[0] == 0
    status, out, _ = verify(capsys, "--dialect", "ultraino-fpga", *words)
    assert status == 1
    assert "3 frames off target" in out
    assert "off by 1.94" in out  # 2 mm, as seen from a focus beside the middle


@pytest.mark.nightly
@pytest.mark.pty
def test_a_port_that_says_nothing_is_inconclusive_in_plain_words(capsys, tmp_path):
    files = {kind: tmp_path / f"result.{kind}" for kind in ("json", "junit", "html", "frames")}
    options = [f"--{kind}={path}" for kind, path in files.items()]
    with SwallowingPort() as far:
        words = ("--dialect", "sonicsurface", *short_line("sonicsurface"), *options)
        status, out, _ = verify(capsys, "--port", far.path, *words)
    assert status == 3
    told = "what left the host is all that was seen, and nothing of the board"
    assert told in out.splitlines()[0]
    assert "evidence  wire" in out
    assert "focus " not in out  # nobody saw one
    assert len(far.data) == (3 + 2) * 258  # off before and behind
    result = json.loads(files["json"].read_text())
    assert (result["verdict"], result["evidence"]) == ("inconclusive", "wire")
    assert result["frames"]["latched"] == result["frames"]["verified"] == 0
    assert all("criteria" not in frame for frame in result["not_on_target"])
    suite = ElementTree.parse(files["junit"]).getroot()
    outcomes = {case.get("classname"): [e.tag for e in case] for case in suite.iter("testcase")}
    assert outcomes["haptogram.verify.verified"] == ["error"]
    assert outcomes["haptogram.verify.lost"] == ["skipped"]
    assert outcomes["haptogram.verify.off_target"] == ["skipped"]
    page = files["html"].read_text()
    assert told in page
    assert "Whether the board latched them was not" in page
    assert "wire evidence" in files["frames"].read_text()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", SERIAL)
def test_the_rate_is_that_of_the_budget(name, capsys, tmp_path):
    result = tmp_path / "result.json"
    words = ("--dialect", name, "--virtual-time", *short_line(name))
    assert verify(capsys, *words, f"--json={result}")[0] == 0
    rate_hz = json.loads(result.read_text())["configuration"]["rate_hz"]
    boards = -(-LAYOUTS[DIALECTS[name].layout].array().count // DIALECTS[name].channels)
    budget = ["budget", "--dialect", name, "--boards", str(boards), "--rate-hz"]
    assert main([*budget, str(rate_hz)]) == 0
    if rate_hz < 1000.0:
        assert main([*budget, str(rate_hz + 1.0)]) == 1
        capsys.readouterr()
        fast = ("--dialect", name, "--port", "/dev/absent", "--rate-hz", str(rate_hz + 1.0))
        status, _, err = verify(capsys, *fast)  # before the port is opened
        assert (status, err.count("\n")) == (2, 1)
        assert f"--rate-hz is {rate_hz + 1.0:g}; " in err
        assert f"carry {rate_hz:g} frames/s" in err


def test_a_faster_line_carries_more(capsys, tmp_path):
    result = tmp_path / "result.json"
    words = ("--dialect", "interactlab", "--baud", "50000000", "--virtual-time", "--repeat", "40")
    status, out, _ = verify(capsys, *words, *short_line("interactlab"), f"--json={result}")
    assert status == 0, out
    configuration = json.loads(result.read_text())["configuration"]
    assert (configuration["baud"], configuration["rate_hz"]) == (50_000_000, 1000.0)


def test_a_rate_of_the_line_that_is_named_counts_though_it_is_the_default(capsys, tmp_path):
    """The frames come as fast as that line carries them, not as the usual one of these boards."""
    result = tmp_path / "result.json"
    words = ("--dialect", "sonicsurface", "--virtual-time", "--object", "point", f"--json={result}")
    found = []
    for baud in (("--baud", "2999999"), ("--baud", "3000000"), ()):
        assert verify(capsys, *words, *baud)[0] == 0
        configuration = json.loads(result.read_text())["configuration"]
        found.append((configuration["baud"], configuration["rate_hz"]))
    assert found == [(2_999_999, 1000.0), (3_000_000, 1000.0), (230_400, 89.0)]


def test_two_boards_face_to_face_and_an_array_of_the_user(capsys):
    two = ("--dialect-option", "boards=2", "--object", "point", "--center-mm", "5,3,160")
    assert verify(capsys, "--dialect", "sonicsurface", "--virtual-time", *two)[0] == 0
    flat = ("--array", "8x8", "--pitch-mm", "10.5", "--object", "point", "--center-mm", "5,3,60")
    assert verify(capsys, "--dialect", "sonicsurface", "--virtual-time", *flat)[0] == 0


def test_several_foci_in_a_frame(capsys):
    words = ("--object", "circle", "--foci", "2", "--resolution-mm", "80", "--radius-mm", "40")
    status, out, _ = verify(capsys, "--dialect", "interactlab", "--virtual-time", *words)
    assert status == 0, out


def test_a_file_names_the_dialect(capsys, tmp_path):
    file = tmp_path / "run.toml"
    file.write_text('[verify]\ndialect = "sonicsurface"\nrate_hz = 20.0\nobject = "point"\n')
    result = tmp_path / "result.json"
    words = ("--config", str(file), "--virtual-time", f"--json={result}")
    assert verify(capsys, *words)[0] == 0
    assert json.loads(result.read_text())["configuration"]["rate_hz"] == 20.0


def test_a_line_that_breaks_ends_the_run_and_not_its_results(capsys):
    fault = ("--fault", "line.disconnect from=100ms", "--object", "line", "--resolution-mm", "5")
    status, out, _ = verify(capsys, "--dialect", "sonicsurface", "--virtual-time", *fault)
    assert status == 3
    assert "the port is gone" in out
    assert "not sent" in out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--dialect", "sonicsurfaces"), "--dialect is 'sonicsurfaces'; known are autd3, "),
        (("--dialect", "sonicsurface", "--mode", "points"), "--mode acts only on Haptogram's own"),
        (("--dialect", "sonicsurface", "--lead-ms", "5"), "--lead-ms acts only on Haptogram's own"),
        (("--dialect-option", "boards=2"), "--dialect-option acts only with --dialect"),
        (("--dialect", "sonicsurface", "--dialect-option", "boards=3"), "must be 1 to 2"),
        (("--port", "haptogram://?dialect=autd3"), "give --dialect autd3 as well"),
        (
            ("--dialect", "autd3", "--port", "haptogram://?dialect=autd3&backdoor=/tmp/none"),
            "leave backdoor out",
        ),
        (("--dialect", "ultraino-fpga", "--port", "/dev/absent"), "there is no such port"),
        (
            ("--dialect", "sonicsurface", "--capture", "a.vcd", "--channels", "a.toml"),
            "a virtual board writes one of its own: haptogram board --capture",
        ),
    ],
)
def test_what_makes_no_sense_is_one_line(words, says, capsys):
    status, _, err = verify(capsys, *words)
    assert (status, err.count("\n")) == (2, 1)
    assert says in err


@pytest.mark.pty
def test_a_link_that_must_answer_and_does_not_is_an_error(capsys):
    with SwallowingPort() as far:
        status, _, err = verify(capsys, "--dialect", "autd3", "--port", far.path)
    assert status == 2
    assert "no answer to Hello within 2 s" in err


@pytest.mark.nightly
@pytest.mark.pty
def test_a_board_that_goes_dark_between_frames_does_what_nobody_intended():
    with VirtualBoard(dialect="sonicsurface") as board:
        with DialectDriver(board.url, dialect="sonicsurface") as driver:
            driver.stream([(0.01 * i - 0.02, 0.0, 0.15) for i in range(4)], rate_hz=20)
            intended, model = list(driver.intended), driver.model
        records = []
        while sum(record["kind"] == "pulses" for record in records) < 6:  # dark, four, dark
            records = board.records()
    judged = verify_run(intended, dialect_run_observations(intended, records, None), model=model)
    assert judged.sentence == "PASS: every focus is on target"
    *_, third, _, dark = (record for record in records if record["kind"] == "pulses")
    between = records.index(third) + 1
    records.insert(between, {**dark, "t_latch_us": third["t_latch_us"] + 100})
    judged = verify_run(intended, dialect_run_observations(intended, records, None), model=model)
    assert judged.sentence == "FAIL: 1 frame latched that nobody intended"

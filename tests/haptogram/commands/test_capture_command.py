"""``haptogram capture``, and the captures that a board in a process of its own writes."""

import json
import subprocess
import sys

import pytest

from haptogram.cli import main
from pin_captures import captured_run
from sim_device.command.command import main as board

MAP = 'reference = "carrier"\nlatch = "latch"\nelements = "e{}"\n'


@pytest.fixture
def files(tmp_path):
    (tmp_path / "map.toml").write_text(MAP)
    return tmp_path / "pins.vcd", tmp_path / "map.toml"


@pytest.mark.parametrize(("faults", "status"), [((), 0), (["device.dead transducer=3"], 1)])
def test_the_status_tells_what_was_found(faults, status, files, capsys):
    pins, mapped = files
    run = captured_run(pins, faults=faults)
    assert main(["capture", str(pins), "--map", str(mapped), "--json", "-"]) == status
    output = capsys.readouterr()
    document = json.loads(output.out)
    assert "smallest phase error that shows: 0.6 degrees" in output.err
    assert ("wrong: element 3 (e3): dead" in output.err) is bool(status)
    assert len(document["latches"]) == len(run.latches) + 1
    assert document["latches"][-1]["silent"]
    phases = [row["phase_deg"][1] for row in document["elements"]]
    assert [phase is None for phase in phases] == [n == 3 and bool(status) for n in range(16)]


def test_a_file_that_was_cut_off_is_read_as_far_as_it_goes(files, capsys):
    pins, mapped = files
    captured_run(pins)
    data = pins.read_bytes()
    pins.write_bytes(data[: len(data) // 2])
    assert main(["capture", str(pins), "--map", str(mapped)]) == 3
    assert "note: cut off: the file ends in the middle of a line" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["pins.vcd", "map.toml"])
def test_an_output_replaces_no_input(name, files, capsys):
    pins, mapped = files
    captured_run(pins, frames=2)
    json_file = str(pins.parent / name)
    assert main(["capture", str(pins), "--map", str(mapped), "--json", json_file]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_too_low_a_rate_says_which_one_is_needed(files, capsys):
    pins, mapped = files
    captured_run(pins, frames=2, capture_rate_hz=0.5e6)
    assert main(["capture", str(pins), "--map", str(mapped)]) == 2
    assert "for 8-bit phases at 2.048e+07 Hz" in capsys.readouterr().err
    captured_run(pins, frames=2, capture_rate_hz=4e6)
    assert main(["capture", str(pins), "--map", str(mapped), "--quiet"]) == 0
    assert "20.48 Msamples/s can" in capsys.readouterr().out


@pytest.mark.parametrize(
    "words",
    [["--capture-ms", "5"], ["--capture", "/dev/null/x"], ["--capture", "b", "--backdoor", "b"]],
)
def test_a_board_refuses_a_capture_that_makes_no_sense(words, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert board(["--link", str(tmp_path / "board"), *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("ms", [3.0, 8.0])
def test_a_capture_is_as_long_as_it_was_to_be(ms, files):
    run = captured_run(files[0], capture_ms=ms)
    found = run.measured()
    assert found.record.duration_s * 1e3 == pytest.approx(ms + 20 * 0.025, abs=0.03)
    assert len(found.latches) == ms


@pytest.mark.pty
def test_a_board_without_a_client_writes_an_empty_capture(files):
    pins, mapped = files
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "sim_device",
            "--link",
            str(pins.parent / "board"),
            "--until-eof",
            "--capture",
            str(pins),
        ],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert "0 edges of 256 pins" in done.stderr
    assert main(["capture", str(pins), "--map", str(mapped)]) == 2

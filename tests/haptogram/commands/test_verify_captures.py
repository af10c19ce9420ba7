"""``haptogram verify --capture``: by a recording and at a port, its files, and its refusals."""

import json
import shutil
import threading
import time
from pathlib import Path
from xml.etree import ElementTree

import pytest

pytest.importorskip("mcap")

from haptogram.acoustics import AcousticModel, Medium, Transducer, TransducerArray
from haptogram.cli import main
from haptogram.evidence.recordings.channels import INTENDED, MODEL
from haptogram.evidence.recordings.reader import Recording
from haptogram.evidence.recordings.recorded_run import record_intended, recorded_run
from haptogram.evidence.recordings.writer import RecordingWriter
from pin_captures import captured_run

MAP = 'reference = "carrier"\nlatch = "latch"\nelements = "e{}"\n'
PART = 'reference = "carrier"\n[elements]\ne1 = 1\ne2 = 2\ne9 = 9\n'
JUDGED = "verify --from-recording run.mcap --capture pins.vcd --channels"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("map.toml").write_text(MAP)
    Path("part.toml").write_text(PART)


def captured(**options):
    """Write pins.vcd and run.mcap of one run, and return the run."""
    run = captured_run(Path("pins.vcd"), **options)
    grid = TransducerArray.parse(options.get("array", "4x4"), pitch_m=0.01)
    model = AcousticModel(grid, Medium.air(20.0), Transducer())
    with RecordingWriter(Path("run.mcap"), command="verify") as writer:
        record_intended(writer, model, run.intended)
    return run


def test_a_recording_gives_back_the_frames_and_the_array():
    run = captured(mode="drives")
    recorded = recorded_run(Recording(Path("run.mcap")))
    assert recorded.intended == run.intended
    assert recorded.model.array.digest() == TransducerArray.parse("4x4", pitch_m=0.01).digest()
    assert recorded.model.wavenumber == AcousticModel.default(4, 4).wavenumber


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("fault", "status"), [(None, 0), ("device.delayed transducer=9", 1)])
def test_a_part_of_the_pins_is_judged_and_the_rest_is_counted(fault, status, capsys):
    captured(faults=[fault] if fault else [])
    files = "--json run.json --junit run.xml --html run.html --frames run.txt --summary run.md"
    assert main([*f"{JUDGED} part.toml {files}".split()]) == status
    said = capsys.readouterr().out
    assert said.startswith(f"{'FAIL' if status else 'PASS'}: 3 of 16 elements: ")
    assert "the other 13 elements are not verified" in said
    result = json.loads(Path("run.json").read_text())
    assert result["verdict"] == ("fail" if status else "pass")
    assert result["evidence"] == "external"
    assert result["frames"]["not_verified"] == 12  # no field is known
    assert result["captures"]["elements"] == [1, 2, 9]
    assert result["captures"]["captures"][0]["frames"]["right"] == (0 if status else 12)
    suite = ElementTree.parse("run.xml").getroot().find("testsuite")
    assert int(suite.get("failures")) == status
    assert int(suite.get("errors")) == 0
    page = Path("run.html").read_text()
    assert "The drive pins of 3 of 16 elements were captured" in page
    assert ("degrees in every frame" in page) is bool(status)
    assert "3 of 16 elements" in Path("run.md").read_text() or status
    lines = Path("run.txt").read_text().splitlines()
    assert len(lines) == 12
    assert all("3 of 16 elements were captured, and " in line for line in lines)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("fault", "status"), [(None, 0), ("device.delayed transducer=9", 1)])
def test_all_pins_give_the_whole_verdict(fault, status, capsys):
    captured(faults=[fault] if fault else [])
    assert main([*f"{JUDGED} map.toml --json run.json".split()]) == status
    result = json.loads(Path("run.json").read_text())
    assert result["frames"]["verified"] == 12
    assert result["frames"]["not_verified"] == 0
    assert (result["frames"]["on_target"] == 12) is not bool(status)
    assert result["captures"]["no_field"] is None
    assert "12 sent, 12 latched, 12 verified" in capsys.readouterr().out


def test_captures_of_several_passes_are_joined(capsys):
    for number, elements in enumerate((range(9), range(9, 16))):
        captured(seed=7)
        Path("pins.vcd").rename(f"{number}.vcd")
        rows = "".join(f"e{n} = {n}\n" for n in elements)
        Path(f"{number}.toml").write_text(f'reference = "carrier"\n[elements]\n{rows}')
    words = "verify --from-recording run.mcap --capture 0.vcd --channels 0.toml"
    assert main([*words.split()]) == 0
    assert "7 of 16 elements were not captured" in capsys.readouterr().out
    assert main([*f"{words} --capture 1.vcd --channels 1.toml".split()]) == 0
    assert "12 sent, 12 latched, 12 verified" in capsys.readouterr().out


BAD = {
    "--from-recording": ("name the --capture", 2),
    "--capture pins.vcd": ("--channels is missing: a capture needs the map of its channels", 2),
    "--capture pins.vcd --channels map.toml": ("haptogram board --capture", 2),
    "--channels map.toml": ("name the --capture", 2),
    f"{JUDGED} map.toml --port x": ("--port acts only on a run", 2),
    f"{JUDGED} none.toml": ("none.toml", 2),
    f"{JUDGED} clock.toml": ("no channel 'D0'", 2),
    f"{JUDGED} far.toml": ("the array has the elements 0 to 15", 2),
    f"{JUDGED} alone.toml": ("capture the clock of the carrier", 2),
    "verify --from-recording run.mcap --capture empty.vcd --channels map.toml": (
        "no edge on any",
        2,
    ),
    "verify --from-recording run.mcap --capture slow.vcd --channels map.toml": (
        "for 8-bit phases at 2.048e+07 Hz",
        2,
    ),
    "verify --from-recording empty.vcd --capture pins.vcd --channels map.toml": (
        "is no recording",
        2,
    ),
    "verify --from-recording bytes.mcap --capture pins.vcd --channels map.toml": (
        "does not hold the frames that were intended",
        2,
    ),
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("words", "told", "status"), [(w, *rest) for w, rest in BAD.items()])
def test_bad_input_is_one_line(words, told, status, capsys):
    captured(frames=3, capture_rate_hz=0.5e6)
    shutil.copy("pins.vcd", "slow.vcd")
    captured(frames=3)
    Path("clock.toml").write_text('reference = "D0"\nelements = "e{}"\n')
    Path("far.toml").write_text('reference = "carrier"\n[elements]\ne1 = 99\n')
    Path("alone.toml").write_text('reference = "e1"\n[elements]\ne1 = 1\n')
    header = Path("pins.vcd").read_text().split("$dumpvars")[0]
    Path("empty.vcd").write_text(f"{header}#1000\n")
    RecordingWriter(Path("bytes.mcap"), command="board").close()
    line = words if words.startswith("verify") else f"verify {words}"
    line = f"{line} run.mcap" if line.endswith("--from-recording") else line
    assert main([*line.split(), "--quiet"]) == status
    said = capsys.readouterr()
    assert told in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""


def test_another_run_and_a_cut_off_file_are_inconclusive(capsys):
    captured(seed=2)
    shutil.copy("pins.vcd", "other.vcd")
    captured()
    words = "verify --from-recording run.mcap --capture other.vcd --channels map.toml"
    assert main([*words.split()]) == 3
    assert "the capture does not show this run" in capsys.readouterr().out
    data = Path("pins.vcd").read_bytes()
    Path("pins.vcd").write_bytes(data[: len(data) // 2])
    assert main([*f"{JUDGED} map.toml".split()]) == 3
    assert "cut off" in capsys.readouterr().out


def rewritten(change):
    """Write run.mcap anew, whole, with the entries that *change* makes of those that it has."""
    entries = change([(e.topic, e.t_ns, e.fields) for e in Recording(Path("run.mcap")).entries()])
    with RecordingWriter(Path("new.mcap"), command="verify") as writer:
        for topic, t_ns, fields in entries:
            if topic in (MODEL, INTENDED):
                writer.document(topic, t_ns, fields)
    Path("new.mcap").replace("run.mcap")


def test_a_recording_that_lacks_frames_passes_and_fails_nothing(capsys):
    for faults in ([], ["device.dead transducer=9"]):
        captured(faults=faults)
        rewritten(lambda entries: entries[:-2])
        assert main([*f"{JUDGED} map.toml --json run.json".split()]) == 3
        said = capsys.readouterr().out
        assert said.startswith("INCONCLUSIVE: all 16 elements: ")
        assert "10 of 12 intended frames are in the recording" in said
        assert ("dead" in said) is bool(faults)
        assert json.loads(Path("run.json").read_text())["verdict"] == "inconclusive"
    captured()
    rewritten(lambda entries: [(t, at, {**f, "intended_frames": None}) for t, at, f in entries])
    assert main([*f"{JUDGED} part.toml".split()]) == 3
    assert "does not say how many frames were intended" in capsys.readouterr().out


DAMAGES = {
    "foci": [[0.0]],
    "phase_codes": "?",
    "amplitude_codes": "AAAA",
    "phase_bits": None,
    "drive_of": 99,
    "session": "lacks",
    "t_apply_us": "lacks",
}


@pytest.mark.parametrize("name", DAMAGES)
def test_a_frame_that_cannot_be_read_is_named_in_one_line(name, capsys):
    captured(frames=3)

    def damaged(entries):
        fields = [fields for topic, _, fields in entries if topic == INTENDED][1]
        fields[name] = DAMAGES[name]
        if DAMAGES[name] == "lacks":
            del fields[name]
        return entries

    rewritten(damaged)
    assert main([*f"{JUDGED} map.toml".split()]) == 2
    said = capsys.readouterr().err
    assert "run.mcap: intended frame 1 cannot be read: " in said
    assert said.count("\n") == 1
    assert "of frame 99, which the recording lacks" in said or name != "drive_of"
    assert f"lacks the field '{name}'" in said or DAMAGES[name] != "lacks"


def test_frames_of_another_array_are_refused(capsys):
    captured(frames=3, array="3x3")
    small = [(e.topic, e.t_ns, e.fields) for e in Recording(Path("run.mcap")).entries()]
    captured(frames=3)
    rewritten(lambda entries: [*(one for one in entries if one[0] == MODEL), *small[-3:]])
    assert main([*f"{JUDGED} map.toml".split()]) == 2
    told = "intended frame 0 is of 9 elements; the array of the recording has 16"
    assert told in capsys.readouterr().err


def test_a_recording_that_was_cut_off_passes_nothing(capsys, monkeypatch):
    monkeypatch.setattr("haptogram.evidence.recordings.writer._CHUNK", 4096)
    captured(frames=60)
    whole = Path("run.mcap").read_bytes()
    told = set()
    for size in range(len(whole) - 8, len(whole) // 3, -len(whole) // 8):
        Path("run.mcap").write_bytes(whole[:size])
        assert main([*f"{JUDGED} part.toml".split()]) in (2, 3)
        told.update(line for line in capsys.readouterr().out.splitlines() if "cut off" in line)
    assert any(" of 60 intended frames are in the recording: " in line for line in told)


def test_an_interrupt_while_a_capture_is_awaited_costs_no_result(capsys, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("haptogram.commands.shell.captures._is_capture_complete", interrupt)
    port = "--port haptogram://?clock=virtual&array=4x4 --capture no.vcd --channels map.toml"
    job = "--object point --array 4x4 --quiet --json run.json"
    assert main(["verify", *job.split(), *port.split()]) == 2
    assert capsys.readouterr().err.count("--capture was not judged") == 1
    assert json.loads(Path("run.json").read_text())["verdict"] == "pass"


def test_a_capture_of_a_run_at_a_port_is_awaited(capsys):
    """The board in this program has no pins, and the capture is of another run: it is told."""
    captured(frames=3)
    job = "--object point --array 4x4 --repeat 40 --rate-hz 1000 --quiet --json run.json"
    port = "--port haptogram://?clock=virtual&array=4x4 --capture new.vcd --channels map.toml"

    def write_later():
        time.sleep(1.0)
        shutil.copyfile("pins.vcd", "new.vcd")

    analyser = threading.Thread(target=write_later)
    analyser.start()
    assert main(["verify", *job.split(), *port.split()]) == 3
    analyser.join()
    said = capsys.readouterr()
    assert "waiting for new.vcd: end the capture" in said.err
    assert said.out.startswith("PASS: ")  # by its own word
    assert "INCONCLUSIVE: all 16 elements" in said.out
    result = json.loads(Path("run.json").read_text())
    assert result["verdict"] == "inconclusive"
    assert result["evidence"] == ["external", "self-reported"]

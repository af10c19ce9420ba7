"""``haptogram watch``: captures of unmodified clients, expected foci, live boards."""

import base64
import json
import os
import signal
import subprocess
import sys
import threading
import time
import zlib
from pathlib import Path
from xml.etree import ElementTree

import pytest

import sim_device
from haptogram import Driver
from haptogram.cli import main
from haptogram.commands.watch.records import WatchedRecords, reader_of_watched
from haptogram.evidence.board_process import BoardProcess
from haptogram.report.watch import document as document_module
from haptogram.verification.watch import Defect

pytestmark = pytest.mark.sampled(2)

ROOT = Path(__file__).parents[3]
DATA = ROOT / "tests" / "data" / "dialects"
AIR = ("--temperature-c", "23.21")  # 346.0 m/s, which these clients assume
DEADLINE_S = 60.0


def capture(name):
    return str(DATA / f"{name}.bin")


def watch(capsys, *words):
    """Run the command; return status, standard output and standard error."""
    status = main(["watch", *words])
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    return status, said.out, said.err


# --- captures -------------------------------------------------------------------------------------

CAPTURES = [
    ("sonicsurface/focus_0_120_0", "sonicsurface", "one focus at (0.0, 119.9, 0.0)", 0.9985),
    ("sonicsurface/focus_20_150_m15", "sonicsurface", "one focus at (20.0, 150.0, -15.0)", 0.9983),
    ("sonicsurface/twin_0_150_0_rot45", "sonicsurface", "twin trap at (0.0, 150.1, 0.0)", 0.9984),
    ("sonicsurface/off", "sonicsurface", "off", None),
    ("sonicsurface/on", "sonicsurface", "uniform", None),
    ("sonicsurface/ramp_phases", "sonicsurface", "none of these", None),
    (
        "ultraino/simplefpga_ss_focus_0_120_0",
        "ultraino-fpga",
        "one focus at (0.0, 120.0, 0.0)",
        0.9988,
    ),
    ("ultraino/mega_flat8x8_focus", "ultraino-mega64", "one focus at (0.0, 50.8, 0.0)", 0.9874),
]


@pytest.mark.parametrize(("name", "dialect", "said", "coherence"), CAPTURES)
def test_a_capture_is_told_in_the_client_s_axes(name, dialect, said, coherence, capsys):
    status, out, _ = watch(capsys, capture(name), "--dialect", dialect, *AIR)
    line = out.splitlines()[1]
    assert line.split("  ", 3)[-1].strip().startswith(said)
    if coherence is not None:
        assert float(line.rsplit(" ", 1)[1]) == pytest.approx(coherence, abs=2e-4)
    assert status == (3 if said == "none of these" else 0)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("beside", [(), ("focus_0_120_0",)], ids=["alone", "beside a focus"])
def test_a_latch_without_a_pattern_fails_if_it_shall(beside, tmp_path, capsys):
    """Without the option, a run in which some latch has a pattern passes."""
    (tmp_path / "program.bin").write_bytes(
        b"".join(
            Path(capture(f"sonicsurface/{name}")).read_bytes() for name in ("ramp_phases", *beside)
        )
    )
    command = (str(tmp_path / "program.bin"), "--dialect", "sonicsurface", *AIR, "--quiet")
    assert watch(capsys, *command)[0] == (0 if beside else 3)
    status, out, _ = watch(capsys, *command, "--fail-on", "unknown")
    assert status == 1
    assert out.startswith("FAIL: ")
    assert "1 none of these" in out.splitlines()[0]


def test_the_amplitude_commit_of_a_client_is_named(capsys):
    name = "ultraino/simplefpga_ss_amp50_0_120_0"
    status, out, _ = watch(capsys, capture(name), "--dialect", "ultraino-fpga")
    assert status == 1
    assert "defect    amplitude frame taken for phases: FB and 256 amplitudes" in out


def test_a_refused_operation_of_autd3_is_told_with_what_to_send_instead(tmp_path, capsys):
    sent = bytearray(Path(capture("autd3/focus")).read_bytes())
    frame = sent.rindex(b"\x03\x05\x00", 0, 2600) + 1  # message 5: a modulation and a gain
    second = int.from_bytes(sent[frame + 2 : frame + 4], "little")
    assert sent[frame + 4 + second] == 0x30
    sent[frame + 4 + second] = 0x41  # GainSTM
    (tmp_path / "sent.bin").write_bytes(sent)
    _, out, _ = watch(capsys, str(tmp_path / "sent.bin"), "--dialect", "autd3")
    assert "refused an operation (error 1, not supported tag): GainSTM" in out
    assert "send its gains one by one, or foci as FociSTM" in out


def test_lost_bytes_tear_a_frame_and_a_lost_commit_hides_one(tmp_path, capsys):
    frame = Path(capture("sonicsurface/focus_0_120_0")).read_bytes()
    lost = tmp_path / "lost.bin"
    lost.write_bytes(frame + frame[:100] + frame[101:] + frame[:-1] + frame)
    status, out, _ = watch(capsys, str(lost), "--dialect", "sonicsurface", *AIR)
    assert status == 1
    assert "torn      latch 2: 1 frame short" in out
    assert "frame without its commit: 1 whole and never shown (latch 3)" in out


def test_bytes_of_another_wire_are_named_and_their_frames_are_not_judged(capsys):
    name = "ultraino/simplefpga128_ss_focus_0_120_0"
    status, out, _ = watch(capsys, capture(name), "--dialect", "sonicsurface")
    assert status == 3
    assert "missing   these bytes look like ultraino-fpga-128, not sonicsurface" in out
    assert "defect" not in out


def test_a_file_that_ends_in_mid_frame_is_told_and_what_was_shown_is_judged(tmp_path, capsys):
    frame = Path(capture("sonicsurface/focus_0_120_0")).read_bytes()
    (tmp_path / "cut.bin").write_bytes(frame + frame[:100])
    _, out, _ = watch(
        capsys, str(tmp_path / "cut.bin"), "--dialect", "sonicsurface", *AIR, "--expect", "0,120,0"
    )
    assert "remark    a frame stops in its middle: 100 bytes came; a frame has 258" in out
    assert "expected  1 " in out
    assert "defect" not in out
    assert "lost" not in out


# --- expectation ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("expected", "status", "told"),
    [
        (("20,150,-15",), 0, "on target"),
        (("20,150,15",), 1, "off target"),
        (("20,150,-15", "0,100,0"), 0, "on target"),  # one latch, one frame
    ],
)
def test_foci_are_expected_in_the_client_s_axes(expected, status, told, capsys):
    words = [word for place in expected for word in ("--expect", place)]
    found, out, _ = watch(
        capsys,
        *(capture("sonicsurface/focus_20_150_m15"), "--dialect", "sonicsurface", *AIR),
        *("--tolerance-c", "0.3", *words),
    )
    assert found == status
    assert f"expected  1 {told}" in out


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_frames_on_a_full_disk_are_told_in_one_line(capsys):
    board = (capture("sonicsurface/two_foci_then_4_commits"), "--dialect", "sonicsurface")
    status, _, err = watch(capsys, *board, "--quiet", "--frames", "/dev/full")
    assert status == 2
    assert "--frames '/dev/full' cannot be written: the disk is full\n" in err


def test_results_are_written_in_every_form(tmp_path, capsys):
    expected = tmp_path / "foci.csv"
    expected.write_text("frame,x,y,z\n1,-40,180,0\n2,40,180,0\n")
    files = {name: tmp_path / f"out.{name}" for name in ("frames", "json", "junit")}
    status, out, err = watch(
        capsys,
        *(capture("sonicsurface/two_foci_then_4_commits"), "--dialect", "sonicsurface", *AIR),
        *("--expect-file", str(expected), "--tolerance-c", "0.3", "--quiet"),
        *(word for name, path in files.items() for word in (f"--{name}", str(path))),
    )
    assert status == 0
    assert out.startswith("PASS: 6 latches of the client\n  patterns  6 one focus\n")
    assert err.count("wrote ") == 3
    latches = [json.loads(line) for line in files["frames"].read_text().splitlines()]
    assert [latch["verdict"] for latch in latches] == [None, *["on target"] * 6]
    assert latches[1]["t_us"] is None  # a file of bytes has no timing
    assert latches[1]["client_mm"][0] == pytest.approx([-40.0, 180.0, 0.0], abs=0.5)
    assert json.loads(files["json"].read_text())["statuses"] == {"on target": 6}
    suite = ElementTree.parse(files["junit"]).getroot()
    assert suite.attrib["failures"] == "0"
    assert int(suite.attrib["tests"]) == 6 + len(Defect) + 1


def test_a_failed_run_fails_in_junit_as_well(tmp_path, capsys):
    junit = tmp_path / "out.xml"
    status, _, _ = watch(
        capsys,
        *(capture("sonicsurface/focus_0_120_0"), "--dialect", "sonicsurface", *AIR),
        *("--expect", "0,90,0", "--junit", str(junit)),
    )
    assert status == 1
    suite = ElementTree.parse(junit).getroot()
    assert suite.attrib["failures"] == "1"
    assert "is where it was expected" in suite.find(".//testcase[failure]").attrib["name"]


def test_the_summary_takes_many_latches_off_target_together(tmp_path, capsys):
    one = Path(capture("sonicsurface/focus_0_120_0")).read_bytes()
    (tmp_path / "ten.bin").write_bytes(10 * one)
    summary = tmp_path / "out.md"
    status, _, _ = watch(
        capsys,
        *(str(tmp_path / "ten.bin"), "--dialect", "sonicsurface", *AIR, "--quiet"),
        *("--expect", "0,90,0", "--summary", str(summary)),
    )
    assert status == 1
    rows = [line for line in summary.read_text().splitlines() if line.startswith("| error")]
    assert len(rows) == 1
    assert rows[0].startswith("| error | 10 latches | 10 frames (")


def test_the_page_has_verdict_defects_latches_and_the_view(tmp_path, capsys):
    page = tmp_path / "watch.html"
    status, _, err = watch(
        capsys,
        *(capture("sonicsurface/two_foci_then_4_commits"), "--dialect", "sonicsurface", *AIR),
        *("--expect=-40,180,0", "--expect=40,170,0", "--tolerance-c", "0.3", "--html", str(page)),
    )
    text = page.read_text()
    assert (status, err) == (1, f"wrote {page}\n")
    assert "<h1>FAIL: " in text
    assert text.count(">off target (S") == 2 * 3  # among the checks, and the latches
    passed = '<span class="badge good">passed</span></td><td class="wide">not found</td>'
    assert text.count(passed) == len(Defect)
    assert "(40.0, 170.0, 0.0)" in text  # expected, in the client's axes
    scene = zlib.decompress(base64.b64decode(text.split('id="scene">')[1].split("<")[0]))
    assert b'"texts":{"2":"' in scene.replace(b" ", b"")


def test_the_page_keeps_the_last_latches_only(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(document_module, "_LISTED", 5)
    frame = Path(capture("sonicsurface/focus_0_120_0")).read_bytes()
    (tmp_path / "long.bin").write_bytes(frame * 40)
    page = tmp_path / "watch.html"
    words = (str(tmp_path / "long.bin"), "--dialect", "sonicsurface", "--html", str(page))
    watch(capsys, *words, *AIR)
    text = page.read_text()
    assert "The last of 41." in text
    assert text.count(">swap</td>") == 5


def test_nothing_latched_is_status_3(tmp_path, capsys):
    (tmp_path / "nothing.bin").write_bytes(b"")
    status, out, _ = watch(capsys, str(tmp_path / "nothing.bin"), "--dialect", "sonicsurface")
    assert status == 3
    assert "INCONCLUSIVE: 0 latches of the client\n" in out


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ((), "nothing to watch; give a back door (unix:PATH), a file of bytes"),
        (
            ("absent.bin", "--dialect", "sonicsurface"),
            "'absent.bin' cannot be read: there",
        ),
        (("absent.jsonl",), "'absent.jsonl' cannot be read: there is no such file"),
        (("unix:absent",), "no board listens at unix:absent"),
        (("x.bin", "--dialect", "sonicsurface", "--link", "y"), "--link starts a board"),
        ((capture("sonicsurface/on"), "--dialect", "sonic"), "--dialect is 'sonic'; known are"),
        (("--link", "y", "--dialect", "sonic"), "--dialect is 'sonic'; known are"),
        (
            ("--link", "y", "--dialect", "sonicsurface", "--dialect-option", "boards=7"),
            "--dialect-option boards is 7, must be 1 to 2",
        ),
        (("foci.csv",), "foci.csv: holds no records of a back door; they may be those of a client"),
        (
            (capture("sonicsurface/on"),),
            f"{capture('sonicsurface/on')}: holds no records of a back door; its bytes look like "
            "sonicsurface or ultraino-fpga: add --dialect sonicsurface",
        ),
        (
            ("client.bin", "--dialect", "sonicsurface", "--json", "client.bin"),
            "--json client.bin: would replace the file that this command reads",
        ),
        (("client.bin", "--expect", "1,2"), "--expect is 1,2, must be X,Y,Z, each -10000 to"),
        (
            (capture("sonicsurface/on"), "--dialect", "sonicsurface", "--expect-file", "foci.csv"),
            "--expect-file foci.csv: must begin with the line x,y,z",
        ),
    ],
)
def test_a_refusal_is_one_line_and_status_2(words, told, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("foci.csv").write_text("a,b,c\n1,2,3\n")
    Path("client.bin").write_bytes(b"")
    status, out, err = watch(capsys, *words)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert err.startswith(f"haptogram watch: {told}")


def test_every_operation_in_a_file_of_autd3_is_shown(tmp_path, capsys):
    path = ROOT / "tests" / "data" / "dialects" / "autd3" / "pyautd3_38.0.1.json"
    sent = json.loads(path.read_text())["segments"]["sent"][:6]
    data = tmp_path / "segments.bin"
    data.write_bytes(b"".join(zlib.decompress(base64.b64decode(text)) for _, text in sent))
    foci = ("--expect", "96.6,76.7,150", "--expect", "96.6,96.7,180", "--tolerance-mm", "1")
    words = (str(data), "--dialect", "autd3", "--temperature-c", "13.587", *foci)
    status, out, _ = watch(capsys, *words)
    assert (status, out.count("on target")) == (0, 3)


@pytest.mark.parametrize(("row", "told"), [("1,2", "2 cells"), ("1,2,x", "is not x,y,z in mm")])
def test_a_file_of_foci_is_refused_by_its_line(row, told, tmp_path, capsys):
    foci = tmp_path / "foci.csv"
    foci.write_text(f"x,y,z\n0,0,100\n{row}\n")
    words = (capture("sonicsurface/on"), "--dialect", "sonicsurface", "--expect-file", str(foci))
    status, _, err = watch(capsys, *words)
    assert status == 2
    assert f"foci.csv:3: {told}" in err or told in err


def test_the_program_in_the_documentation_runs(capsys):
    page = (ROOT / "docs" / "watch.md").read_text()
    program = page.split("```python\n")[1].split("```")[0]
    exec(program, {})
    assert capsys.readouterr().out.split() == ["one", "focus", "on", "target", "pass"]


# --- live -----------------------------------------------------------------------------------------


def wait_for(condition):
    end_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.02)


def test_bytes_that_never_end_are_refused(capsys):
    assert main(["watch", "/dev/zero", "--dialect", "sonicsurface"]) == 2
    assert "/dev/zero: has more than 67108864 bytes, the most that" in capsys.readouterr().err
    assert main(["watch", "/dev/zero"]) == 2
    assert capsys.readouterr().err == "haptogram watch: /dev/zero: line 1 has no end\n"


def test_haptogram_s_own_board_is_watched_from_a_file(tmp_path, capsys):
    door = tmp_path / "door.jsonl"
    sim_device.register_url_handler()
    with Driver(f"haptogram://?clock=virtual&reconstruct=0&seed=1&backdoor={door}") as driver:
        driver.arm()
        driver.focus((0.02, 0.01, 0.15))
        driver.hold(0.01)
    status, out, _ = watch(capsys, str(door), "--expect", "20,10,150", "--latches", "1")
    assert status == 0
    assert "one focus at (20.0, 10.0, 150.0) mm" in out
    assert "expected  1 on target" in out


@pytest.mark.nightly
def test_a_board_that_the_command_starts_is_followed_until_ctrl_c(tmp_path):
    link, log = tmp_path / "board", tmp_path / "out.txt"
    words = ["watch", "--dialect", "sonicsurface", "--link", str(link), *AIR]
    with log.open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "haptogram", *words],
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**os.environ, "TMPDIR": str(tmp_path)},
        )
    try:
        wait_for(lambda: "power-up" in log.read_text())
        (door,) = tmp_path.glob("haptogram-watch-*/backdoor")
        assert door.is_fifo()  # a file would grow as long as the board is watched
        port = os.open(link, os.O_RDWR | os.O_NOCTTY)
        os.write(port, Path(capture("sonicsurface/focus_0_120_0")).read_bytes())
        wait_for(lambda: "one focus at (0.0, 119.9, 0.0)" in log.read_text())
        os.close(port)
        process.send_signal(signal.SIGINT)
        assert process.wait(DEADLINE_S) == 0
    finally:
        process.kill()
        process.wait()
    assert "PASS: 1 latch of the client" in log.read_text()
    assert not link.exists()


def test_the_back_door_of_a_running_board_is_watched(tmp_path, capsys):
    door, link = f"unix:{tmp_path}/door", tmp_path / "board"
    board = BoardProcess(
        ["--dialect=sonicsurface", f"--link={link}", f"--backdoor={door}", "--no-reconstruct"],
        tmp_path / "log",
    )
    try:
        board.wait_until_ready()
        frame = Path(capture("sonicsurface/focus_0_120_0")).read_bytes()
        watched = threading.Event()

        def send() -> None:
            """Write the frame again and again: the socket shows what comes once it is open."""
            port = os.open(link, os.O_RDWR | os.O_NOCTTY)
            while not watched.wait(0.05):
                os.write(port, frame)
            os.close(port)

        sender = threading.Thread(target=send)
        sender.start()
        try:
            status, out, _ = watch(capsys, door, "--latches", "2")
        finally:
            watched.set()
            sender.join()
    finally:
        board.stop()
        board.close_pipe()
    assert status == 0
    assert "PASS: 2 latches of the client" in out


def test_the_last_records_of_a_board_that_ends_are_read():
    """It writes them and ends, between a read that finds nothing and the question if it runs."""

    class Stream:
        is_open, reads = True, 0

        def read(self):
            self.reads += 1
            return {1: [{"kind": "hello"}], 3: [{"kind": "end"}]}.get(self.reads, [])

    stream, taken = Stream(), []
    read = reader_of_watched(stream, lambda: stream.reads < 2)
    records = WatchedRecords("x", read)
    taken += [record["kind"] for record in records]
    records.close()
    assert taken == ["hello", "end"]


@pytest.mark.parametrize("words", [(), ("--as-device",)])
def test_a_program_beside_a_source_is_told_how_it_is_run(words, capsys):
    status, _, err = watch(
        capsys, "bytes.bin", "--dialect", "sonicsurface", *words, "--", "program", "argument"
    )
    assert (status, err) == (
        2,
        "haptogram watch: -- is one word too many; only --as-device takes a program, and no "
        "source\n",
    )

"""``haptogram conform``: its files, its exit status, a baseline, a board in another process."""

import json
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from haptogram.cli import main

ROOT = Path(__file__).parents[3]
FEW = ["--quiet", "--clause", "HG-2.3", "--clause", "HG-4.1", "--clause", "HG-5.3/2"]
SMALL = ["--port", "haptogram://?clock=virtual&array=4x4", *FEW]


def broken(mutant):
    return ["--quiet", "--port", f"haptogram://?clock=virtual&array=4x4&mutant={mutant}"]


def test_a_run_writes_all_its_files(tmp_path, capsys):
    json_, junit, html = (tmp_path / name for name in ("a.json", "a.xml", "a.html"))
    files = ["--json", str(json_), "--junit", str(junit), "--html", str(html)]
    assert main(["conform", *SMALL, *files]) == 0
    assert "verdict      PASS" in capsys.readouterr().out

    found = json.loads(json_.read_text())
    verdicts = {item["case"]: item["behaviour"] for item in found["results"]}
    assert verdicts["HG-2.3/1"] == "OK"
    assert verdicts["HG-5.3/2"] == "NOT-OBSERVED"
    assert found["device"]["transducers"] == 16
    suite = ElementTree.parse(junit).getroot().find("testsuite")
    assert int(suite.get("tests")) == len(verdicts)
    assert int(suite.get("skipped")) == list(verdicts.values()).count("NOT-OBSERVED")
    assert len(suite.findall("testcase/skipped")) == int(suite.get("skipped"))
    assert "HG-2.3/1" in html.read_text()


def test_a_failure_is_a_failure_everywhere(tmp_path, capsys):
    files = ["--junit", str(tmp_path / "a.xml"), "--html", str(tmp_path / "a.html")]
    clauses = ["--clause", "HG-2.3", "--clause", "HG-2.4/2", "--clause", "HG-11.4/1"]
    assert main(["conform", *broken("crc-unchecked"), *clauses, *files]) == 1
    out = capsys.readouterr().out
    heading = re.search(r"<h1>FAIL: (.* cases: .*)</h1>", (tmp_path / "a.html").read_text())[1]
    assert re.search(r"cases: \d+ FAILED, \d+ OK, \d+ NOT-OBSERVED$", heading)
    assert f"cases        {heading}\n" in out
    assert "HG-2.4/2  FAILED" in out
    assert "requirement  A receiver MUST drop a frame whose CRC is wrong" in out
    suite = ElementTree.parse(tmp_path / "a.xml").getroot().find("testsuite")
    assert int(suite.get("failures")) == len(suite.findall("testcase/failure")) >= 1
    assert "bytes exchanged" in (tmp_path / "a.html").read_text()


def test_a_baseline_takes_known_failures_and_tells_of_passes(tmp_path, capsys):
    known = tmp_path / "expected.toml"
    run = [*broken("crc-unchecked"), "--clause", "HG-2.4", "--clause", "HG-2.5"]
    assert main(["conform", *run, "--write-baseline", str(known)]) == 1
    assert main(["conform", *run, "--baseline", str(known)]) == 0
    capsys.readouterr()
    healthy = ["--port", "haptogram://?clock=virtual&array=4x4", "--clause", "HG-2.4", "--quiet"]
    assert main(["conform", *healthy, "--baseline", str(known)]) == 0
    assert "FAILED was expected" in capsys.readouterr().out
    known.write_text('[expected]\n"HG-2.5/1" = "FAILED"\n')
    assert main(["conform", *run, "--baseline", str(known)]) == 1  # HG-2.4/2 is new


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ('[expected]\n"HG-99" = "FAILED"\n', "there is no case"),
        ('[expected]\n"HG-2.5/1" = "BROKEN"\n', "are known"),
        ("expected = 3\n", "one table"),
        ("[[[", "expected.toml"),
    ],
)
def test_a_baseline_that_makes_no_sense(tmp_path, capsys, text, why):
    (tmp_path / "expected.toml").write_text(text)
    assert main(["conform", *SMALL, "--baseline", str(tmp_path / "expected.toml")]) == 2
    assert why in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        ["--port", "/dev/does-not-exist"],
        ["--clause", "HG-99"],
        ["--clause", "HG-2", "--clause", "HG-98"],
        ["--timeout", "0"],
        ["--timeout", "nan"],
        ["--timeout", "inf"],
        ["--repeat", "0"],
        ["--seed", "-1"],
        ["--baud", "0"],
        ["--boot-timeout", "nan"],
        ["--json", "/"],
        ["--spawn", "x", "--port", "y"],
        ["--spawn", ""],
        ["--spawn", "true", "--reset-cmd", "true"],
        ["--spawn", "true", "--dtr", "pulse"],
        ["--reset-cmd", "true"],
        ["--rts", "1", "--port", "haptogram://"],
        ["--port-regex", "x"],
        ["--spawn", "does-not-exist-here"],
        ["--spawn", "yes", "--boot-timeout", "0.1"],
        ["--spawn", "true", "--boot-timeout", "1"],
        ["--spawn", "true", "--port-regex", "("],
        ["--port", "haptogram://?colour=red"],
        ["--compare", "does-not-exist.json", "--html", "x.html"],
        ["--compare", "does-not-exist.json"],
    ],
)
def test_what_cannot_be_run_is_status_2_and_one_line(capsys, arguments):
    assert main(["conform", *arguments]) == 2
    err = capsys.readouterr().err
    assert err.startswith("haptogram conform: ")
    assert err.count("\n") == 1


def test_the_list_names_every_case(capsys):
    assert main(["conform", "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 220
    assert any(line.startswith("HG-4.1/1 ") and "not observable" in line for line in lines)


def test_devices_side_by_side(tmp_path):
    files = [tmp_path / "healthy.json", tmp_path / "broken.json"]
    main(["conform", *SMALL, "--json", str(files[0])])
    main(["conform", *broken("crc-unchecked"), "--clause", "HG-2.4/2", "--json", str(files[1])])
    page = tmp_path / "matrix.html"
    assert main(["conform", "--compare", *map(str, files), "--html", str(page)]) == 0
    text = page.read_text()
    assert "HG-2.3/1" in text
    assert "FAILED" in text
    assert text.count("haptogram-sim 1") >= 2


#: An emulator that listens, says so, and then finds that it cannot start.
NO_EMULATOR = """
import socket, sys
server = socket.create_server(("127.0.0.1", 0))
print(f"listening on socket://127.0.0.1:{server.getsockname()[1]}", flush=True)
server.accept()
sys.exit("emulator: no such machine")
"""


def test_the_last_words_of_a_spawned_board_are_told(tmp_path, capsys):
    program = tmp_path / "emulator.py"
    program.write_text(NO_EMULATOR)
    assert main(["conform", "--spawn", f"{sys.executable} {program}", "--boot-timeout", "60"]) == 2
    err = capsys.readouterr().err
    assert err.endswith(" emulator: no such machine\n")
    assert f"; {sys.executable} ended with status 1; it printed: listening on " in err
    assert err.count("\n") == 1


@pytest.mark.nightly
@pytest.mark.pty
def test_a_spawned_board_is_restarted_for_the_clauses_about_a_reset(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{ROOT / 'protocol'}")
    command = f"{sys.executable} -m sim_device --array 4x4 --link {tmp_path}/board"
    chosen = ["--clause", "HG-2.7/3", "--clause", "HG-6.1/1", "--clause", "HG-2.3", "--quiet"]
    run = ["conform", "--spawn", command, "--boot-timeout", "60", "--timeout", "5", *chosen]
    assert main(run) == 0
    out = capsys.readouterr().out
    assert "3 OK" in out
    assert "wall time" in out


@pytest.mark.pty
def test_without_a_way_to_reset_these_clauses_are_not_observed(capsys):
    from haptogram.evidence.virtual_board import VirtualBoard

    with VirtualBoard("4x4", reconstruct=False, clock="wall") as board:
        chosen = ["--clause", "HG-6.1/1", "--clause", "HG-2.3", "--quiet", "--timeout", "5"]
        assert main(["conform", "--port", board.url, *chosen]) == 0
    out = capsys.readouterr().out
    assert "1 OK, 1 NOT-OBSERVED" in out


def test_an_interrupt_is_130_and_keeps_the_results(monkeypatch, capsys):
    from haptogram.conformance.run.runner import SuiteRunner

    judged = SuiteRunner.result

    def result(self, case):
        if case.id == "HG-4.1/1":
            raise KeyboardInterrupt
        return judged(self, case)

    monkeypatch.setattr(SuiteRunner, "result", result)
    assert main(["conform", *SMALL]) == 130
    out = capsys.readouterr().out
    assert "interrupted after" in out
    assert "INCONCLUSIVE (exit status 130)" in out


@pytest.mark.parametrize(
    "words",
    [
        ["verify", "--quiet"],
        ["conform", "--quiet", "--clause", "HG-2.3", "--timeout", "0.2"],
        ["bench", "--seconds", "0.1"],
    ],
)
def test_a_port_without_a_board_is_status_2_for_every_command(words, capsys):
    assert main([*words, "--port", "loop://"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith(f"haptogram {words[0]}: ")
    assert said.err.count("\n") == 1


def test_the_page_tells_a_case_after_which_the_board_does_not_recover(tmp_path):
    page = tmp_path / "a.html"
    gone = "haptogram://?clock=virtual&baud=3000000&fault=line.half_open+from=60ms"
    run = ["--quick", "--quiet", "--clause", "HG-2", "--port", gone]
    assert main(["conform", *run, "--html", str(page)]) == 1
    rows = re.findall(r"<td>(.*?)</td>\n<td class=\"wide\">(.*)<br>", page.read_text())
    told = [(re.sub("<.*?>", "", badge), text) for badge, text in rows if "recovery not" in text]
    lost = "recovery not clean: in a new session: no answer to GET_STATUS"
    assert any(badge == "not recovered" and text.startswith(lost) for badge, text in told)
    assert any(
        badge == "FAILED" and " came since then; recovery not clean: " in text
        for badge, text in told
    )

"""The commands in the documentation and in the CI files are commands that there are."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from haptogram.cli import main
from haptogram.conformance.verdict import meaning_table

DOCS = Path(__file__).parents[3] / "docs"
FILES = [DOCS / "conformance.md", *sorted((DOCS / "ci").glob("*.yml"))]


def commands(path):
    """Lines that begin with the command, with those that continue them."""
    text = path.read_text("utf-8").replace("\\\n", " ")
    if path.suffix == ".yml":  # folded: the lines behind belong to it, down to the next entry
        text = re.sub(r"\n +(?=--\w)", " ", text)
    found = re.findall(r"^ *(?:\.venv/bin/)?haptogram (conform.*)$", text, re.MULTILINE)
    return [shlex.split(command, comments=True) for command in found]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_command_can_be_parsed(path, capsys):
    found = commands(path)
    assert len(found) >= 3
    for command in found:
        if "--compare" not in command:
            assert main([*command, "--list"]) == 0
    capsys.readouterr()


@pytest.mark.parametrize("path", FILES[1:], ids=lambda path: path.name)
def test_ci_files_have_the_three_kinds_of_boards(path):
    told = " ".join(" ".join(command) for command in commands(path))
    assert "firmware_native" in told
    assert "qemu-system" in told
    assert "/dev/ttyACM0" in told


# A firmware build that opens a pseudo-terminal: here the virtual board in a process of its own.
FIRMWARE = """#!/bin/sh
rm -f build/board
{python} -m sim_device --array 4x4 --no-reconstruct --link build/board > build/log &
until [ -e build/board ]; do sleep 0.02; done
echo "PTY is $(readlink build/board)"
wait
"""


@pytest.mark.pty
@pytest.mark.parametrize("path", FILES[1:], ids=lambda path: path.name)
def test_the_native_job_runs(path, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PYTHONPATH", f"{DOCS.parent}:{DOCS.parent / 'protocol'}")
    monkeypatch.chdir(tmp_path)
    for folder in ("build", "conformance"):
        Path(folder).mkdir()
    firmware = Path("build/firmware_native")
    firmware.write_text(FIRMWARE.format(python=sys.executable))
    firmware.chmod(0o755)
    Path("conformance/expected.toml").write_text("[expected]\n")
    (native,) = [command for command in commands(path) if "./build/firmware_native" in command]
    few = ["--clause", "HG-2.3", "--clause", "HG-6.1", "--timeout", "5", "--boot-timeout", "60"]
    assert main([*native, *few]) == 0
    assert "2 OK" in capsys.readouterr().out
    assert Path("conform.xml").exists()
    assert Path("conform.html").exists()


@pytest.mark.parametrize("path", FILES[1:], ids=lambda path: path.name)
def test_ci_files_are_yaml_that_their_readers_take(path):
    yaml = pytest.importorskip("yaml", reason="not run: no PyYAML")
    read = yaml.safe_load(path.read_text("utf-8"))
    if path.name == "gitlab-ci.yml":
        jobs = {name: job for name, job in read.items() if name.startswith("conformance:")}
        scripts = [line for job in jobs.values() for line in job["script"]]
        assert {job["extends"] for job in jobs.values()} == {".conformance"}
    else:
        jobs = read["jobs"]
        assert read[True] == ["push", "pull_request"]  # YAML 1.1 reads "on" as a truth
        steps = [step for job in jobs.values() for step in job["steps"]]
        assert all(("uses" in step) != ("run" in step) for step in steps)
        scripts = [step["run"] for step in steps if "run" in step]
    assert len(jobs) == 3
    for script in scripts:
        assert subprocess.run(["bash", "-n", "-c", script], check=False).returncode == 0, script


def test_the_port_regex_of_the_examples_finds_the_port():
    (pattern,) = {
        command[command.index("--port-regex") + 1]
        for command in commands(FILES[1])
        if "redirected" in " ".join(command)
    }
    said = "char device redirected to /dev/pts/7 (label serial0)"
    assert re.search(pattern, said)[1] == "/dev/pts/7"


def test_the_table_of_verdicts_is_that_of_the_code():
    text = FILES[0].read_text("utf-8")
    table = re.search(r"<!-- verdicts -->\n```\n(.*?)\n```\n<!-- end -->", text, re.DOTALL)[1]
    assert table == meaning_table()

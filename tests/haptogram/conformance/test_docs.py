"""The commands in the documentation and in the CI files are commands that there are."""

import re
import shlex
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

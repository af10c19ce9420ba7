"""docs/recordings.md: its table is that of the channels; its examples run.

``python`` this file writes the table anew.
"""

import io
import re
import shlex
import sys
from pathlib import Path

import pytest

pytest.importorskip("mcap")

from haptogram.cli import main
from haptogram.evidence.recordings.channels import CHANNELS

PAGE = Path(__file__).parents[4] / "docs" / "recordings.md"
BEGIN = "<!-- channels: written by tests/haptogram/evidence/recordings/test_docs.py -->\n"
END = "<!-- end of channels -->\n"


def table():
    rows = [
        f"| `{channel.topic}` | {channel.clock} | {channel.meaning} |"
        for channel in CHANNELS.values()
    ]
    head = ["| channel | times by | a message is |", "|---|---|---|"]
    return "\n".join([*head, *rows, ""])


def written(text):
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}\n{table()}\n{END}{rest.split(END)[1]}"


def test_the_table_is_that_of_the_channels():
    text = PAGE.read_text(encoding="utf-8")
    assert text == written(text), f"python {__file__} writes it anew"


def test_the_examples_run_in_their_order(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```(sh|python)\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    assert len(blocks) >= 4
    for language, block in blocks:
        if language == "python":
            exec(compile(block, str(PAGE), "exec"), {})
            continue
        for line in block.splitlines():
            text, _, command = line.rpartition(" | ")
            if text:
                content = text.removeprefix("echo '").removesuffix("'").encode()
                monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(content)))
            program, *words = shlex.split(command)
            assert program == "haptogram"
            assert main(words) == 0, line
            assert capsys.readouterr().out


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")

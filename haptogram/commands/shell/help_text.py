"""The help of each command, in help.txt: what it does, then examples and exit status."""

from __future__ import annotations

from pathlib import Path

from haptogram.settings.parser import Parser


def describe_command(parser: Parser, name: str) -> None:
    """Give *parser* the texts of a command: the first paragraph is its description."""
    texts = Path(__file__).with_name("help.txt").read_text("utf-8")
    text = texts.partition(f"#### {name}\n")[2].partition("#### ")[0]
    description, _, parser.epilog = text.partition("\n\n")
    parser.description = " ".join(description.split("\n"))

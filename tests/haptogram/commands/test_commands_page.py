"""The page of the commands: its table, and on the site every option of every command."""

from __future__ import annotations

from pathlib import Path

import pytest
from commands_page import command_rows, section, words

from haptogram.cli import COMMANDS, command_parser

PAGE = Path(__file__).parents[3] / "docs" / "commands.md"


def test_the_page_lists_every_command() -> None:
    assert PAGE.read_text(encoding="utf-8").endswith(command_rows() + "\n")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_is_in_the_section_of_its_command(name: str) -> None:
    text = section(name)
    for action in command_parser(name)._actions:  # noqa: SLF001  argparse shows them to nobody
        if action.dest != "help":
            assert words(action).startswith("".join(action.option_strings[:1]))
            assert f"| `{words(action)}` |" in text

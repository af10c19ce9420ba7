"""docs/commands.md, which is written from the parsers: ``python`` this file writes it anew."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import pytest

from haptogram.cli import COMMANDS, command_parser

PAGE = Path(__file__).parents[3] / "docs" / "commands.md"
HEAD = """\
# Commands

This page is written from the parsers of the commands, and a test holds it up to date. Every command
prints the same with `--help`, and with `-h` a page of what matters most.

- An option has one name, with its unit, in all commands, in TOML files and in `haptogram://` URLs.
  There are no abbreviations.
- A refusal comes before the work, in one line with option, value and limit, with exit status 2. An
  option that does nothing in its mode is refused, and so are two outputs with one name, an output
  that would replace a file which the command reads, and a file that cannot be written.
- `-` as the name of an output is standard output; the text goes to standard error then.
- Verdicts and errors have a colour on a terminal, not in pipes or files; `NO_COLOR` and
  `FORCE_COLOR` are respected.
"""


def page() -> str:
    """Return the page."""
    rows = [
        f"| [`haptogram {name}`](#haptogram-{name}) | {what} |"
        for name, (_, what) in COMMANDS.items()
    ]
    table = "\n".join(["| command | job |", "|---|---|", *rows])
    return "\n".join([HEAD, table, "", *map(section, COMMANDS)])


def section(name: str) -> str:
    """Return what the page has of one command."""
    parser = command_parser(name)
    assert parser.description is not None
    assert parser.epilog is not None
    lines = [f"## haptogram {name}", "", parser.description, ""]
    for group in parser._action_groups:  # noqa: SLF001  argparse shows them to nobody
        actions = [a for a in group._group_actions if a.dest != "help"]  # noqa: SLF001
        if actions:
            lines += list(group_lines(group, actions))
    return "\n".join([*lines, "```text", parser.epilog.rstrip(), "```", ""])


def group_lines(group: argparse._ArgumentGroup, actions: list[argparse.Action]) -> Iterator[str]:
    """Yield the table of a group of options."""
    title = {"positional arguments": "arguments"}.get(str(group.title), group.title)
    yield from (f"**{title}**", "")
    if group.description:
        yield from (group.description, "")
    yield from ("| option | meaning |", "|---|---|")
    for action in actions:
        text = (action.help or "").replace("%%", "%")
        yield f"| `{words(action)}` | {text} |"
    yield ""


def words(action: argparse.Action) -> str:
    """Return an option with the placeholder of its value."""
    is_pair = isinstance(action, argparse.BooleanOptionalAction)
    shown = action.option_strings[:1] if is_pair else action.option_strings
    names = ", ".join(shown)
    if is_pair or action.nargs == 0:
        value = ""
    elif action.choices is not None and action.metavar is None:
        value = "/".join(map(str, action.choices))
    else:
        value = str(action.metavar or action.dest.upper())
    value = f"[{value}]" if action.nargs in ("?", "*") else value
    # A bar would end the cell of the table.
    return f"{names} {value}".strip().replace("|", "/")


def test_the_page_is_what_the_parsers_say() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), f"python {__file__} writes it anew"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_has_its_name_in_the_table(name: str) -> None:
    for action in command_parser(name)._actions:  # noqa: SLF001  argparse shows them to nobody
        if action.dest != "help":
            assert words(action)
            assert words(action).startswith("".join(action.option_strings[:1]))


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")

"""The page of all commands: every option of each, as the parsers have it; the site shows it."""

import argparse
from collections.abc import Iterator

from haptogram.cli import COMMANDS, command_parser


def command_rows() -> str:
    """Return the table of the commands."""
    rows = [f"| `haptogram {name}` | {what} |" for name, (_, what) in COMMANDS.items()]
    return "\n".join(["| command | job |", "|---|---|", *rows])


def sections() -> str:
    """Return the options, examples and exit statuses of every command."""
    return "\n".join(map(section, COMMANDS))


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

"""Colour on a terminal: verdicts and errors, nowhere in pipes or files unless it is asked for."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Sequence
from typing import Final, TextIO

_RED: Final = "31"
_COLOURS: Final = {"PASS": "32", "FAIL": _RED, "INCONCLUSIVE": "33"}
_VERDICT: Final = re.compile(rf"^((?:verdict +)?)({'|'.join(_COLOURS)})\b", re.MULTILINE)
#: The two forms of a command of GitHub: a line that begins with ::, and ##[ anywhere.
_COMMANDS: Final = re.compile(r"(?m)^(\s*):(?=:)|#(?=#\[)")


def terminal_has_colour(stream: TextIO) -> bool:
    """Return True if *stream* takes colours.

    NO_COLOR and FORCE_COLOR decide, in this order; else a terminal does, unless it is dumb.
    """
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    return os.environ.get("TERM") != "dumb" and stream.isatty()


def is_terminal_of_github_job() -> bool:
    """Return True if this program runs in a job of GitHub, which obeys commands among its lines."""
    return os.environ.get("GITHUB_ACTIONS") == "true"


def terminal_text_without_job_commands(text: str) -> str:
    """Return *text*; in a job of GitHub, with a space in everything that is a command there."""
    return (
        _COMMANDS.sub(lambda found: f"{found[0]} ", text) if is_terminal_of_github_job() else text
    )


def printable_on_terminal(text: str) -> str:
    r"""Return *text* with U+FFFD for every control character: no terminal obeys a board's name.

    Examples
    --------
    >>> printable_on_terminal("v1\n::error::")
    'v1\ufffd::error::'
    """
    return "".join(sign if sign.isprintable() else "\ufffd" for sign in text)


def terminal_error_line(program: str, message: str, stream: TextIO) -> str:
    """Return the one line of an error on *stream*, the name of the program in red."""
    name = f"{program}:"
    shown = _painted_on_terminal(name, _RED) if terminal_has_colour(stream) else name
    line = printable_on_terminal(re.sub(r"\s", " ", message))  # a name of a file may hold anything
    return terminal_text_without_job_commands(f"{shown} {line}")


def terminal_command_line(words: Sequence[str]) -> str:
    r"""Return the one line of a shell that runs *words*, a line feed in one of them as ``\n``.

    Examples
    --------
    >>> print(terminal_command_line(["haptogram", "--fault=line.drop p=1", "it's\nso"]))
    haptogram '--fault=line.drop p=1' $'it\'s\nso'
    """
    # A text with a double quote is shown in single ones, which is how $'...' is written.
    return " ".join(
        shlex.quote(word) if word.isprintable() else "$" + repr(f'{word}"')[:-2] + "'"
        for word in words
    )


def paint_verdicts_on_terminal(text: str, stream: TextIO) -> str:
    """Return *text* with the verdicts at the beginnings of its lines in their colours.

    It holds no command of a job of GitHub, though a board may have put one into its name.
    """
    text = terminal_text_without_job_commands(text)
    if not terminal_has_colour(stream):
        return text
    return _VERDICT.sub(
        lambda match: match[1] + _painted_on_terminal(match[2], _COLOURS[match[2]]), text
    )


def _painted_on_terminal(text: str, colour: str) -> str:
    """Return *text* bold in a colour, a code of SGR such as 31, between escape sequences."""
    return f"\x1b[1;{colour}m{text}\x1b[0m"

"""The parser of every command line: a refusal is one line with a guess at the right word.

It takes no abbreviations, and notes which options were given.
``-h`` prints a page, ``--help`` all of it.
"""

from __future__ import annotations

import argparse
import copy
import itertools
import os
import re
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, NoReturn, TypeVar

from ..errors import ConfigurationError
from .arguments import check_choice, did_you_mean, option_word

_T = TypeVar("_T")
_COLUMNS: Final = 80
_SHOWN: Final = 40  # characters of a value that are printed
_EXAMPLES_ON_A_PAGE: Final = 2
#: A help text: its first clause, the rest, and its default unless that is none.
_CLAUSES: Final = re.compile(
    r"(.*?)(?:(?:;|\.(?= [A-Z])) .*?)?(?: \[none\]|( \[[^]]*\]))?", re.DOTALL
)
_EXAMPLE: Final = re.compile(r"^  \S.*\n(?:   .*\n)*", re.MULTILINE)
_OPTION: Final = re.compile(r"--[a-z][a-z0-9-]*")
_NEGATIVE: Final = re.compile(r"-(?:[\d.].*|inf|nan)")
#: The words of argparse that a user does not know, and plain ones.
_PLAINER: Final = (
    (r"^argument ([^:]+): ", r"\1 "),
    (r"expected (?:at least )?one argument", "needs a value"),
    (r"expected \d+ arguments?", "needs a value"),
    (r"not allowed with argument", "does not go with"),
    (r"ignored explicit argument .*", "takes no value"),
    (r"^the following arguments are required: (.*)", r"\1 is missing; --help tells more"),
    (r"^one of the arguments (.*) is required", r"one of \1 is missing; --help tells more"),
)


class Acting(NamedTuple):
    """When an option acts.

    Attributes
    ----------
    where : str
        The modes in words, after "acts only".
    is_there : callable
        Returns True for the settings of a command in such a mode.
    """

    where: str
    is_there: Callable[[Any], bool]


class UsageError(ConfigurationError):
    """A command line that cannot be used.

    Attributes
    ----------
    program : str
        Name of the program and of its command, as the user called them.
    """

    def __init__(self, program: str, message: str) -> None:
        super().__init__(message)
        self.program = program


class _HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """As wide as the terminal; argparse would load shutil, with its compressors, to ask."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=_parser_columns() - 2)

    def words_of(self, argument: argparse.Action) -> str:
        """Return how often an argument without an option can stand, with its placeholder."""
        return self._format_args(argument, str(argument.metavar))


class _Help(argparse.Action):
    """``-h``: the page of the command; ``--help``: all of it."""

    def __call__(self, parser: argparse.ArgumentParser, *called: Any, **_: Any) -> None:
        """Print and end."""
        if isinstance(parser, Parser) and called[-1] == "-h":
            sys.stdout.write(parser.format_page())
        else:
            sys.stdout.write(parser.format_help())
        parser.exit()


def _parser_columns() -> int:
    """Return the columns that COLUMNS names, else those of the terminal, else 80."""
    named = os.environ.get("COLUMNS", "")
    if named.isdecimal() and int(named) > 0:
        return int(named)
    try:
        return os.get_terminal_size(1).columns or _COLUMNS
    except OSError:  # a file or a pipe
        return _COLUMNS


class Parser(argparse.ArgumentParser):
    """A parser that raises :class:`UsageError` in one line instead of printing its usage.

    Attributes
    ----------
    main_options : str
        Names of the options that ``-h`` shows, apart by spaces; all, if there are few.
    program_option : str
        The option with which a program may stand behind ``--``; empty: there is none.
    listed : callable
        Returns the end of the whole help, which takes time to list; by default nothing.
    acting : mapping of str to Acting
        When each option acts, by its name; one that is not here always does.
    """

    def __init__(self, prog: str, **options: Any) -> None:
        super().__init__(
            prog,
            allow_abbrev=False,
            formatter_class=_HelpFormatter,
            add_help=False,
            **options,
        )
        self.main_options = ""
        self.program_option = ""
        self.listed: Callable[[], str] = str
        self.add_argument(
            *("-h", "--help"),
            action=_Help,
            nargs=0,
            default=argparse.SUPPRESS,
            help="-h: the options that matter most; --help: all of them",
        )
        self.acting: Mapping[str, Acting] = {}
        self._in_file: dict[str, str] = {}

    @property
    def option_actions(self) -> dict[str, argparse.Action]:
        """The actions by the words that call them."""
        return self._option_string_actions

    def format_help(self) -> str:
        """Return the whole help, and after it what takes time to list."""
        return super().format_help() + self.listed()

    def format_page(self) -> str:
        """Return usage, main options and two examples; for the list of commands, all of it."""
        if self._subparsers is not None:
            return self.format_help()
        named = [a for a in self._actions if a.option_strings and a.dest != "help"]
        words = [a for a in self._actions if not a.option_strings]
        main = [a for a in named if a.dest in self.main_options.split()]
        formatter = _HelpFormatter(self.prog)
        for title, actions in (("arguments", words), ("options", main or named)):
            formatter.start_section(title)
            formatter.add_arguments(map(_in_short, actions))
            formatter.end_section()
        usage = " ".join(["usage:", self.prog, "[OPTIONS]", *map(formatter.words_of, words)])
        about = (self.description or "").partition(". ")[0].rstrip(".") + "."
        shown = _EXAMPLE.findall((self.epilog or "").partition("\n\n")[0] + "\n")
        examples = "".join(shown[:_EXAMPLES_ON_A_PAGE])
        more = f"{self.prog} --help shows all options, more examples and the exit status"
        about = textwrap.fill(about, _parser_columns())
        parts = (usage, about, formatter.format_help(), f"examples:\n{examples}", f"{more}.")
        return "\n\n".join(part.rstrip() for part in parts if part) + "\n"

    def parse_known_args(  # type: ignore[override]  # overloads; nothing is ever left unknown
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """Parse and refuse the rest; leave ``parser`` and ``given``, the names of given options."""
        words = attach_negative_option_values(sys.argv[1:] if args is None else args)
        self._check_options(words)
        found, rest = super().parse_known_args(words, namespace)
        if rest:
            missing = self.program_option and rest[0] == "--"
            why = f"; only {self.program_option} takes a program, and no source" if missing else ""
            self.error(f"{_shown_option_value(rest[0])} is one word too many{why}")
        if self._subparsers is None:
            found.parser = self
            found.given = frozenset(self._given(words))
        return found, []

    def named(self, message: str) -> str:
        """Return *message* with the source of the value in place of the name that it begins with.

        The name is a Python argument or an option; the source is a key of a file, or the option.
        So is that of a setting to "give too" at its end.
        """
        message = re.sub(r"(?<=\bgive )\w+(?= too$)", lambda found: self._word(found[0]), message)
        name = message.partition(" ")[0]
        key = name.removeprefix("--").replace("-", "_")
        option = option_word(key)
        known = key.isidentifier() and option in self.option_actions and name in (key, option)
        return self._in_file.get(key, option) + message[len(name) :] if known else message

    def _word(self, name: str) -> str:
        """Return the setting *name* as an option is written; *name* if no option sets it."""
        return option if (option := option_word(name)) in self.option_actions else name

    def settle_source(self, file: Path | None, keys: Iterable[str]) -> None:
        """Let errors about *keys* name them as keys of *file*: their values came from there."""
        self._in_file = {key: f"{file}: {key}" for key in keys}

    def error(self, message: str) -> NoReturn:
        """Raise *message* as :class:`UsageError`."""
        for pattern, plain in _PLAINER:
            message = re.sub(pattern, plain, message)
        for action in self._actions:
            missing = f"{action.metavar} is missing"
            if isinstance(action.choices, tuple) and message.startswith(missing):
                message = f"{missing}; known are {', '.join(action.choices)}"
        raise UsageError(self.prog, message)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a value that is not among the choices; suggest the nearest command."""
        if action.choices is None or value in action.choices:
            return
        if isinstance(action.choices, dict):  # of parsers: those of the commands
            guess = did_you_mean(str(value), action.choices)
            known = f"; known are {', '.join(action.choices)}"
            self.error(f"there is no command {_shown_option_value(value)}{guess or known}")
        try:
            check_choice("", value, [str(choice) for choice in action.choices])
        except ConfigurationError as error:
            raise argparse.ArgumentError(action, str(error).strip()) from None

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:
        """Return an option's value as argparse does; refuse ``--option=--``, which has none.

        The error says that the option needs a value.
        """
        if action.option_strings and arg_strings == ["--"]:
            raise argparse.ArgumentError(action, "expected one argument")
        return super()._get_values(action, arg_strings)

    def _check_options(self, words: Sequence[str]) -> None:
        """Refuse unknown options before missing values are reported."""
        if self._subparsers is not None:  # those after a command are the command's
            words = list(itertools.takewhile(lambda word: word.startswith("-"), words))
        for word in _options_among_command_words(words):
            if word not in self.option_actions and not self._is_short(word):
                guess = did_you_mean(word, self.option_actions)
                self.error(f"there is no option {_shown_option_value(word)}{guess}")

    def _is_short(self, word: str) -> bool:
        """Return True for short options, alone or together with others or a value (-vh)."""
        return not word.startswith("--") and word[:2] in self.option_actions

    def _given(self, words: Sequence[str]) -> Iterator[str]:
        """Yield the names of the settings whose options are on the command line."""
        actions = self.option_actions
        return (
            actions[word].dest for word in _options_among_command_words(words) if word in actions
        )


def _in_short(action: argparse.Action) -> argparse.Action:
    """Return a copy of *action* whose help is the first clause and the default."""
    found = _CLAUSES.fullmatch(action.help or "")
    short = copy.copy(action)
    short.help = "".join(part or "" for part in found.groups()) if found else action.help
    return short


def _options_among_command_words(words: Sequence[str]) -> Iterator[str]:
    """Yield the option names among command-line words, without their values, up to "--"."""
    for word in words:
        if word == "--":
            return
        if len(word) > 1 and word.startswith("-") and not _NEGATIVE.fullmatch(word):
            name = word.partition("=")[0]
            if " " not in name:
                yield name


def attach_negative_option_values(words: Sequence[str]) -> list[str]:
    """Return *words* with values that begin with a minus attached to their options.

    argparse takes them for options: ``--focus-mm -20,0,120`` becomes ``--focus-mm=-20,0,120``.
    What is behind ``--`` is for another program.
    """
    result = [""]
    for word in words:
        if _OPTION.fullmatch(result[-1]) and _NEGATIVE.fullmatch(word) and "--" not in result:
            result[-1] += f"={word}"
        else:
            result.append(word)
    return result[1:]


def _shown_option_value(value: object) -> str:
    """Return *value* as a message shows it: on one line, 40 characters, nothing unprintable."""
    text = str(value)
    if not text or not text.isprintable() or " " in text:
        text = repr(text)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


# --- Values ----------------------------------------------------------------------------------


def file_name_option(text: str) -> Path:
    """Return the path of an argument that names a file or a folder."""
    return Path(name_option(text))  # Path("") is the current folder


def add_file_option(group: argparse._ActionsContainer, word: str, help: str, **more: Any) -> None:
    """Add an option, or an argument without one, that names a file."""
    more.setdefault("metavar", "FILE")
    group.add_argument(word, type=file_name_option, help=help, **more)


def add_flag(group: argparse._ActionsContainer, *words: str, help: str) -> None:
    """Add an option without a value, which is off unless it is given."""
    group.add_argument(*words, action="store_true", help=help)


def name_option(text: str, what: str = "the name of a file") -> str:
    """Return an argument that names a place, *what*, which may begin with ``unix:``."""
    if not text.removeprefix("unix:"):
        raise argparse.ArgumentTypeError(f"is {text!r}, must be {what}")
    return text


def checked_option_type(read: Callable[[str], _T], name: str = "") -> Callable[[str], _T]:
    """Return *read*, whose refusals begin with *name*, as the type of an argument."""

    def parse(text: str) -> _T:
        try:
            return read(text)
        except ConfigurationError as error:
            refusal = str(error).removeprefix(name).removeprefix(" ")
            raise argparse.ArgumentTypeError(refusal) from None

    return parse

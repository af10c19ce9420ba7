"""The parser of every command line: refusals of one line, guesses."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from haptogram.settings.command_line import add_command_options
from haptogram.settings.option import Settings, option, options_of
from haptogram.settings.parser import Parser, UsageError, attach_negative_option_values


@dataclass(frozen=True, kw_only=True)
class Rows(Settings):
    baud: int | None = option(None, unit="BAUD", low=1200, high=50_000_000, help="line")
    rate_hz: float = option(1000.0, unit="HZ", low=0.5, high=40_000.0, help="rate")
    hours: float = option(unit="HOURS", low=0.0, high=9.0, help="duration")
    name: tuple[str, ...] = option((), unit="NAME", help="100 % of them")
    trim: bool = option(False, help="shorter")


def parser() -> Parser:
    made = Parser("prog")
    rows = options_of(Rows)
    add_command_options(made, [rows["baud"], rows["rate_hz"]])
    made.add_argument("--mode", choices=("phases", "drives"))
    made.add_argument("--at-mm", nargs="?", const="here")
    made.add_argument("--quiet", action="store_true")
    made.add_argument("-v", "--verbose", action="store_true")
    return made


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("--baud 12x", "--baud is '12x', must be a whole number, 1200 to 50000000 Bd"),
        ("--baud 12", "--baud is 12, must be 1200 to 50000000 Bd"),
        ("--baud=", "--baud is '', must be a whole number, 1200 to 50000000 Bd"),
        ("--rate-hz nan", "--rate-hz is nan, must be 0.5 to 40000 Hz"),
        ("--rate-hz -1e3", "--rate-hz is -1000, must be 0.5 to 40000 Hz"),
        ("--rate-hz -inf", "--rate-hz is -inf, must be 0.5 to 40000 Hz"),
        ("--rate-hz", "--rate-hz needs a value"),
        ("--quiet=yes", "--quiet takes no value"),
        ("--mode phase", "--mode is 'phase'; known are phases, drives; did you mean phases?"),
        ("--mode 7", "--mode is '7'; known are phases, drives"),
        ("--link-baud=9600", "there is no option --link-baud; did you mean --baud?"),
        ("--rate 1000", "there is no option --rate; did you mean --rate-hz?"),
        ("--ratehz 1000", "there is no option --ratehz; did you mean --rate-hz?"),
        ("--xyzzy", "there is no option --xyzzy"),
        ("-x", "there is no option -x"),
        ("more", "more is one word too many"),
    ],
)
def test_a_refusal_is_one_line_with_option_value_and_limit(line: str, told: str) -> None:
    with pytest.raises(UsageError) as refused:
        parser().parse_args(line.split(" "))
    assert str(refused.value) == told
    assert refused.value.program == "prog"


def test_an_unknown_option_is_told_before_a_value_that_is_missing() -> None:
    with_required = parser()
    with_required.add_argument("--hours", required=True)
    with pytest.raises(UsageError, match="no option --baut; did you mean --baud"):
        with_required.parse_args(["--baut", "9600"])
    with pytest.raises(UsageError, match="--hours is missing; --help tells more"):
        with_required.parse_args([])


def test_a_word_that_is_missing_is_told_with_those_that_are_known() -> None:
    made = Parser("prog")
    made.add_argument("kind", choices=("am", "lm"), metavar="KIND")
    with pytest.raises(UsageError, match=r"^KIND is missing; known are am, lm$"):
        made.parse_args([])


def test_options_of_a_command_have_their_defaults_and_a_required_one_has_none() -> None:
    made = Parser("prog")
    add_command_options(made, options_of(Rows).values(), baud="that of the board")
    found = made.parse_args(["--hours", "2", "--name", "a", "--name=b"])
    assert (found.baud, found.rate_hz, found.hours) == (None, 1000.0, 2.0)
    assert (found.name, found.trim) == (["a", "b"], False)
    assert made.parse_args(["--hours", "2", "--trim"]).trim
    assert made.parse_args(["--hours", "2"]).name == []
    with pytest.raises(UsageError, match=r"^--hours is missing; --help tells more"):
        made.parse_args([])
    help_text = made.format_help()
    assert "duration\n" in help_text
    assert "line [that of the board]" in help_text
    assert "100 % of them [none]" in help_text
    assert "--no-trim" not in help_text


def test_given_names_the_options_of_the_command_line_and_no_default() -> None:
    found = parser().parse_args(["--baud", "9600", "-v", "--mode=drives"])
    assert found.given == {"baud", "verbose", "mode"}
    assert found.rate_hz == 1000.0


def test_a_command_is_guessed_and_its_options_are_its_own() -> None:
    root = Parser("prog")
    commands = root.add_subparsers(dest="command", required=True, metavar="COMMAND")
    commands.add_parser("verify").add_argument("--only-here")
    with pytest.raises(UsageError, match=r"^there is no command verfy; did you mean verify"):
        root.parse_args(["verfy"])
    with pytest.raises(UsageError, match=r"^COMMAND is missing; --help tells more"):
        root.parse_args([])
    with pytest.raises(UsageError, match="no option --only-her; did you mean --only-here") as told:
        root.parse_args(["verify", "--only-her", "1"])
    assert told.value.program == "prog verify"
    assert root.parse_args(["verify", "--only-here", "1"]).given == {"only_here"}


def test_an_error_of_a_python_argument_names_the_option() -> None:
    named = parser().named
    assert named("rate_hz is 0, must be 1 to 2") == "--rate-hz is 0, must be 1 to 2"
    assert named("rate is 0") == "rate is 0"
    assert named("--baud is 0") == "--baud is 0"
    assert named("mode") == "--mode"
    assert named("mode needs a rate: give rate_hz too") == "--mode needs a rate: give --rate-hz too"
    assert named("mode is x; give baud_rate too") == "--mode is x; give baud_rate too"


def test_a_strange_value_is_shown_short_and_harmless() -> None:
    with pytest.raises(UsageError) as refused:
        parser().parse_args(["--baud", "\x1b[31m" + "9" * 1000])
    assert "\x1b" not in str(refused.value)
    assert len(str(refused.value)) < 120


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--focus-mm", "-20,0,120"], ["--focus-mm=-20,0,120"]),
        (["--ear-mm", "-.5,-1e1,3", "--quiet"], ["--ear-mm=-.5,-1e1,3", "--quiet"]),
        (["--ear-mm", "--quiet"], ["--ear-mm", "--quiet"]),
        (["--step-mm", "-3"], ["--step-mm=-3"]),
        (["--json", "-"], ["--json", "-"]),
        (["-h", "-1,2,3"], ["-h", "-1,2,3"]),
        (["--", "prog", "--x", "-1"], ["--", "prog", "--x", "-1"]),
        ([], []),
    ],
)
def test_a_value_may_begin_with_a_minus(words: list[str], expected: list[str]) -> None:
    assert attach_negative_option_values(words) == expected

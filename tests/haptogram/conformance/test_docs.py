"""The commands in the documentation are commands that there are."""

import re
import shlex
from pathlib import Path

from haptogram.cli import command_parser
from haptogram.commands.acting_options import refuse_idle_options
from haptogram.commands.conform.options import check_conform_arguments
from haptogram.conformance.cases import all_cases, select
from haptogram.conformance.verdict import suite_verdict_meaning_table

PAGE = Path(__file__).parents[3] / "docs" / "conformance.md"


def commands():
    """Lines that begin with the command, with those that continue them."""
    text = PAGE.read_text("utf-8").replace("\\\n", " ")
    found = re.findall(r"^ *haptogram (conform.*)$", text, re.MULTILINE)
    return [shlex.split(command, comments=True) for command in found]


def test_every_command_is_parsed_and_refused_nothing():
    found = commands()
    assert len(found) >= 3
    for name, *words in found:
        arguments = command_parser(name).parse_args(words)
        refuse_idle_options(arguments)
        check_conform_arguments(arguments)
        assert all(any(select(all_cases(), [clause])) for clause in arguments.clause)


def test_the_table_of_verdicts_is_that_of_the_code():
    text = PAGE.read_text("utf-8")
    table = re.search(r"<!-- verdicts -->\n```\n(.*?)\n```\n<!-- end -->", text, re.DOTALL)[1]
    assert table == suite_verdict_meaning_table()

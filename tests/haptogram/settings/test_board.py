"""The options of a board: one table, and readers and writers that are each other's inverse."""

import inspect
import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.acoustics.arrays import MAX_TRANSDUCERS
from haptogram.errors import ConfigurationError
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram.settings.board import BOARD_OPTIONS, MOST_TRANSDUCERS, BoardConfig, FaultWords
from haptogram.settings.board_url import URL_OPTIONS, PortConfig, read_board_url, write_board_url
from haptogram.settings.command_line import add_setting_options, written_options
from haptogram.settings.command_line import given_options as given_words
from haptogram.settings.faults.kinds import FAULT_KINDS, PLACES, fault_words
from haptogram.settings.faults.plan import Fault
from haptogram.settings.option import options_of
from haptogram.settings.parser import Parser

DOCS = Path(__file__).resolve().parents[3] / "docs" / "board.md"
TEXTS = st.text(st.characters(codec="utf-8", exclude_categories=("C",)), min_size=1)
# An option that says nothing without another one.
NEEDS = {"baud_error_ppm": "baud", "rx_fifo": "baud", "latency_ms": "baud", "rx_poll_us": "rx_fifo"}


def test_the_most_elements_of_a_grid_are_those_of_an_array():
    assert MOST_TRANSDUCERS == MAX_TRANSDUCERS


def values_of(row):
    """Values within the limits of an option, to its very edges."""
    if row.count == 0:
        return st.lists(TEXTS, max_size=3).map(tuple)
    if row.choices:
        return st.sampled_from(row.choices)
    if row.kind is bool:
        return st.booleans()
    if row.kind is int:
        return st.integers(int(row.low), int(row.high))
    if row.kind is float:
        return st.floats(row.low, row.high)
    return TEXTS.map(row.kind)


@st.composite
def faults(draw, name):
    """A fault of this kind with any of its words."""
    parameters = {
        key: draw(
            st.integers(int(row.least), int(row.most))
            if row.whole
            else st.floats(row.least, row.most)
        )
        for key, row in FAULT_KINDS[name].items()
        if key not in PLACES and draw(st.booleans())
    }
    if set(PLACES) <= FAULT_KINDS[name].keys():
        parameters[draw(st.sampled_from(PLACES))] = draw(st.integers(0, 65_535))
    words = [f"{key}={value!r}" for key, value in parameters.items()]
    start_ns, length_ns = draw(st.integers(0, 10**12)), draw(st.integers(1, 10**12))
    times = {"from": f"from={start_ns}ns", "until": f"until={start_ns + length_ns}ns"}
    usable = [word for word in fault_words(name) if word in times]
    if name == "line.disconnect" and "ms" in parameters:
        usable.remove("until")
    words += [times[key] for key in usable if draw(st.booleans())]
    if "until" in "".join(words) and "from" not in "".join(words):
        words.append(times["from"])
    if "direction" in fault_words(name):
        words.append(f"direction={draw(st.sampled_from(['down', 'up', 'both']))}")
    return Fault.parse(" ".join([name, *words]))


@st.composite
def boards(draw):
    rows = options_of(BoardConfig)
    names = draw(st.sets(st.sampled_from(sorted(rows))))
    for name in sorted(names):
        while name in NEEDS:
            name = NEEDS[name]
            names.add(name)
    values = {name: draw(values_of(rows[name])) for name in sorted(names)}
    kinds = draw(st.lists(st.sampled_from(sorted(FAULT_KINDS)), max_size=3, unique=True))
    return BoardConfig(
        faults=tuple(draw(faults(kind)) for kind in kinds),
        line=BoardConfig.of(**{n: v for n, v in values.items() if n in LINE}).line,
        **{name: value for name, value in values.items() if name not in LINE},
    )


LINE = options_of(type(BoardConfig().line))


def read_words(words):
    parser = Parser("board")
    add_setting_options(parser, BOARD_OPTIONS.values())
    return BoardConfig.of(**given_words(parser.parse_args(words), BOARD_OPTIONS))


@given(boards())
def test_a_command_line_that_was_written_reads_as_the_same_board(board):
    assert read_words(written_options(board.non_default(), BOARD_OPTIONS)) == board


@given(boards(), st.data())
def test_a_url_that_was_written_reads_as_the_same_port(board, data):
    rows = options_of(PortConfig)
    given_ = {name: data.draw(values_of(row)) for name, row in rows.items()}
    port = PortConfig(board=board, **given_)
    assert read_board_url(write_board_url(port)) == port


@pytest.mark.parametrize("name", sorted(FAULT_KINDS))
def test_every_kind_of_fault_survives_url_and_command_line(name):
    @given(faults(name))
    def survives(fault):
        board = BoardConfig(faults=(fault,))
        assert read_words(written_options(board.non_default(), BOARD_OPTIONS)) == board
        assert read_board_url(write_board_url(PortConfig(board=board))).board == board

    survives()


@pytest.mark.parametrize("name", sorted(BOARD_OPTIONS.keys() - options_of(FaultWords).keys()))
def test_every_option_survives_url_and_command_line(name):
    row = BOARD_OPTIONS[name]
    others = {"baud": 9600, "rx_fifo": 9} if name in LINE else {}

    @given(values_of(row))
    def survives(value):
        board = BoardConfig.of(**(others | {name: value}))
        assert board.values()[name] == value
        assert read_words(written_options(board.non_default(), BOARD_OPTIONS)) == board
        assert read_board_url(write_board_url(PortConfig(board=board))).board == board

    survives()


@pytest.mark.parametrize("name", sorted(NEEDS))
def test_an_option_without_the_one_that_it_needs_is_refused(name):
    row = BOARD_OPTIONS[name]
    with pytest.raises(ConfigurationError, match=f"^{name} "):
        BoardConfig.of(**{name: row.high if row.kind is float else int(row.high)})


def test_a_fault_is_told_in_the_words_of_the_user():
    words = ("line.flip ber=0.00001 from=0.5s",)
    assert BoardConfig.of(fault=words).non_default()["fault"] == words


def beyond(row):
    below, above = math.nextafter(row.low, -math.inf), math.nextafter(row.high, math.inf)
    return (int(row.low) - 1, int(row.high) + 1) if row.kind is int else (below, above, math.nan)


NUMBERS = [name for name, row in BOARD_OPTIONS.items() if row.kind in (int, float)]


@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_beyond_its_limits_is_the_same_error_everywhere(name):
    row = BOARD_OPTIONS[name]
    for value in beyond(row):
        said = set()
        for read in (
            lambda value=value: BoardConfig.of(**{name: value}),
            lambda value=value: read_board_url(f"haptogram://?{name}={value!r}"),
            lambda value=value: read_words([f"{row.word}={value!r}"]),
        ):
            with pytest.raises(ConfigurationError) as error:
                read()
            text = str(error.value).removeprefix(f"haptogram://?{name}={value!r}: ")
            said.add(text.replace(row.word, name))
        assert re.fullmatch(rf"{name} is .*, must be .* to .*{row.sign}", next(iter(said)))
        assert len(said) == 1


def test_the_keywords_of_a_virtual_board_are_options_with_the_same_defaults():
    other_names = {"baudrate": "baud", "faults": "fault", "dialect_options": "dialect_option"}
    parameters = inspect.signature(VirtualBoard).parameters
    for name, parameter in parameters.items():
        if name not in ("reconstruct", "clock"):
            assert parameter.default == BOARD_OPTIONS[other_names.get(name, name)].default


def test_the_documentation_has_the_options_of_urls_alone():
    text = DOCS.read_text(encoding="utf-8")
    documented = re.findall(r"^\| `(\w+)` .*\|$", text, re.MULTILINE)
    assert set(documented) == URL_OPTIONS.keys() - BOARD_OPTIONS.keys() - {"backdoor"}
    for name in documented:
        assert table_row(name, URL_OPTIONS[name]) in text.splitlines()


def table_row(name, row):
    """The line of docs/board.md for an option."""
    limits = f"{row.low:.10g} to {row.high:.10g}" if row.kind in (int, float) else ""
    values = ", ".join(row.choices) or limits or row.unit.replace("|", " or ")
    return f"| `{name}` | {values} | {row.default_text} | {row.help} |"

"""The one table and the one paragraph of all text for a terminal."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.report.formats.console import WIDTH, console_paragraph, console_table

WORD = st.text("abcµ", min_size=1, max_size=12)


def test_texts_are_aligned_to_the_left_and_numbers_to_the_right():
    assert console_table(
        ("name", "n", ""), [("a", 5, "ok"), ("longer", 1234, "")], numbers=(1,)
    ) == [
        "name       n",
        "a          5  ok",
        "longer  1234",
    ]


def test_a_table_without_rows_is_its_head():
    assert console_table(("a", "b"), [], indent=2) == ["  a  b"]


def test_a_cell_is_one_line_and_nothing_that_a_terminal_obeys():
    assert console_table((), [("a\nb\x1b[31m", "c")]) == ["a\ufffdb\ufffd[31m  c"]


def test_a_row_that_lacks_a_cell_is_an_error():
    with pytest.raises(ValueError, match="shorter"):
        console_table(("a", "b"), [("only one",)])


@given(st.lists(st.tuples(WORD, WORD), min_size=1), st.integers(0, 6))
def test_every_cell_stands_below_its_heading(rows, indent):
    head, *lines = console_table(("first", "second"), rows, indent=indent)
    start = head.index("second")
    assert [line[start:] for line in lines] == [second for _, second in rows]
    assert all(line[:indent] == " " * indent for line in lines)


@given(st.lists(WORD, min_size=1), st.integers(0, 8))
def test_a_paragraph_keeps_its_words_within_the_width(words, indent):
    lines = console_paragraph(" ".join(words), indent=indent, bullet="- ")
    assert all(len(line) <= WIDTH for line in lines)
    assert " ".join(lines).split() == ["-", *words]

"""Records of a back door, whatever another program makes of one field, are read or refused."""

import contextlib
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dialect_boards import SENT, DialectBoard
from haptogram.errors import ConfigurationError
from haptogram.evidence.dialects.watched_board import WatchedBoard
from sim_device.backdoor.recorder import InlineReconstructionWorker

anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=2), inner),
    max_leaves=3,
)


def records_of(dialect):
    """Return the records of a board, as they are read from a file."""
    board, records = DialectBoard(dialect), []
    recorder = InlineReconstructionWorker(board.settings, records.append, reconstruct=False)
    board.send(SENT[dialect])
    for latch in board.latches:
        recorder.latch(latch)
        records[-1]["reconstruction"] = {"kind": "no_focus", "reason": "muted"}
    return json.loads(json.dumps(records))


RECORDS = {name: records_of(name) for name in ("ultraino-nano8", "ultraino-mega64")}


def places_in(value):
    """Yield every object in a value, with each name of its fields."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield value, name
            yield from places_in(inner)


def watch(records):
    board = WatchedBoard(records[0])
    return [board.latch(record) for record in records[1:]]


@pytest.mark.parametrize("name", RECORDS)
def test_whole_records_are_read(name):
    latches = watch(RECORDS[name])
    assert [latch.number for latch in latches] == [0, 1]


@pytest.mark.parametrize("name", RECORDS)
@pytest.mark.parametrize("number", [0, 2])
@given(data=st.data())
def test_a_field_of_another_type_is_read_or_refused(number, name, data):
    for place in range(sum(1 for _ in places_in(RECORDS[name][number]))):
        records = json.loads(json.dumps(RECORDS[name]))
        fields, field = list(places_in(records[number]))[place]
        fields[field] = data.draw(anything)
        if data.draw(st.booleans()):
            del fields[field]
        if all("kind" in record for record in records):  # as a reader of lines sees to
            with contextlib.suppress(ConfigurationError):
                watch(records)

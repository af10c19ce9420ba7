"""Two accounts are joined by their keys, whatever comes first; each difference is counted once."""

import contextlib
import dataclasses
import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.evidence.recordings.compare import RECORDED, REPLAYED, ReplayComparison
from haptogram.records.latch import Codes, LatchRecord
from haptogram_protocol.annotation.frames import annotated_frame
from haptogram_protocol.errors import RemoteProtocolError
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import MESSAGES, RESPONSE_RANGE, Header, Pong, Status
from strategies_protocol import records


def latch(index):
    codes = Codes(bytes([index % 256] * 4), b"\xff" * 4)
    return LatchRecord(1, 0, 0, index, index, 1000 * index, None, False, False, 8, codes)


def frame(message, seq=0, time_us=5):
    header = Header(message.TYPE, 0, seq, time_us, 1)
    return annotated_frame(encode_frame(header.pack() + message.pack())[1:-1])


@given(st.permutations([(side, n) for side in (RECORDED, REPLAYED) for n in range(8)]))
def test_the_order_in_which_two_accounts_come_does_not_matter(order):
    comparison = ReplayComparison(exact=True)
    for side, number in order:
        comparison.add_latch(side, latch(number))
    assert comparison.awaited == 0
    comparison.close(10**9)
    assert (comparison.same["latches"], comparison.differing) == (8, {})


@given(st.sets(st.integers(0, 9)), st.sets(st.integers(0, 9)))
def test_what_only_one_account_has_is_named(recorded, replayed):
    comparison = ReplayComparison(exact=True)
    for number in recorded:
        comparison.add_latch(RECORDED, latch(number))
    for number in replayed:
        comparison.add_latch(REPLAYED, latch(number))
    comparison.close(10**9)
    found = {(d.what, d.detail) for d in comparison.differences}
    assert found == {
        *((f"latch {n} of session 0x0001", "missing in the replay") for n in recorded - replayed),
        *((f"latch {n} of session 0x0001", "not in the recording") for n in replayed - recorded),
    }
    assert comparison.same["latches"] == len(recorded & replayed)


KEY = ("session", "sequence", "loop", "index")
CHANGES = {
    "session": 2,
    "sequence": 3,
    "loop": 1,
    "index": 6,
    "late": True,
    "ramping": True,
    "commanded_bits": 5,
    "t_latch_us": 7,
    "number": 99,
    "t_received_us": 3,
    "latched": Codes(b"\x00" * 4, b"\xff" * 4),
    "radiated": Codes(b"\x00" * 4, b"\xff" * 4),
}


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(LatchRecord)])
def test_every_field_of_a_latch_is_compared(name):
    comparison = ReplayComparison(exact=True)
    comparison.add_latch(RECORDED, latch(5))
    comparison.add_latch(REPLAYED, dataclasses.replace(latch(5), **{name: CHANGES[name]}))
    comparison.close(10**9)
    assert comparison.differing["latches"] == (2 if name in KEY else 1)


ANSWERS = [kind for number, kind in MESSAGES.items() if number in RESPONSE_RANGE]


@pytest.mark.parametrize("exact", [True, False])
def test_an_answer_of_another_type_is_a_difference_whatever_it_says(exact):
    for first, second in itertools.permutations(ANSWERS, 2):
        comparison = ReplayComparison(exact=exact)
        comparison.add_frame(RECORDED, frame(zeros(first)))
        comparison.add_frame(REPLAYED, frame(zeros(second)))
        assert comparison.differing["frames"] == 1, (first, second)


def zeros(kind):
    """Return a message of zeros, as far as 0 is a value of its fields."""
    size = kind.LAYOUT.size
    for value in range(2):
        with contextlib.suppress(RemoteProtocolError):
            return kind.unpack(bytes([value]) * size)
    raise AssertionError(kind)


#: Fields of answers that depend on the moment, on the clock or on the boot of a board.
OF_THE_MOMENT = {
    "Pong": {"t_rx_us", "t_tx_us"},
    "StatusReply": {"queued", "free_bytes", "last_seq", "last_latch_us", "margins", "counters"}
    | {"margin_min_us", "margin_mean_us", "config_crc"},
    "ConfigReply": {"config_crc"},
    "SetConfigReply": {"config_crc"},
    "DriveReply": {"t_latch_us"},
    "TraceReply": {"oldest", "next"},
}


@pytest.mark.parametrize(
    "name", sorted({kind.__name__ for kind in ANSWERS} - {"HelloReply", "Error"})
)
@given(data=st.data())
def test_between_two_clocks_every_field_counts_that_is_not_of_the_moment(name, data):
    kind = next(kind for kind in ANSWERS if kind.__name__ == name)
    one, other = data.draw(records(kind)), data.draw(records(kind))
    for path, changed in changed_one_by_one(one, other):
        comparison = ReplayComparison(exact=False)
        comparison.add_frame(RECORDED, frame(one))
        comparison.add_frame(REPLAYED, frame(changed))
        counts = changed != one and not OF_THE_MOMENT.get(name, set()).intersection(path)
        assert comparison.differing["frames"] == counts, path


def changed_one_by_one(one, other):
    """Yield the path of each field, and *one* with the value of *other* there."""
    for field, form in type(one).WIRE.items():
        values = getattr(one, field), getattr(other, field)
        inner = [((), values[1])] if form.record is None else changed_one_by_one(*values)
        for path, value in inner:
            yield (field, *path), dataclasses.replace(one, **{field: value})


@given(st.sets(st.integers(0, 9), min_size=1), st.sets(st.integers(0, 9)), st.integers(0, 2**32))
def test_an_answer_that_the_recorded_board_owed_is_a_difference(recorded, replayed, begin_us):
    """What came within 250 ms of the last frame that was read, the host may not have read."""
    for is_exact in (True, False):
        comparison = ReplayComparison(exact=is_exact)
        for side, numbers in ((RECORDED, recorded), (REPLAYED, replayed)):
            for number in sorted(numbers):
                time_us = (begin_us + 100_000 * number) % 2**32
                comparison.add_frame(side, frame(Pong(number, 0, 0), number, time_us))
        comparison.forget_replayed(frames=True)
        comparison.close(2**32)
        owed = {number for number in replayed - recorded if number < max(recorded) - 2}
        missing = len(recorded - replayed)
        assert comparison.differing["frames"] == missing + len(owed) * (not is_exact)


@given(records(Pong), records(Pong), st.integers(0, 99), st.integers(0, 99))
def test_times_count_on_the_same_clock_only(first, second, early_us, late_us):
    for exact in (True, False):
        comparison = ReplayComparison(exact=exact)
        comparison.add_frame(RECORDED, frame(first, time_us=early_us))
        comparison.add_frame(REPLAYED, frame(second, time_us=late_us))
        same = first.echo == second.echo
        if exact:
            same &= (first, early_us) == (second, late_us)
        assert comparison.same["frames"] == same


@given(records(Status))
def test_periodic_reports_are_not_compared_between_two_clocks(status):
    comparison = ReplayComparison(exact=False)
    comparison.add_frame(RECORDED, frame(status))
    assert comparison.awaited == 0


def test_the_same_frames_in_another_order_are_a_difference():
    comparison = ReplayComparison(exact=True)
    comparison.note_bytes(3, b"ab", b"ab")
    comparison.note_bytes(4, b"ab", b"ba")
    comparison.close(10**9)
    (difference,) = comparison.differences
    assert str(difference).startswith("bytes of the board at 4 µs: a read of 2 bytes")
    assert comparison.differing["bytes"] == 1

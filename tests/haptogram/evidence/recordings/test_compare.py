"""Two accounts are joined by their keys, whatever comes first; each difference is counted once."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.evidence.recordings.compare import RECORDED, REPLAYED, ReplayComparison
from haptogram.records.latch import Codes, LatchRecord
from haptogram_protocol.annotation.frames import annotated_frame
from haptogram_protocol.framing import encode_frame
from haptogram_protocol.messages import Header, Pong, Status
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


CHANGES = {
    "late": True,
    "t_latch_us": 7,
    "number": 99,
    "t_received_us": 3,
    "latched": Codes(b"\x00" * 4, b"\xff" * 4),
    "radiated": Codes(b"\x00" * 4, b"\xff" * 4),
}


@pytest.mark.parametrize("name", CHANGES)
def test_every_field_of_a_latch_is_compared(name):
    comparison = ReplayComparison(exact=True)
    comparison.add_latch(RECORDED, latch(5))
    comparison.add_latch(REPLAYED, dataclasses.replace(latch(5), **{name: CHANGES[name]}))
    assert comparison.differing["latches"] == 1


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

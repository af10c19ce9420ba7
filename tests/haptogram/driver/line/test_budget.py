import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.driver.line.budget import (
    LineBudget,
    check_line_rate,
    frame_bytes_on_line,
    highest_line_rate_hz,
    line_round_trip_ns,
    line_transmission_ns,
)
from haptogram.errors import ConfigurationError
from haptogram_protocol.framing import encode_frame


@given(st.integers(0, 2060), st.randoms(use_true_random=False))
def test_no_frame_is_longer_than_its_budget(payload, random):
    body = bytes(random.choices(range(1, 256), k=10 + payload))
    assert (
        frame_bytes_on_line(payload) - 2 <= len(encode_frame(body)) <= frame_bytes_on_line(payload)
    )
    assert len(encode_frame(os.urandom(10 + payload))) <= frame_bytes_on_line(payload)


def test_the_figures_of_the_design():
    size = frame_bytes_on_line(2 + 256)
    assert size == 276
    assert line_transmission_ns(size, 3_000_000) == 920_000
    assert int(highest_line_rate_hz(size, 3_000_000)) == 1086


def test_a_latency_timer_holds_back_the_answer():
    assert line_round_trip_ns(28, 30, 3_000_000) == 93_334 + 100_000
    assert line_round_trip_ns(28, 30, 3_000_000, 16_000_000) == 16_000_000 + 193_334


def test_a_rate_that_the_line_cannot_carry_is_refused_with_both_rates():
    check_line_rate(276, baudrate=3_000_000, rate_hz=1086)
    text = "rate_hz is 2000; 276 bytes a frame at 3000000 baud carry 1086 frames/s"
    with pytest.raises(ConfigurationError, match=text):
        check_line_rate(276, baudrate=3_000_000, rate_hz=2000)


@given(st.integers(1, 5000), st.integers(300, 12_000_000))
def test_transmission_is_never_shorter_than_the_bits(size, baudrate):
    bits_ns = size * 10 * 10**9
    assert bits_ns <= line_transmission_ns(size, baudrate) * baudrate < bits_ns + baudrate


def test_a_line_empties_at_its_rate():
    line = LineBudget(1_000_000)  # 10 µs a byte
    line.add(100, now_ns=5_000)
    assert line.free_ns == 1_005_000
    assert line.unsent_bytes(5_000) == 100
    assert line.unsent_bytes(505_000) == 50
    assert line.unsent_bytes(2_000_000) == 0
    line.add(10, now_ns=505_000)
    assert line.free_ns == 1_105_000
    line.add(10, now_ns=9_000_000)
    assert line.free_ns == 9_100_000


@given(st.integers(1, 1000), st.integers(0, 1000), st.integers(9600, 3_000_000))
def test_room_comes_when_no_more_than_asked_is_left(size, unsent, baudrate):
    line = LineBudget(baudrate)
    line.add(size, now_ns=0)
    assert line.unsent_bytes(max(0, line.room_at_ns(unsent))) <= unsent

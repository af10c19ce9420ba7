"""Bytes from the edges of a line, against a line that the test draws sample by sample."""

import numpy as np
import pytest

from haptogram.errors import ConfigurationError
from haptogram.evidence.captures.capture import Capture, ChannelEdges
from haptogram.evidence.captures.channel_map import ChannelMap
from haptogram.evidence.captures.pin_record import pin_record_of_capture
from haptogram.evidence.captures.uart import decoded_uart_bytes


def drawn(data, gaps, samples_a_bit):
    """Return the levels of a line, sample by sample, and when each byte has ended."""
    now, moments, levels, ends = 12.0 * samples_a_bit, [0.0], [1], []
    for value, gap in zip(data, gaps, strict=True):
        for bit in (0, *((value >> place) & 1 for place in range(8)), 1):
            moments.append(now)
            levels.append(bit)
            now += samples_a_bit
        ends.append(now)
        now += gap
    at = np.arange(int(now) + 100)
    return np.array(levels)[np.searchsorted(moments, at, side="right") - 1], np.array(ends)


def edges_of(levels, begin=0):
    levels = levels[begin:]
    return ChannelEdges(np.flatnonzero(np.diff(levels)) + 1, bool(levels[0]))


@pytest.mark.parametrize("samples_a_bit", [4.0, 5.333, 8.0, 104.17])
@pytest.mark.parametrize("clocks_apart", [0.0, 0.02, -0.02])
def test_every_byte_comes_back_with_its_time(samples_a_bit, clocks_apart):
    random = np.random.default_rng(1)
    data = random.integers(0, 256, 300).astype(np.uint8)
    data[:40] = np.tile([0x00, 0xFF, 0x55, 0xAA], 10)
    gaps = np.where(random.random(300) < 0.5, 0.0, random.uniform(0, 40, 300)) * samples_a_bit
    levels, ends = drawn(data.tolist(), gaps, samples_a_bit * (1.0 + clocks_apart))
    values, found, damaged = decoded_uart_bytes(edges_of(levels), samples_a_bit)
    assert values.tolist() == data.tolist()
    assert damaged == 0
    assert np.abs(found - ends).max() <= 2.0 + 10.0 * abs(clocks_apart) * samples_a_bit


def test_a_capture_that_begins_within_a_byte_is_read_from_the_next_pause_on():
    levels, _ = drawn([0x5A, 0xC3, 0x12, 0x34], [0, 200, 0, 0], 8.0)
    for begin in range(98, 250, 7):
        values, _, damaged = decoded_uart_bytes(edges_of(levels, begin), 8.0)
        assert values.tolist() == [0x12, 0x34]
        assert damaged == 0


def test_a_break_is_no_byte():
    levels, _ = drawn([0x31, 0x32], [400, 0], 8.0)
    levels[250:450] = 0
    values, _, damaged = decoded_uart_bytes(edges_of(levels), 8.0)
    assert values.tolist() == [0x31, 0x32]
    assert damaged == 1


def test_a_line_that_is_sampled_too_slowly_is_refused():
    clock = ChannelEdges(np.arange(50, 5000, 100), False)
    pin = ChannelEdges(np.arange(60, 5000, 100), False)
    line = ChannelEdges(np.array([100, 130]), True)
    channels = {"c": clock, "p": pin, "q": pin, "rx": line}
    capture = Capture("x.sr", channels, 1 / 8e6, 5000, 8e6)
    document = {"reference": "c", "to_board": "rx", "elements": {"p": 0, "q": 1}}
    with pytest.raises(ConfigurationError, match=r"2\.67 in a bit of rx .* 12000000|1\.2e\+07 Hz"):
        pin_record_of_capture(capture, ChannelMap.of("map", document))

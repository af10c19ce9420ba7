"""Maps of captures: what they may say, and what is refused, in one line."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from haptogram.errors import ConfigurationError
from haptogram.evidence.captures.capture import Capture, ChannelEdges
from haptogram.evidence.captures.channel_map import ChannelMap
from haptogram.evidence.captures.pin_record import pin_record_of_capture
from pin_captures import measured


def square(period=600, count=50, shift=0):
    rises = shift + period * np.arange(count, dtype=np.int64)
    return ChannelEdges(np.sort(np.concatenate([rises, rises + period // 2])), False)


CAPTURE = Capture(
    Path("pins.sr"),
    {"D0": square(), "D1": square(shift=150), "quiet": ChannelEdges(np.zeros(0, np.int64), False)},
    1 / 24e6,
    600 * 50,
    24e6,
)

REFUSED = {
    "elements = {D1 = 0}": "no reference",
    'reference = "D0"': "no [elements]",
    'reference = "D0"\nelements = "e"': "must have one {}",
    'reference = "D0"\n[elements]\nD1 = -1': "whole number from 0",
    'reference = "D0"\n[elements]\nD1 = true': "whole number from 0",
    'reference = "D0"\n[elements]\nD0 = 1\nD1 = 1': "are both element 1",
    'reference = "D0"\n[elements]\nD9 = 1': "no channel 'D9'; the capture has D0, D1, quiet",
    'reference = "D7"\n[elements]\nD1 = 1': "no channel 'D7'",
    'reference = "D0"\nlatch = "D7"\n[elements]\nD1 = 1': "no channel 'D7'",
    'reference = "D0"\nelements = "e{}"': "no channel of pins.sr is mapped",
    'reference = "D0"\ncarrier = 40e3\n[elements]\nD1 = 1': "carrier_hz",
    'reference = "D0"\ncarrier_hz = 50e3\n[elements]\nD1 = 1': "has 40000 Hz, must have",
    'reference = "quiet"\n[elements]\nD1 = 1': "has 0 pulses, must have 3",
    'reference = "D0"\nsample_rate_hz = 1e6\n[elements]\nD1 = 1': "sample at 1.28e+06 Hz or more",
    "reference = [": "is no TOML",
}


@pytest.mark.parametrize(("text", "words"), REFUSED.items())
def test_what_makes_no_sense_is_refused_in_one_line(text, words, tmp_path):
    file = tmp_path / "map.toml"
    file.write_text(text)
    with pytest.raises(ConfigurationError) as refusal:
        pin_record_of_capture(CAPTURE, ChannelMap.from_file(file))
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_the_phase_of_a_clock_that_is_a_quarter_late():
    found = measured(CAPTURE, {"reference": "D0", "elements": {"D1": 4, "quiet": 5}})
    assert found.latches == []
    assert found.weights.round(6).tolist() == [[1j, 0j]]
    again = dataclasses.replace(CAPTURE, stated_rate_hz=None, tick_s=1e-9)
    assert again.sample_rate_hz == pytest.approx(1e9 / 150)  # the grid that its edges lie on

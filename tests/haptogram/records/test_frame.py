import math

import pytest

from haptogram.errors import ConfigurationError
from haptogram.records.frame import Focus, FrameKey


def test_stream_keys_have_no_sequence_and_no_loop():
    assert FrameKey.of_stream(7, 65520) == FrameKey(7, 0, 0, 65520)


def test_focus_takes_any_three_numbers():
    assert Focus.at([0, 0.01, 0.15]) == Focus((0.0, 0.01, 0.15), 1.0, 0.0)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (((0, 0),), "three finite"),
        (((0, 0, math.nan),), "three finite"),
        (("abc",), "three finite"),
        (([(0, 0), (0, 0, 0.1)],), "x, y, z"),
        (((0, 0, 0.1), 1.5), "1.5, must be 0 to 1"),
        (((0, 0, 0.1), math.nan), "must be 0 to 1"),
        (((0, 0, 0.1), 1.0, math.inf), "phase_rad of a focus is inf, must be -1000000 to 1000000"),
    ],
)
def test_focus_refuses_what_is_no_focus(arguments, text):
    with pytest.raises(ConfigurationError, match=text):
        Focus.at(*arguments)

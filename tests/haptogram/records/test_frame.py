import math

import numpy as np
import pytest

from haptogram.errors import ConfigurationError
from haptogram.records.frame import Focus, FrameKey


def test_stream_keys_have_no_sequence_and_no_loop():
    assert FrameKey.of_stream(7, 65520) == FrameKey(7, 0, 0, 65520)


def test_focus_takes_any_three_numbers():
    assert Focus.at([0, 0.01, 0.15]) == Focus((0.0, 0.01, 0.15), 1.0, 0.0)
    assert Focus.at(np.array([0.0, 0.01, 0.15])) == Focus((0.0, 0.01, 0.15))
    assert Focus.at(np.array([0, 1, 2], dtype=np.int16)) == Focus((0.0, 1.0, 2.0))
    assert type(Focus.at(np.zeros(3, dtype=np.float32)).position_m[0]) is float


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (((0, 0),), "three finite"),
        (((0, 0, math.nan),), "three finite"),
        (("abc",), "three finite"),
        (([(0, 0), (0, 0, 0.1)],), "x, y, z"),
        ((np.zeros((3, 1)),), "x, y, z"),
        ((np.zeros(3, dtype=bool),), "x, y, z"),
        ((np.zeros(3, dtype=complex),), "x, y, z"),
        ((0.1,), "x, y, z"),
        ((b"abc",), "x, y, z"),
        (({0: 1, 1: 2, 2: 3},), "x, y, z"),
        (((0, 0, 10**400),), "x, y, z"),
        (((0, 0, 0.1), 1.5), "1.5, must be 0 to 1"),
        (((0, 0, 0.1), math.nan), "must be 0 to 1"),
        (((0, 0, 0.1), 1.0, math.inf), "phase_rad of a focus is inf, must be -1000000 to 1000000"),
    ],
)
def test_focus_refuses_what_is_no_focus(arguments, text):
    with pytest.raises(ConfigurationError, match=text):
        Focus.at(*arguments)

"""Which tests a change selects."""

from pathlib import Path

import pytest

from changed_tests import ALWAYS, touched_tests


@pytest.mark.parametrize(
    ("file", "selected"),
    [
        ("haptogram/acoustics/levels/force.py", "tests/haptogram/acoustics/levels"),
        ("sim_device/board/stream_queue.py", "tests/sim_device/board"),
        ("protocol/haptogram_protocol/cobs.py", "tests/protocol/test_cobs.py"),
        ("protocol/c/haptogram_codec.c", "tests/protocol_c"),
        ("protocol/SPEC.md", "tests/protocol/test_spec.py"),
        ("tests/oracles.py", "tests/haptogram/acoustics/field/test_reference.py"),
        ("tests/mutants/single/types.py", "tests/sim_device/test_mutants.py"),
        ("tests/test_start.py", "tests/test_start.py"),
        ("haptogram/no_such_module.py", ALWAYS),
    ],
)
def test_a_change_selects_the_tests_that_touch_it(file, selected):
    tests = touched_tests([file])
    assert selected in tests
    assert ALWAYS in tests
    assert len(tests) < len([*Path("tests").rglob("test_*.py")]) / 4


def test_nothing_changed_selects_the_contracts_alone():
    assert touched_tests([]) == [ALWAYS]

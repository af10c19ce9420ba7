from __future__ import annotations

import numpy as np
import pytest

from haptogram.acoustics import AcousticModel, TransducerArray
from haptogram.report.run.frame_rows import run_frame_table
from haptogram.verification import RunVerdict
from judged_runs import aim, damage, delay, hide, lose, make_run, targets


@pytest.fixture(scope="module")
def everything() -> RunVerdict:
    model = AcousticModel.default(6, 6)
    moved = targets(6)[5] + [3e-3, 0.0, 0.0]
    changes = {1: lose, 2: delay, 3: damage, 4: hide, 5: aim(model, moved)}
    return make_run(model, targets(6), changes)


def test_wrong_frames_come_first_then_the_largest_errors(everything: RunVerdict) -> None:
    table = run_frame_table(everything)
    numbers = [row["number"] for row in table["rows"]]
    assert sorted(numbers) == list(range(6))
    wrong = {frame.number for frame in everything.frames if frame.is_wrong}
    assert set(numbers[: len(wrong)]) == wrong
    assert (table["odd"], table["more"]) == (5, 0)


def test_frames_without_anything_odd_are_sorted_by_their_relative_error() -> None:
    run = make_run(AcousticModel.default(6, 6), targets(5))
    table = run_frame_table(run)
    errors = [float(row["cells"][-1]) for row in table["rows"]]
    assert errors == sorted(errors, reverse=True)
    assert all(0.0 < error <= 1.0 for error in errors)
    assert table["odd"] == 0


def test_a_coordinate_that_cannot_be_observed_has_no_error() -> None:
    plane = AcousticModel.default(2, 2)
    model = AcousticModel(TransducerArray.grid(128, 1), plane.medium, plane.transducer)
    run = make_run(model, np.array([(-0.1, 0.0, 0.15)]))
    frame = run.frames[0]
    assert frame.measured_m is not None
    assert frame.measured_m[0] is not None
    assert frame.bound_mm is not None
    assert frame.bound_mm[0] is not None
    error = 1e3 * abs(frame.measured_m[0] + 0.1) / frame.bound_mm[0]
    (row,) = run_frame_table(run)["rows"]
    assert row["cells"][-1] == f"{error:.3f}"

"""What becomes of a focus does not depend on where the array lies, nor on which way it faces.

From target to phases and from phases to the focus, by the reference and by the compiled ways: all
on an array that is turned and moved, against the same array where it was.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptogram.acoustics import (
    AcousticModel,
    Drive,
    FocusTracker,
    NumpyEngine,
    Reconstructor,
    SingleFocus,
    TransducerArray,
    dequantise_phase,
    find_pressure_peak,
    fit_focus,
    focus_phases,
    predict_focal_shift,
    propagators,
    quantise_phase,
    solve_foci,
    superpose_foci,
)
from solver_oracles import solver_quality
from strategies_acoustics import poses, seeds, targets, upright_poses

GRID = AcousticModel.default(8, 7)
FREE = AcousticModel(
    TransducerArray.from_positions(
        GRID.array.positions_m + np.random.default_rng(0).uniform(-1e-3, 1e-3, (56, 3))
    ),
    GRID.medium,
    GRID.transducer,
)
MODELS = st.sampled_from(["grid", "free"]).map({"grid": GRID, "free": FREE}.get)
near = targets(lateral=0.04, low=0.05, high=0.15)


def codes_of(model, target):
    return quantise_phase(focus_phases(model, target), 8)


@given(MODELS, poses(), near, near, st.floats(-3.0, 3.0))
def test_phases_and_weights_stay(model, pose, target, other, lag):
    moved, places = pose.model(model), pose.points([target, other])
    assert focus_phases(moved, places) == pytest.approx(
        focus_phases(model, [target, other]), abs=1e-11
    )
    arguments = [1.0, 0.5], [0.0, lag]
    difference = superpose_foci(moved, places, *arguments) - superpose_foci(
        model, [target, other], *arguments
    )
    assert np.abs(difference).max() <= 1e-11


@given(MODELS, poses(), near, seeds)
def test_fits_turn_with_the_array(model, pose, target, seed):
    """The reference to a nanometre; the compiled one, in single precision, to two micrometres."""
    start = target + np.random.default_rng(seed).uniform(-2e-3, 2e-3, 3)
    moved, codes = pose.model(model), codes_of(model, target)
    phases = dequantise_phase(codes, 8)
    expected = fit_focus(model, phases, start, phase_bits=8)
    found = fit_focus(moved, phases, pose.points(start), phase_bits=8)
    assert found.position_m == pytest.approx(pose.points(expected.position_m), abs=1e-9)
    assert found.residual_rad == pytest.approx(expected.residual_rad, abs=1e-6)
    quick = FocusTracker(moved).fit(codes, tuple(pose.points(start).tolist()))
    assert quick.position_m == pytest.approx(pose.points(expected.position_m), abs=2e-6)
    assert quick.residual_rms_rad == pytest.approx(expected.residual_rms_rad, abs=1e-4)
    assert quick.clearance_m == pytest.approx(
        np.linalg.norm(model.array.positions_m - expected.position_m, axis=1).min(), rel=1e-4
    )


@given(MODELS, poses(), near)
def test_peaks_turn_with_the_array(model, pose, target):
    moved, place = pose.model(model), pose.points(target)
    shift, expected = predict_focal_shift(moved, place), predict_focal_shift(model, target)
    assert shift.size_rad == pytest.approx(expected.size_rad, abs=1e-6)
    assert shift.offset_m == pytest.approx(pose.turn @ expected.offset_m, abs=1e-7, nan_ok=True)
    assert shift.gain == pytest.approx(expected.gain, abs=1e-7, nan_ok=True)
    weights = np.exp(1j * focus_phases(model, target))
    peaks = [
        find_pressure_peak(NumpyEngine(m), weights, x) for m, x in ((moved, place), (model, target))
    ]
    assert peaks[0] == pytest.approx(pose.points(peaks[1]), abs=1e-6)


@settings(max_examples=5)
@given(MODELS, upright_poses(), near)
def test_searches_follow_an_array_that_looks_up(model, pose, target):
    """They look above the array: it may be moved, and turned around the vertical."""
    codes = codes_of(model, target)
    expected = fit_focus(model, dequantise_phase(codes, 8), target, phase_bits=8)
    moved, place = pose.model(model), pose.points(expected.position_m)
    found = FocusTracker(moved).acquire(codes)
    assert found.position_m == pytest.approx(place, abs=2e-5)
    result = Reconstructor(moved).reconstruct(Drive(codes, np.full(56, 255)))
    assert isinstance(result, SingleFocus)
    assert result.position_m == pytest.approx(place, abs=1e-7)


@pytest.mark.parametrize("method", ["naive", "ibp", "gs", "gspat", "wgs"])
@given(pose=upright_poses(), lag=st.floats(0.0, 2.0 * math.pi))
@settings(max_examples=4)
def test_solvers_serve_the_foci_wherever_they_are(method, pose, lag):
    c, s = 0.02 * math.cos(lag), 0.02 * math.sin(lag)
    foci, wanted = np.array([[c, s, 0.12], [-s, c, 0.13], [-c, 0.03, 0.12]]), [1.0, 0.7, 0.9]
    moved, places = pose.model(GRID), pose.points(foci)
    expected = solve_foci(GRID, foci, wanted, method=method, rounds=20)
    found = solve_foci(moved, places, wanted, method=method, rounds=20)
    level = np.abs(propagators(moved, places) @ found)
    assert level == pytest.approx(np.abs(propagators(GRID, foci) @ expected), rel=2e-3)
    here, there = (
        solver_quality(GRID, expected, foci, wanted),
        solver_quality(moved, found, places, wanted),
    )
    assert there.uniformity == pytest.approx(here.uniformity, abs=5e-3)

"""Several foci at once: what each solver promises, and what they reach."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.solver_comparison import compare_solvers
from haptogram.acoustics import (
    AcousticModel,
    Medium,
    Transducer,
    TransducerArray,
    propagators,
    saturated_weights,
    superpose_foci,
)
from haptogram.acoustics.solvers import several
from haptogram.acoustics.solvers.several import (
    METHODS,
    solve_foci,
    weighted_gerchberg_saxton,
    weights_for_foci,
)
from haptogram.errors import ConfigurationError
from solver_oracles import solver_quality
from strategies_acoustics import seeds

BOARD = AcousticModel.default()
PHASE_ONLY = ["gs", "wgs", "gradient"]


def spread_foci(seed, count):
    """Foci on a 20 mm raster, so that none lies within the spot of another."""
    rng = np.random.default_rng(seed)
    nodes = rng.choice(49, count, replace=False)
    return np.column_stack(
        [(nodes % 7 - 3) * 0.02, (nodes // 7 - 3) * 0.02, rng.uniform(0.12, 0.18, count)]
    )


@pytest.mark.parametrize("method", METHODS)
def test_one_focus_gets_the_conjugate_phases(method):
    target = [[0.01, -0.02, 0.15]]
    weights = solve_foci(BOARD, target, method=method)
    arrivals = propagators(BOARD, target)[0] * weights
    assert abs(arrivals.sum()) == pytest.approx(np.abs(arrivals).sum(), rel=1e-3)


@pytest.mark.parametrize("method", METHODS)
@given(seed=seeds, count=st.integers(2, 8))
def test_magnitudes_never_exceed_one(method, seed, count):
    weights = solve_foci(BOARD, spread_foci(seed, count), method=method, rounds=10)
    assert weights.shape == (256,)
    assert np.abs(weights).max() <= 1.0 + 1e-9
    if method in PHASE_ONLY:
        assert np.abs(weights) == pytest.approx(np.ones(256))


@given(seeds, st.integers(2, 12))
def test_the_weighted_solver_evens_out_what_the_plain_one_leaves(seed, count):
    foci, ones = spread_foci(seed, count), np.ones(count)
    plain = solver_quality(BOARD, solve_foci(BOARD, foci, method="gs", rounds=60), foci, ones)
    even = solver_quality(BOARD, solve_foci(BOARD, foci, method="wgs", rounds=60), foci, ones)
    assert even.uniformity > (0.95 if count < 6 else 0.85)
    assert even.uniformity >= plain.uniformity - 1e-3
    assert even.efficiency > 0.8 * plain.efficiency


def test_foci_are_superposed_or_solved_and_never_driven_beyond_what_there_is():
    points, levels, lags = spread_foci(3, 4), [1.0, 0.8, 0.6, 0.9], [0.0, 1.0, 2.0, 3.0]
    naive = weights_for_foci(BOARD, points, levels, lags)
    assert (naive == saturated_weights(superpose_foci(BOARD, points, levels, lags))).all()
    assert np.abs(naive).max() == pytest.approx(1.0)
    solved = weights_for_foci(BOARD, points, levels, lags, method="wgs")
    assert (solved == solve_foci(BOARD, points, levels, method="wgs")).all()
    one = weights_for_foci(BOARD, points[:1], [0.5], [1.0], method="wgs")
    assert np.abs(one) == pytest.approx(0.5)  # a single focus needs no solver, and has its level


def test_the_gradient_lowers_the_misfit_that_naive_phases_leave():
    for seed in range(4):
        foci, ones = spread_foci(seed, 6), np.ones(6)
        naive = solver_quality(BOARD, solve_foci(BOARD, foci, method="naive"), foci, ones)
        found = solver_quality(BOARD, solve_foci(BOARD, foci, method="gradient"), foci, ones)
        assert found.uniformity > max(0.9, naive.uniformity)
        assert found.efficiency > 2.0 * naive.efficiency


@pytest.mark.parametrize(("method", "within"), [("wgs", 0.01), ("gradient", 0.1), ("gspat", 0.2)])
def test_wanted_amplitudes_are_followed(method, within):
    foci, wanted = spread_foci(3, 3), np.array([1.0, 0.5, 0.8])
    weights = solve_foci(BOARD, foci, wanted, method=method, rounds=200)
    level = np.abs(propagators(BOARD, foci) @ weights)
    assert level / level[0] == pytest.approx(wanted, rel=within)


def test_the_gradient_is_the_derivative_of_the_misfit(monkeypatch):
    captured = {}

    def spy(function, start, **options):
        captured["function"], captured["start"] = function, start
        return original(function, start, **options)

    import scipy.optimize

    original = scipy.optimize.minimize
    monkeypatch.setattr(scipy.optimize, "minimize", spy)
    solve_foci(AcousticModel.default(4, 4), spread_foci(1, 3) * [0.3, 0.3, 1], method="gradient")
    rng = np.random.default_rng(0)
    phases, direction = captured["start"] + 0.1, rng.normal(size=16)
    _, slope = captured["function"](phases)
    step = 1e-6
    up, down = (captured["function"](phases + s * direction)[0] for s in (step, -step))
    assert slope @ direction == pytest.approx((up - down) / (2 * step), rel=1e-5)


@given(seeds, st.integers(1, 32), st.integers(1, 60))
def test_the_compiled_solver_follows_the_reference(seed, count, rounds):
    foci = spread_foci(seed, count)
    matrix, ones = propagators(BOARD, foci), np.ones(count)
    start = superpose_foci(BOARD, foci, ones, np.zeros(count))
    slow = weighted_gerchberg_saxton(matrix, ones, start, rounds)
    expected = solver_quality(BOARD, slow, foci, ones)
    reached = solver_quality(BOARD, solve_foci(BOARD, foci, rounds=rounds), foci, ones)
    assert reached.efficiency == pytest.approx(expected.efficiency, abs=0.02)
    assert reached.uniformity == pytest.approx(expected.uniformity, abs=0.03)


@pytest.mark.parametrize("count", [1, 5, 16])
def test_compiled_propagators_lead_to_the_same_drive(count, monkeypatch):
    """Rounding to single precision apart, where a last bit may differ."""
    foci, levels = spread_foci(3, count), np.linspace(0.5, 2.0, count)
    fast = solve_foci(BOARD, foci, levels)
    assert (solve_foci(BOARD, foci, levels) == fast).all()
    monkeypatch.setattr(several, "_solved_for_pistons", lambda *_: None)
    assert np.abs(solve_foci(BOARD, foci, levels) - fast).max() < 2e-5


def test_foci_beside_the_highest_element_are_solved_without_compiled_propagators():
    places = AcousticModel.default(4, 4).array.positions_m + np.eye(16, 3, -13)[:, [2, 1, 0]] * 0.1
    model = AcousticModel(
        TransducerArray.from_positions(places), Medium.air(), AcousticModel.default(2, 2).transducer
    )
    pair = [[-0.01, 0.0, 0.06], [0.02, 0.01, 0.07]]
    assert model.array.positions_m[:, 2].max() > 0.07
    assert solver_quality(model, solve_foci(model, pair), pair, np.ones(2)).uniformity > 0.9


def test_quality_of_a_perfect_and_of_a_lopsided_drive():
    foci = np.array([[-0.03, 0, 0.15], [0.03, 0, 0.15]])
    matrix = propagators(BOARD, foci)
    perfect = solver_quality(BOARD, matrix[0].conj() / np.abs(matrix[0]), foci[:1], [1.0])
    assert (perfect.efficiency, perfect.uniformity) == pytest.approx((1.0, 1.0))
    lopsided = solver_quality(BOARD, matrix[0].conj() / np.abs(matrix[0]), foci, [1.0, 1.0])
    assert lopsided.uniformity < 0.1


def test_the_comparison_has_a_row_for_each_method_and_number():
    ticks = itertools.count(0, 1000)
    solvers = {
        method: lambda points, method=method: solve_foci(BOARD, points, method=method, rounds=5)
        for method in ("naive", "wgs")
    }
    rows = compare_solvers(BOARD, solvers, lambda: next(ticks), counts=(1, 3), sets=2)
    assert [(row["foci"], row["method"]) for row in rows] == [
        (1, "naive"), (1, "wgs"), (3, "naive"), (3, "wgs"),
    ]  # fmt: skip
    assert [row["time_us"] for row in rows] == [1.0] * 4
    assert all(0.0 <= row["uniformity"] <= 1.0 and row["efficiency"] > 0.0 for row in rows)
    assert rows[1]["efficiency"] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        ([[0, 0, 0.1]], {"method": "magic"}, "'magic'"),
        (np.empty((0, 3)), {}, "0 foci"),
        (np.full((257, 3), 0.1), {}, "257 foci"),
        ([[0, 0, 0.1]], {"rounds": 0}, "rounds is 0"),
        ([[0, 0, 0.1]], {"amplitudes": [0.0]}, "amplitude is 0"),
        ([[0, 0, 0.1]], {"amplitudes": [1.0, 1.0]}, "shape"),
        (spread_foci(1, 2), {"amplitudes": [1e-6, 2.0]}, "ratio of the amplitudes is 2000000"),
        ([[0, 0, 0.1], [0, 0, np.nan]], {}, "finite"),
        ([[0, 0, -0.1]], {}, "height z"),
    ],
)
def test_bad_input_is_refused(points, options, message):
    with pytest.raises(ConfigurationError, match=message):
        solve_foci(BOARD, points, **options)


@pytest.mark.parametrize("amplitudes", [(1e-6, 1.0), (1.0, 1e6), (1e6, 1e6)])
@pytest.mark.parametrize("method", METHODS)
def test_amplitudes_as_far_apart_as_may_be_give_a_drive(method, amplitudes):
    drive = solve_foci(BOARD, spread_foci(1, 2), amplitudes, method=method)
    assert np.isfinite(drive).all()


def test_a_single_focus_needs_no_solver_but_one_that_there_is():
    with pytest.raises(ConfigurationError, match="method is 'magic'"):
        weights_for_foci(BOARD, [[0, 0, 0.1]], [1.0], [0.0], method="magic")


class NarrowBeam:
    """A pattern of a user's own: nothing beyond 40 degrees."""

    baffled = True

    def gain(self, cos_theta, wavenumber):  # noqa: ARG002  (Directivity)
        return np.where(cos_theta >= np.cos(np.radians(40.0)), 1.0, 0.0)


def test_a_focus_that_no_element_reaches_is_refused():
    narrow = Transducer(NarrowBeam())
    model = AcousticModel(TransducerArray.grid(4, 4), Medium.air(), narrow)
    foci = [[0, 0, 0.1], [0.15, 0, 0.05]]
    for method in METHODS:
        with pytest.raises(ConfigurationError, match="focus 1 gets no sound"):
            solve_foci(model, foci, method=method)

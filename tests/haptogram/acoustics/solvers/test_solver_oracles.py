"""Every iterative solver against its paper's equations in plain loops, and what all promise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import solver_oracles
from haptogram.acoustics import (
    AcousticModel,
    propagators,
    solve_foci,
    superpose_foci,
)
from haptogram.acoustics.solvers.several import weighted_gerchberg_saxton
from strategies_acoustics import seeds

MODEL = AcousticModel.default(5, 4)
ORACLES = {
    "ibp": solver_oracles.backpropagation,
    "gs": solver_oracles.gerchberg_saxton,
    "wgs": solver_oracles.weighted_gerchberg_saxton,
    "gspat": solver_oracles.gs_pat,
}


def some_foci(seed):
    """One to three foci, 15 mm apart at least, and what is wanted of them."""
    rng = np.random.default_rng(seed)
    count = rng.integers(1, 4)
    places = np.array([[-0.02, 0.0], [0.015, 0.01], [0.0, -0.02]])
    places += rng.uniform(-3e-3, 3e-3, (3, 2))
    foci = np.column_stack([places, rng.uniform(0.04, 0.07, 3)])[:count]
    return foci, rng.uniform(0.3, 1.0, count)


@pytest.mark.parametrize("method", ORACLES)
@given(seed=seeds, rounds=st.integers(1, 6))
def test_a_solver_does_what_its_paper_says(method, seed, rounds):
    foci, wanted = some_foci(seed)
    start = superpose_foci(MODEL, foci, wanted, np.zeros(len(foci)))
    start /= np.abs(start).max()
    gains = propagators(MODEL, foci).tolist()
    expected = ORACLES[method](gains, wanted.tolist(), start.tolist(), rounds)
    found = solve_foci(MODEL, foci, wanted, method=method, rounds=rounds)
    assert np.abs(found - expected).max() <= (1e-3 if method == "wgs" else 1e-9)
    if method == "wgs":  # the one that is compiled has a reference of its own
        slow = weighted_gerchberg_saxton(np.array(gains), wanted, start, rounds)
        assert np.abs(slow - expected).max() <= 1e-9


@pytest.mark.parametrize("method", ["naive", "ibp", "gs", "wgs", "gspat", "gradient"])
@given(seed=seeds, share=st.floats(0.3, 0.7))
@settings(max_examples=6)
def test_a_focus_that_is_asked_for_less_gets_less(method, seed, share):
    rng = np.random.default_rng(seed)
    model = AcousticModel.default(12, 12)
    foci = [[-0.03, 0.0, 0.12], [0.03, rng.uniform(-0.02, 0.02), 0.12]]
    even, less = (
        np.abs(propagators(model, foci) @ solve_foci(model, foci, wanted, method=method, rounds=30))
        for wanted in ([1.0, 1.0], [1.0, share])
    )
    assert less[1] / less[0] < 0.9 * even[1] / even[0]

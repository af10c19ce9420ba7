"""Foci: the focus of a frame, and the phases of a focus."""

import time

import numpy as np
import pytest
import references
from solver_comparison import compare_solvers, random_foci

from haptogram.acoustics import (
    Drive,
    FocusTracker,
    NumpyEngine,
    Reconstructor,
    focus_phases,
    quantise_phase,
    solve_foci,
    superpose_foci,
)
from haptogram.acoustics.field.engines.compiled import load_kernels
from haptogram.acoustics.field.reference import propagators
from haptogram.acoustics.solvers.several import METHODS, weighted_gerchberg_saxton

OFFSET_M = (1.5e-3, -1.2e-3, 3e-3)  # of the hint from the focus


@pytest.fixture(scope="module")
def tracker(board):
    tracker = FocusTracker(board)
    tracker.warm_up()
    return tracker


def some_targets(count, low=0.12, high=0.25):
    rng = np.random.default_rng(count)
    return np.column_stack([rng.uniform(-0.05, 0.05, (count, 2)), rng.uniform(low, high, count)])


def frames(board, count=64):
    targets = some_targets(count)
    return targets, quantise_phase(focus_phases(board, targets), 8)


def in_turn(calls):
    """Call one after the other, round and round."""
    state = [0]

    def call():
        result = calls[state[0]]()
        state[0] = (state[0] + 1) % len(calls)
        return result

    return call


@pytest.mark.row("fit of a focus from a hint")
def test_warm_fit_against_a_local_search(compare, board, engine, tracker):
    targets, codes = frames(board)
    starts = [tuple(start) for start in (targets + OFFSET_M).tolist()]
    drives = np.exp(2j * np.pi * codes / 256)
    grids = [references.local_grid(start) for start in starts]
    fixes = [tracker.fit(c, s) for c, s in zip(codes, starts, strict=True)]
    errors = np.linalg.norm(np.array([fix.position_m for fix in fixes]) - targets, axis=1)

    def search(drive, grid):
        return grid[np.abs(engine.pressure(drive, grid)).argmax()]

    compare(
        25.0,
        in_turn([lambda c=c, s=s: tracker.fit(c, s) for c, s in zip(codes, starts, strict=True)]),
        in_turn([lambda d=d, g=g: search(d, g) for d, g in zip(drives, grids, strict=True)]),
        repeats=640,
        reference_repeats=64,
        median_error_um=float(np.median(errors) * 1e6),
    )


@pytest.mark.row("fit of a focus without a hint")
def test_acquisition_against_a_wide_search(compare, board, engine, tracker):
    targets, codes = frames(board)
    drives = np.exp(2j * np.pi * codes / 256)
    grid = references.wide_grid()
    squares = (grid**2).sum(axis=1)
    found = np.array([tracker.acquire(c).position_m for c in codes])
    errors = np.linalg.norm(found - targets, axis=1)
    assert errors.max() < 1e-3

    def search(drive, c):
        best = grid[(np.abs(engine.pressure(drive, grid)) ** 2 * squares).argmax()]
        return tracker.fit(c, tuple(best.tolist()))

    compare(
        5.0,
        in_turn([lambda c=c: tracker.acquire(c) for c in codes]),
        in_turn([lambda d=d, c=c: search(d, c) for d, c in zip(drives, codes, strict=True)]),
        repeats=64,
        reference_repeats=2,
        found=f"{(errors < 1e-3).sum()} of {len(errors)}",
    )


@pytest.mark.row("reconstruction of a drive")
def test_reconstruction_against_double_precision(compare, board):
    targets = some_targets(1)[0] + np.outer(np.arange(64), [2e-4, 0.0, 0.0])
    drives = [Drive.from_weights(np.exp(1j * focus_phases(board, t))) for t in targets]
    ours, reference = Reconstructor(board), Reconstructor(board, engine=NumpyEngine(board))
    vars(reference)["_tracker"] = None  # as where numba is not installed
    compare(
        None,
        in_turn([lambda d=d: ours.reconstruct(d) for d in drives]),
        in_turn([lambda d=d: reference.reconstruct(d) for d in drives]),
        repeats=16,
        reference_repeats=4,
    )


@pytest.mark.row("weighted Gerchberg-Saxton, {foci} foci")
@pytest.mark.parametrize("foci", [2, 4, 8, 16, 32])
def test_weighted_gerchberg_saxton_against_numpy(foci, compare, board):
    rounds = 100
    matrix = propagators(board, random_foci(np.random.default_rng(foci), foci))
    matrix = (matrix / np.abs(matrix).max()).astype(np.complex64)
    wanted, start = np.ones(foci, dtype=np.float32), np.ones(256, dtype=np.complex64)
    re, im = np.ascontiguousarray(matrix.real), np.ascontiguousarray(matrix.imag)
    drive_re, drive_im = np.ones(256, np.float32), np.zeros(256, np.float32)
    kernel = load_kernels().gerchberg_saxton_kernel
    compare(
        6.0 if foci == 16 else None,
        lambda: kernel(re, im, wanted, rounds, drive_re, drive_im),
        lambda: weighted_gerchberg_saxton(matrix, wanted, start, rounds),
        repeats=10,
        pairs=256 * foci * rounds,
        rounds_of_each_call=rounds,
    )


@pytest.mark.row("solve_foci, 16 foci, 50 rounds, everything included")
def test_solver_from_foci_to_drive(compare, board):
    foci = random_foci(np.random.default_rng(5), 16)

    def plainly():
        matrix = propagators(board, foci)
        start = superpose_foci(board, foci, np.ones(16), np.zeros(16))
        return weighted_gerchberg_saxton(matrix, np.ones(16), start, 50)

    compare(None, lambda: solve_foci(board, foci), plainly, repeats=20, reference_repeats=2)


def test_table_of_the_solvers(benchmark, board):
    solvers = {
        method: lambda points, method=method: solve_foci(board, points, method=method)
        for method in METHODS
    }
    rows = compare_solvers(board, solvers, time.thread_time_ns)
    benchmark.pedantic(
        compare_solvers, (board, solvers, time.thread_time_ns), {"counts": (4,)}, rounds=1
    )
    benchmark.extra_info["solvers"] = rows

"""Fields at arbitrary points."""

import math

import numpy as np
import pytest
import references

from haptogram.acoustics import AcousticModel, TransducerArray
from haptogram.acoustics.field.engines.engine import NumbaEngine

FLOPS_PER_PAIR = 69  # of the prototype whose arithmetic sets the limit; ours needs fewer
COUNTS = [100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000]


@pytest.mark.row("field at {count} points")
@pytest.mark.parametrize("count", COUNTS)
def test_arbitrary_points_against_numpy(count, compare, board, engine, drive, scattered):
    points = scattered(count)
    part = points[:2_000]  # numpy's time per point no longer changes beyond it
    compare(
        40.0,
        lambda: engine.pressure(drive, points),
        lambda: references.field(board, drive, part),
        repeats=max(1, 2_000 // count),
        pairs=256 * count,
        share=len(part) / count,
    )


@pytest.mark.row("field of {sources} sources, {shape}")
@pytest.mark.parametrize("sources", [16, 64, 256, 1024])
@pytest.mark.parametrize("shape", ["lattice", "bowl"])
def test_sources_against_numpy(shape, sources, compare, scattered):
    """A lattice shares squares among its rows; in a bowl every element has a normal of its own."""
    side = math.isqrt(sources)
    model = AcousticModel.default(side, side)
    if shape == "bowl":
        places = model.array.positions_m.copy()
        places[:, 2] = 2.0 * (places**2).sum(axis=1)
        normals = np.array([0.0, 0.0, 0.25]) - places
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        array = TransducerArray.from_positions(places, normals)
        model = AcousticModel(array, model.medium, model.transducer)
    engine = NumbaEngine(model)
    drive, points = np.exp(1j * np.arange(sources)), scattered(10_000)
    points[:, 2] += 0.15  # in front of the bowl
    part = points[:500]
    compare(
        None,
        lambda: engine.pressure(drive, points),
        lambda: references.field(model, drive, part),
        repeats=max(1, 512 // sources),
        pairs=sources * len(points),
        share=len(part) / len(points),
    )


@pytest.mark.row("field of 256 sources anywhere in a plane")
def test_flat_array_against_a_plain_kernel(compare, board, drive, scattered):
    """No lattice: the squares of no row are shared."""
    off = np.random.default_rng(2).uniform(-5e-4, 5e-4, (256, 3)) * [1.0, 1.0, 0.0]
    array = TransducerArray.from_positions(board.array.positions_m + off)
    model = AcousticModel(array, board.medium, board.transducer)
    engine, points = NumbaEngine(model), scattered(10_000)
    plain = references.direct_kernel(model, drive)
    exact = references.field(model, drive, points[::50])
    for field in (plain, lambda points: engine.pressure(drive, points)):
        assert np.abs(field(points[::50]) - exact).max() <= 1e-4 * np.abs(exact).max()
    compare(
        0.95,
        lambda: engine.pressure(drive, points),
        lambda: plain(points),
        repeats=5,
        reference_repeats=5,
        pairs=256 * len(points),
    )


@pytest.mark.row("field at {count} points, beside sgemm")
@pytest.mark.parametrize("count", [10_000, 100_000])
def test_arbitrary_points_against_the_arithmetic_limit(count, compare, engine, drive, scattered):
    """69 flop per pair at the rate of sgemm: the ratio is the share of that limit."""
    points = scattered(count)
    side = 1024
    a = np.random.default_rng(0).random((side, side), dtype=np.float32)
    b, out = a.copy(), np.empty_like(a)
    flops = 256 * count * FLOPS_PER_PAIR
    compare(
        0.85,
        lambda: engine.pressure(drive, points),
        lambda: np.matmul(a, b, out=out),
        repeats=max(1, 50_000 // count),  # some 10 ms: the reference empties the caches
        reference_repeats=max(1, flops // (2 * side**3) // 4),
        pairs=256 * count,
        share=2 * side**3 / flops,
    )

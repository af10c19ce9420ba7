"""Percentiles, comparisons, the control loop, the fingerprint."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.campaigns.bench.compare import bench_differences, compare_benches
from haptogram.campaigns.bench.control import NoiseFloorLoop
from haptogram.campaigns.bench.percentiles import (
    BLOCKS,
    TimingPercentiles,
    percentiles_with_missed_ticks,
)
from haptogram.machine.fingerprint import (
    fingerprint_cpu_share,
    fingerprint_cpu_times,
    machine_fingerprint,
)


@given(st.lists(st.floats(-10, 1e6), min_size=1, max_size=400))
def test_percentiles_are_values_that_occurred(values):
    found = TimingPercentiles.of(values)
    ranked = sorted(values)
    assert found.n == len(values)
    assert found.max == ranked[-1]
    for level, value in found.levels.items():
        share = float(level[1:]) / 100
        assert value in ranked
        assert sum(v <= value for v in ranked) >= share * len(ranked) - 1e-6
        assert sum(v < value for v in ranked) <= share * len(ranked)
    assert TimingPercentiles(**json.loads(json.dumps(asdict(found)))) == found


def test_what_nobody_saw_is_left_out():
    assert TimingPercentiles.of([np.nan, 1.0]).n == 1
    assert TimingPercentiles.of([np.nan]) == TimingPercentiles(0, {}, 0.0, {})


def test_the_tenths_of_a_run_are_in_order_of_time():
    found = TimingPercentiles.of(np.repeat(np.arange(BLOCKS), 50))
    assert found.blocks["p50"] == list(range(BLOCKS))
    assert TimingPercentiles.of(np.arange(100)).blocks == {}


@given(st.lists(st.integers(0, 20), min_size=1, max_size=50))
def test_missed_ticks_are_late_too(tenths):
    """Against a walk over the grid: a tick is late until the loop is there again."""
    expected, tick = [], 0
    for late in tenths:
        expected += [late - 5 * k for k in range(late // 5 + 1)]
        tick += late // 5 + 1
    found = percentiles_with_missed_ticks(np.array(tenths, float), 5.0)
    assert found.tolist() == expected
    assert len(found) == tick


# --- comparison ----------------------------------------------------------------------------------


def a_result(seed, **shift_us):
    random = np.random.default_rng(seed)
    stages = {}
    for name in ("wake", "work", "control"):
        values = random.gamma(4.0, 10.0, 5000) + shift_us.get(name, 0.0)
        stages[name] = asdict(TimingPercentiles.of(values))
    return {"stages": stages, "configuration": {"rate_hz": 1000}, "environment": {"cpu": "x"}}


def changed(old, new):
    return {(c.stage, c.level): c for c in compare_benches(old, new) if c.beyond_noise}


@pytest.mark.parametrize("seed", range(1, 21))
def test_two_runs_of_the_same_are_not_found_different(seed):
    assert len(changed(a_result(0), a_result(seed))) <= 1


@pytest.mark.parametrize("shift_us", [-25.0, 25.0])
def test_what_changed_is_found_and_the_machine_not_blamed(shift_us):
    found = changed(a_result(0), a_result(1, wake=shift_us))
    assert ("wake", "p50") in found
    assert {stage for stage, _ in found} == {"wake"}
    assert not found["wake", "p50"].machine
    word = "slower" if shift_us > 0 else "faster"
    assert word in str(found["wake", "p50"])


def test_what_the_control_did_too_is_put_down_to_the_machine():
    found = changed(a_result(0), a_result(1, wake=30.0, control=28.0))
    assert found["wake", "p50"].machine
    assert "the machine changed" in str(found["wake", "p50"])
    assert not found["control", "p50"].machine


def test_what_was_set_differently_is_named():
    old, new = a_result(0), a_result(1)
    new["configuration"] = {"rate_hz": 2000}
    assert bench_differences(old, new) == ["configuration: rate_hz was 1000, is 2000"]


# --- control, fingerprint ------------------------------------------------------------------------


def test_the_control_runs_beside_on_its_own_grid_and_never_early():
    with NoiseFloorLoop(1_000_000, 5.0) as control:
        sum(range(3_000_000))
    assert len(control.deadline_ns) > 0
    assert (control.lateness_us >= 0).all()
    assert (np.diff(control.deadline_ns) % 1_000_000 == 0).all()
    assert (np.diff(control.deadline_ns) > 0).all()


def test_a_span_is_stalled_if_the_control_was_late_within_it():
    control = NoiseFloorLoop(1_000_000, 1.0)
    control.deadline_ns = np.array([0, 1, 2, 7, 8]) * 1_000_000
    control.wake_ns = np.array([0.01, 1.02, 6.5, 7.05, 8.2]) * 1_000_000
    spans = np.array([[0.0, 1.9], [1.5, 2.5], [3.0, 4.0], [6.6, 7.9], [7.0, 8.1], [8.3, 9.0]]) * 1e6
    found = control.stalled(spans[:, 0].astype(int), spans[:, 1].astype(int))
    assert found.tolist() == [False, True, True, False, True, False]


def test_the_fingerprint_names_the_machine_and_nobody():
    found = machine_fingerprint()
    assert found["cpu"]
    assert found["kernel"]
    assert found["packages"]["numpy"]
    json.dumps(found)
    shares = fingerprint_cpu_share(
        {"busy": 10, "idle": 10, "steal": 0}, {"busy": 40, "idle": 20, "steal": 10}
    )
    assert shares == {"busy": 0.6, "idle": 0.2, "steal": 0.2}
    assert fingerprint_cpu_share(fingerprint_cpu_times(), fingerprint_cpu_times()).keys() <= {
        "busy",
        "idle",
        "steal",
    }
    assert fingerprint_cpu_share({}, {}) == {}

"""One way to measure for all benchmarks: the two sides of a ratio take turns."""

import statistics
import time
from pathlib import Path

import numpy as np
import pytest
from disturbance import Disturbance, undisturbed
from rows import repeated, row_of

import haptogram
from haptogram.acoustics import AcousticModel
from haptogram.acoustics.field.engines.engine import NumbaEngine

SECONDS = 1.5  # for each pair
ALONE_S = 0.25  # for what has no reference
BRIEF_S = 0.15  # for each benchmark of a comparison with another commit
LONGEST_COUNT = 100_000  # of points in such a comparison: more say the same, and take seconds
ROUND_S = 1e-3  # long enough for the clock


def pytest_addoption(parser):
    parser.addoption(
        "--brief",
        action="store_true",
        help="time each benchmark for a moment and without its reference: ci/bench --baseline",
    )
    parser.addoption(
        "--once", action="store_true", help="run each benchmark once: times say nothing then"
    )


def pytest_configure(config):
    config.addinivalue_line("markers", "row(name): what is measured; {braces} hold a parameter")
    config.disturbance = Disturbance()


def pytest_collection_modifyitems(config, items):
    timed = [item for item in items if {"compare", "measure"} & set(item.fixturenames)]
    if unnamed := [item.name for item in timed if row_of(item) is None]:
        raise pytest.UsageError(f"{unnamed[0]}: no @pytest.mark.row names what it measures")
    if twice := repeated([row_of(item) for item in timed]):
        raise pytest.UsageError(f"two benchmarks measure {twice[0]!r}: give one another row")
    if config.getoption("--brief"):
        items[:] = [item for item in items if is_brief(item)]


def is_brief(item):
    """Return whether the fixtures here time a benchmark, and in no more than a moment."""
    count = item.callspec.params.get("count", 0) if hasattr(item, "callspec") else 0
    return count <= LONGEST_COUNT and {"compare", "measure"} & set(item.fixturenames)


def pytest_benchmark_update_machine_info(machine_info):
    """Record which packages were measured: a comparison has two sets of them."""
    machine_info["packages"] = str(Path(haptogram.__file__).parents[1])


def pytest_benchmark_update_json(config, output_json):
    """Record how busy the machine was with other work while all this was measured."""
    watch = config.disturbance
    output_json["machine_info"] |= {"stolen": watch.stolen, "others": watch.others}


@pytest.fixture(scope="session")
def board():
    """256 sources: the array of every figure."""
    return AcousticModel.default(16, 16)


@pytest.fixture(scope="session")
def engine(board):
    engine = NumbaEngine(board)
    engine.warm_up()
    return engine


@pytest.fixture(scope="session")
def drive():
    return np.exp(2j * np.pi * np.random.default_rng(7).random(256))


@pytest.fixture
def scattered():
    """Points above the array, as a haptic scene has them."""

    def points(count):
        rng = np.random.default_rng(count)
        return np.column_stack([rng.uniform(-0.1, 0.1, (count, 2)), rng.uniform(0.05, 0.3, count)])

    return points


@pytest.fixture
def compare(benchmark, measure, request):
    """Time *ours* as the benchmark, and a reference beside it, round for round.

    On a shared machine only such pairs compare. The ratio is the median over the rounds of the
    reference's time over ours. A reference that does only a share of the work counts as if it had
    done all of it. `repeats` calls make one round of ours long enough for the clock.
    """

    def run(
        goal,
        ours,
        reference,
        *,
        repeats=1,
        reference_repeats=1,
        share=1.0,
        seconds=SECONDS,
        **notes,
    ):
        if request.config.getoption("--brief"):
            measure(ours, repeats=repeats, **notes)
            return
        ours()
        reference()
        least, most = (1, 1) if request.config.getoption("--once") else (7, 400)

        def pairs():
            found = []
            deadline = time.perf_counter() + seconds
            while len(found) < least or (time.perf_counter() < deadline and len(found) < most):
                theirs = timed(reference, reference_repeats) / share
                found.append((timed(ours, repeats), theirs))
            return found

        found, stolen = undisturbed(pairs)
        mine, theirs = zip(*found, strict=True)
        ratios = [b / a for a, b in found]
        benchmark.pedantic(ours, rounds=min(5, most), iterations=min(repeats, most))
        ratio = statistics.median(ratios)
        low, high = np.quantile(ratios, [0.25, 0.75])
        benchmark.extra_info.update(
            row=row_of(request.node),
            goal=goal,
            ratio=ratio,
            ratio_quartiles=[float(low), float(high)],
            ours_s=statistics.median(mine),
            reference_s=statistics.median(theirs),
            rounds=len(ratios),
            stolen=stolen,
            **notes,
        )

    return run


@pytest.fixture
def measure(benchmark, request):
    """Time *ours* as the benchmark, with a yardstick beside it, round for round.

    The yardstick is work that is always the same, so that `yards`, the median of ours over it,
    changes less than a time does when others use the machine.
    """

    def run(ours, *, repeats=None, **notes):
        ours()
        repeats = repeats or max(1, int(ROUND_S / max(timed(ours, 1), 1e-7)))
        least, most = (1, 1) if request.config.getoption("--once") else (3, 400)
        brief = request.config.getoption("--brief")

        def pairs():
            found = []
            deadline = time.perf_counter() + (BRIEF_S if brief else ALONE_S)
            while len(found) < least or (time.perf_counter() < deadline and len(found) < most):
                yard = timed(yardstick, 1)
                found.append((timed(ours, repeats), yard))
            return found

        found, stolen = undisturbed(pairs)
        benchmark.pedantic(ours, rounds=1, iterations=1)
        benchmark.extra_info.update(
            row=row_of(request.node),
            ours_s=statistics.median(mine for mine, _ in found),
            yards=statistics.median(mine / yard for mine, yard in found),
            rounds=len(found),
            stolen=stolen,
            **notes,
        )

    return run


def yardstick():
    """Compute in Python for a fifth of a millisecond: the same in every commit."""
    total = 0
    for number in range(4_000):
        total += number & 0xFF
    return total


def timed(function, repeats):
    """Return processor time per call: on a shared machine, waiting for a core is no work."""
    started = time.thread_time()
    for _ in range(repeats):
        function()
    return (time.thread_time() - started) / repeats

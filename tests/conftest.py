"""Settings that every test shares: one numerical thread, signals, and the Hypothesis profiles."""

import contextlib
import functools
import gc
import os
import signal
import sys
from collections import Counter, defaultdict
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

pytest_plugins = ["costs", "time_limit"]

# Before the first import of numpy: the tests must not compete with themselves for cores.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# The tests may run in a job of GitHub; those of its annotations set this themselves.
os.environ.pop("GITHUB_ACTIONS", None)

# What a script starts in the background ignores these signals, and so would the programs that a
# test ends by one. A handler is not inherited: programs have the default, the tests go on.
for _number in (signal.SIGINT, signal.SIGHUP):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, lambda *_: None)

# A shared machine may stop for a while at any point, so slowness is no failure.
_UNHURRIED = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}

settings.register_profile("commit", max_examples=5, derandomize=True, **_UNHURRIED)
settings.register_profile("nightly", max_examples=200, print_blob=True, **_UNHURRIED)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "commit"))


def pytest_configure(config):
    if "PYTEST_XDIST_WORKER" not in os.environ:
        costs = config.pluginmanager.get_plugin("costs")
        config.pluginmanager.register(costs.Costs(config.rootpath / "out" / "durations.json"))


@pytest.hookimpl(wrapper=True)
def pytest_collection(session):
    """Collect without the garbage collector, which would find none among thousands of tests."""
    gc.disable()
    try:
        with _one_compiles_for_all(session.config.rootpath / "out"):
            return (yield)
    finally:
        gc.freeze()
        gc.enable()
        gc.set_threshold(20_000)  # most of what a test makes goes without the collector


@contextlib.contextmanager
def _one_compiles_for_all(folder):
    """In a new clone, keep the other processes waiting until the first has compiled every test."""
    compiled = Path(__file__).with_name("__pycache__").glob("test_start.*pytest*.pyc")
    kept = not sys.dont_write_bytecode and sys.pycache_prefix is None
    if "PYTEST_XDIST_WORKER" not in os.environ or not kept or next(compiled, None) is not None:
        yield
        return
    import fcntl  # ci/test runs on POSIX

    folder.mkdir(exist_ok=True)
    with (folder / "collection.lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            fcntl.flock(lock, fcntl.LOCK_SH)
        yield


@pytest.fixture(scope="session", autouse=True)
def shared_search_volumes():
    """Keep the search volumes of more arrays than a program needs: half a second for each."""
    from haptogram.acoustics.reconstruct import cells  # numpy is told its threads by then

    keep = functools.lru_cache(16)
    cells._kept_search_volume = keep(cells._kept_search_volume.__wrapped__)  # noqa: SLF001


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown():
    """Fail a test that leaves Ctrl-C ignored, for later ones and the programs that they start."""
    result = yield
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        pytest.fail("SIGINT is ignored behind this test (haptogram.start.main is for a process)")
    return result


@pytest.hookimpl(tryfirst=True)  # before -m chooses
def pytest_collection_modifyitems(items):
    """Leave to the night all but N of the parameters of a test that is marked `sampled(N)`.

    With several processes, begin with the files of slow tests, then with the longest files.

    Whole files are handed out in this order (`ci/test`): no process is left with a slow one at the
    end.
    """
    families = defaultdict(list)
    for item in items:
        if item.get_closest_marker("sampled"):
            families[item.path, item.originalname].append(item)
    for family in families.values():
        (kept,) = family[0].get_closest_marker("sampled").args
        with_commits = {k * len(family) // kept for k in range(kept)}
        for k, item in enumerate(family):
            if k not in with_commits:
                item.add_marker("nightly")
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    length = Counter(item.path for item in items)
    items.sort(key=lambda item: (item.path not in slow, -length[item.path]))

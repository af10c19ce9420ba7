"""A time limit for every test: one that hangs fails alone, with a trace of every thread."""

import faulthandler
import signal

import pytest

# The slowest takes 10 s here; a machine ten times slower may be six times overloaded.
LIMIT_S = 600.0
NIGHTLY_S = 3600.0
AGAIN_S = 60.0  # for code that goes on all the same
STDERR = 2


class TimeLimitReached(BaseException):
    """A test hangs; no Exception, which it might catch and for which Hypothesis would repeat it."""


def _stop(*_):
    faulthandler.dump_traceback(STDERR)
    raise TimeLimitReached


def _limited(item):
    signal.signal(signal.SIGALRM, _stop)
    limit_s = NIGHTLY_S if item.get_closest_marker("nightly") else LIMIT_S
    signal.setitimer(signal.ITIMER_REAL, limit_s, AGAIN_S)
    try:
        return (yield)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


# Each part has the limit to itself: the first of many tests makes the fixtures of all.
pytest_runtest_setup = pytest_runtest_call = pytest_runtest_teardown = pytest.hookimpl(
    wrapper=True, tryfirst=True
)(_limited)

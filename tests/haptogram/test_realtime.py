import contextlib
import gc
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.realtime import LoopStats, can_arrive, next_deadline_ns, real_time

TIME = st.integers(0, 10**12)
PERIOD = st.integers(1, 10**9)


@given(TIME, TIME, PERIOD)
def test_the_next_deadline_is_the_first_one_on_the_grid_after_now(deadline_ns, now_ns, period_ns):
    following = next_deadline_ns(deadline_ns=deadline_ns, now_ns=now_ns, period_ns=period_ns)
    assert following > now_ns
    assert (following - deadline_ns) % period_ns == 0
    assert following - period_ns <= max(now_ns, deadline_ns)


@given(TIME, PERIOD)
def test_a_loop_on_time_takes_every_deadline(deadline_ns, period_ns):
    following = next_deadline_ns(deadline_ns=deadline_ns, now_ns=deadline_ns, period_ns=period_ns)
    assert following == deadline_ns + period_ns


@given(TIME, TIME, PERIOD, TIME)
def test_a_frame_is_sent_exactly_while_it_can_be_complete_in_time(now, free, transmission, due):
    sent = can_arrive(now_ns=now, line_free_ns=free, transmission_ns=transmission, due_ns=due)
    assert sent == (now + transmission <= due and free + transmission <= due)


def test_lateness_is_kept_in_microseconds_and_bounded():
    stats = LoopStats(3)
    stats.record(1_500)
    stats.record(-250)
    assert stats.lateness_us().tolist() == [1.5, -0.25]
    stats.record(0)
    with pytest.raises(IndexError):
        stats.record(0)


def test_the_collector_pauses_and_comes_back():
    assert gc.isenabled()
    with contextlib.suppress(KeyError), real_time():
        assert not gc.isenabled()
        raise KeyError
    assert gc.isenabled()


def test_a_collector_that_was_off_stays_off():
    gc.disable()
    try:
        with real_time():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="prctl is a Linux call")
def test_the_timer_slack_is_put_back():
    def slack_ns():
        with open("/proc/self/timerslack_ns") as file:
            return int(file.read())

    before = slack_ns()
    with real_time():
        assert slack_ns() == 1
    assert slack_ns() == before

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.driver.timing.realtime import (
    STAMPS,
    PeriodicLoop,
    TickLog,
    TickStamps,
    can_arrive_by_deadline,
    next_deadline_ns,
)
from haptogram.errors import ConfigurationError

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
    sent = can_arrive_by_deadline(
        now_ns=now, line_free_ns=free, transmission_ns=transmission, due_ns=due
    )
    assert sent == (now + transmission <= due and free + transmission <= due)


class Clock:
    """Virtual time that passes while the port is served, and a little with every look at it."""

    def __init__(self, look_ns=0, stalls=()):
        self.t_ns = 0
        self.look_ns = look_ns
        self.served = []
        self._stalls = itertools.chain(stalls, itertools.repeat(0))

    def now_ns(self):
        self.t_ns += self.look_ns
        return self.t_ns

    def serve(self, until_ns):
        self.served.append(until_ns)
        self.t_ns = max(self.t_ns, until_ns) + next(self._stalls)


@given(
    st.lists(st.integers(0, 5_000_000), max_size=60),
    st.lists(st.integers(0, 5_000_000), max_size=60),
    st.integers(100_000, 10_000_000),
    st.integers(0, 2_000_000),
    st.integers(0, 300),
)
def test_ticks_stay_on_the_grid_whatever_stalls(stalls, work, period_ns, spin_ns, look_ns):
    clock = Clock(look_ns, stalls)
    spin_ns = min(spin_ns, period_ns // 4)
    loop = PeriodicLoop(clock.now_ns, clock.serve, period_ns=period_ns, spin_ns=spin_ns)
    busy = iter(work)
    ticks, done_ns = [], [0]
    for tick in loop.ticks(1000, 1000 + 50 * period_ns):
        ticks.append(tick)
        clock.t_ns += next(busy, 0)
        done_ns.append(clock.t_ns)
    numbers = [tick.number for tick in ticks]
    assert numbers == sorted(set(numbers))
    assert all(tick.deadline_ns == 1000 + tick.number * period_ns for tick in ticks)
    assert all(tick.wake_ns >= tick.deadline_ns for tick in ticks)
    for tick, before_ns in zip(ticks[1:], done_ns[1:], strict=False):
        # nothing is missed but what was over when the tick before it ended
        assert tick.deadline_ns - period_ns <= before_ns + look_ns


@given(period_ns=st.integers(1, 10**9), part=st.fractions(0, 1))
def test_up_to_a_quarter_of_a_period_is_spun_and_more_is_refused(period_ns, part):
    longest_ns = period_ns // 4
    spin_ns = int(longest_ns * part)
    loop = PeriodicLoop(lambda: 0, lambda _: None, period_ns=period_ns, spin_ns=spin_ns)
    assert loop.spin_ns == spin_ns
    for wrong_ns in (longest_ns + 1, -1):
        with pytest.raises(ConfigurationError, match=r"^spin_us is .*a quarter of the period$"):
            PeriodicLoop(lambda: 0, lambda _: None, period_ns=period_ns, spin_ns=wrong_ns)


def test_where_time_only_passes_in_serving_nothing_spins():
    clock = Clock()
    loop = PeriodicLoop(clock.now_ns, clock.serve, period_ns=1_000_000, spin_ns=200_000)
    assert loop.wait(5_000_000) == 5_000_000
    assert clock.served == [4_800_000, 5_000_000]


def test_the_log_keeps_every_stamp_of_a_bounded_number_of_ticks():
    log = TickLog(2)
    log.record(TickStamps(*range(0, 7000, 1000)))
    assert [log.stamp_ns(name).tolist() for name in STAMPS] == [[1000 * i] for i in range(7)]
    assert log.lateness_us().tolist() == [2.0]
    log.record(TickStamps(*[0] * 7))
    with pytest.raises(IndexError):
        log.record(TickStamps(*[0] * 7))

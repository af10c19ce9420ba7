import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram.driver.timing.clock import ClockEstimate, ClockSample, fit_clock_drift
from haptogram.errors import NoAnswerError

WRAP_US = 2**32
DELAY_US = st.integers(5, 3_000)


class Board:
    """A device clock that runs *ppm* too fast from *start_us*, reached through two delays."""

    def __init__(self, start_us=WRAP_US - 10_000_000, ppm=0):
        self.start_us = start_us
        self.ppm = ppm

    def clock_us(self, host_ns):
        return self.start_us + (host_ns + host_ns * self.ppm // 1_000_000) // 1000

    def exchange(self, clock, host_ns, there_us, back_us, stay_us=20):
        rx_ns = host_ns + there_us * 1000
        tx_ns = rx_ns + stay_us * 1000
        clock.add(
            host_ns,
            self.clock_us(rx_ns) % WRAP_US,
            self.clock_us(tx_ns) % WRAP_US,
            tx_ns + back_us * 1000,
        )


@given(st.lists(st.tuples(DELAY_US, DELAY_US), min_size=1, max_size=40), st.integers(-50, 50))
def test_the_truth_lies_within_the_stated_error(delays, ppm):
    board, clock = Board(ppm=ppm), ClockEstimate(device_ppm=50)
    for number, (there_us, back_us) in enumerate(delays):
        host_ns = number * 980_000_000
        board.exchange(clock, host_ns, there_us, back_us)
        middle_ns = host_ns + (there_us + 20 + back_us) * 500
        error_us = clock.to_device_us(middle_ns) - board.clock_us(middle_ns)
        assert abs(error_us) <= clock.uncertainty_us + 1
    assert clock.rejected == 0


@given(DELAY_US, DELAY_US)
def test_the_stated_error_is_at_least_half_the_round_trip(there_us, back_us):
    board, clock = Board(), ClockEstimate()
    board.exchange(clock, 0, there_us, back_us)
    assert clock.uncertainty_us >= (there_us + back_us) / 2


def test_equal_delays_give_the_exact_offset():
    board, clock = Board(start_us=1000), ClockEstimate()
    board.exchange(clock, 0, 40, 40)
    assert clock.offset_us == 1000


def test_the_shortest_round_trip_is_believed():
    board, clock = Board(start_us=0), ClockEstimate()
    board.exchange(clock, 0, 2000, 10)
    board.exchange(clock, 10_000_000, 30, 30)
    board.exchange(clock, 20_000_000, 10, 2500)
    assert clock.offset_us == 0
    assert clock.uncertainty_us < 40


def test_device_time_is_unwrapped_across_the_wire_wrap():
    board, clock = Board(), ClockEstimate()
    for second in range(25):
        board.exchange(clock, second * 10**9, 50, 50)
    assert clock.to_device_us(24 * 10**9) == WRAP_US - 10_000_000 + 24_000_000


def test_ten_minutes_of_drift_do_not_part_the_clocks():
    board, clock = Board(ppm=50), ClockEstimate(device_ppm=50)
    for ping in range(612):
        board.exchange(clock, ping * 980_000_000, 60, 40 + ping % 7)
    now_ns = 611 * 980_000_000
    assert abs(clock.to_device_us(now_ns) - board.clock_us(now_ns)) < 150
    assert clock.drift_ppm == pytest.approx(50, abs=2)


def test_one_exchange_has_no_drift():
    board, clock = Board(), ClockEstimate()
    board.exchange(clock, 0, 10, 10)
    assert math.isnan(clock.drift_ppm)


def test_a_single_lie_is_ignored_and_a_new_clock_is_believed():
    board, other = Board(start_us=0), Board(start_us=5_000_000)
    clock = ClockEstimate()
    board.exchange(clock, 0, 20, 20)
    other.exchange(clock, 10**9, 20, 20)
    assert (clock.offset_us, clock.rejected) == (0, 1)
    board.exchange(clock, 2 * 10**9, 20, 20)
    assert clock.offset_us == 0
    for second in range(3, 6):
        other.exchange(clock, second * 10**9, 20, 20)
    assert (clock.offset_us, clock.rejected) == (5_000_000, 4)


@pytest.mark.parametrize(("t_tx_us", "t_receive_ns"), [(8, -3_000), (1007, 900_000), (6, 10**9)])
def test_an_exchange_shorter_than_the_stay_at_the_board_says_nothing(t_tx_us, t_receive_ns):
    clock = ClockEstimate()
    clock.add(0, 7, t_tx_us, t_receive_ns)
    assert not clock.ready
    with pytest.raises(NoAnswerError, match="no ping"):
        clock.to_device_us(0)


@given(st.integers(0, 10**12))
def test_both_directions_agree(host_ns):
    board, clock = Board(), ClockEstimate()
    board.exchange(clock, 0, 17, 29)
    assert 0 <= host_ns - clock.to_host_ns(clock.to_device_us(host_ns)) < 1000


# --- drift ---------------------------------------------------------------------------------------

EXCHANGES = st.lists(
    st.tuples(st.integers(5, 20_000), st.integers(5, 20_000), st.integers(1, 1_500)),
    min_size=2,
    max_size=60,
)


@given(EXCHANGES, st.integers(-100, 100), st.integers(0, 40_000_000))
def test_offset_and_drift_stay_within_their_bounds_between_the_pings_too(exchanges, ppm, to_wrap):
    """Over random delays, gaps, drift, and across the wrap of the 32-bit clock."""
    board, clock = Board(start_us=WRAP_US - to_wrap, ppm=ppm), ClockEstimate(device_ppm=50)
    host_ns = 0
    for there_us, back_us, gap_ms in exchanges:
        board.exchange(clock, host_ns, there_us, back_us)
        for ahead_ns in (0, gap_ms * 1_000_000):
            at_ns = host_ns + (there_us + 20 + back_us) * 500 + ahead_ns
            error_us = clock.to_device_us(at_ns) - board.clock_us(at_ns) + unwrapped(clock, board)
            assert abs(error_us) <= clock.uncertainty_at_us(at_ns) + 1
        host_ns += (there_us + back_us + 40) * 1000 + gap_ms * 1_000_000
    assert (clock.rejected, clock.jumps) == (0, 0)
    if not math.isnan(clock.drift_ppm):
        assert abs(clock.drift_ppm - ppm) <= clock.drift_uncertainty_ppm


def unwrapped(clock, board):
    """Whole wraps by which a host that came after one counts differently."""
    return WRAP_US * round((board.clock_us(0) - clock.to_device_us(0)) / WRAP_US)


@given(st.integers(-90, 90))
def test_the_drift_is_reckoned_with_once_it_is_known(ppm):
    board, clock = Board(ppm=ppm), ClockEstimate(device_ppm=50)
    for ping in range(40):
        board.exchange(clock, ping * 980_000_000, 40 + ping % 5, 40)
    last_ns = 39 * 980_000_000
    assert clock.drift_uncertainty_ppm < 5
    later_ns = last_ns + 20 * 10**9
    error_us = abs(clock.to_device_us(later_ns) - board.clock_us(later_ns))
    assert error_us <= clock.uncertainty_at_us(later_ns) + 1
    assert clock.uncertainty_at_us(later_ns) < 200  # 100 ppm alone would make it 2000


def test_the_bound_of_the_drift_is_what_wrong_margins_could_do():
    samples = [ClockSample(0, 0, 1000), ClockSample(10**9, 0, 1000)]
    drift = fit_clock_drift(samples)
    assert drift.ppm == 0.0
    # one end up by its margin, the other down by its own: 2 µs in a second
    assert drift.uncertainty_ppm == pytest.approx(2.0)


def test_old_samples_fade():
    steady = [ClockSample(n * 10**9, 0, 1000) for n in range(60)]
    drifting = [ClockSample((60 + n) * 10**9, 50_000 * n, 1000) for n in range(30)]
    assert fit_clock_drift(steady + drifting[:1]).ppm == pytest.approx(0.0, abs=0.1)
    # the line of all is less than 25 ppm; the newest third weighs more
    assert fit_clock_drift(steady + drifting).ppm > 25.0


@given(
    st.integers(-(2**30), 2**30).filter(lambda us: abs(us) > 10_000),
    st.integers(-50, 50),
    st.integers(1, 20),
)
def test_a_clock_that_was_set_is_believed_after_three_exchanges_and_counted(step_us, ppm, before):
    board, clock = Board(ppm=ppm), ClockEstimate()
    other = Board(board.start_us + step_us, ppm)
    for ping in range(before):
        board.exchange(clock, ping * 980_000_000, 50, 40)
    assert not clock.doubtful
    for ping in range(before, before + 3):
        assert clock.jumps == 0
        other.exchange(clock, ping * 980_000_000, 50, 40)
        assert clock.doubtful == (ping < before + 2)
    assert (clock.jumps, clock.rejected) == (1, 3)
    assert abs(clock.jump_us - step_us) <= 10 + 3 * (before + 3) * 100
    now_ns = (before + 2) * 980_000_000
    assert abs(clock.to_device_us(now_ns) - other.clock_us(now_ns)) <= clock.uncertainty_us + 1


@given(st.integers(0, 10**12), st.integers(-150, 150))
def test_both_directions_agree_with_a_drift(host_ns, ppm):
    board, clock = Board(ppm=ppm), ClockEstimate(device_ppm=150)
    for ping in range(10):
        board.exchange(clock, ping * 980_000_000, 17, 29)
    assert -2 <= host_ns - clock.to_host_ns(clock.to_device_us(host_ns)) < 1010

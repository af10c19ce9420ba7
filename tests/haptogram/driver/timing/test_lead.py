import itertools
import math
from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from haptogram.driver.timing.lead import LeadMargin, LeadTrim, default_lead_us, sufficient_lead_us

DELAYS = st.lists(st.integers(-1000, 60_000), min_size=1, max_size=400)


def test_the_default_fills_three_quarters_of_the_queue_up_to_100_ms():
    assert default_lead_us(128_000) == 96_000
    assert default_lead_us(256_000) == 100_000
    assert default_lead_us(32_000) == 24_000
    assert default_lead_us(Fraction(12_800)) == 9_600


@given(DELAYS, st.integers(1, 5000), st.floats(0, 1))
def test_a_sufficient_lead_is_exceeded_by_no_more_reports_than_frames_may_be_late(
    delays, frames, share
):
    lead_us = sufficient_lead_us(delays, frames=frames, miss_share=share)
    late = sum(delay > lead_us for delay in delays)
    assert late <= share * frames
    assert lead_us <= 1.25 * max(0, *delays, 0) + 200


def leads(delays, **limits):
    trim = LeadTrim(**({"longest_us": 100_000, "shortest_us": 920} | limits))
    return [trim.lead_us, *(trim.add(delay, 100) for delay in delays)], trim


@given(DELAYS, st.sampled_from([0.0, 1e-3, 0.05]))
def test_the_lead_turns_round_rarely_and_stays_within_its_limits(delays, share):
    path, trim = leads(delays, miss_share=share)
    assert all(920 <= lead <= 100_000 for lead in path)
    steps = [b - a for a, b in itertools.pairwise(path) if b != a]
    turns = sum((a < 0) != (b < 0) for a, b in itertools.pairwise(steps))
    assert turns <= 2 * math.log2(len(delays) + 1)
    assert trim.moves == len(steps)


@given(st.integers(0, 70_000), st.integers(8, 300))
def test_steady_delays_are_met_after_the_first_epoch_and_never_left(delay, reports):
    path, trim = leads([delay] * reports)
    wanted = max(920, delay + delay // 4 + 200)
    assert set(path[8:]) == {wanted}
    assert trim.moves == 1


@given(st.lists(st.integers(0, 20_000), min_size=60, max_size=300))
def test_with_no_miss_allowed_no_delay_of_an_epoch_exceeds_the_lead_that_it_led_to(delays):
    path, _ = leads(delays, miss_share=0.0)
    start, size = 0, 8
    while start + size <= len(delays):
        assert path[start + size] >= max(delays[start : start + size])
        start, size = start + size, 2 * size


def test_a_delay_beyond_the_lead_raises_it_at_once():
    path, _ = leads([1000] * 8 + [9000], miss_share=0.0)
    assert path[8] == 1450
    assert path[9] == 11_450


def test_one_freak_in_a_thousand_frames_is_not_waited_for():
    path, _ = leads([1000] * 30 + [50_000] + [1000] * 100, miss_share=1e-3)
    assert path[8 + 16] == 1450
    assert max(path[25:31]) == 1450
    assert path[-1] == 1450


@given(st.lists(st.integers(-30_000, 90_000), max_size=100), st.floats(0, 1000))
def test_the_safety_margin_covers_clock_and_lateness_within_its_limit(margins, uncertainty):
    safety = LeadMargin(uncertainty)
    for margin in margins:
        before = safety.ns
        safety.take(margin, uncertainty)
        if margin < 0:
            grown = before - 1000 * margin
            assert safety.ns >= min(grown, 10_000_000) - 2
        assert uncertainty * 1000 - 1 <= safety.ns <= (uncertainty + 10_000) * 1000


def test_the_safety_margin_fades_when_nothing_is_late():
    safety = LeadMargin(5.0)
    safety.take(-400, 5.0)
    assert safety.ns == 405_000
    for _ in range(100):
        safety.take(3, 5.0)
    assert 5_000 <= safety.ns < 5_100

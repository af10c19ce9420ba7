"""Segments, event by event, against a device that looks at every period, as its FPGA does."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptogram_protocol.dialects.autd3.operations import ErrorCode, Silencer, TransitionMode
from sim_device.dialects.autd3.refusals import (
    Autd3Limits,
    autd3_segment_refusal,
    autd3_silencer_refusal,
    autd3_time_refusal,
    autd3_transition_refusal,
)
from sim_device.dialects.autd3.segments import PERIOD_NS, Autd3Sampling, Autd3SwapChain

MODES = list(TransitionMode)


class PeriodByPeriod:
    """The state machine of stm_swapchain.sv, one step a period."""

    def __init__(self) -> None:
        self.samplings = [Autd3Sampling(), Autd3Sampling()]
        self.segment, self.offset, self.ticks = 0, 0, None
        self.waiting = None
        self.ext = False
        self.loops = None
        self.stopped = False

    def swap(self, segment, sampling, mode, value_ns):
        self.samplings[segment] = sampling
        self.loops, self.ext, self.waiting = None, False, None
        if sampling.repeat == 0xFFFF:
            self.segment, self.stopped, self.offset = segment, False, 0
            self.ext = mode == TransitionMode.EXT
        else:
            self.waiting = (segment, mode, value_ns)

    def step(self, period):
        """Go to *period* from the one before it."""
        now = [sampling.index(period) for sampling in self.samplings]
        before = [sampling.index(period - 1) for sampling in self.samplings]
        came_back = [a != b and b == 0 for a, b in zip(before, now, strict=True)]
        segment, sampling = self.segment, self.samplings[self.segment]
        ticked = period % max(1, sampling.divider) == 0
        if self.waiting is not None:
            self._start(period, came_back)
        elif self.loops is not None and ticked:
            self.ticks += 1
            self.loops -= self.ticks % sampling.length == 0
            if self.loops == 0:
                self.loops, self.stopped = None, True
        elif self.ext and came_back[segment]:
            self.segment, self.offset = 1 - segment, 0
        return self.output(period)

    def output(self, period):
        sampling = self.samplings[self.segment]
        if self.stopped:
            return self.segment, sampling.length - 1
        return self.segment, (sampling.index(period) - self.offset) % sampling.length

    def _start(self, period, came_back):
        segment, mode, value_ns = self.waiting
        if mode == TransitionMode.SYNC_INDEX:
            starts = came_back[segment]
        else:
            starts = mode == TransitionMode.SYSTEM_TIME and value_ns <= period * PERIOD_NS
        if starts:
            self.waiting, self.segment, self.stopped = None, segment, False
            self.ticks, self.loops = 0, self.samplings[segment].repeat + 1
            self.offset = self.samplings[segment].index(period)


samplings = st.builds(
    Autd3Sampling, st.integers(1, 4), st.integers(2, 5), st.sampled_from([0, 1, 2, 0xFFFF])
)
swaps = st.lists(
    st.tuples(
        st.integers(1, 40), st.integers(0, 1), samplings, st.sampled_from(MODES), st.integers(0, 60)
    ),
    max_size=5,
)


@given(swaps=swaps, stops=st.sets(st.integers(0, 150)), start=st.integers(1, 50))
def test_segments_are_those_of_a_look_at_every_period(swaps, stops, start) -> None:
    reference, chain = PeriodByPeriod(), Autd3SwapChain()
    due = {}
    at = start
    for gap, segment, sampling, mode, ahead in swaps:
        at += gap
        due[at] = (segment, sampling, mode, (at + ahead) * PERIOD_NS - 3)
    change = chain.next_change(start)
    last = None
    for period in range(start + 1, at + 80):
        output = reference.step(period)
        if period in stops or change is None or period >= change or period in due:
            chain.advance(period)
            last = chain.segment, chain.index(period)
            change = chain.next_change(period)
            assert last == output
        elif last is not None:
            assert last == output
        if period in due:  # after its beginning: it takes effect in the next one
            segment, sampling, mode, value_ns = due[period]
            reference.swap(segment, sampling, mode, value_ns)
            chain.swap(segment, reference.samplings, mode, value_ns, period)
            change = period + 1


# --- errors 5 to 8 -------------------------------------------------------------------------------

WAITING = {TransitionMode.SYNC_INDEX, TransitionMode.SYSTEM_TIME, TransitionMode.GPIO}


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("segment", [0, 1])
@pytest.mark.parametrize("repeat", [0, 3, 0xFFFF])
def test_a_transition_fits_or_is_error_8(mode, segment, repeat) -> None:
    found = autd3_transition_refusal(0, segment, repeat, mode)
    must_wait = segment == 1 and repeat != 0xFFFF
    fits = mode == TransitionMode.LATER or (mode in WAITING) == must_wait
    assert found == (ErrorCode.NONE if fits else ErrorCode.INVALID_TRANSITION_MODE)


def test_a_transition_that_does_not_exist_is_error_8() -> None:
    assert autd3_transition_refusal(0, 1, 0, 0x55) == ErrorCode.INVALID_TRANSITION_MODE


@pytest.mark.parametrize(
    ("sequence", "modulation", "strict", "error"),
    [
        (40, 10, True, 0),
        (39, 10, True, 7),
        (40, 9, True, 7),
        (9, 10, True, 7),
        (1, 1, False, 0),
    ],
)
def test_dividers_suit_a_strict_silencer_or_are_error_7(sequence, modulation, strict, error):
    assert autd3_silencer_refusal(Autd3Limits(strict), sequence, modulation) == error
    lower = Autd3Limits.of(Silencer(False, strict, 9, 9), Autd3Limits())
    assert autd3_silencer_refusal(lower, max(9, sequence), max(9, modulation)) == 0
    assert Autd3Limits.of(Silencer(True, True, 1, 1), Autd3Limits()) == Autd3Limits(False)


@given(st.integers(0, 2**64 - 1), st.integers(0, 2**63), st.sampled_from(MODES))
def test_a_time_is_10_ms_ahead_or_error_6(value_ns, now_ns, mode) -> None:
    late = mode == TransitionMode.SYSTEM_TIME and value_ns - now_ns < 10_000_000
    assert autd3_time_refusal(mode, value_ns, now_ns) == (6 if late else 0)


def test_a_segment_is_there_and_holds_what_is_asked_for_or_error_5() -> None:
    assert [autd3_segment_refusal(number) for number in (0, 1, 2, 255)] == [0, 0, 5, 5]
    assert autd3_segment_refusal(1, is_of_kind=False) == ErrorCode.INVALID_SEGMENT_TRANSITION

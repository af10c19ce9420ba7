"""Patterns that run along: against the firmware's loop, period by period; ports and power-up."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dialect_boards import DialectBoard
from dialect_frames import mega64_frame
from haptogram_protocol.dialects.ultraino.arduino import operations as nibbles
from haptogram_protocol.dialects.ultraino.arduino.slots import (
    MEGA64_FIRMWARE,
    NANO8_FIRMWARE,
    NANO16_FIRMWARE,
    Pulse,
)
from sim_device.board.events import CarrierState
from sim_device.dialects.ultraino.slot_boards import (
    UPLOAD,
    ArduinoPlaylist,
    SlotBoards,
    UnsteadyUnit,
)

PATTERNS = 5


class Firmware:
    """The loop of DriverMEGA: which pattern it shows in each period, by its own variables."""

    def __init__(self):
        self.durations = [1] + [0] * (PATTERNS - 1)
        self.pointer = self.current_pattern = self.current_periods = 0

    def period(self):
        """Return the pattern of one period, and count it."""
        shown = self.pointer
        self.current_periods = (self.current_periods + 1) % 256
        if self.current_periods == self.durations[self.current_pattern]:
            self.current_periods = 0
            following = [*self.durations, 0][self.current_pattern + 1]
            last = self.current_pattern + 1 == PATTERNS
            self.current_pattern += 1
            self.pointer += 1
            if last or following == 0:
                self.current_pattern = self.pointer = 0
        return shown


durations = st.lists(st.integers(0, 6), min_size=PATTERNS, max_size=PATTERNS)
acts = st.lists(
    st.tuples(st.integers(0, 40), st.none() | durations), max_size=5
)  # periods to wait; None: a swap


@given(acts)
def test_the_playlist_is_the_firmware_s_loop(acts):
    firmware, playlist, shown, changes = Firmware(), ArduinoPlaylist(PATTERNS), [], {0: 0}
    passes = [(0, 1)]  # from when on, and how many periods a whole pass lasts
    for wait, act in [*acts, (700, None)]:
        end = len(shown) + wait
        shown += [firmware.period() for _ in range(wait)]
        while (at := playlist.next_change()) is not None and at < end:
            if playlist.advance_to(at):
                changes[at] = playlist.pointer
        playlist.skip_to(end)
        assert playlist.pointer == firmware.pointer
        if act is None:
            firmware.pointer = 0
            playlist.restart()
        else:
            firmware.durations = act
            playlist.commit(bytes(act))
        changes[end] = playlist.pointer
        first, *others = firmware.durations
        passes.append((end, (first or 256) + sum(itertools.takewhile(bool, others))))
    # What was told for a whole pass behind each act is what was shown.
    told = list(itertools.accumulate(range(len(shown)), lambda last, t: changes.get(t, last)))
    for (start, periods), (end, _) in itertools.pairwise(passes):
        until = min(end, start + periods)
        assert told[start:until] == shown[start:until]


def pattern(code):
    return MEGA64_FIRMWARE.slots([Pulse(code, 5)] * 64)


def test_several_patterns_are_latched_one_after_the_other_for_a_whole_pass():
    board = DialectBoard("ultraino-mega64")
    unit = SlotBoards(MEGA64_FIRMWARE, 1, 0)
    for number in range(3):
        unit.take(nibbles.SetPattern(0, number, pattern(number)), 0)
    unit.take(nibbles.SetDurations(bytes([4, 2, 3, 0])), 0)
    unit.take(nibbles.CommitDurations(), 0)
    unit.take(nibbles.Swap(), 0)
    while (next_us := unit.next_event_us()) is not None:
        unit.advance_to(next_us)
    latches = unit.take_latches()[1:]
    assert [latch.index for latch in latches][:4] == [0, 1, 2, 0]
    assert [latch.t_latch_us for latch in latches][:4] == [0, 4 * 25, 6 * 25, 9 * 25]
    assert [int(latch.pulses.rises[0]) for latch in latches][:4] == [0, 1, 2, 0]
    assert len(latches) <= 8
    assert board.settings.count == 64


@given(
    st.lists(st.integers(1, 6), min_size=2, max_size=PATTERNS),
    st.lists(st.integers(0, 5000), max_size=20),
    st.lists(st.integers(1, 400), max_size=9),
)
def test_patterns_change_when_they_are_due_whoever_asks_and_whatever_is_heard(
    durations, stops, bytes_us
):
    latches = []
    for is_disturbed in (False, True):
        boards = SlotBoards(MEGA64_FIRMWARE, 1, 0)
        unit = UnsteadyUnit(boards, CarrierState.STEADY, is_disturbed=is_disturbed)
        for number in range(len(durations)):
            unit.take(nibbles.SetPattern(0, number, pattern(number)), 0)
        unit.take(nibbles.SetDurations(bytes([*durations, 0])), 0)
        unit.take(nibbles.CommitDurations(), 0)
        unit.take(nibbles.Swap(), 0)
        for end_us in itertools.accumulate(bytes_us):
            unit.hear(end_us - 0.5, end_us)
        for t_us in [*sorted(stops), 6000] if is_disturbed else [6000]:
            unit.advance_to(t_us)
        latches.append([at for at in unit.take_latches() if at.cause != UPLOAD])
    quiet, disturbed = ([(at.t_latch_us, at.cause, at.index) for at in of] for of in latches)
    assert disturbed == quiet
    ends = itertools.accumulate(durations)
    assert [t_us for t_us, cause, _ in quiet if cause == "pattern"][: len(durations)] == [
        25 * end for end in ends
    ]


@pytest.mark.parametrize(
    ("name", "layout", "on"),
    [
        ("ultraino-mega64", MEGA64_FIRMWARE, range(64)),
        ("ultraino-nano8", NANO8_FIRMWARE, range(8)),
        ("ultraino-nano16", NANO16_FIRMWARE, [*range(6), *range(10, 16)]),
    ],
)
def test_power_up_drives_every_output_that_is_connected(name, layout, on):
    latch = DialectBoard(name).latches[0]
    half = layout.steps // 2
    assert latch.pulses.widths.tolist() == [half * (n in on) for n in range(len(layout.pins))]
    assert not latch.pulses.rises.any()


@given(st.binary(min_size=100, max_size=100))
def test_any_slots_are_the_pulses_of_the_codec(slots):
    unit = SlotBoards(MEGA64_FIRMWARE, 1, 0)
    for operation in mega64_frame([slots]):
        unit.take(operation, 0)
    found = unit.take_latches()[-1].pulses
    for channel, pulse in enumerate(MEGA64_FIRMWARE.pulses(slots)):
        if pulse is None:
            assert sum(found.levels[channel]) == found.widths[channel]
        else:
            assert channel not in found.levels
            assert (found.rises[channel], found.widths[channel]) == (pulse.code, pulse.width)


def test_a_chain_forwards_what_is_for_nobody_and_the_host_reads_it():
    board = DialectBoard("ultraino-mega64", "boards=2", array="tinylev")
    board.send(bytes([0x51, 0x52, 0x53, 0x50, 0x40, 0x00]))
    board.pass_us(1000)
    assert board.simulation.host_read() == bytes([0x51, 0x4E, 0x3E, 0x00])
    assert board.settings.count == 72
    assert board.latches[-1].pulses.count == 128
    assert np.count_nonzero(board.latches[0].radiated) == 72

"""The FIFO of InteractLab: times typed from the HDL, and bounds whatever comes."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dialect_boards import DialectBoard
from haptogram_protocol.dialects.interactlab import (
    FRAME_BYTES,
    FifoCleared,
    InteractlabBoardEnd,
    InteractlabHostEnd,
    QueueFrame,
)
from sim_device.dialects.interactlab import FIFO_FRAMES, READY_FRAMES, InteractlabUnit

UP_US = 1_000_000  # the board reads from a second after power-up on


def frame(number: int, divider: int | None = None, colour: int | None = None) -> QueueFrame:
    return QueueFrame(bytes([number]) * 256, bytes([64] * 256), colour, divider)


def shown(unit: InteractlabUnit) -> list[tuple[int, str, int]]:
    return [
        (latch.t_latch_us, latch.cause, int(latch.pulses.rises[0])) for latch in unit.take_latches()
    ]


def fed(rows, until_us: int) -> InteractlabUnit:
    unit = InteractlabUnit(0)
    for t_us, operation in rows:
        unit.advance_to(t_us)
        unit.take(operation, t_us)
    unit.advance_to(until_us)
    return unit


# rows of (time, frame), latches of frames as (time, code)
TIMES = [
    # a frame that comes while the board has nothing to do is read at once (10.24 µs), and shown at
    # the next boundary of 25 µs
    ([(UP_US + 100, frame(1))], [(UP_US + 125, 1)]),
    ([(UP_US + 114, frame(1))], [(UP_US + 125, 1)]),
    ([(UP_US + 115, frame(1))], [(UP_US + 150, 1)]),
    # frames that wait go out every 4 periods
    ([(UP_US + 100, frame(n)) for n in (1, 2, 3)], [(UP_US + 25 * n, n // 4) for n in (5, 9, 13)]),
    # a divider holds from its own frame on
    (
        [(UP_US + 100, frame(1, divider=2)), (UP_US + 100, frame(2)), (UP_US + 100, frame(3))],
        [(UP_US + 125, 1), (UP_US + 175, 2), (UP_US + 225, 3)],
    ),
    # 0 divides by 256
    (
        [(UP_US + 100, frame(1, divider=0)), (UP_US + 100, frame(2))],
        [(UP_US + 125, 1), (UP_US + 125 + 256 * 25, 2)],
    ),
    # an underrun keeps the last frame; the next is read when it comes, not on the divider
    (
        [(UP_US + 100, frame(1)), (UP_US + 300, frame(2))],
        [(UP_US + 125, 1), (UP_US + 325, 2)],
    ),
]


@pytest.mark.parametrize(("rows", "expected"), TIMES)
def test_frames_are_shown_on_the_divider(rows, expected) -> None:
    found = shown(fed(rows, 3 * UP_US))
    assert found[:2] == [(0, "power-up", 0), (UP_US + 25, "off-frame", 0)]
    assert [(t_us, code) for t_us, _, code in found[2:]] == expected
    assert {cause for _, cause, _ in found[2:]} == {"frame"}


def test_what_comes_in_the_first_second_is_read_right_behind_the_off_frame() -> None:
    """Both are read within a period, so only the second is seen."""
    found = shown(fed([(5, frame(1)), (6, frame(2))], 3 * UP_US))
    assert found[1:] == [(UP_US + 25, "frame", 1), (UP_US + 125, "frame", 2)]


def test_a_pulse_is_high_from_its_phase_for_its_duty() -> None:
    phases, duties = bytes(range(128)) * 2, bytes([0, 1, 64, 127] * 64)
    unit = fed([(UP_US, QueueFrame(phases, duties))], 2 * UP_US)
    pulses = unit.take_latches()[-1].pulses
    assert pulses.rises.tolist() == list(phases)
    assert pulses.widths.tolist() == list(duties)
    assert pulses.steps == 128
    weights = pulses.weights()
    assert abs(weights[2]) == pytest.approx(1.0)
    assert np.angle(weights[2]) == pytest.approx(np.angle(np.exp(2j * np.pi * (2 + 32) / 128)))


def test_the_colour_stays_until_it_is_set_again() -> None:
    unit = fed([(UP_US + 1, frame(1, colour=0x123456)), (UP_US + 2, frame(2))], 2 * UP_US)
    assert unit.colour == 0x123456


def test_a_client_that_nothing_holds_back_loses_frames_beyond_the_fifo() -> None:
    unit = fed([(10, frame(n % 128)) for n in range(FIFO_FRAMES + 5)], 20)
    assert unit.room_bytes == 0
    assert unit.counters == {"frames_beyond_fifo": 5}


@given(
    rows=st.lists(
        st.tuples(st.integers(0, 3_000), st.none() | st.integers(0, 255), st.booleans()),
        max_size=60,
    )
)
def test_a_client_that_is_held_back_loses_nothing(rows) -> None:
    """Every frame is shown, in order, and no two within less than the divider's periods."""
    unit, t_us, divider, sent, dividers = InteractlabUnit(0), 0, 4, 0, []
    latches = []
    for gap, change, _ in rows:
        t_us += gap
        unit.advance_to(t_us)
        while unit.room_bytes < FRAME_BYTES:
            next_us = unit.next_event_us()
            assert next_us is not None
            t_us = max(t_us, next_us)
            unit.advance_to(t_us)
        unit.take(frame(sent % 128, divider=change), t_us)
        divider = divider if change is None else change
        dividers.append(divider or 256)
        sent += 1
        assert unit.room_bytes <= READY_FRAMES * FRAME_BYTES
    unit.advance_to(t_us + 30 * 256 * 25 + 2 * UP_US)
    latches = [row for row in shown(unit) if row[1] == "frame"]
    assert [code for _, _, code in latches] == [number % 128 for number in range(sent)]
    for number in range(sent - 1):
        gap_us = latches[number + 1][0] - latches[number][0]
        assert gap_us % 25 == 0
        assert gap_us >= 25 * dividers[number]
    assert not unit.counters


def test_less_than_a_frame_is_cleared_every_second() -> None:
    unit = fed([(UP_US + 500_000, frame(1))], UP_US + 500_000)
    times = []
    while (next_us := unit.next_event_us()) is not None and next_us < 5 * UP_US:
        times += [next_us for reply in unit.advance_to(next_us) if isinstance(reply, FifoCleared)]
    assert times == [UP_US * n + 500_000 for n in (2, 3, 4)]


def test_a_frame_that_waits_is_not_cleared() -> None:
    rows = [(UP_US - 10, frame(n % 128, divider=255)) for n in range(20)]
    unit = InteractlabUnit(0)
    for t_us, operation in rows:
        unit.advance_to(t_us)
        unit.take(operation, t_us)
    assert not unit.advance_to(UP_US + 20 * 255 * 25)  # 128 ms: none is cleared
    assert sum(cause == "frame" for _, cause, _ in shown(unit)) == 20


def test_the_end_forgets_the_beginning_of_a_frame_that_is_cleared() -> None:
    board, line = InteractlabBoardEnd(), InteractlabHostEnd().send(frame(5))
    assert board.receive_data(line[:300]) == []
    assert board.send(FifoCleared()) == b""
    assert board.send(FifoCleared()) == b""
    assert board.pending == 0
    assert board.receive_data(line[300:] + line) == [frame(5)]
    assert board.counters == {"bytes_cleared": 300, "bytes_outside_frame": 212}


def sent_as_fast_as_taken(board: DialectBoard, line: bytes) -> list[int]:
    """Write *line* as far as the board takes it, over and over; return the room before each."""
    rooms, simulation = [], board.simulation
    while line:
        rooms.append(simulation.host_room)
        line = line[simulation.host_write(line, simulation.now_ns) :]
        simulation.advance_to(simulation.next_event_ns())
    return rooms


def test_a_client_on_a_quick_line_waits_while_28_frames_are_there() -> None:
    board, host = DialectBoard("interactlab", baud=50_000_000), InteractlabHostEnd()
    board.pass_us(UP_US + 1000)
    frames = [frame(number % 128, divider=8 if not number else None) for number in range(300)]
    rooms = sent_as_fast_as_taken(board, b"".join(map(host.send, frames)))
    assert max(rooms) <= READY_FRAMES * FRAME_BYTES
    assert min(rooms) < FRAME_BYTES
    board.pass_us(UP_US)
    shown = [latch for latch in board.latches if latch.cause == "frame"]
    assert [int(latch.pulses.rises[0]) for latch in shown] == [n % 128 for n in range(300)]
    times = [latch.t_latch_us for latch in shown]
    assert {b - a for a, b in itertools.pairwise(times)} == {200}  # it never ran dry
    assert not board.simulation.dialect.counters


def test_a_frame_under_way_when_the_fifo_is_cleared_loses_its_beginning() -> None:
    """A second after the board last had a frame, and every second after that."""
    board, line = DialectBoard("interactlab"), InteractlabHostEnd().send(frame(7))
    board.pass_us(UP_US - 10_000)  # the first clear comes in the middle of this frame: 20.5 ms
    board.send(line)
    board.pass_us(1000)
    assert [latch.cause for latch in board.latches] == ["power-up", "off-frame"]
    counters = dict(board.simulation.dialect.counters)
    assert 240 <= counters["bytes_cleared"] <= 255  # 40 µs a byte, 10 ms
    board.send(line)
    board.pass_us(1000)
    assert board.latches[-1].pulses.rises[0] == 7

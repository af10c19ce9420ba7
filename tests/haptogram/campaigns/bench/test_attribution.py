import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from haptogram.campaigns.bench.attribution import (
    CAUSES,
    BenchLatenessParts,
    Cause,
    attribute_bench_lateness,
    bench_lateness_shares,
    count_late_bench_frames,
    split_bench_lateness,
)
from haptogram.driver.timing.realtime import TickLog, TickStamps

MS = 1_000_000
WIRE_NS = 920_000


def log_of(rows):
    log = TickLog(len(rows))
    for row in rows:
        log.record(TickStamps(*row))
    return log


def a_tick(deadline, *, idle=None, wake=0, work=0, room=0, write=0, queue=0):
    """Stamps of a tick: so late it woke, so long each stage took."""
    woke = deadline + wake
    ready = woke + work
    done = ready + room + write
    began = deadline - MS // 2 if idle is None else idle
    return (deadline, began, woke, ready, ready + room, done, done + queue + WIRE_NS)


def parts_of(ticks, board=0):
    count = len(ticks)
    return split_bench_lateness(log_of(ticks), np.full(count, WIRE_NS), np.full(count, board))


TIMES = st.integers(0, 3 * MS)


@given(st.lists(st.tuples(TIMES, TIMES, TIMES, TIMES, TIMES, TIMES), min_size=1, max_size=30))
def test_the_parts_sum_up_to_the_lateness_and_the_shares_to_the_parts(stages):
    ticks, board = [], []
    for number, (idle, wake, work, room, queue, at_board) in enumerate(stages):
        deadline = number * MS
        ticks.append(
            a_tick(
                deadline, idle=deadline - MS + idle, wake=wake, work=work, room=room, queue=queue
            )
        )
        board.append(at_board)
    log = log_of(ticks)
    parts = split_bench_lateness(log, np.full(len(ticks), WIRE_NS), np.array(board))
    done = log.stamp_ns("done") - log.stamp_ns("deadline")
    queue = np.array([stage[4] for stage in stages])
    assert parts.at_port_ns.tolist() == done.tolist()
    assert parts.total_ns.tolist() == (done + queue + board).tolist()
    assert all((column >= 0).all() for column in (parts.before, parts.scheduling, parts.queue))
    found = bench_lateness_shares(parts)
    assert (found >= 0).all()
    assert np.abs(found.sum(axis=1) - parts.total_ns).max() <= len(CAUSES)


@pytest.mark.parametrize(
    ("stage", "board", "cause"),
    [
        ({"wake": 2 * MS}, 0, Cause.SCHEDULING),
        ({"work": 2 * MS}, 0, Cause.WORK),
        ({"write": 2 * MS}, 0, Cause.WORK),
        ({"room": 2 * MS}, 0, Cause.LINE),
        ({"queue": 2 * MS}, 0, Cause.LINE),
        ({}, 2 * MS, Cause.BOARD),
    ],
)
def test_one_late_stage_is_the_cause(stage, board, cause):
    parts = parts_of([a_tick(0, **({"wake": 50_000} | stage))], board)
    assert CAUSES[attribute_bench_lateness(parts)[0]] is cause
    assert parts.total_ns[0] >= 2 * MS


def burst(first, frames):
    """A tick that is late by its own doing, and those that run after it without a rest."""
    ticks = [first]
    for number in range(1, frames):
        before = ticks[-1][5]
        deadline = number * MS
        begun = max(before, deadline)
        room = max(0, ticks[-1][6] - begun - WIRE_NS)  # one frame may be unsent
        done = begun + room + 20_000
        line_free = max(done, ticks[-1][6]) + WIRE_NS
        ticks.append((deadline, begun, begun, begun, begun + room, done, line_free))
    return ticks


@pytest.mark.parametrize(
    ("stage", "cause"), [({"wake": 8 * MS}, Cause.SCHEDULING), ({"work": 8 * MS}, Cause.WORK)]
)
def test_a_burst_has_the_cause_of_the_stall_that_it_follows(stage, cause):
    parts = parts_of(burst(a_tick(0, **stage), 40))
    late = parts.total_ns > MS
    assert late.sum() >= 39  # a line that is 92 % full recovers slowly
    assert {CAUSES[place] for place in attribute_bench_lateness(parts)[late]} == {cause}


def test_sleeping_on_while_the_line_is_free_again_is_scheduling():
    first = a_tick(0)
    late = a_tick(MS, wake=0, room=3 * MS)  # the line had room all the time
    parts = parts_of([first, late])
    assert (parts.scheduling[1], parts.room[1]) == (3 * MS, 0)
    assert CAUSES[attribute_bench_lateness(parts)[1]] is Cause.SCHEDULING


def test_what_ran_into_the_first_tick_is_work_of_the_host():
    parts = parts_of([a_tick(0, idle=3 * MS, wake=3 * MS)])
    assert parts.before[0] == 3 * MS
    assert CAUSES[attribute_bench_lateness(parts)[0]] is Cause.WORK


def test_a_skipped_frame_has_no_line_and_no_board():
    log = log_of([(0, 0, 9 * MS, 9 * MS, 9 * MS, 9 * MS, 2 * MS)])
    parts = split_bench_lateness(log, np.zeros(1, np.int64), np.zeros(1, np.int64))
    assert (parts.queue[0], parts.board[0], parts.total_ns[0]) == (0, 0, 9 * MS)


COLUMN = hnp.arrays(np.int64, 12, elements=st.integers(0, 5 * MS))


@given(COLUMN, COLUMN, COLUMN, COLUMN, COLUMN, COLUMN, st.floats(0, 5000), st.data())
def test_every_miss_has_exactly_one_cause(before, sleep, work, room, queue, board, limit, data):
    parts = BenchLatenessParts(before, sleep, work, room, queue, board, np.full(12, WIRE_NS))
    stalled = np.array(data.draw(st.lists(st.booleans(), min_size=12, max_size=12)))
    found = count_late_bench_frames(
        parts.total_ns, attribute_bench_lateness(parts), limit_us=limit, stalled=stalled
    )
    assert found.count == sum(found.by_cause.values()) == (parts.total_ns > limit * 1e3).sum()
    assert found.control_stalled_too <= found.by_cause[Cause.SCHEDULING]
    assert found.n == 12

"""The cause of each late frame, from the stamps of its tick.

The lateness of a frame is split, without a rest, into five parts: the time before its tick (the
tick before it was still at work), host scheduling (the loop slept on, at its tick or when the line
had room again), host work (encode ahead and write), line (the line had no room yet, or carried
other bytes first) and board (from the line to a complete frame).

The time before a tick is in turn split as the lateness of the previous frame was.  So every frame
of a burst after one stall is attributed to that stall, and a backlog with several causes to all of
them.  A frame in a backlog also waits for a line that is busy with the previous frame: that wait is
split likewise, because the line did not cause it.  A late frame is attributed to the largest sum.
"""

from __future__ import annotations

import dataclasses
import enum
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.driver.line.link import BURST_NS
from haptogram.driver.timing.realtime import TickLog

Times = NDArray[np.int64]
#: Latenesses from which on frames are counted, in microseconds.
MISS_LIMITS_US: Final = (100.0, 1000.0)


class Cause(enum.StrEnum):
    """The part of the chain that delayed a frame."""

    SCHEDULING = "host scheduling"
    WORK = "host work"
    LINE = "line"
    BOARD = "board"


CAUSES: Final = tuple(Cause)


@dataclass(frozen=True, slots=True)
class BenchLatenessParts:
    """The lateness of n frames in nanoseconds, beyond their own time on the line.

    Attributes
    ----------
    before, scheduling, work, room, queue, board : (n,) numpy.ndarray of int
        Their sum is the lateness.  The wait for the line is ``room`` (until the line had room for
        the frame) and ``queue`` (until other bytes had left).
    transmission : (n,) numpy.ndarray of int
        Time of each frame itself on the line, which is no part of its lateness.
    """

    before: Times
    scheduling: Times
    work: Times
    room: Times
    queue: Times
    board: Times
    transmission: Times

    @property
    def total_ns(self) -> Times:
        """Lateness of each frame, (n,)."""
        return self.at_port_ns + self.queue + self.board

    @property
    def at_port_ns(self) -> Times:
        """Lateness of each frame when the port had taken its last byte, (n,)."""
        return self.before + self.scheduling + self.work + self.room

    @property
    def line(self) -> Times:
        """Time that each frame waited for the line, (n,)."""
        return self.room + self.queue

    def at_port(self) -> BenchLatenessParts:
        """Return the parts up to the port: without queue and board."""
        nothing = np.zeros_like(self.board)
        return dataclasses.replace(self, queue=nothing, board=nothing)


def split_bench_lateness(
    ticks: TickLog, transmission_ns: Times, board_ns: Times
) -> BenchLatenessParts:
    """Split the lateness of every tick into its parts.

    Parameters
    ----------
    ticks : TickLog
        Stamps of n ticks.
    transmission_ns : (n,) numpy.ndarray of int
        Time of each frame on the line; 0 for a skipped frame.
    board_ns : (n,) numpy.ndarray of int
        Time from the end of its transmission to the complete frame at the board; 0 where the board
        does not report it.
    """
    deadline, idle, wake, ready, room, done, line_free = (
        ticks.stamp_ns(name)
        for name in ("deadline", "idle", "wake", "ready", "room", "done", "line_free")
    )
    # A loop that was idle before the deadline has no earlier work; an early loop has no lateness.
    begun = np.clip(idle, deadline, np.maximum(wake, deadline))
    sent = transmission_ns > 0
    queue = np.where(sent, np.maximum(0, line_free - done - transmission_ns), 0)
    # The line had room before all bytes had left (Link.make_room); from then on the loop slept on.
    unsent_ns = np.maximum(transmission_ns, BURST_NS - transmission_ns)
    free_before = np.concatenate([room[:1] + unsent_ns[:1], line_free[:-1]])
    overslept = room - np.clip(free_before - unsent_ns, ready, room)
    return BenchLatenessParts(
        before=begun - deadline,
        scheduling=np.maximum(wake, deadline) - begun + overslept,
        work=(ready - wake) + (done - room),
        room=room - ready - overslept,
        queue=queue,
        board=np.maximum(0, board_ns),
        transmission=transmission_ns,
    )


def bench_lateness_shares(parts: BenchLatenessParts) -> Times:
    """Return the (n, causes) nanoseconds of each frame's lateness by cause."""
    behind = parts.before > 0
    # In a backlog the line is busy with the previous frame: that wait is the backlog's.
    old_room = np.where(behind, np.minimum(parts.room, parts.transmission), 0)
    old_queue = np.where(behind, np.minimum(parts.queue, parts.transmission), 0)
    own = (parts.scheduling, parts.work, parts.room - old_room, np.zeros_like(parts.board))
    carried = np.stack(own, axis=1).astype(np.float64)  # to the next tick: not queue, nor board
    found = np.zeros_like(carried)
    for place in np.flatnonzero(behind):
        inherited = _lateness_proportions(carried[place - 1] if place else None)
        carried[place] += (parts.before[place] + old_room[place]) * inherited
        found[place] = old_queue[place] * inherited
    found += carried
    found[:, CAUSES.index(Cause.LINE)] += parts.queue - old_queue
    found[:, CAUSES.index(Cause.BOARD)] += parts.board
    return np.rint(found).astype(np.int64)


def _lateness_proportions(before: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Return each cause's share, 0 to 1, of the lateness carried over from the tick before.

    *before*: that lateness by cause, in the order of CAUSES, as is the result. All is WORK if
    *before* is None or its sum is 0.
    """
    total = 0.0 if before is None else float(before.sum())
    if before is None or total <= 0.0:
        # Work that ran into the tick without being a tick is host work: the loop served the port.
        return np.array([cause is Cause.WORK for cause in CAUSES], dtype=np.float64)
    return before / total


def attribute_bench_lateness(parts: BenchLatenessParts) -> NDArray[np.int64]:
    """Return the (n,) indices into :data:`CAUSES` of the cause of each frame."""
    causes: NDArray[np.int64] = np.argmax(bench_lateness_shares(parts), axis=1)
    return causes


@dataclass(frozen=True, slots=True)
class LatenessMisses:
    """Frames that were later than a limit; the fields are those of the JSON.

    Attributes
    ----------
    limit_us : float
        The limit, in microseconds.
    count : int
        Number of frames that were later.
    n : int
        Number of all frames.
    by_cause : dict of Cause to int
        Number by cause; the sum is *count*.
    control_stalled_too : int
        Number of those attributed to scheduling while the control loop was stalled too.
    """

    limit_us: float
    count: int
    n: int
    by_cause: dict[Cause, int]
    control_stalled_too: int


def count_late_bench_frames(
    late_ns: Times, causes: NDArray[np.int64], *, limit_us: float, stalled: NDArray[np.bool_]
) -> LatenessMisses:
    """Count the frames that were later than *limit_us*, by cause.

    Parameters
    ----------
    stalled : (n,) numpy.ndarray of bool
        Whether the control loop was stalled while the frame was late.
    """
    missed = late_ns > limit_us * 1e3
    by_cause = {
        cause: int((missed & (causes == place)).sum()) for place, cause in enumerate(CAUSES)
    }
    scheduling = missed & (causes == CAUSES.index(Cause.SCHEDULING))
    return LatenessMisses(
        limit_us, int(missed.sum()), len(late_ns), by_cause, int((scheduling & stalled).sum())
    )

"""One segment: a board is powered up, streamed to, interrupted in every way, and accounted for.

A segment streams in *bursts*.  During a burst frames are hit; then the line is left alone until
both ends have told of everything (the stream goes on), and the account is closed.  What comes
between two bursts, a pause, an outage, a new session, begins with nothing under way.
"""

from __future__ import annotations

import random
import sys
from collections.abc import Callable
from typing import Final, Protocol

from haptogram.settings.faults.plan import Fault, FaultPlan
from haptogram_protocol.messages import (
    Arm,
    ArmReply,
    Config,
    GetStatus,
    SetConfig,
    SetConfigReply,
    StatusReply,
)
from haptogram_protocol.state import OutputState

from .account.course import CourseTaker
from .account.tally import SoakTally
from .board import BoardUnderSoak, Hopeless
from .excerpts import SoakExcerpts
from .rig import BAUD, SoakRig

PERIOD_US: Final = 1000
_LEAD_US: Final = 40_000
_MS: Final = 1_000_000
_S: Final = 1_000_000_000
_PINGS: Final = 8
_BURST_S: Final = (0.3, 6.0)
_MOST_CALM_MS: Final = 3000
_MARGIN_US: Final = 20_000  # by which the first latch after a pause may miss its plan
_PPM: Final = 50  # that the board declares for its clock
_STEP: Final = "clock.step"
_STEP_US: Final = (5_000, 30_000)
_LEAST_FOR_STEP_S: Final = 20.0
_BLOCKS: Final = 5000  # of memory that may come and go

#: Called with the virtual seconds that are done.
Progress = Callable[[float], None]


class MakeBoard(Protocol):
    """Powers a board up; see ``sim_device.driven.soak_board.VirtualSoakBoard``."""

    def __call__(self, *, seed: int, baud: int, plan: FaultPlan, running_us: int) -> BoardUnderSoak:
        """Return it."""
        ...


def run_soak_segment(
    make_board: MakeBoard,
    *,
    seed: int,
    number: int,
    seconds: float,
    start_s: float,
    fault_rate: float,
    interval_s: float = 1.0,
    progress: Progress | None = None,
    recorded: bool = False,
) -> SoakTally:
    """Run a segment and return its account; it follows from the arguments alone.

    Parameters
    ----------
    seed, number : int
        Of the soak, and of the segment in it.
    seconds, start_s : float
        How long it is, and how long the soak is before it: the board's clock goes on.
    fault_rate : float
        Share of the frames that are hit, in each direction.
    interval_s : float
        Length of the intervals of the course, from the begin of the soak on.
    recorded : bool
        Whether the account keeps excerpts around violations.
    """
    source = random.Random(f"{seed}/{number}")
    tally = SoakTally()
    plan = FaultPlan(_soak_clock_faults(seconds, source), seed + number)
    board = make_board(
        seed=seed + number,
        baud=BAUD,
        plan=plan,
        running_us=round(start_s * 1e6),
    )
    excerpts = SoakExcerpts(tally) if recorded else None
    course = CourseTaker(tally.course, tally.take_counts, start_s, interval_s)
    rig = SoakRig(board, fault_rate, source, tally, excerpts, course)
    stepped = any(plan.named(_STEP))
    # What is kept for a recording comes and goes: no leak.
    segment = _SoakSegment(
        rig, source, round(seconds * _S), stepped=stepped, watches_memory=not recorded
    )
    try:
        segment.run(progress)
    except Hopeless as error:
        tally.violate("given up", f"segment {number}: {error}")
    course.close()
    if excerpts is not None:
        excerpts.look(rig.now_ns)
        tally.excerpts = excerpts.found
    tally.examples = [f"segment {number}, {text}" for text in tally.examples]
    return tally


def _soak_clock_faults(seconds: float, source: random.Random) -> tuple[Fault, ...]:
    """Return a drift within what the board declares, and a step in every other segment."""
    drift = Fault("clock.ppm", {"ppm": float(source.randint(-_PPM, _PPM))})
    step_us, at_s = source.randint(*_STEP_US), seconds * source.uniform(0.3, 0.6)
    if seconds < _LEAST_FOR_STEP_S or source.random() < 0.5:
        return (drift,)
    return drift, Fault(_STEP, {"us": float(step_us)}, from_ns=round(round(at_s, 6) * _S))


class _SoakSegment:
    def __init__(
        self,
        rig: SoakRig,
        source: random.Random,
        length_ns: int,
        *,
        stepped: bool,
        watches_memory: bool,
    ) -> None:
        self._rig, self._source, self._length_ns = rig, source, length_ns
        self._tally = rig.tally
        self._stepped, self._watches_memory = stepped, watches_memory
        self._due_us = 0
        self._jumps = 0
        self._blocks: int | None = None
        self._interruptions: tuple[Callable[[], None], ...] = (
            self._pause,
            self._pause,
            self._outage,
            self._mute,
            self._restart,
        )

    def run(self, progress: Progress | None) -> None:
        rig = self._rig
        self._connect()
        while True:
            self._burst()
            self._wait_idle()
            self._watch_memory()
            if progress is not None:
                progress(min(rig.now_ns, self._length_ns) / _S)
            if rig.now_ns >= self._length_ns:
                break
            self._source.choice(self._interruptions)()
        self._finish()

    # --- streaming -----------------------------------------------------------------------------

    def _connect(self) -> None:
        rig, source = self._rig, self._source
        rig.new_session()
        self._calm(False)
        config = Config(
            hold_ms=source.choice((100, 200, 400)),
            ramp_ms=source.choice((0, 20, 50)),
            host_timeout_ms=source.choice((100, 200, 500)),
            status_period_ms=50,
            late_window_us=source.choice((0, 2000)),
        )
        rig.request(SetConfig(config), SetConfigReply)
        rig.oracle.config = config
        for _ in range(_PINGS):
            rig.wait_for(rig.ping())
        rig.request(Arm(), ArmReply)

    def _calm(self, calm: bool) -> None:
        self._rig.down.calm = self._rig.up.calm = calm

    def _burst(self) -> None:
        self._calm(False)
        self._due_us = 0
        left_ns = max(self._length_ns - self._rig.now_ns, 100 * _MS)
        self._stream(min(left_ns, round(self._source.uniform(*_BURST_S) * _S)) // _MS)

    def _wait_idle(self) -> None:
        """Stream on undisturbed until both ends have told of everything."""
        self._calm(True)
        self._stream(_LEAD_US // PERIOD_US + 60)  # longer than a STATUS takes to come
        for _ in range(_MOST_CALM_MS // 10):
            if self._drained():
                break
            self._stream(10)
        else:
            self._tally.violate("not in order again", f"after {_MOST_CALM_MS} ms without a fault")
            raise Hopeless("the link does not recover")
        self._rig.close()
        self._rig.listen()

    def _drained(self) -> bool:
        """Let what is on the lines come, and tell whether nothing is open."""
        rig = self._rig
        until_ns = rig.now_ns + _MS
        while not rig.is_idle and rig.now_ns < until_ns:
            rig.run_until(rig.now_ns + _MS // 10)
        return rig.is_idle

    def _stream(self, frames: int) -> None:
        rig, clock = self._rig, self._rig.clock
        for _ in range(frames):
            if clock.jumps != self._jumps:
                self._see_jump()
            self._due_us = self._due_us + PERIOD_US if self._due_us else self._first_due_us()
            rig.run_until(max(rig.now_ns, clock.to_host_ns(self._due_us - _LEAD_US)))
            rig.keep_clock()
            rig.stream_frame(self._due_us)

    def _first_due_us(self) -> int:
        return self._rig.clock.to_device_us(self._rig.now_ns) + _LEAD_US

    def _see_jump(self) -> None:
        """Go by the board's new time; it only ever jumps ahead."""
        self._tally.totals["clock steps seen"] += self._rig.clock.jumps - self._jumps
        self._jumps = self._rig.clock.jumps
        self._due_us = max(self._due_us + PERIOD_US, self._first_due_us())

    # --- interruptions -------------------------------------------------------------------------

    def _pause(self) -> None:
        """Say nothing for a while: shorter than the timers, or longer."""
        self._tally.totals["pauses"] += 1
        self._rig.idle_until(self._rig.now_ns + self._some_time_ns())
        self._resume()

    def _outage(self) -> None:
        """Lose both directions, and stream on into the void."""
        self._tally.totals["outages"] += 1
        rig = self._rig
        self._due_us = 0
        rig.down.cut = rig.up.cut = True
        end_ns = rig.now_ns + self._some_time_ns()
        while rig.now_ns < end_ns:
            self._stream(1)
            rig.listen()
        rig.down.cut = rig.up.cut = False
        self._resume()

    def _some_time_ns(self) -> int:
        config = self._rig.oracle.config
        limit_ms = min(config.hold_ms, config.host_timeout_ms) + config.ramp_ms
        return round(self._source.uniform(0.1, 2.5) * limit_ms) * _MS

    def _resume(self) -> None:
        """Arm the board again if a timer has muted it, or will before the first latch."""
        rig = self._rig
        status = rig.request(GetStatus(), StatusReply)
        rig.listen()
        soon_us = rig.board.device_us(rig.now_ns) + _LEAD_US + _MARGIN_US
        if status.state is OutputState.ARMED and soon_us > rig.oracle.fades_at_us:
            rig.wait_for(rig.host.send_mute(rig.now_ns // 1000))
        rig.request(Arm(), ArmReply)

    def _mute(self) -> None:
        """Ask for silence in the midst of the stream."""
        self._tally.totals["mutes"] += 1
        rig = self._rig
        rig.wait_for(rig.host.send_mute(rig.now_ns // 1000))
        rig.idle_until(rig.now_ns + self._source.randint(1, 50) * _MS)
        rig.request(Arm(), ArmReply)

    def _restart(self) -> None:
        """Begin another session in the midst of the stream, without a word."""
        self._tally.totals["restarts"] += 1
        self._connect()

    # --- the end -------------------------------------------------------------------------------

    def _watch_memory(self) -> None:
        """Compare the blocks of memory in use at moments of equal state."""
        if not self._watches_memory:
            return
        blocks = sys.getallocatedblocks()
        if self._blocks is None:
            self._blocks = blocks
        elif blocks > self._blocks + _BLOCKS:
            grown = blocks - self._blocks
            self._tally.violate("memory leak", f"{grown} blocks more than after the first burst")
            self._blocks = blocks

    def _finish(self) -> None:
        """Let the last frame be latched, and compare the counters with the account."""
        rig = self._rig
        rig.idle_until(rig.now_ns + 2 * _LEAD_US * 1000)
        self._tally.totals["virtual ms"] += self._length_ns // _MS
        self._tally.totals["clock steps"] += self._stepped
        if self._jumps < self._stepped:
            self._tally.violate("clock step unseen", "the host did not notice")
        elif self._jumps > self._stepped:
            steps = self._jumps - self._stepped
            self._tally.violate("clock stepped by itself", f"{steps} times")
        _compare_soak_counters(rig.board.counters, self._tally)


def _compare_soak_counters(counters: dict[str, int], tally: SoakTally) -> None:
    """Explain every counter of the board, by name."""
    totals = tally.totals
    explained: dict[str, int] = dict.fromkeys(counters, 0)
    explained |= {
        "frames": totals["board frames"],
        "requests": totals["request"],
        **{name: totals[f"the board: {name}"] for name in ("crc", "cobs", "short", "oversize")},
        **{
            name: totals[name]
            for name in (
                *("accepted", "latched", "late", "dropped_late"),
                *("flushed", "gap", "duplicate"),
            )
        },
        "repeated": totals["repeated"],
        "timeouts": totals["muted by a timer"],
    }
    for name, count in counters.items():
        tally.totals[f"counter {name}"] += count
        if count != explained[name]:
            tally.violate(
                "counter unexplained", f"{name} is {count}; the account says {explained[name]}"
            )

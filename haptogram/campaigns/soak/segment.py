"""One segment: a board is powered up, streamed to, interrupted in every way, and accounted for.

A segment streams in *bursts*.  During a burst frames are hit; then the line is left alone until
both ends have told of everything (the stream goes on), and the account is closed.  What comes
between two bursts, a pause, an outage, a new session, begins with nothing under way.
"""

from __future__ import annotations

import random
import sys
from collections.abc import Callable
from typing import Final, TypeAlias

from haptogram.driver.line.link import NS_PER_S
from haptogram.errors import DeviceError, NoAnswerError
from haptogram.settings.faults.plan import Fault, FaultPlan
from haptogram_protocol import messages as m

from .comparison import Hopeless, MakeBoard
from .line import BAUD
from .rig import NS_PER_MS, SoakRig
from .setup import SoakSetup
from .tally import SoakTally

PERIOD_US: Final = 1000
_LEAD_US: Final = 40_000
_BURST_S: Final = (0.3, 6.0)
_MOST_CALM_MS: Final = 3000
_MARGIN_NS: Final = 25_000_000  # tolerance of the first latch after a pause
_PPM: Final = 50  # clock tolerance that the board declares
_STEP: Final = "clock.step"
_STEP_US: Final = (5_000, 30_000)
_LEAST_FOR_STEP_S: Final = 20.0
_BLOCKS: Final = 5000  # tolerated change of the number of memory blocks

#: Called with the virtual seconds that are done, of this segment and those before it.
Progress: TypeAlias = Callable[[float], None]


def run_soak_segment(
    make_board: MakeBoard,
    setup: SoakSetup,
    number: int,
    progress: Progress | None = None,
    *,
    recorded: bool = False,
) -> SoakTally:
    """Run a segment and return its account; it follows from setup and number alone.

    The board's clock goes on where that of the segment before has ended.

    Parameters
    ----------
    number : int
        Of the segment.
    progress : callable, optional
        Called after each burst, with the virtual seconds since the begin of the soak.
    recorded : bool
        Whether the account keeps excerpts around violations.
    """
    source = random.Random(f"{setup.seed}/{number}")
    tally = SoakTally()
    start_s = setup.start_s(number)
    seed, running_us = setup.seed + number, round(start_s * 1e6)
    plan = FaultPlan(_soak_clock_faults(setup.length_s(number), source), seed)
    board = make_board(seed=seed, baud=BAUD, plan=plan, running_us=running_us)
    tally.interval = start_s / setup.interval_s
    rig = SoakRig(board, setup, source, tally, recorded=recorded)
    length_ns = round(setup.length_s(number) * NS_PER_S)
    try:
        _SoakSegment(rig, plan, length_ns, start_s).run(progress)
    except (DeviceError, Hopeless, NoAnswerError) as error:
        if not isinstance(error, Hopeless):
            tally.violate("no answer", f"{error}")
        tally.violate("given up", f"segment {number}: {error}")
    rig.comparison.count()
    rig.excerpts.look(rig.now_ns())
    tally.examples = [f"segment {number}, {text}" for text in tally.examples]
    return tally


def _soak_clock_faults(seconds: float, source: random.Random) -> tuple[Fault, ...]:
    """Return a clock drift of up to 50 ppm and, for half of the long segments, a step.

    Long are those of 20 s or more.
    """
    drift = Fault("clock.ppm", {"ppm": float(source.randint(-_PPM, _PPM))})
    step_us, at_s = source.randint(*_STEP_US), seconds * source.uniform(0.3, 0.6)
    if seconds < _LEAST_FOR_STEP_S or source.random() < 0.5:
        return (drift,)
    return drift, Fault(_STEP, {"us": float(step_us)}, from_ns=round(round(at_s, 6) * NS_PER_S))


class _SoakSegment:
    def __init__(self, rig: SoakRig, plan: FaultPlan, length_ns: int, start_s: float) -> None:
        self._rig, self._source, self._tally = rig, rig.source, rig.tally
        self._length_ns, self._start_s = length_ns, start_s
        self._stepped = any(plan.named(_STEP))
        self._timers_ms = self._ramp_ms = 0
        self._due_us = self._jumps = self._blocks = 0

    def run(self, progress: Progress | None) -> None:
        rig = self._rig
        interruptions = {
            "pauses": self._pause,
            "outages": self._outage,
            "mutes": self._mute,
            "restarts": self._connect,  # in the midst of the stream, without a word
        }
        self._connect()
        while True:
            self._burst()
            self._wait_idle()
            if not rig.excerpts.kept:  # which come and go: no leak
                self._watch_memory()
            if progress is not None:
                progress(self._start_s + min(rig.now_ns(), self._length_ns) / NS_PER_S)
            if rig.now_ns() >= self._length_ns:
                break
            name = self._source.choice(("pauses", *interruptions))
            self._tally.totals[name] += 1
            interruptions[name]()
        self._finish()

    # --- streaming -----------------------------------------------------------------------------

    def _connect(self) -> None:
        """Open a session with random timers, and arm the board."""
        rig, source = self._rig, self._source
        rig.new_session()
        rig.down.calm = rig.up.calm = False
        config = m.Config(
            hold_ms=source.choice((100, 200, 400)),
            ramp_ms=source.choice((0, 20, 50)),
            host_timeout_ms=source.choice((100, 200, 500)),
            status_period_ms=50,
            late_window_us=source.choice((0, 2000)),
        )
        self._timers_ms = min(config.hold_ms, config.host_timeout_ms)
        self._ramp_ms = config.ramp_ms
        rig.link.request(m.SetConfig(config), m.SetConfigReply)
        rig.pinger.synchronise()
        rig.arm()

    def _burst(self) -> None:
        """Stream frames with line faults for a random 0.3 to 6 s, or to the segment's end."""
        self._rig.down.calm = self._rig.up.calm = False
        self._due_us = 0
        left_ns = max(self._length_ns - self._rig.now_ns(), 100 * NS_PER_MS)
        self._stream(min(left_ns, round(self._source.uniform(*_BURST_S) * NS_PER_S)) // NS_PER_MS)

    def _wait_idle(self) -> None:
        """Stream without faults until both ends are idle; raise Hopeless if that takes 3 s."""
        rig = self._rig
        rig.down.calm = rig.up.calm = True
        self._stream(_LEAD_US // PERIOD_US + 60)  # longer than a STATUS takes to come
        for _ in range(_MOST_CALM_MS // 10):
            rig.run_until(rig.now_ns() + NS_PER_MS)
            if rig.down.is_idle and rig.up.is_idle and not rig.link.connection.outstanding:
                break
            self._stream(10)
        else:
            self._tally.violate("not in order again", f"after {_MOST_CALM_MS} ms without a fault")
            raise Hopeless("the link does not recover")
        self._tally.close()
        rig.listen()

    def _stream(self, frames: int) -> None:
        """Stream *frames* frames, one per period."""
        rig, clock = self._rig, self._rig.clock
        for _ in range(frames):
            first_us = clock.to_device_us(rig.now_ns()) + _LEAD_US
            if clock.jumps != self._jumps:  # the board's time only ever jumps ahead
                self._tally.totals["clock steps seen"] += clock.jumps - self._jumps
                self._jumps = clock.jumps
                self._due_us = max(self._due_us, first_us - PERIOD_US)
            self._due_us = self._due_us + PERIOD_US if self._due_us else first_us
            rig.run_until(max(rig.now_ns(), clock.to_host_ns(self._due_us - _LEAD_US)))
            rig.stream_frame(self._due_us)

    # --- interruptions -------------------------------------------------------------------------

    def _pause(self) -> None:
        """Send nothing for a time shorter or longer than hold and lease, then arm again."""
        since_ns = self._rig.now_ns()
        self._rig.idle_until(since_ns + self._some_time_ns())
        self._resume(since_ns)

    def _outage(self) -> None:
        """Stream with both directions cut, for less or more than hold and lease, then go on.

        A request that fails five times meanwhile is given up: only another session helps.
        """
        rig, hits = self._rig, self._tally.request_hits
        self._due_us = 0
        rig.down.cut = rig.up.cut = True
        since_ns = rig.now_ns()
        end_ns = since_ns + self._some_time_ns()
        try:
            while rig.now_ns() < end_ns:
                self._stream(1)
                rig.listen()
            rig.down.cut = rig.up.cut = False
            self._resume(since_ns)
        except NoAnswerError:
            if not hits:  # the last try was not lost
                raise
            self._tally.find(hits.pop(0), "given up")
            rig.down.cut = rig.up.cut = False
            self._connect()

    def _some_time_ns(self) -> int:
        """Return a random duration: 0.1 to 2.5 times the sum of the shorter timer and the ramp."""
        return round(self._source.uniform(0.1, 2.5) * (self._timers_ms + self._ramp_ms)) * NS_PER_MS

    def _resume(self, since_ns: int) -> None:
        """Rearm the board, after silence if a timer may just be muting it.

        *since_ns*: when the host fell silent; the last latch was a lead later.
        """
        quiet_ns = self._rig.now_ns() - since_ns + _MARGIN_NS
        end_ns = self._timers_ms * NS_PER_MS
        if end_ns < quiet_ns < end_ns + self._ramp_ms * NS_PER_MS + 3 * _MARGIN_NS:
            self._rig.silence()  # it fades, or soon will
        self._rig.arm()

    def _mute(self) -> None:
        """Send MUTE in the middle of the stream; arm again after 1 to 50 ms."""
        self._rig.silence()
        self._rig.idle_until(self._rig.now_ns() + self._source.randint(1, 50) * NS_PER_MS)
        self._rig.arm()

    # --- the end -------------------------------------------------------------------------------

    def _watch_memory(self) -> None:
        """Report a violation if Python holds 5000 memory blocks more than after the first burst."""
        blocks = sys.getallocatedblocks()
        self._blocks = self._blocks or blocks
        if (grown := blocks - self._blocks) > _BLOCKS:
            self._tally.violate("memory leak", f"{grown} blocks more than after the first burst")
            self._blocks = blocks

    def _finish(self) -> None:
        """Wait for the last latch, then compare the board's counters with the injected faults.

        The clock steps that the host noticed too; a difference is a violation of the soak.
        """
        rig = self._rig
        rig.idle_until(rig.now_ns() + 2 * _LEAD_US * 1000)
        self._tally.totals["virtual ms"] += self._length_ns // NS_PER_MS
        self._tally.totals["clock steps"] += self._stepped
        if self._jumps != self._stepped:
            name = "clock stepped by itself" if self._jumps else "clock step unseen"
            self._tally.violate(name, f"the host noticed {self._jumps} steps")
        rig.comparison.compare_counters()

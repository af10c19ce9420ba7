"""Measure the goals for control loop and round trip, each beside the same work in C.

A figure and what it is held against come from the same minute on the same machine. A goal that is
not met is reported; nothing fails by it.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.campaigns.bench.config import BenchConfig
from haptogram.campaigns.bench.measure import BenchRun, run_bench
from haptogram.campaigns.bench.percentiles import percentiles_with_missed_ticks
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram.machine.fingerprint import (
    fingerprint_cpu_share,
    fingerprint_cpu_times,
    machine_fingerprint,
)

from .c_programs import CPrograms, c_programs
from .exchange import Exchange, exchanger, fastest_pipeline, highest_verified_rate_hz
from .table import Goal, Goals

_RATE_HZ: Final = 1000.0
_PERIOD_US: Final = 1e6 / _RATE_HZ
_SPIN_US: Final = 150
_COMPLETE_US: Final = 1000.0
_PIPELINED_HZ: Final = 15_500  # 1.4 times the 11 100 of f17889f on a quiet core
_CHANCE: Final = 0.001  # difference of two runs one after the other
_BAUD: Final = 12_000_000  # the loop is measured, not how a line that is 92 % full catches up
_FRAME_BYTES: Final = 276
_TRACE_BYTES: Final = 28
_NO_COMPILER: Final = "no C compiler"


def measure_goals(*, seconds: float = 30.0, trips: int = 5000, step_s: float = 0.5) -> Goals:
    """Measure every goal.

    Parameters
    ----------
    seconds : float
        Length of each control loop, in seconds.
    trips : int
        Number of round trips, and of frames of each exchange.
    step_s : float
        Length of each step of the search for the highest rate, in seconds.
    """
    before = fingerprint_cpu_times()
    with c_programs() as programs:
        lines = _loop_goals(programs, seconds) + _line_goals(programs, trips, step_s)
    return Goals(
        lines, machine_fingerprint(), fingerprint_cpu_share(before, fingerprint_cpu_times())
    )


def _loop_goals(programs: CPrograms | None, seconds: float) -> list[Goal]:
    found = []
    for spin_us in (_SPIN_US, 0):
        config = BenchConfig(rate_hz=_RATE_HZ, seconds=seconds, baud=_BAUD, spin_us=spin_us)
        run, beside = _beside_c(programs, config)
        found += _lateness_goals(run, beside)
    return [*found, *_two_processes(run, programs)]


def _beside_c(
    programs: CPrograms | None, config: BenchConfig
) -> tuple[BenchRun, NDArray[np.float64] | None]:
    """Return the run, and the lateness of the C loop beside it in us."""
    if programs is None:
        return run_bench(config), None
    count = round(config.rate_hz * config.seconds)
    period_ns = round(1e9 / config.rate_hz)
    with programs.running_loop(
        period_ns=period_ns, count=count, spin_ns=config.spin_us * 1000
    ) as lateness:
        run = run_bench(config)
    # The stream counts every frame; so the C loop has to count every tick.
    return run, percentiles_with_missed_ticks(lateness[0], period_ns / 1e3)


def _lateness_goals(run: BenchRun, beside: NDArray[np.float64] | None) -> list[Goal]:
    own, spin_us = run.stages_us["wake"], run.config.spin_us
    name = f"spin of {spin_us} µs" if spin_us else "asleep"
    label = f"1 kHz, {run.config.seconds:g} s, {name}"
    p50, tail = _percentile(own, 50.0), _percentile(own, 99.9)
    if beside is None:
        return [Goal(f"{label}: lateness p99.9", f"{tail:.1f} µs", _NO_COMPILER, "<= 2x C", None)]
    c50, c_tail = _percentile(beside, 50.0), _percentile(beside, 99.9)
    limit, met = ("<= 1 µs", p50 <= 1.0) if spin_us else ("none", None)
    return [
        Goal(f"{label}: lateness p50", f"{p50:.1f} µs", f"C {c50:.1f} µs", limit, met),
        Goal(
            f"{label}: lateness p99.9",
            f"{tail:.0f} µs",
            f"C {c_tail:.0f} µs",
            "<= 2x C",
            tail <= 2 * c_tail,
        ),
        _late_ticks(label, own, beside),
    ]


def _percentile(lateness_us: NDArray[np.float64], level: float) -> float:
    return float(np.percentile(lateness_us, level, method="inverted_cdf"))


def _late_ticks(label: str, own: NDArray[np.float64], beside: NDArray[np.float64]) -> Goal:
    count, c_count = (int((late > _PERIOD_US).sum()) for late in (own, beside))
    return Goal(
        f"{label}: later than a period",
        f"{count} of {len(own)}",
        f"C {c_count} of {len(beside)}",
        "<= 2x C + 5",
        count <= 2 * c_count + 5,
    )


def _two_processes(run: BenchRun, programs: CPrograms | None) -> list[Goal]:
    due = run.report.frames
    in_time = float((run.stages_us["complete"] < _COMPLETE_US).mean())
    beside = None
    if programs is not None:
        period_ns = round(_PERIOD_US * 1000)
        beside = programs.round_trips_us(
            there=_FRAME_BYTES, back=_TRACE_BYTES, count=due, period_ns=period_ns
        )
    share = None if beside is None else float((beside < _COMPLETE_US).mean())
    return [
        Goal(
            "1 kHz, two processes over a pty: latched on its carrier period",
            f"{100 * run.latched / due:.2f} %",
            "-",
            "100 %",
            run.latched == due,
        ),
        Goal(
            "the same: complete at the board within 1 ms",
            f"{100 * in_time:.2f} %",
            _NO_COMPILER if share is None else f"C, after it {100 * share:.2f} %",
            "no worse than C",
            None if share is None else in_time >= share - _CHANCE,
        ),
    ]


def _line_goals(programs: CPrograms | None, trips: int, step_s: float) -> list[Goal]:
    with VirtualBoard(reconstruct=False, clock="wall") as board, exchanger(board.url) as session:
        trips_us = session.round_trips_us(trips)
        closed = session.closed_loop(trips)
        pipelined = fastest_pipeline(session, trips)
        streamed_hz = highest_verified_rate_hz(session, step_s)
    beside = None
    if programs is not None:
        beside = programs.round_trips_us(there=_FRAME_BYTES, back=_TRACE_BYTES, count=trips)
    return [
        _trip_goal(trips_us, beside),
        _closed_goal(closed, beside),
        Goal(
            "pipelined, every frame verified",
            _verified(pipelined),
            "the 40 kHz carrier, on which a board latches",
            f">= {_PIPELINED_HZ} frames/s",
            pipelined.verified == pipelined.frames and pipelined.rate_hz >= _PIPELINED_HZ,
        ),
        Goal(
            "highest rate of a stream, every frame on its carrier period",
            f"{streamed_hz:.0f} frames/s",
            "steps of a quarter",
            "none",
            None,
        ),
    ]


def _trip_goal(trips_us: NDArray[np.float64], beside: NDArray[np.float64] | None) -> Goal:
    own = float(np.median(trips_us))
    c_us = None if beside is None else float(np.median(beside))
    return Goal(
        "round trip of the driver, p50",
        f"{own:.0f} µs",
        _NO_COMPILER if c_us is None else f"C ping-pong {c_us:.0f} µs",
        "<= 4x C",
        None if c_us is None else own <= 4 * c_us,
    )


def _closed_goal(closed: Exchange, beside: NDArray[np.float64] | None) -> Goal:
    c_hz = None if beside is None else 1e6 / float(beside.mean())
    whole = closed.verified == closed.frames
    return Goal(
        "closed loop, every frame verified",
        _verified(closed),
        _NO_COMPILER if c_hz is None else f"C ping-pong {c_hz:.0f}/s",
        ">= 0.4x C",
        None if c_hz is None else whole and closed.rate_hz >= 0.4 * c_hz,
    )


def _verified(done: Exchange) -> str:
    return f"{done.rate_hz:.0f} frames/s, {done.verified} of {done.frames} verified"

"""The goals of this project for loop and round trip, measured in one run, side by side.

Each figure stands beside what it is held against, measured in the same minute on the same machine.
A goal that is not met is said to be not met; nothing fails by it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram.campaigns.bench.c_programs import CPrograms, c_programs
from haptogram.campaigns.bench.exchange import (
    Exchange,
    exchanger,
    fastest_pipeline,
    highest_verified_rate_hz,
)
from haptogram.campaigns.bench.measure import BenchConfig, BenchRun, run_bench
from haptogram.campaigns.bench.percentiles import with_missed_ticks
from haptogram.evidence.virtual_board import VirtualBoard
from haptogram.machine.fingerprint import cpu_share, cpu_times, fingerprint

_RATE_HZ: Final = 1000.0
_SPIN_US: Final = 150
_BAUD: Final = 12_000_000  # the loop is measured, not how a line that is 92 % full catches up
_FRAME_BYTES: Final = 276
_TRACE_BYTES: Final = 28


@dataclass(frozen=True, slots=True)
class Goal:
    """One line of the table.

    Attributes
    ----------
    figure, measured, against, goal : str
        What, how much, measured beside it, and what was hoped for.
    met : bool or None
        None: cannot be told here.
    """

    figure: str
    measured: str
    against: str
    goal: str
    met: bool | None


@dataclass(frozen=True, slots=True)
class Goals:
    """The table, and where it was made."""

    lines: list[Goal]
    environment: Mapping[str, Any]
    processors: Mapping[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {
            "goals": [
                {name: getattr(line, name) for name in Goal.__slots__} for line in self.lines
            ],
            "environment": dict(self.environment),
            "processors": dict(self.processors),
        }


def measure_goals(*, seconds: float = 30.0, trips: int = 5000, step_s: float = 0.5) -> Goals:
    """Measure everything, loops for *seconds* each, *trips* round trips.

    Parameters
    ----------
    step_s : float
        How long each rate is tried in search of the highest one.
    """
    before = cpu_times()
    with c_programs() as programs:
        lines = _loop_goals(programs, seconds) + _line_goals(programs, trips, step_s)
    return Goals(lines, fingerprint(), cpu_share(before, cpu_times()))


def _loop_goals(programs: CPrograms | None, seconds: float) -> list[Goal]:
    spinning = BenchConfig(rate_hz=_RATE_HZ, seconds=seconds, baudrate=_BAUD, spin_us=_SPIN_US)
    sleeping = BenchConfig(rate_hz=_RATE_HZ, seconds=seconds, baudrate=_BAUD)
    found = []
    for config, name in ((spinning, f"spin of {_SPIN_US} us"), (sleeping, "asleep")):
        run, beside = _beside_c(programs, config)
        found += _lateness(run, beside, name, spinning=config is spinning)
    return [*found, *_two_processes(run)]


def _beside_c(
    programs: CPrograms | None, config: BenchConfig
) -> tuple[BenchRun, NDArray[np.float64] | None]:
    if programs is None:
        return run_bench(config), None
    count = round(config.rate_hz * config.seconds)
    period_ns = round(1e9 / config.rate_hz)
    with programs.running_loop(
        period_ns=period_ns, count=count, spin_ns=config.spin_us * 1000
    ) as lateness:
        run = run_bench(config)
    # The stream counts every frame; so must what it is held against count every tick.
    return run, with_missed_ticks(lateness[0], period_ns / 1e3)


def _lateness(
    run: BenchRun, beside: NDArray[np.float64] | None, name: str, *, spinning: bool
) -> list[Goal]:
    own = run.stages_us["wake"]
    p50, tail, misses = _figures(own, run.config.rate_hz)
    label = f"1 kHz, {run.config.seconds:g} s, {name}"
    limit_us = 1.0 if spinning else None
    if beside is None:
        nothing = "no C compiler"
        return [Goal(f"{label}: lateness p99.9", f"{tail:.1f} us", nothing, "<= 2x C", None)]
    c50, c_tail, c_misses = _figures(beside, run.config.rate_hz)
    median = Goal(
        f"{label}: lateness p50",
        f"{p50:.1f} us",
        f"C {c50:.1f} us",
        "<= 1 us" if limit_us else "none",
        p50 <= limit_us if limit_us else None,
    )
    return [
        median,
        Goal(
            f"{label}: lateness p99.9",
            f"{tail:.0f} us",
            f"C {c_tail:.0f} us",
            "<= 2x C",
            tail <= 2 * c_tail,
        ),
        Goal(
            f"{label}: later than a period",
            f"{misses} of {len(own)}",
            f"C {c_misses} of {len(beside)}",
            "<= 2x C + 5",
            misses <= 2 * c_misses + 5,
        ),
    ]


def _figures(lateness_us: NDArray[np.float64], rate_hz: float) -> tuple[float, float, int]:
    p50, tail = np.percentile(lateness_us, [50.0, 99.9], method="inverted_cdf")
    return float(p50), float(tail), int((lateness_us > 1e6 / rate_hz).sum())


def _two_processes(run: BenchRun) -> list[Goal]:
    due = run.report.frames
    late = run.stages_us["complete"]
    in_time = int((late < 1000.0).sum())
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
            f"{100 * in_time / due:.2f} %",
            "-",
            ">= 99.9 %",
            in_time >= 0.999 * due,
        ),
    ]


def _line_goals(programs: CPrograms | None, trips: int, step_s: float) -> list[Goal]:
    with VirtualBoard(reconstruct=False) as board, exchanger(board.url) as session:
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
            ">= 60000 frames/s",
            pipelined.verified == pipelined.frames and pipelined.rate_hz >= 60_000,
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
    c = float("nan") if beside is None else float(np.median(beside))
    return Goal(
        "round trip of the driver, p50",
        f"{own:.0f} us",
        "no C compiler" if beside is None else f"C ping-pong {c:.0f} us",
        "<= 1.4x C",
        None if beside is None else own <= 1.4 * c,
    )


def _verified(done: Exchange) -> str:
    return f"{done.rate_hz:.0f} frames/s, {done.verified} of {done.frames} verified"


def _closed_goal(closed: Exchange, beside: NDArray[np.float64] | None) -> Goal:
    c_hz = float("nan") if beside is None else 1e6 / float(beside.mean())
    return Goal(
        "closed loop, every frame verified",
        _verified(closed),
        "no C compiler" if beside is None else f"C ping-pong {c_hz:.0f}/s",
        ">= 0.4x C",
        None
        if beside is None
        else closed.verified == closed.frames and closed.rate_hz >= 0.4 * c_hz,
    )


def as_text(goals: Goals) -> str:
    """Return the table for people."""
    words = {True: "met", False: "NOT met", None: "-"}
    rows = [("figure", "measured", "beside it", "goal", "")]
    rows += [(g.figure, g.measured, g.against, g.goal, words[g.met]) for g in goals.lines]
    widths = [max(len(row[column]) for row in rows) for column in range(5)]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    found = goals.environment
    shares = ", ".join(f"{name} {100 * v:.0f} %" for name, v in goals.processors.items())
    lines.append(
        f"\n{found['cpu']}, {found['cpus_usable']} processors, {found['virtualisation']}, "
        f"{found['kernel']} {found['preemption']}, {found['python']}\n"
        f"processors meanwhile: {shares}"
    )
    return "\n".join(lines)

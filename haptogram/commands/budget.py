"""``haptogram budget``: where the time of one frame goes, and the highest rate that fits."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_choice
from haptogram.settings.board import MOST_TRANSDUCERS
from haptogram.settings.command_line import add_setting_options, settings_of
from haptogram.settings.option import Settings, option, option_of, options_of
from haptogram.settings.parser import Parser
from haptogram.settings.run.frames import LinkConfig, PaceConfig

from .acting_options import refuse_idle_options, with_option, without_option

if TYPE_CHECKING:
    from haptogram.campaigns.bench import frame_budget

_TIMERS_MS: Final = {
    "without a USB adapter": 0,
    "latency timer of 1 ms": 1,
    "latency timer of 16 ms, as it comes": 16,
}


@dataclass(frozen=True, kw_only=True)
class BudgetConfig(Settings):
    """The frames whose time is looked at, and their line."""

    baud: int = option_of(LinkConfig, "baud")
    rate_hz: float = option_of(PaceConfig, "rate_hz", low=0.001, help="frames per second")
    transducers: int = option(
        256, unit="N", low=1, high=MOST_TRANSDUCERS, help="transducers of the array"
    )
    dialect: str | None = option(
        None,
        unit="NAME",
        help="wire of other boards, at the rates that they have and at --baud, if it is given",
        absent="Haptogram's own",
    )
    boards: int = option(1, unit="N", low=1, high=16, help="boards on the line, with --dialect")


_ACTING: Final = {"boards": with_option("dialect"), "transducers": without_option("dialect")}


def set_up_budget(parser: Parser) -> None:
    """Add the options of the command."""
    parser.acting = _ACTING
    parser.set_defaults(run=run_budget)
    baud = f"{BudgetConfig.baud}, with --dialect: that of its boards"
    add_setting_options(parser, options_of(BudgetConfig).values(), baud=baud)


def run_budget(arguments: argparse.Namespace) -> int:
    """Measure, print, and return 0 if the rate fits the format asked for, else 1."""
    refuse_idle_options(arguments)
    if arguments.dialect is not None:
        return _run_dialect_budget(arguments)
    return _run_own_budget(settings_of(arguments, BudgetConfig))


def _run_own_budget(config: BudgetConfig) -> int:
    """Print the measured budget of each frame format; return 1 if PHASES miss the rate, else 0."""
    from haptogram.campaigns.bench import frame_budget

    wake_ns = frame_budget.measure_budget_wake_ns(config.rate_hz)
    budgets = [
        frame_budget.measure_frame_budget(name, message, baudrate=config.baud)
        for name, message in frame_budget.bench_frame_formats(config.transducers).items()
    ]
    asked = next(b for b in budgets if b.name == "phases")
    print(_frame_budget_text(asked, wake_ns, config))
    print(_budget_table(budgets, wake_ns))
    print(_answer_budget(config.baud))
    return 0 if asked.highest_hz >= config.rate_hz else 1


def _run_dialect_budget(arguments: argparse.Namespace) -> int:
    """Print how many frames per second the line of another maker's board carries, by baud.

    Returns 1 if the rate that was asked for is higher at the first baud (--baud, else the dialect's
    first), else 0. ConfigurationError for a board without a serial line or --baud.
    """
    from haptogram.driver.line.budget import highest_line_rate_hz, line_transmission_ns
    from haptogram_protocol.dialects.table import DIALECTS

    check_choice("--dialect", arguments.dialect, tuple(DIALECTS))
    config = settings_of(arguments, BudgetConfig)
    dialect, boards = DIALECTS[arguments.dialect], config.boards
    bauds = dialect.bauds if arguments.baud is None else (config.baud,)
    if not bauds:
        raise ConfigurationError(
            f"{dialect.name} has no serial line, whose rate could limit it; give --baud for one"
        )
    size = dialect.frame_bytes(boards)
    what = "a board" if boards == 1 else f"{boards} boards"
    print(f"{dialect.title}: {size} bytes a frame for {what}")
    for baud in bauds:
        rate_hz = highest_line_rate_hz(size, baud)
        verdict = "fits" if rate_hz >= config.rate_hz else "does not fit"
        frame_ms = line_transmission_ns(size, baud) / 1e6
        print(
            f"  {baud:>9} baud {frame_ms:9.3f} ms a frame {rate_hz:9.1f} frames/s at most: "
            f"{config.rate_hz:g} Hz {verdict}"
        )
    return 0 if highest_line_rate_hz(size, bauds[0]) >= config.rate_hz else 1


def _frame_budget_text(asked: frame_budget.FrameBudget, wake_ns: int, config: BudgetConfig) -> str:
    """Return a table of the stages of one frame: how much of a period each takes.

    *wake_ns* is the median lateness of a loop that sleeps.
    """
    from haptogram.report.formats.console import console_table

    period_us = 1e6 / config.rate_hz
    stages = [
        ("wake", wake_ns, "median lateness of a sleeping loop, measured"),
        ("encode", asked.encode_ns, "header, CRC-32 and COBS, measured; done ahead of the tick"),
        ("write", asked.write_ns, "one write to a pty, measured"),
        ("wire", asked.wire_ns, f"{asked.size} bytes of 10 bits at {config.baud} baud"),
        ("decode", asked.decode_ns, "at a board in Python, measured"),
        ("latch", 25_000, "to the next period of a 40 kHz carrier, at most"),
        ("sum", asked.latency_ns(wake_ns), "the shortest lead"),
    ]
    rows = [
        (name, f"{ns / 1e3:.1f} µs", f"{100 * ns / 1e3 / period_us:.1f} %", what)
        for name, ns, what in stages
    ]
    verdict = "fits" if asked.highest_hz >= config.rate_hz else "does not fit"
    return "\n".join(
        [
            f"one frame of {config.transducers} {asked.name} at {config.rate_hz:g} Hz: "
            f"a period of {period_us:g} µs",
            *console_table((), rows, numbers=(1, 2), indent=2),
            f"  {config.rate_hz:g} Hz {verdict}: the line is "
            f"{100 * config.rate_hz / asked.line_hz:.1f} % full, the host "
            f"{100 * config.rate_hz / asked.host_hz:.1f} % busy "
            "(stages overlap: the fullest decides)",
            "",
        ]
    )


def _budget_table(budgets: list[frame_budget.FrameBudget], wake_ns: int) -> str:
    """Return a table of all frame formats: times, highest rate, and what limits it."""
    from haptogram.report.formats.console import console_table

    head = ("format", "bytes", "encode", "write", "wire", "decode", "lead", "highest rate", "limit")
    rows = []
    for one in budgets:
        times = (one.encode_ns, one.write_ns, one.wire_ns, one.decode_ns, one.latency_ns(wake_ns))
        limit = "line" if one.line_hz <= one.host_hz else "host"
        figures = (f"{ns / 1e3:.1f}" for ns in times)
        rows.append((one.name, one.size, *figures, f"{one.highest_hz:.0f} Hz", limit))
    table = console_table(head, rows, numbers=range(1, 8))
    return "\n".join([*table, "times in µs; highest rate: stages overlap, the slowest decides"])


def _answer_budget(baudrate: int) -> str:
    """Return a table of a PING's longest round trip, by setting of the USB latency timer.

    Its second column is half of that, the uncertainty of the board's clock.
    """
    from haptogram.driver.line.budget import frame_bytes_on_line, line_round_trip_ns
    from haptogram.report.formats.console import console_table
    from haptogram_protocol.messages import Ping, Pong

    ping, pong = [frame_bytes_on_line(message.LAYOUT.size) for message in (Ping, Pong)]
    head = ("an answer (PING, PONG), at most:", "round trip", "the board's clock is known to")
    rows = []
    for name, timer_ms in _TIMERS_MS.items():
        trip_us = line_round_trip_ns(ping, pong, baudrate, timer_ms * 1_000_000) / 1e3
        rows.append((f"  {name}", f"{trip_us:.1f} µs", f"{trip_us / 2:.1f} µs"))
    note = "frames to the board do not wait for that timer; the lead covers the clock's uncertainty"
    return "\n".join(["", *console_table(head, rows, numbers=(1, 2)), note])

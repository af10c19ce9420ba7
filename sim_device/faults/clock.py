"""Effects of the faults of a plan on the board's clock."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator
from typing import Final

from haptogram.errors import ConfigurationError
from haptogram.settings.faults.kinds import FOR_EVER_NS
from haptogram.settings.faults.plan import Fault, FaultPlan

from ..board.clock import BoardClock, ClockChange

_MILLION: Final = 1_000_000
_WRAP_US: Final = 1 << 32


def faulty_clock(plan: FaultPlan, healthy: BoardClock) -> BoardClock:
    """Return *healthy* with the faults of *plan*.

    Raises
    ------
    ConfigurationError
        If the clock would run backwards, or start before 0.
    """
    boot_us = healthy.boot_us
    for fault in plan.named("clock.wrap"):
        boot_us = _WRAP_US - _clock_fault_amount(fault)
    boot_us += sum(map(_clock_fault_amount, plan.named("clock.offset")))
    if boot_us < 0:
        raise ConfigurationError(
            f"{_listed_faults(plan.named('clock.offset'))}: the device's clock would start at "
            f"{boot_us} µs, must be 0 or more"
        )
    steps = [
        ClockChange(f.from_ns, step_us=_clock_fault_amount(f)) for f in plan.named("clock.step")
    ]
    rates = [change for f in plan.named("clock.ppm") for change in _clock_fault_rates(f)]
    _check_clock_faults(plan, healthy.ppm, rates)
    changes = sorted([*healthy.changes, *steps, *rates], key=lambda change: change.at_ns)
    return dataclasses.replace(healthy, boot_us=boot_us, changes=tuple(changes))


def clock_fault_changes(plan: FaultPlan, clock: BoardClock) -> Iterator[tuple[str, int]]:
    """Yield each fault that changes *clock*, which has the faults, and when its change begins."""
    for fault in plan.faults:
        if fault.name == "clock.wrap":
            yield fault.name, max(0, clock.reached_ns(_WRAP_US))
        elif fault.name.startswith("clock.") and _clock_fault_amount(fault):
            yield fault.name, fault.from_ns


def _check_clock_faults(plan: FaultPlan, ppm: int, rates: list[ClockChange]) -> None:
    """Refuse rates that together stop the device clock or run it backwards at some time.

    *ppm* is its deviation without them; ConfigurationError at -1 000 000 ppm or less.
    """
    slowest = min(
        (ppm + sum(c.ppm for c in rates if c.at_ns <= rate.at_ns) for rate in rates),
        default=ppm,
    )
    if slowest <= -_MILLION:
        raise ConfigurationError(
            f"{_listed_faults(plan.named('clock.ppm'))}: the device's clock would be fast by "
            f"{slowest} ppm, must be above -{_MILLION}: it must not run backwards"
        )


def _clock_fault_amount(fault: Fault) -> int:
    """Return the size of a fault of the clock: in ppm for "clock.ppm", else in µs."""
    return round(fault.values["ppm" if fault.name == "clock.ppm" else "us"])


def _clock_fault_rates(fault: Fault) -> Iterator[ClockChange]:
    """Yield the change of rate when a fault begins, and its undoing when it ends.

    The second is left out for a fault that never ends.
    """
    yield ClockChange(fault.from_ns, ppm=_clock_fault_amount(fault))
    if fault.until_ns != FOR_EVER_NS:
        yield ClockChange(fault.until_ns, ppm=-_clock_fault_amount(fault))


def _listed_faults(faults: Iterable[Fault]) -> str:
    """Return faults as text, joined by "and"."""
    return " and ".join(map(str, faults))

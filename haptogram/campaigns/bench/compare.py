"""The changes from one run to another beyond the noise of both.

The noise of a percentile is its scatter over the ten tenths of its own run.  A change of the
machine shows in the control loop beside each run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from haptogram.campaigns.bench.percentiles import TimingPercentiles
from haptogram.settings.text_file import flat_document

_LEVELS: Final = ("p50", "p90", "p99")  # a tenth of a run holds too few frames for p99.9
_SIGMAS: Final = 4.0  # limit at which none of three dozen comparisons differs by chance
_MAD_TO_SIGMA: Final = 1.4826  # standard deviation over median deviation, for a normal distribution
_MEDIAN_LOSS: Final = 1.2533  # a median varies so much more than a mean
_LEAST_US: Final = 1.0  # resolution of the board's clock
_CONTROL: Final = "control"


@dataclass(frozen=True, slots=True)
class BenchChange:
    """The difference of one percentile of one stage between two runs.

    Attributes
    ----------
    stage, level : str
        Name of the stage, and percentile (``p50``).
    before_us, after_us : float
        Medians of the ten tenths of each run.
    noise_us : float
        Largest difference that chance explains.
    machine : bool
        Whether the control loop changed in the same direction by at least half as much.
    """

    stage: str
    level: str
    before_us: float
    after_us: float
    noise_us: float
    machine: bool = False

    @property
    def beyond_noise(self) -> bool:
        """True if the difference is larger than chance explains."""
        return abs(self.after_us - self.before_us) > self.noise_us

    def __str__(self) -> str:
        difference = self.after_us - self.before_us
        word = "slower" if difference > 0 else "faster"
        blame = ", as the control loop: the machine changed" if self.machine else ""
        return (
            f"{self.stage} {self.level}: {self.before_us:.1f} -> {self.after_us:.1f} µs, "
            f"{abs(difference):.1f} µs {word} (noise {self.noise_us:.1f}){blame}"
        )


def compare_benches(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[BenchChange]:
    """Compare every percentile that both results hold; changes beyond the noise come first.

    Parameters
    ----------
    old, new : mapping
        Results as :func:`haptogram.campaigns.bench.result.bench_dict` makes them.
    """
    before, after = _bench_percentiles(old), _bench_percentiles(new)
    control = {
        level: _bench_change(_CONTROL, level, before[_CONTROL], after[_CONTROL])
        for level in _LEVELS
        if _CONTROL in before and _CONTROL in after
    }
    found = []
    for stage in before:
        for level in _LEVELS:
            change = _bench_change(stage, level, before[stage], after.get(stage))
            if change is not None:
                found.append(_blamed_bench_change(change, control.get(level)))
    return sorted(found, key=lambda change: not change.beyond_noise)


def bench_differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Return a line for each setting, version or part of the machine that differs."""
    lines = []
    for part in ("configuration", "environment"):
        one, other = (dict(flat_document(result.get(part, {}))) for result in (old, new))
        lines += [
            f"{part}: {name} was {one.get(name)}, is {other.get(name)}"
            for name in sorted(one.keys() | other.keys())
            if one.get(name) != other.get(name) and name != "load_1_min"
        ]
    return lines


def _bench_percentiles(result: Mapping[str, Any]) -> dict[str, TimingPercentiles]:
    """Return the percentiles of every stage in a bench's JSON result."""
    return {name: TimingPercentiles(**stage) for name, stage in result["stages"].items()}


def _bench_change(
    stage: str, level: str, before: TimingPercentiles, after: TimingPercentiles | None
) -> BenchChange | None:
    """Return the change of a percentile between two benches, with its noise; None if unmeasured.

    *level* names the percentile, such as p99. The noise is 4 standard errors of the difference,
    plus 1 µs.
    """
    if after is None or not before.blocks or not after.blocks:
        return None
    one, other = before.blocks[level], after.blocks[level]
    noise_us = _SIGMAS * math.hypot(_bench_error_us(one), _bench_error_us(other)) + _LEAST_US
    return BenchChange(stage, level, float(np.median(one)), float(np.median(other)), noise_us)


def _bench_error_us(values: list[float]) -> float:
    """Return the standard error of the median of *values* (µs), from their absolute deviations."""
    deviation = float(np.median(np.abs(np.array(values) - np.median(values))))
    return _MEDIAN_LOSS * _MAD_TO_SIGMA * deviation / math.sqrt(len(values))


def _blamed_bench_change(change: BenchChange, control: BenchChange | None) -> BenchChange:
    """Return *change* as the machine's if the control measurement changed likewise.

    That is beyond its noise, the same way, and at least half as much. Without a *control* it is
    returned as it is.
    """
    if control is None or change.stage == _CONTROL or not control.beyond_noise:
        return change
    own, machine = change.after_us - change.before_us, control.after_us - control.before_us
    same = own * machine > 0 and abs(machine) >= abs(own) / 2
    return replace(change, machine=same)

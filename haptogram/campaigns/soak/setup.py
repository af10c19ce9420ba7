"""The settings of a soak, and the segments into which they divide it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from haptogram.settings.option import Settings, option, option_of
from haptogram.settings.run.frames import LimitConfig

_LEAST_INTERVAL_S: Final = 1.0
_INTERVALS: Final = 400  # intervals of the time series
_MOST_RATE: Final = 0.2  # above it, what must come through at times would not


@dataclass(frozen=True, kw_only=True)
class SoakSetup(Settings):
    """Setup of a campaign; the same setup gives the same account.

    Raises
    ------
    SettingError
        If a value is outside its limits.
    """

    hours: float = option(
        unit="HOURS", low=1e-6, high=1e5, help="virtual time; an hour takes 3 minutes of a core"
    )
    fault_rate: float = option(
        1e-2, unit="SHARE", low=0.0, high=_MOST_RATE, help="share of frames hit in each direction"
    )
    seed: int = option_of(LimitConfig, "seed", high=2**63 - 1, help="seed of everything random")
    # Ten minutes are long enough for what goes wrong slowly, or only with high numbers.
    segment_minutes: float = option(
        10.0, unit="MINUTES", low=1e-3, high=60.0, help="virtual time from checkpoint to checkpoint"
    )
    mutant: str | None = option(
        None,
        unit="NAME",
        help="firmware that is wrong in one way, or the MODULE:CLASS of one",
        absent="healthy",
    )

    @property
    def seconds(self) -> float:
        """Virtual time in seconds."""
        return self.hours * 3600

    @property
    def segment_s(self) -> float:
        """Virtual length of a segment in seconds."""
        return self.segment_minutes * 60

    @property
    def segments(self) -> int:
        """Number of segments; the last one may be shorter."""
        return max(1, math.ceil(self.seconds / self.segment_s - 1e-9))

    @property
    def interval_s(self) -> float:
        """Virtual length of an interval of the course in seconds."""
        return max(_LEAST_INTERVAL_S, self.seconds / _INTERVALS)

    def start_s(self, number: int) -> float:
        """Return when segment *number* begins."""
        return min(number * self.segment_s, self.seconds)

    def length_s(self, number: int) -> float:
        """Return the duration of segment *number*."""
        return self.start_s(number + 1) - self.start_s(number)

    def as_dict(self) -> dict[str, Any]:
        """Return the settings for JSON, with the length of a segment in seconds."""
        values = self.values()
        del values["segment_minutes"]
        return values | {"segment_s": self.segment_s}

"""The settings of a benchmark of the loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from haptogram.settings.option import SettingError, Settings, option, option_of
from haptogram.settings.run.frames import LinkConfig, PaceConfig

MAX_FRAMES: Final = 300_000


@dataclass(frozen=True, kw_only=True)
class BenchConfig(Settings):
    """The stream that is measured.

    Raises
    ------
    SettingError
        If a value is outside its limits, or the number of frames is.
    ConfigurationError
        If the spin is longer than a quarter of the period.
    """

    port: str | None = option_of(LinkConfig, "port")
    rate_hz: float = option_of(
        PaceConfig, "rate_hz", low=100.0, high=10_000.0, help="frames per second"
    )
    seconds: float = option(10.0, unit="S", low=1e-3, high=86_400.0, help="duration of the stream")
    baud: int = option_of(LinkConfig, "baud")
    lead_ms: float | None = option_of(PaceConfig, "lead_ms")
    trim: bool = option(False, help="shorten the lead to what the arrival margins allow")
    spin_us: int = option(
        0,
        unit="US",
        high=10_000,
        help="watch the clock so long before a deadline; a quarter of the period at most",
    )
    realtime: bool = option(
        False, help="ask for fixed priority, locked memory and a frozen garbage collector"
    )

    def __post_init__(self) -> None:
        """Check the values, then the number of frames and the spin."""
        super().__post_init__()
        frames = self.rate_hz * self.seconds
        if frames > MAX_FRAMES:
            raise SettingError(
                "seconds",
                f"is {self.seconds:g} s; at {self.rate_hz:g} Hz these are {frames:.0f} frames, "
                f"must be {MAX_FRAMES} at most",
            )
        if self.spin_us:
            from haptogram.driver.timing.realtime import check_spin_before_tick  # takes numpy

            check_spin_before_tick(self.spin_us * 1000, round(1e9 / self.rate_hz))

    @property
    def lead_us(self) -> int | None:
        """Lead of a frame over its time to apply in microseconds; None: the driver's own."""
        return None if self.lead_ms is None else round(self.lead_ms * 1e3)

    def as_dict(self) -> dict[str, Any]:
        """Return the settings for JSON, where baud and lead have names of their own."""
        values = self.values()
        values["baudrate"], values["lead_us"] = values.pop("baud"), self.lead_us
        del values["lead_ms"]
        return values

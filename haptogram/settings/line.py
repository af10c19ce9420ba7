"""The settings of a serial line between a host and the virtual board."""

from __future__ import annotations

from typing import Final

from haptogram.settings.frozen import dataclass

from .option import SettingError, Settings, option

#: Rates of a line, of every command: the slowest UART that is sold, and USB at full speed, twice.
LEAST_BAUD: Final = 300
MAX_BAUD: Final = 50_000_000
DEFAULT_BAUD: Final = 3_000_000
MAX_ERROR_PPM: Final = 200_000
_POLL_US: Final = 50


@dataclass(frozen=True, kw_only=True)
class LineSettings(Settings):
    """Rate and imperfections of a line; the default is a wire that takes no time.

    Raises
    ------
    SettingError
        If a value is outside its limits, or needs another option that is not given.
    """

    baud: int | None = option(
        None,
        unit="BAUD",
        low=LEAST_BAUD,
        high=MAX_BAUD,
        help="rate of the line",
        absent="takes no time",
    )
    baud_error_ppm: int = option(
        0,
        unit="PPM",
        low=-MAX_ERROR_PPM,
        high=MAX_ERROR_PPM,
        help="error of the rate of the board's UART; from 53000 (5.3 %) on it damages characters",
    )
    rx_fifo: int | None = option(
        None,
        unit="BYTES",
        low=1,
        high=65_536,
        help="size of the receive FIFO of the board's UART; overflow is dropped",
        absent="no limit",
    )
    rx_poll_us: int | None = option(
        None,
        unit="US",
        low=1,
        high=1_000_000,
        help="period in which the firmware empties that FIFO",
        absent=str(_POLL_US),
    )
    latency_ms: float | None = option(
        None,
        unit="MS",
        low=0.001,
        high=255.0,  # of the timer's eight bits
        help="latency timer of the host's USB adapter: bytes come in packets of 62, or when it "
        "runs out; 16 is usual, 1 the least of a good driver",
        absent="no adapter",
    )
    host_buffer: int | None = option(
        None,
        unit="BYTES",
        low=1,
        high=1 << 30,
        help="size of the host's receive buffer; overflow is dropped",
        absent="the board waits",
    )

    def __post_init__(self) -> None:
        """Check the values, and that an option has the others that it needs."""
        super().__post_init__()
        if self.rx_poll_us is not None and self.rx_fifo is None:
            raise SettingError("rx_poll_us", "is the period that empties a FIFO: give rx_fifo too")
        for name in ("baud_error_ppm", "rx_fifo", "latency_ms"):
            if self.baud is None and getattr(self, name):
                raise SettingError(name, "needs a baud rate: without one, bytes take no time")

    @property
    def poll_us(self) -> int:
        """Period in which the firmware empties its FIFO."""
        return _POLL_US if self.rx_poll_us is None else self.rx_poll_us

    @property
    def latency_us(self) -> int | None:
        """Latency timer of the host's USB adapter; None: there is no adapter."""
        return None if self.latency_ms is None else max(1, round(self.latency_ms * 1000))

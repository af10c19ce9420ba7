"""What a line is beyond its rate: data, which :mod:`sim_device.line.uart` makes a line of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from haptogram.errors import ConfigurationError

MAX_ERROR_PPM: Final = 200_000


@dataclass(frozen=True, kw_only=True)
class LineSettings:
    """What a line is beyond its rate; by default nothing more than a wire.

    Attributes
    ----------
    baud_error_ppm : int
        By how much the board's UART is fast, both when it sends and when it listens.
    rx_fifo : int or None
        Bytes that the board's UART holds until its firmware takes them; None: as many as come.
    rx_poll_us : int
        How often the firmware takes them, if ``rx_fifo`` is given.
    latency_us : int or None
        Latency timer of the host's USB adapter; None: there is no adapter.
    host_buffer : int or None
        Bytes that may wait to be read by the host, what comes then is lost; None: the board waits,
        as a pseudo-terminal makes it.

    Raises
    ------
    ConfigurationError
        If a value is out of its limits.
    """

    baud_error_ppm: int = 0
    rx_fifo: int | None = None
    rx_poll_us: int = 50
    latency_us: int | None = None
    host_buffer: int | None = None

    def __post_init__(self) -> None:
        for name, (least, most) in _LIMITS.items():
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                raise ConfigurationError(f"{name} is {value}, must be {least} to {most}")

    def check(self, baud: int | None) -> None:
        """Refuse what makes no sense on a line that takes no time.

        Raises
        ------
        ConfigurationError
            If *baud* is None and something here depends on the rate.
        """
        for name in ("baud_error_ppm", "rx_fifo"):
            if baud is None and getattr(self, name):
                raise ConfigurationError(f"{name} needs a baud rate: without one, bytes take none")


_LIMITS: Final = {
    "baud_error_ppm": (-MAX_ERROR_PPM, MAX_ERROR_PPM),
    "rx_fifo": (1, 65_536),
    "rx_poll_us": (1, 1_000_000),
    "latency_us": (1, 255_000),
    "host_buffer": (1, 1 << 30),
}

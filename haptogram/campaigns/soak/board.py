"""The board under test, as the soak sees it."""

from __future__ import annotations

from typing import Any, Protocol

from haptogram.errors import HaptogramError


class Hopeless(HaptogramError):
    """The board is so wrong that the account cannot go on."""


class BoardUnderSoak(Protocol):
    """A board without its line; times are nanoseconds since power-up."""

    transducers: int
    carrier_us: int

    @property
    def session(self) -> int: ...  # noqa: D102  see sim_device.driven.soak_board.VirtualSoakBoard
    @property
    def counters(self) -> dict[str, int]: ...  # noqa: D102
    @property
    def is_silent(self) -> bool: ...  # noqa: D102
    def device_us(self, t_ns: int) -> int: ...  # noqa: D102
    def receive(self, data: bytes, t_ns: int, up_free_ns: int) -> None: ...  # noqa: D102
    def advance_to(self, t_ns: int) -> None: ...  # noqa: D102
    def take_output(self) -> bytes: ...  # noqa: D102
    def take_verdicts(self) -> list[Any]: ...  # noqa: D102
    def take_latches(self) -> list[Any]: ...  # noqa: D102
    def take_timeouts(self) -> int: ...  # noqa: D102

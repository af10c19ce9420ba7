"""The boards that a verification can run on, behind one face: where they are, what they show."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, Protocol

from haptogram.acoustics import AcousticModel
from haptogram.backdoor import observations_of, on_the_clock_of
from haptogram.budget import BITS_PER_BYTE, frame_bytes
from haptogram.driver import Driver
from haptogram.errors import ConfigurationError
from haptogram.records import Observation
from haptogram.transport import Transport
from haptogram.virtual_board import VirtualBoard
from haptogram_protocol.messages import Feature, HelloReply, TraceDrive, TraceMode

_TRACE_SHARE: Final = 0.5  # of the line from the board, for full drives


class BoardUnderTest(Protocol):
    """A board to run on."""

    @property
    def label(self) -> str:
        """What it is, for the report."""
        ...

    @property
    def port(self) -> str | Transport:
        """Where it is."""
        ...

    @property
    def model(self) -> AcousticModel | None:
        """Array and air that it radiates into; None: nobody knows better than the host."""
        ...

    def prepare(self, driver: Driver) -> None:
        """Make it tell, or be ready to tell, what it latches."""
        ...

    def observations(self, driver: Driver) -> list[Observation]:
        """Return what it latched in the session of *driver*, which is closed by now."""
        ...


class ProcessBoard:
    """The virtual board in a process of its own, on a pty, seen through its back door."""

    def __init__(self, board: VirtualBoard) -> None:
        self._board = board
        self.label = "virtual board, on a pty, in a process of its own"
        self.port = board.url
        self.model = board.model

    def prepare(self, driver: Driver) -> None:
        """Nothing to do: the back door shows everything."""

    def observations(self, driver: Driver) -> list[Observation]:
        """Return what came out of the back door, once the last field has been rebuilt."""
        self._board.settle(driver.intended)
        return on_the_clock_of(driver.intended, self._board.observations(driver.session))


class InProcessBoard:
    """A virtual board in this program, in virtual time, seen through its back door.

    Parameters
    ----------
    port : Transport
        Open; a blocking read advances its time.
    records : callable
        Returns the records of the back door so far.
    model : AcousticModel
        What it radiates with.
    """

    def __init__(
        self,
        port: Transport,
        records: Callable[[], Iterable[Mapping[str, Any]]],
        model: AcousticModel,
    ) -> None:
        self._records = records
        self.label = "virtual board, in virtual time"
        self.port = port
        self.model = model

    def prepare(self, driver: Driver) -> None:
        """Nothing to do: the back door shows everything."""

    def observations(self, driver: Driver) -> list[Observation]:
        """Return what came out of the back door."""
        found = observations_of(self._records(), driver.session)
        return on_the_clock_of(driver.intended, found)


class PortBoard:
    """A board at a port, judged by its own word: trace events, or the trace ring.

    Parameters
    ----------
    url : str
        Any pyserial URL.
    rate_hz : float
        Frames per second that it will be sent.
    board_computes : bool
        Whether it computes the drives; then a CRC says nothing, and drives are asked for.
    """

    def __init__(self, url: str, *, baudrate: int, rate_hz: float, board_computes: bool) -> None:
        self.label = url
        self.port = url
        self.model = None
        self._baudrate = baudrate
        self._rate_hz = rate_hz
        self._board_computes = board_computes

    def prepare(self, driver: Driver) -> None:
        """Switch on the trace that says most and fits the line.

        Raises
        ------
        ConfigurationError
            If the board has no trace at all: nothing could be verified.
        """
        features = Feature(driver.identity.features)
        if Feature.CONFIG not in features:
            raise ConfigurationError(f"{self.port}: the board cannot be told to trace its latches")
        if self._board_computes and Feature.TRACE_DRIVE in features:
            divider = self._divider(driver.identity)
            driver.configure(trace_mode=TraceMode.DRIVE, trace_divider=divider)
        elif Feature.TRACE in features:
            driver.configure(trace_mode=TraceMode.CRC)
        elif Feature.TRACE_RING in features:
            driver.configure(trace_mode=TraceMode.RING)
        else:
            raise ConfigurationError(f"{self.port}: the board has no trace to verify it by")

    def _divider(self, identity: HelloReply) -> int:
        """Return k so that every k-th drive in full leaves half of the line free."""
        size = frame_bytes(TraceDrive.LAYOUT.size + 2 * identity.transducers)
        carried_hz = self._baudrate * _TRACE_SHARE / BITS_PER_BYTE / size
        return max(1, math.ceil(self._rate_hz / carried_hz))

    def observations(self, driver: Driver) -> list[Observation]:
        """Return what the board said that it latched."""
        return driver.observations

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

    def finish(self, driver: Driver) -> None:
        """Take down what can only be asked while the session lasts."""
        ...

    def observations(self, driver: Driver) -> list[Observation]:
        """Return what it latched in the session of *driver*, which is closed by now."""
        ...

    @property
    def unseen(self) -> str | None:
        """Why a frame may have been latched that nobody saw; None: everything is seen."""
        ...


class ProcessBoard:
    """The virtual board in a process of its own, on a pty, seen through its back door."""

    def __init__(self, board: VirtualBoard) -> None:
        self._board = board
        self.label = "virtual board, on a pty, in a process of its own"
        self.port = board.url
        self.model = board.model

    unseen = None

    def prepare(self, driver: Driver) -> None:
        """Nothing to do: the back door shows everything."""

    def finish(self, driver: Driver) -> None:
        """Nothing to do: the back door stays open."""

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

    unseen = None

    def prepare(self, driver: Driver) -> None:
        """Nothing to do: the back door shows everything."""

    def finish(self, driver: Driver) -> None:
        """Nothing to do: the back door stays open."""

    def observations(self, driver: Driver) -> list[Observation]:
        """Return what came out of the back door."""
        found = observations_of(self._records(), driver.session)
        return on_the_clock_of(driver.intended, found)


class PortBoard:
    """A board at a port, judged by its own word: trace events, trace ring, or a last read-back.

    Parameters
    ----------
    url : str
        Any pyserial URL.
    rate_hz : float
        Frames per second that it will be sent.
    board_computes : bool
        Whether it computes the drives; then a CRC says nothing, and drives are asked for.

    Attributes
    ----------
    unseen : str or None
        Why it may have latched what it did not show.
    """

    def __init__(self, url: str, *, baudrate: int, rate_hz: float, board_computes: bool) -> None:
        self.label = url
        self.port = url
        self.model = None
        self.unseen: str | None = None
        self._baudrate = baudrate
        self._rate_hz = rate_hz
        self._board_computes = board_computes
        self._read_back: list[Observation] = []

    def prepare(self, driver: Driver) -> None:
        """Switch on the trace that says most and fits the line.

        Raises
        ------
        ConfigurationError
            If the board can show nothing at all: nothing could be verified.
        """
        features = Feature(driver.identity.features)
        traces = features if Feature.CONFIG in features else Feature(0)
        if self._board_computes and Feature.TRACE_DRIVE in traces:
            divider = self._divider(driver.identity)
            driver.configure(trace_mode=TraceMode.DRIVE, trace_divider=divider)
            if divider > 1:
                self.unseen = f"the board shows one drive in {divider}: more do not fit the line"
        elif Feature.TRACE in traces:
            driver.configure(trace_mode=TraceMode.CRC)
        elif Feature.TRACE_RING in traces:
            driver.configure(trace_mode=TraceMode.RING)
        elif Feature.READ_LATCHED in features:
            self.unseen = "the board has no trace, and its last drive only was read back"
        else:
            raise ConfigurationError(
                f"{self.port}: the board has neither trace nor read-back to verify it by"
            )

    def _divider(self, identity: HelloReply) -> int:
        """Return k so that every k-th drive in full leaves half of the line free."""
        size = frame_bytes(TraceDrive.LAYOUT.size + 2 * identity.transducers)
        carried_hz = self._baudrate * _TRACE_SHARE / BITS_PER_BYTE / size
        return max(1, math.ceil(self._rate_hz / carried_hz))

    def finish(self, driver: Driver) -> None:
        """Read the last drive back if there is no trace; see how much of the trace was sent."""
        features = Feature(driver.identity.features)
        if not features & (Feature.TRACE | Feature.TRACE_DRIVE | Feature.TRACE_RING):
            self._read_back = [driver.read_drive()]
        dropped = driver.status().counters.trace_dropped
        if dropped and self.unseen is None:
            self.unseen = f"the board found no room on the line for {dropped} trace events"

    def observations(self, driver: Driver) -> list[Observation]:
        """Return what the board said that it latched."""
        return driver.observations + self._read_back

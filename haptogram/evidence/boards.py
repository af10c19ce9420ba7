"""The boards that a verification can run on, behind one face: where they are, what they show."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final, Self, TypeAlias

from haptogram.acoustics import AcousticModel
from haptogram.driver.driver import Driver
from haptogram.driver.line.budget import BITS_PER_BYTE, frame_bytes_on_line
from haptogram.driver.line.port import Transport
from haptogram.errors import ConfigurationError
from haptogram.evidence import backdoor
from haptogram.evidence.backdoor import BackdoorReader
from haptogram.evidence.dialects.latches import (
    are_records_of_another_dialect,
    dialect_run_observations,
    has_dialect_latched_all,
)
from haptogram.records.frame import Observation
from haptogram.records.losses import BoardLosses
from haptogram.settings.arguments import Progress
from haptogram_protocol.messages import Feature, HelloReply, StateChanged, TraceDrive, TraceMode
from haptogram_protocol.state import OutputState

if TYPE_CHECKING:
    from haptogram.driver.dialect_driver import DialectDriver
    from haptogram.evidence.virtual_board import VirtualBoard

_TRACE_SHARE: Final = 0.5  # share of the line from the board for traces with drives
_AFTER_LAST_NS: Final = 5_000_000
_LONGEST_QUEUE_NS: Final = 2_000_000_000  # a sequence may go on for as long as it likes
_DAMAGE: Final = ("gap", "crc", "cobs", "short", "oversize")  # counters of damaged frames
# Of a board at a port, seen through its back door:
_LAST_S: Final = 10.0  # wait for the last latch records
_QUEUE_S: Final = 2.0  # wait for its queue
_POLL_S: Final = 0.01

_Records: TypeAlias = Sequence[Mapping[str, Any]]
AnyDriver: TypeAlias = "Driver | DialectDriver"


class BoardUnderTest:
    """A board to run on; one that its back door shows, unless a subclass says otherwise.

    Attributes
    ----------
    label : str
        Description of the board for the report.
    port : str or Transport
        Name of the port, or the open port.
    model : AcousticModel or None
        Array and air that it radiates into; None: those of the host are the best known.
    unseen : str or None
        Why latches may be missing from the observations, once these are there; None:
        everything is seen.
    is_in_process : bool
        True for a board in this program, whose :meth:`records` costs nothing.
    """

    is_in_process = False

    def __init__(
        self,
        label: str,
        port: str | Transport,
        model: AcousticModel | None = None,
        records: Callable[[], _Records] = tuple,
    ) -> None:
        self.label, self.port, self.model = label, port, model
        self.unseen: str | None = None
        self._records = records

    def prepare(self, driver: Driver) -> None:
        """Make it tell, or be ready to tell, what it latches: a back door tells everything."""

    def finish(self, driver: Driver) -> None:
        """Take down what can only be asked while the session lasts: a back door stays open."""

    def wait_for_queue(self, driver: Driver) -> None:
        """Let the frames in its queue come to their time, after the link to it broke."""

    def give_up(self) -> bool:
        """End it, if it is this program's own, without a session; return whether it still ran."""
        return True

    def settle(
        self, driver: AnyDriver, progress: Progress | None = None, *, skip_fields: bool = False
    ) -> None:
        """Wait for the latches of the session of *driver*, which is closed by now.

        *progress* is called with the number of latches so far and the number that may come, if
        that takes time.  With *skip_fields* the board rebuilds no field any more.
        """

    def observations(self, driver: AnyDriver) -> Sequence[Observation]:
        """Return the latches of the session of *driver*, which have settled by now."""
        return dialect_run_observations(driver.intended, self.records(), driver.session)

    def silences(self, driver: Driver) -> list[int]:
        """Return the device times at which its output fell silent, once the observations are there.

        They are counted as those of what was intended.
        """
        return backdoor.observed_silences_on_clock_of(driver.intended, self.brief_records())

    def losses(self, driver: Driver) -> BoardLosses:
        """Return the reasons for frames that it did not latch, once the observations are there."""
        return backdoor.observed_losses_on_clock_of(
            driver.intended, self.brief_records(), is_machine_in_between=not self.is_in_process
        )

    def records(self) -> _Records:
        """Return the records of its back door so far; none, if it has no back door."""
        return self._records()

    def brief_records(self) -> _Records:
        """Return :meth:`records`; latches may lack their drive."""
        return self.records()

    @property
    def fault_counts(self) -> dict[str, int] | None:
        """Counts of the planned faults that fired, once the observations are there; or None."""
        return backdoor.observed_fault_counts(self.brief_records())


class ProcessBoardUnderTest(BoardUnderTest):
    """The virtual board in a process of its own, on a pty, seen through its back door."""

    def __init__(self, board: VirtualBoard) -> None:
        label = "virtual board, on a pty, in a process of its own"
        super().__init__(label, board.url, board.model, board.records)
        self._board = board

    def wait_for_queue(self, driver: Driver) -> None:
        """Wait, if the board is still there."""
        if self._board.how_it_ended() is None:
            time.sleep(
                max(0, _last_latch_due_ns(driver, time.monotonic_ns()) - time.monotonic_ns()) / 1e9
            )

    def give_up(self) -> bool:
        """End the board, so that it tells what it counted."""
        ran = self._board.how_it_ended() is None
        self._board.finish(skip_fields=True)
        return ran

    def settle(
        self, driver: AnyDriver, progress: Progress | None = None, *, skip_fields: bool = False
    ) -> None:
        """End the board, and read everything that comes out of its back door."""
        expected = driver.intended.total
        show = None if progress is None else lambda done: progress(min(done, expected), expected)
        fate = self._board.how_it_ended()
        self._board.finish(show, skip_fields=skip_fields)
        self.unseen = backdoor.why_observations_incomplete(self.records(), driver.session)
        if self.unseen is not None and fate is not None:
            self.unseen += f" ({fate})"

    def losses(self, driver: Driver) -> BoardLosses:
        """Return the records of the back door; faults on purpose may delay the line."""
        return self._board.losses(driver.intended)


class InProcessBoardUnderTest(BoardUnderTest):
    """A virtual board in this program, in virtual time, seen through its back door.

    Parameters
    ----------
    port : Transport
        Open; a blocking read advances its time.
    records : callable
        Returns the records of the back door so far.
    wait_until_ns : callable
        Lets time pass up to a time of the port's clock.
    model : AcousticModel
        Array and air of the board.
    label : str
        Description of the board for the report.
    latches : callable, optional
        Returns the latches among the records of Haptogram's own board, so that nobody has to read
        them.
    brief : callable, optional
        Returns the records; latches may lack their drive.
    """

    is_in_process = True

    def __init__(
        self,
        port: Transport,
        records: Callable[[], _Records],
        wait_until_ns: Callable[[int], None],
        model: AcousticModel,
        label: str = "virtual board, in virtual time",
        latches: Callable[[], Sequence[Observation]] | None = None,
        brief: Callable[[], _Records] | None = None,
    ) -> None:
        super().__init__(label, port, model, records)
        self._port, self._wait_until_ns = port, wait_until_ns
        self._latches, self._brief = latches, brief or records

    def wait_for_queue(self, driver: Driver) -> None:
        """Let virtual time pass."""
        self._wait_until_ns(_last_latch_due_ns(driver, self._port.now_ns()))

    def give_up(self) -> bool:
        """Close its port: that ends it."""
        self._port.close()
        return True

    def observations(self, driver: AnyDriver) -> Sequence[Observation]:
        """Return the latches of the session of *driver*."""
        if self._latches is None or are_records_of_another_dialect(self._brief()):
            return super().observations(driver)
        own = [latch for latch in self._latches() if latch.key.session == driver.session]
        return backdoor.observations_on_clock_of(driver.intended, own)

    def brief_records(self) -> _Records:
        """Return the records; latches may lack their drive."""
        return self._brief()


def _last_latch_due_ns(driver: Driver, now_ns: int) -> int:
    """Return when the last frame is due by the host's clock, 2 s from *now_ns* at most.

    Without a frame, or for one with no due time, it is *now_ns*.
    """
    due_us = driver.intended[-1].t_apply_us if driver.intended else None
    due_ns = now_ns if due_us is None else driver.clock.to_host_ns(due_us) + _AFTER_LAST_NS
    return min(due_ns, now_ns + _LONGEST_QUEUE_NS)


class PortBoardUnderTest(BoardUnderTest):
    """A board at a port, judged by its own word: trace events, trace ring, or a last read-back.

    One of another dialect has no word, and is neither prepared nor finished: all that there is of
    it is what left the host.

    Parameters
    ----------
    url : str
        Any pyserial URL.
    baudrate : int or None
        Rate of its line; None: it has none, as a socket and a pseudo-terminal.
    rate_hz : float
        Frames per second that it will be sent.
    board_computes : bool
        Whether it computes the drives; then a CRC says nothing, and drives are asked for.

    Attributes
    ----------
    unseen : str or None
        Why it may have latched what it did not show.
    """

    def __init__(
        self, url: str, *, baudrate: int | None, rate_hz: float, board_computes: bool
    ) -> None:
        super().__init__(url, url)
        self._baudrate = baudrate
        self._rate_hz = rate_hz
        self._board_computes = board_computes
        self._mode = TraceMode.OFF
        self._dropped_before = 0
        self._read_back: list[Observation] = []

    def prepare(self, driver: Driver) -> None:
        """Switch on the trace that says most and fits the line.

        Raises
        ------
        ConfigurationError
            If the board can show nothing at all: nothing could be verified.
        """
        features = Feature(driver.identity.features)
        config = driver.config()
        if Feature.CONFIG in features and (wanted := self._best_trace(features)) is not None:
            divider = self._divider(driver.identity) if wanted is TraceMode.DRIVE else 1
            config = driver.configure(trace_mode=wanted, trace_divider=divider)
        self._mode = config.trace_mode  # without CONFIG: whatever the board does by itself
        if self._mode is TraceMode.OFF and Feature.READ_LATCHED not in features:
            raise ConfigurationError(
                f"{self.port}: the board has neither trace nor read-back to verify it by"
            )
        self.unseen = self._gaps_of(self._mode, config.trace_divider)
        self._dropped_before = driver.status().counters.trace_dropped

    def _best_trace(self, features: Feature) -> TraceMode | None:
        """Return the trace mode to use, by *features*: CRC, else DRIVE, else RING (kept on board).

        If the board computes the drives, DRIVE comes first. None if it has no trace.
        """
        by_feature = {
            Feature.TRACE: TraceMode.CRC,
            Feature.TRACE_DRIVE: TraceMode.DRIVE,
            Feature.TRACE_RING: TraceMode.RING,
        }
        if self._board_computes:
            by_feature = {Feature.TRACE_DRIVE: TraceMode.DRIVE} | by_feature
        return next((mode for feature, mode in by_feature.items() if feature in features), None)

    @staticmethod
    def _gaps_of(mode: TraceMode, divider: int) -> str | None:
        """Return as text which latches a trace mode leaves out; None if it shows them all.

        *divider* N: the drive of every N-th latch is traced.
        """
        if mode is TraceMode.OFF:
            return "the board has no trace in force, and its last drive only was read back"
        if mode is TraceMode.DRIVE and divider > 1:
            return (
                f"the board shows one drive in {divider}: more do not fit the line; a lower rate "
                "of frames or a faster line shows more"
            )
        return None

    def _divider(self, identity: HelloReply) -> int:
        """Return N so that tracing the drive of every N-th latch leaves half of the line free."""
        if self._baudrate is None:
            return 1
        size = frame_bytes_on_line(TraceDrive.LAYOUT.size + 2 * identity.transducers)
        carried_hz = self._baudrate * _TRACE_SHARE / BITS_PER_BYTE / size
        return max(1, math.ceil(self._rate_hz / carried_hz))

    def finish(self, driver: Driver) -> None:
        """Take down what the board kept, and see how much it did not keep or send."""
        if self._mode is TraceMode.OFF:
            self._read_back = [driver.read_drive()]
        driver.collect_ring()  # what a run that was cut short has left there
        dropped = driver.status().counters.trace_dropped - self._dropped_before
        damaged = sum(driver.link_counters[name] for name in _DAMAGE)
        kept = driver.identity.trace_ring
        if dropped and self.unseen is None:
            self.unseen = f"the board found no room on the line for {dropped} trace events"
        if damaged and self.unseen is None:
            self.unseen = "frames from the board were damaged or lost on the line"
        if self._mode is TraceMode.RING and driver.intended.total > kept:
            self.unseen = f"the board's trace ring keeps the last {kept} latches"

    def observations(self, driver: AnyDriver) -> Sequence[Observation]:
        """Return the latches that the board reported."""
        if not self._read_back:
            return driver.observations
        return [*driver.observations, *self._read_back]

    def silences(self, driver: Driver) -> list[int]:
        """Return when the board said that it left ARMED; the ramp is not counted."""
        return [
            driver.time_of_event_us(event)
            for event in driver.events
            if isinstance(event.message, StateChanged)
            and event.message.state is not OutputState.ARMED
        ]

    def losses(self, driver: Driver) -> BoardLosses:
        """Return when a timer of the board muted it, by its own word."""
        return BoardLosses(
            timeouts_us=tuple(
                driver.time_of_event_us(event)
                for event in driver.events
                if isinstance(event.message, StateChanged)
                and event.message.reason.name in backdoor.TIMED_OUT
            ),
            is_machine_in_between=self._baudrate is None,
        )


class ShownPortBoardUnderTest(BoardUnderTest):
    """A board started elsewhere, at a port, seen through its back door.

    Parameters
    ----------
    url : str
        Its port.
    reader : BackdoorReader
        Its back door.

    Attributes
    ----------
    unseen : str or None
        Why it may have latched what it did not show.

    Raises
    ------
    ConfigurationError
        The back door tells nothing.
    """

    def __init__(self, url: str, reader: BackdoorReader) -> None:
        self._seen: list[Mapping[str, Any]] = [*reader.read_first()]
        model = backdoor.board_model_of_evidence(self._seen[0])
        super().__init__(f"{url}, seen through its back door", url, model, lambda: self._seen)
        self._reader = reader
        while self._read():
            pass
        if are_records_of_another_dialect(self._seen):
            del self._seen[1:]  # of clients before; frames of other boards carry no number

    @classmethod
    @contextmanager
    def opened(cls, url: str, source: str) -> Iterator[Self]:
        """Open the back door at *source* and give the board."""
        with BackdoorReader(source) as reader:
            yield cls(url, reader)

    @property
    def fault_counts(self) -> dict[str, int] | None:
        """None: it has not ended."""
        return None

    def wait_for_queue(self, driver: Driver) -> None:  # noqa: ARG002  it cannot tell any more
        """Wait for the frames that the board still has."""
        time.sleep(_QUEUE_S)

    def settle(
        self,
        driver: AnyDriver,
        progress: Progress | None = None,
        *,
        skip_fields: bool = False,  # noqa: ARG002  the board decides
    ) -> None:
        """Wait until all latches that are due have come, or for 10 s."""
        end_s, total = time.monotonic() + _LAST_S, driver.intended.total
        while (why := self._why_incomplete(driver)) is not None and time.monotonic() < end_s:
            self._read()
            if progress is not None:
                progress(min(len(self._seen), total), total)
        self.unseen = why

    def _why_incomplete(self, driver: AnyDriver) -> str | None:
        """Return why latches of sent frames are missing in the back door; None if all are there."""
        if are_records_of_another_dialect(self._seen):
            if has_dialect_latched_all(driver.intended, self._seen):
                return None
            return "the back door has told fewer latches than frames were sent"
        last = driver.intended[-1].key if driver.intended else None
        return backdoor.why_observations_incomplete(self._seen, driver.session, last)

    def _read(self) -> bool:
        """Read new records; if none has arrived, sleep 10 ms and return False."""
        if found := self._reader.read():
            self._seen += found
            return True
        time.sleep(_POLL_S)
        return False

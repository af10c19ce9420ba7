"""The wall clock of a board: waits for its port or for the next event of its simulation."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Iterator
from typing import Final

from haptogram.machine.waiter import DescriptorWaiter
from haptogram.records.remark import About

from .backdoor.line_tap import LineTap
from .backdoor.worker import ReconstructionWorker
from .board.clock import earliest_board_time, whole_board_us
from .line.port import BoardPort
from .line.sampling import is_baud_understood
from .log import BoardCountLog
from .simulation import Simulation

_SHORT_NS: Final = 60_000  # shortest sleep; the next carrier boundary is nearer
_HAND_OVER_NS: Final = 20_000_000  # time from one batch of records for the worker to the next
_LONGEST_NS: Final = 3_600_000_000_000  # longest sleep: select(2) takes no more than some centuries
_LAST_BYTES_NS: Final = 5_000_000  # time from one look for the last bytes of a client to the next
_CHUNK: Final = 4_096
_ENDINGS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Heartbeat:
    """Runs a simulation on the wall clock, behind a port, until it is stopped.

    Parameters
    ----------
    simulation : Simulation
        The board.
    port : Port
        Where the host's bytes come and go.
    worker : ReconstructionWorker or None
        Needs to be given time to hand over its records.
    counts : BoardCountLog or None
        Says how the counters move on.
    tap : LineTap or None
        Takes down the bytes of the port.
    slow_down : float
        Seconds of the wall clock for a second of the board.  A simulated board that takes longer
        gets them, and no time passes meanwhile.

    Attributes
    ----------
    was_stopped : bool
        Whether :meth:`stop` was called: False if the board ended by itself, or runs.
    """

    def __init__(
        self,
        simulation: Simulation,
        port: BoardPort,
        worker: ReconstructionWorker | None = None,
        counts: BoardCountLog | None = None,
        tap: LineTap | None = None,
        slow_down: float = 1.0,
    ) -> None:
        self._simulation, self._port, self._slow_down = simulation, port, slow_down
        self._worker, self._counts, self._tap = worker, counts, tap
        self._stopping = self.was_stopped = False
        self._is_plugged = True
        self._client_baud: int | None = None
        self._parents: list[int] = []  # whose end is that of the board
        self._clients: list[int] = []  # the same, but what they have sent still counts
        self._has_no_client = self._is_quiet = False
        self._due_ns: int | None = None  # when it meant to wake
        self._hand_over_ns = 0
        self._waiter = DescriptorWaiter()
        self._wake_read, self._wake_write = os.pipe()
        self._signals: list[int] = []  # a pipe with a byte for each signal
        self._start_ns = time.monotonic_ns()

    def stop(self) -> None:
        """Make :meth:`run` return; may be called from a signal handler, and after its end."""
        self.was_stopped = True
        if not self._stopping:
            self._stopping = True
            os.write(self._wake_write, b"!")

    @contextlib.contextmanager
    def stopped_by_signals(self) -> Iterator[None]:
        """Let SIGINT, SIGTERM and SIGHUP stop the board in good order, as long as this lasts.

        A SIGHUP that is ignored (nohup) stays so.

        The system writes into a pipe for each: Python calls a handler between two instructions, so
        one that comes right before the wait would be heard after it, and an idle board waits long.
        """
        before = {number: signal.getsignal(number) for number in _ENDINGS}
        reading, writing = os.pipe()
        os.set_blocking(writing, False)
        writing_before = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
        self._signals.append(reading)
        try:
            for number in _ENDINGS:
                if number != signal.SIGHUP or before[number] is not signal.SIG_IGN:
                    signal.signal(number, lambda *_: self.stop())
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, signal.SIG_DFL if handler is None else handler)
            signal.set_wakeup_fd(writing_before)
            self._signals.remove(reading)
            os.close(reading)
            os.close(writing)

    def stop_at_eof(self, descriptor: int) -> None:
        """Let the end of a pipe stop the board: whoever held it open has ended, however it did.

        Fields are not awaited any more then: the remaining records are written without them.
        """
        self._parents.append(descriptor)

    def stop_after(self, descriptor: int) -> None:
        """Let the end of a pipe stop the board, once it has taken all that its client sent."""
        self._clients.append(descriptor)

    def run(self) -> None:
        """Serve the port until :meth:`stop`; then mute the board.

        Raises
        ------
        PortLostError
            If the port goes away for good.
        """
        try:
            while not self._stopping:
                self._turn()
                if self._has_no_client and self._is_quiet:
                    return
                self._wait()
        finally:
            self._stopping = True  # from here on a signal finds the pipe closed
            self._simulation.advance_to(self._elapsed_ns())  # it may have slept since
            self._simulation.power_down()
            os.close(self._wake_read)
            os.close(self._wake_write)

    def _turn(self) -> None:
        """Read the host's bytes, advance the board to now, and write what it sends and records."""
        simulation, port, now_ns = self._simulation, self._port, self._elapsed_ns()
        # Late for what it meant to wake for: for so long the host's bytes may lie here already.
        # Time spent idle is not counted, or a frame after a pause would take no time on the line.
        stalled_ns = 0 if self._due_ns is None else max(0, now_ns - self._due_ns)
        data = port.read(simulation.host_room)
        self._is_quiet = not data and not simulation.host_unsent
        if data:
            self._check_rate()
            simulation.host_write(data, now_ns, waited_ns=stalled_ns)
            if self._tap is not None:
                self._tap.to_board(now_ns, data, stalled_ns)
        self._advance_to(now_ns)
        if simulation.is_connected is not self._is_plugged:
            self._is_plugged = simulation.is_connected
            port.plug(self._is_plugged)
        if port.take_departure():
            simulation.unplug()  # the next client must not get what this one left
            if self._tap is not None:
                self._tap.departed(now_ns)
        port.write(b"")  # the rest of last time; once it is gone nothing else would wake us up
        if not port.pending:
            self._answer(now_ns)
        self._hand_over(now_ns)
        if self._counts is not None and self._counts.is_due(now_ns):
            self._counts.update(simulation.dialect.counters, now_ns)

    def _advance_to(self, now_ns: int) -> None:
        """Advance the board to *now_ns*; slow its clock if a simulator could not keep up.

        It is slowed by what the simulator took beyond half of its time.
        """
        simulation, begin_ns = self._simulation, time.monotonic_ns()
        given_ns = round((now_ns - simulation.now_ns) * self._slow_down)
        simulation.advance_to(now_ns)
        taken_ns = time.monotonic_ns() - begin_ns
        if simulation.dialect.ahead is not None and taken_ns > given_ns:
            self._start_ns += taken_ns - given_ns // 2  # half, so that its steps become shorter

    def _check_rate(self) -> None:
        """Remark if a client sets a baud rate, not seen before, that real boards do not have."""
        settings = self._simulation.settings
        if settings.wiring is None:
            return
        if (baud := self._port.client_baud) is None or baud == self._client_baud:
            return
        self._client_baud = baud
        known = [*settings.wiring.bauds, settings.line.baud or baud]
        if not any(is_baud_understood(baud / board_baud) for board_baud in known):
            self._simulation.remark(
                About.OTHER_RATE,
                f"the client sends at {baud} baud: a real board of {settings.wiring.dialect} has "
                f"{', '.join(map(str, settings.wiring.bauds))}, and would understand nothing",
            )

    def _answer(self, now_ns: int) -> None:
        """Write the board's bytes to the port."""
        data = self._simulation.host_read()
        self._port.write(data)
        if data and self._tap is not None:
            self._tap.to_host(now_ns, data)

    def _hand_over(self, now_ns: int) -> None:
        """Send pending records to the worker: once in 20 ms, or each time if it takes no more."""
        worker = self._worker
        if worker is None or not worker.pending:
            return
        if worker.is_refusing or now_ns >= self._hand_over_ns:
            worker.pump()
            self._hand_over_ns = now_ns + _HAND_OVER_NS

    def _wait(self) -> None:
        """Sleep until bytes arrive, the port is writable or an event is due."""
        reading = self._port.reading() if self._simulation.host_room else []
        writing = self._port.writing()
        hand_over_ns = None
        if self._worker is not None and self._worker.is_refusing:
            writing = [*writing, self._worker.fileno()]
        elif self._worker is not None and self._worker.pending:
            hand_over_ns = self._hand_over_ns
        self._due_ns = self._simulation.next_event_ns()
        next_ns = earliest_board_time(self._due_ns, hand_over_ns, self._port_due_ns())
        wait_ns = None
        if next_ns is not None:
            wait_ns = round((next_ns - self._elapsed_ns()) * self._slow_down)
        if self._has_no_client:  # no descriptor says that its last byte has been taken
            wait_ns = _LAST_BYTES_NS if wait_ns is None else min(wait_ns, _LAST_BYTES_NS)
        if wait_ns is not None and wait_ns <= 0:
            return  # it is due already: the next turn looks at the port all the same
        waiting = [self._wake_read, *self._signals, *self._parents, *self._clients, *reading]
        ready = self._waiter.wait(waiting, writing, _heartbeat_timeout_s(wait_ns))
        for signals in ready.intersection(self._signals):
            os.read(signals, _CHUNK)  # one with a handler of others would end every wait to come
        if any(client in ready and not os.read(client, _CHUNK) for client in self._clients):
            self._clients.clear()
            self._has_no_client = True
        if any(parent in ready and not os.read(parent, _CHUNK) for parent in self._parents):
            self.stop()
            if self._worker is not None:
                self._worker.skip_fields()

    def _port_due_ns(self) -> int | None:
        """Return when the port must be called although nothing comes, on the board's clock in ns.

        That clock is slowed down; None: it need not be called.
        """
        due_ns = self._port.due_ns
        return None if due_ns is None else round((due_ns - self._start_ns) / self._slow_down)

    def _elapsed_ns(self) -> int:
        """Return the board's time since power-up, slowed down, in whole microseconds."""
        elapsed_ns = time.monotonic_ns() - self._start_ns
        return whole_board_us(round(elapsed_ns / self._slow_down))


def _heartbeat_timeout_s(wait_ns: int | None) -> float | None:
    """Return how long to sleep for *wait_ns*: an hour at most, 0.0 up to 60 µs; None: for ever."""
    if wait_ns is None:
        return None
    wait_ns = min(wait_ns, _LONGEST_NS)
    return wait_ns / 1e9 if wait_ns > _SHORT_NS else 0.0

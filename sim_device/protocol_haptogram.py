"""The URL ``haptogram://``: a virtual board inside any pyserial program.

::

    import serial, sim_device
    sim_device.register_url_handler()
    port = serial.serial_for_url("haptogram://?seed=1&array=8x8", timeout=1)

There is no thread: every read, write and look at ``in_waiting`` lets the board catch up with the
clock. With ``clock=virtual`` there is no wall clock either: time passes in a blocking read (to the
next byte, or to its timeout), in a blocking write, and in :meth:`Serial.wait_until_ns`.
"""

from __future__ import annotations

import time
import weakref
from collections.abc import Callable, MutableMapping
from typing import TYPE_CHECKING, Any, Final

import serial

from haptogram.errors import ConfigurationError
from haptogram.records.frame import Observation
from haptogram.settings.board import BoardConfig
from haptogram.settings.board_url import SCHEME, PortConfig, read_board_url

from .backdoor.recorder import InlineReconstructionWorker
from .backdoor.records import Record, backdoor_record_line
from .blueprint import Blueprint, blueprint_of
from .board.settings import BoardSettings
from .simulation import Simulation, SimulationRecorder

if TYPE_CHECKING:
    from .backdoor.sinks import FileSink, SocketSink
    from .backdoor.worker import ReconstructionWorker

#: Ports whose board others reach as well, as long as it runs.
_SHARED: Final[MutableMapping[str, Serial]] = weakref.WeakValueDictionary()
_LONGEST_SLEEP_NS: Final = 50_000_000  # another thread may write meanwhile


def register_url_handler() -> None:
    """Teach pyserial the URL ``haptogram://``; doing it twice does no harm."""
    package = __name__.rpartition(".")[0]
    if package not in serial.protocol_handler_packages:
        serial.protocol_handler_packages.append(package)


def open_virtual_port(config: PortConfig) -> Serial:
    """Power up a virtual board in this process, and return the port to it.

    Raises
    ------
    ConfigurationError
        If the board cannot be built.
    """
    port = Serial(timeout=0)
    port.config = config
    port.port = SCHEME
    port.open()
    return port


class Serial(serial.SerialBase):
    """A pyserial port whose far end is a virtual board in this process.

    Attributes
    ----------
    config : PortConfig or None
        Port and board; None: the URL names them.
    simulation : Simulation
        The board and its line, while the port is open.
    shared_as : str or None
        Name under which other ports of this program reach the board: set before it is opened.
    """

    config: PortConfig | None = None
    shared_as: str | None = None
    _owner: Serial | None = None  # of the board, if that is another port
    simulation: Simulation

    # pyserial keeps these, but its type stubs do not know them.
    _port: str | None
    _timeout: float | None
    _write_timeout: float | None

    # --- opening and closing -------------------------------------------------------------------

    def open(self) -> None:
        """Power the board up.

        Raises
        ------
        ConfigurationError
            If the URL makes no sense.
        """
        if self._port is None:
            raise serial.SerialException("Port must be configured before it can be used.")
        if self.is_open:
            raise serial.SerialException("Port is already open.")
        config = self.config or read_board_url(self._port)
        if config.shared is not None:
            self._join(config.shared)
            return
        self._is_virtual = config.is_virtual
        if config.board.simulator is not None and not self._is_virtual:
            raise ConfigurationError(f"{self._port}: simulator needs clock=virtual")
        blueprint = self._blueprint(config.board)
        settings = blueprint.settings
        self._records: list[Record] = []
        self._observations: list[Observation] = []
        self._sink: FileSink | SocketSink | None = None
        self._worker: ReconstructionWorker | None = None
        self._inline: InlineReconstructionWorker | None = None
        try:
            recorders = self._recorders(settings, config.backdoor, config.reconstruct)
            self.simulation = Simulation(
                settings, *recorders, parts=blueprint.parts, faults=blueprint.faults
            )
        except BaseException:
            self._close_records()
            raise
        self._start_ns = time.monotonic_ns()
        self.is_open = True
        if self.shared_as is not None:
            _SHARED[self.shared_as] = self

    def _join(self, name: str) -> None:
        """Share the board of the open port *name* of this program; else ConfigurationError."""
        owner = _SHARED.get(name)
        if owner is None or not owner.is_open:
            raise ConfigurationError(
                f"{self._port}: the board was ended, or is in another process: open its URL in "
                'the program of the VirtualBoard, before the end of its "with"; for other '
                'programs, VirtualBoard(clock="wall") has a pseudo-terminal'
            )
        self._owner, self._is_virtual, self._start_ns = owner, owner._is_virtual, owner._start_ns  # noqa: SLF001
        self.simulation, self._inline = owner.simulation, owner._inline  # noqa: SLF001  its own class
        self._records, self._observations = owner.records, owner.observations
        self._sink = self._worker = None
        self.is_open = True

    @property
    def records(self) -> list[Record]:
        """Records of the back door, where ``reconstruct`` is given and no worker writes them."""
        if self._inline is not None:
            self._inline.complete()
        return self._records

    @property
    def brief_records(self) -> list[Record]:
        """:attr:`records`; latches may lack their drive."""
        return self._records

    @property
    def observations(self) -> list[Observation]:
        """The latches among :attr:`records`, as a verdict has them."""
        if self._inline is not None:
            self._inline.settle()
        return self._observations

    def skip_searches(self) -> None:
        """Leave out the fields that only a search of the whole volume tells."""
        if self._inline is not None:
            self._inline.limit_searches(0)

    def _blueprint(self, board: BoardConfig) -> Blueprint:
        """Return the blueprint of the board; name the URL in an error."""
        try:
            return blueprint_of(board)
        except ConfigurationError as error:
            if self.config is not None:
                raise
            raise ConfigurationError(f"{self._port}: {error}") from error

    def _recorders(
        self, settings: BoardSettings, backdoor: str | None, reconstruct: bool | None
    ) -> list[SimulationRecorder]:
        """Return the recorders of the board; [] if *backdoor* and *reconstruct* are both None.

        *backdoor*: file or socket that gets the records; None keeps them in memory. *reconstruct*
        False: records have no reconstructed fields.
        """
        if backdoor is None and reconstruct is None:
            return []
        wanted = reconstruct is not False
        if backdoor is not None and not self._is_virtual:
            from .backdoor.worker import ReconstructionWorker

            self._worker = ReconstructionWorker(settings, backdoor, reconstruct=wanted)
            return [self._worker]
        write: Callable[[Record], object] = self._records.append
        told: list[Observation] | None = self._observations
        if backdoor is not None:
            from .backdoor.sinks import open_backdoor_sink

            self._sink = sink = open_backdoor_sink(backdoor)
            told = None
            write = lambda record: sink.write(backdoor_record_line(record))  # noqa: E731  one line, used once
        self._inline = InlineReconstructionWorker(settings, write, reconstruct=wanted, told=told)
        return [self._inline]

    def close(self) -> None:
        """Power the board down: it is muted, and the last record is written."""
        if not self.is_open:
            return
        self.is_open = False
        if self._owner is not None:
            if self._owner.is_open:
                self.simulation.unplug()
            return
        self.simulation.power_down()
        self._close_records()

    def _close_records(self) -> None:
        """Finish and close all that records the board."""
        if self._inline is not None:
            self._inline.finish()
        if self._worker is not None:
            self._worker.close()
        if self._sink is not None:
            self._sink.close()

    def from_url(self, url: str) -> str:
        """Return *url*: pyserial asks for a port's name."""
        return url

    # --- time ----------------------------------------------------------------------------------

    def now_ns(self) -> int:
        """Return the time of this port's clock: virtual, or the monotonic one."""
        return self.simulation.now_ns if self._is_virtual else time.monotonic_ns()

    def raise_hardware_fault(self) -> None:
        """Let the hardware of the board fail now."""
        self._catch_up()
        self.simulation.raise_hardware_fault()

    def wait_until_ns(self, t_ns: int) -> None:
        """Let time pass up to *t_ns* of this port's clock; bytes that come stay unread."""
        while self.now_ns() < t_ns:
            self._pass_time(t_ns)
        self._catch_up()

    def _catch_up(self) -> None:
        """Advance the board to now."""
        if not self.is_open or (self._owner is not None and not self._owner.is_open):
            raise serial.PortNotOpenError
        if self._is_virtual:
            self.simulation.advance_to(self.simulation.now_ns)
        else:
            # Up to whole microseconds, on which the board takes bytes: nothing is left over.
            elapsed_ns = -(-(time.monotonic_ns() - self._start_ns) // 1000) * 1000
            self.simulation.advance_to(max(elapsed_ns, self.simulation.now_ns))
        if self._worker is not None:
            self._worker.pump()

    def _pass_time(self, until_ns: int | None) -> None:
        """Advance to the next event of the board or *until_ns*; at a wall clock sleep until then.

        A sleep lasts up to 50 ms at a wall clock: an event may be added meanwhile. In virtual time
        SerialException if neither is to come.
        """
        next_ns = self.simulation.next_event_ns()
        if self._is_virtual:
            times = [t_ns for t_ns in (next_ns, until_ns) if t_ns is not None]
            if not times:
                raise serial.SerialException("nothing will ever come: the read has no timeout")
            self.simulation.advance_to(max(min(times), self.simulation.now_ns))
            return
        now_ns = time.monotonic_ns()
        waits = [_LONGEST_SLEEP_NS]
        if next_ns is not None:
            waits.append(next_ns + self._start_ns - now_ns)
        if until_ns is not None:
            waits.append(until_ns - now_ns)
        time.sleep(max(0, min(waits)) / 1e9)
        self._catch_up()

    def _deadline_ns(self, timeout_s: float | None) -> int | None:
        """Return when a timeout from now ends, on the board's clock in ns; None without one."""
        return None if timeout_s is None else self.now_ns() + round(timeout_s * 1e9)

    def _is_over(self, deadline_ns: int | None) -> bool:
        """Return True if the deadline has passed; a deadline of None never does."""
        return deadline_ns is not None and self.now_ns() >= deadline_ns

    # --- bytes ---------------------------------------------------------------------------------

    def _check_cable(self) -> None:
        """Advance the board to now; SerialException if a fault has pulled the cable."""
        self._catch_up()
        self._check_connected()

    def _check_connected(self) -> None:
        """Raise SerialException if a fault has pulled the cable (line.disconnect)."""
        if not self.simulation.is_connected:
            raise serial.SerialException("unplugged, by line.disconnect")

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read without waiting."""
        self._check_cable()
        return self.simulation.host_waiting

    def read(self, size: int = 1) -> bytes:
        """Return *size* bytes, or fewer when the timeout has passed."""
        self._check_cable()
        deadline_ns = self._deadline_ns(self._timeout)
        data = self.simulation.host_read(size)
        while len(data) < size and not self._is_over(deadline_ns):
            self._await_byte(deadline_ns)
            data += self.simulation.host_read(size - len(data))
        return data

    def read_until_ns(self, deadline_ns: int) -> bytes:
        """Return all that has come; wait for the first byte, up to a time of this port's clock."""
        self._check_cable()
        while not self.simulation.host_waiting and self.now_ns() < deadline_ns:
            self._await_byte(deadline_ns)
        return self.simulation.host_read()

    def _await_byte(self, deadline_ns: int | None) -> None:
        """Let time pass to the next byte or event, at most to *deadline_ns*.

        None: without a limit. SerialException if a fault has pulled the cable.
        """
        if self._is_virtual and deadline_ns is not None:
            self.simulation.advance_to_output(deadline_ns)
        else:
            self._pass_time(deadline_ns)
        self._check_connected()

    def write(self, b: Any, /) -> int:
        """Hand over bytes, and return how many were taken.

        Without a write timeout that is all of them; with one of 0, what the line takes at once.

        Raises
        ------
        serial.SerialTimeoutException
            If a timeout above 0 passes first.
        """
        self._check_cable()
        data = bytes(b)
        sent = self._put(data)
        if sent == len(data) or self._write_timeout == 0:
            return sent
        deadline_ns = self._deadline_ns(self._write_timeout)
        while sent < len(data):
            if self._is_over(deadline_ns):
                raise serial.SerialTimeoutException("Write timeout")
            self._pass_time(deadline_ns)
            sent += self._put(data[sent:])
        return sent

    def _put(self, data: bytes) -> int:
        """Write bytes to the line; return how many it took, which may be fewer."""
        taken = self.simulation.host_write(data, self.simulation.now_ns)
        self._catch_up()
        return taken

    def flush(self) -> None:
        """Wait until the line has carried everything that was written."""
        while self.simulation.host_unsent:
            self._pass_time(None)

    def reset_input_buffer(self) -> None:
        """Discard what has come and was not read."""
        self._catch_up()
        self.simulation.host_read()

    def reset_output_buffer(self) -> None:
        """Do nothing: what was written is on the line."""
        self._catch_up()

    # --- settings and modem lines, which a virtual line does not have --------------------------

    def _reconfigure_port(self) -> None:
        """Do nothing: any setting is taken, the line is that of the URL."""

    def _update_break_state(self) -> None:
        pass

    def _update_rts_state(self) -> None:
        pass

    def _update_dtr_state(self) -> None:
        pass

    @property
    def cts(self) -> bool:
        """Clear to send: always."""
        return True

    @property
    def dsr(self) -> bool:
        """Board ready: always."""
        return True

    @property
    def ri(self) -> bool:
        """Ring: never."""
        return False

    @property
    def cd(self) -> bool:
        """Carrier detected: always."""
        return True

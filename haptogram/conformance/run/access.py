"""Ways to a board: in this program, or behind a port; and ways to reset it."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final, Protocol

import serial

from haptogram.driver.line.port import DEFAULT_BAUDRATE, Transport, open_transport
from haptogram.errors import ConfigurationError, LinkError

_POLL_S: Final = 0.02
_PULSE_S: Final = 0.1
_FAULT_TIMEOUT_S: Final = 10.0
_NO_VARIABLES: Final[Mapping[str, str]] = MappingProxyType({})


class Access(Protocol):
    """A way to one board.

    Attributes
    ----------
    url : str
        Name of the board in reports.
    baudrate : int
        Rate of the line.
    virtual : bool
        Whether the board's time is virtual.
    can_reset : bool
        Whether :meth:`reset` can restart the board.
    boots : bool
        Whether :meth:`open` finds a board that has just started.
    boot_timeout_s : float
        How long a board that has just started may be deaf.
    """

    url: str
    baudrate: int
    virtual: bool
    can_reset: bool
    boots: bool
    boot_timeout_s: float

    @property
    def raise_fault(self) -> Callable[[], None] | None:
        """Function that lets the hardware of the board fail; None: nothing can."""

    def open(self) -> Transport:
        """Open the port; :class:`HaptogramError` if the port does not open."""

    def reset(self) -> Transport:
        """Restart the board and open its port; the caller has closed the old one."""

    def last_words(self) -> str:
        """Return the end of the program of the board, with its last words; empty if it runs."""

    def close(self) -> None:
        """End the processes that :meth:`open` started."""


class VirtualAccess:
    """A virtual board that starts whenever its port is opened.

    Parameters
    ----------
    url : str
        Name of the board in reports.
    start : callable
        Takes the number of earlier starts, returns the port.
    raise_fault : callable, optional
        Lets the hardware of the board that was started last fail.
    """

    can_reset = True
    boots = True
    boot_timeout_s = 0.0

    def __init__(
        self,
        url: str,
        start: Callable[[int], Transport],
        *,
        baudrate: int,
        virtual: bool,
        raise_fault: Callable[[], None] | None = None,
    ) -> None:
        self.url, self.baudrate, self.virtual = url, baudrate, virtual
        self.raise_fault = raise_fault
        self._start = start
        self._starts = 0

    def open(self) -> Transport:
        """Power the board up."""
        self._starts += 1
        return self._start(self._starts - 1)

    def reset(self) -> Transport:
        """Power up another board, in the state of a board after a reset."""
        return self.open()

    def last_words(self) -> str:
        """Return an empty string: its end is that of this program."""
        return ""

    def close(self) -> None:
        """Do nothing: a board whose port is closed has no power."""


class RecordedAccess:
    """Another access whose bytes are written down, board after board.

    Parameters
    ----------
    access : Access
        The way to the board.
    wrap : callable
        Takes a port that was opened, returns what the suite talks to in its place.
    """

    def __init__(self, access: Access, wrap: Callable[[Transport], Transport]) -> None:
        self.url, self.baudrate, self.virtual = access.url, access.baudrate, access.virtual
        self.can_reset, self.boots = access.can_reset, access.boots
        self.boot_timeout_s, self.raise_fault = access.boot_timeout_s, access.raise_fault
        self._access, self._wrap = access, wrap

    def open(self) -> Transport:
        """Open the port."""
        return self._recorded_transport(self._access.open())

    def reset(self) -> Transport:
        """Restart the board and open its port."""
        return self._recorded_transport(self._access.reset())

    def _recorded_transport(self, transport: Transport) -> Transport:
        """Return *transport* wrapped to record what passes; store the URL of the board.

        A program that is the board may have named its URL only now, at its start.
        """
        self.url = self._access.url  # of a program that names its port when it starts
        return self._wrap(transport)

    def last_words(self) -> str:
        """Return the last words of the board that is recorded."""
        return self._access.last_words()

    def close(self) -> None:
        """End what the access has started."""
        self._access.close()


class PortAccess:
    """A board behind a port of the system.

    Parameters
    ----------
    url : str
        Anything that pyserial opens.
    reset_command : str or None
        Shell command that restarts the board.
    boot_timeout_s : float
        Longest wait for the port after a restart, and then for an answer.
    dtr, rts : bool or None
        State of the modem lines during the run; None: as the system sets them.
    pulse : str or None
        ``"dtr"`` or ``"rts"``: the line on which a pulse restarts the board.
    fault_command : str or None
        Shell command that lets the hardware of the board fail.
    """

    virtual = False
    boots = False

    def __init__(
        self,
        url: str,
        *,
        baudrate: int = DEFAULT_BAUDRATE,
        reset_command: str | None = None,
        boot_timeout_s: float = 5.0,
        dtr: bool | None = None,
        rts: bool | None = None,
        pulse: str | None = None,
        fault_command: str | None = None,
    ) -> None:
        self.url, self.baudrate = url, baudrate
        self.raise_fault = access_fault_raiser(fault_command, lambda: None)
        self.can_reset = reset_command is not None or pulse is not None
        self.boot_timeout_s = boot_timeout_s
        self._reset_command = reset_command
        self._lines = {
            name: state for name, state in (("dtr", dtr), ("rts", rts)) if state is not None
        }
        self._pulse = pulse

    def open(self) -> Transport:
        """Open the port."""
        self._set_lines(self._lines)
        return open_transport(self.url, baudrate=self.baudrate)

    def reset(self) -> Transport:
        """Restart the board and wait until its port opens."""
        if self._pulse is not None:
            self._set_lines({self._pulse: True}, then={self._pulse: False})
        if self._reset_command is not None:
            _run_command_for_access("--reset-cmd", self._reset_command, self.boot_timeout_s)
        return open_access_port(self.open, self.boot_timeout_s)

    def _set_lines(self, states: dict[str, bool], then: dict[str, bool] | None = None) -> None:
        """Set control lines of the port, such as DTR; 0.1 s later set those of *then*.

        Nothing if *states* is empty; no second step if *then* is None.
        """
        if not states:
            return
        try:
            with serial.serial_for_url(self.url, baudrate=self.baudrate) as port:
                for name, state in states.items():
                    setattr(port, name, state)
                if then is not None:
                    time.sleep(_PULSE_S)
                    for name, state in then.items():
                        setattr(port, name, state)
        except (OSError, ValueError) as error:
            raise LinkError(f"{self.url}: modem lines cannot be set: {error}") from error

    def last_words(self) -> str:
        """Return an empty string: the board is no program of this run."""
        return ""

    def close(self) -> None:
        """Do nothing: the run did not start the board."""


def access_fault_raiser(
    command: str | None, process_id: Callable[[], int | None]
) -> Callable[[], None] | None:
    """Return a function that lets a board fail by a shell command, in which BOARD_PID is set."""
    if command is None:
        return None

    def raise_fault() -> None:
        pid = process_id()
        environment = {} if pid is None else {"BOARD_PID": str(pid)}
        _run_command_for_access("--fault-cmd", command, _FAULT_TIMEOUT_S, environment)

    return raise_fault


def _run_command_for_access(
    option: str, command: str, timeout_s: float, environment: Mapping[str, str] = _NO_VARIABLES
) -> None:
    """Run a shell command of the user, given by *option*, with *environment* added.

    :class:`ConfigurationError` if it fails, or takes longer than *timeout_s*, which counts as 1 s
    at least.
    """
    try:
        done = subprocess.run(
            command,
            shell=True,
            timeout=max(timeout_s, 1.0),
            env=os.environ | environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise ConfigurationError(f"{option} took more than {timeout_s:g} s") from error
    if done.returncode:
        printed = " ".join(done.stdout.decode(errors="replace").split())[-200:]
        raise ConfigurationError(f"{option} ended with status {done.returncode}: {printed}")


def open_access_port(open_port: Callable[[], Transport], timeout_s: float) -> Transport:
    """Open a port as soon as it exists; raise the last error after *timeout_s*."""
    end_s = time.monotonic() + timeout_s
    while True:
        try:
            return open_port()
        except LinkError:
            if time.monotonic() > end_s:
                raise
            time.sleep(_POLL_S)

"""Ways to a board: an open port, a process that is one, a reset."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, Protocol

import serial

from haptogram.errors import ConfigurationError, LinkError
from haptogram.transport import DEFAULT_BAUDRATE, Transport, open_transport

DEFAULT_PORT_REGEX: Final = r"(?:listening on|redirected to|PTY is|pty:?) +(/\S+)"
_POLL_S: Final = 0.02
_PULSE_S: Final = 0.1
_STOP_S: Final = 5.0


class Access(Protocol):
    """A way to one board.

    Attributes
    ----------
    url : str
        Its name in reports.
    baudrate : int
        Rate of the line.
    virtual : bool
        Whether its time is virtual.
    can_reset : bool
        Whether :meth:`reset` can restart it.
    boots : bool
        Whether :meth:`open` finds a board that has just started.
    """

    url: str
    baudrate: int
    virtual: bool
    can_reset: bool
    boots: bool

    def open(self) -> Transport:
        """Open the port; :class:`HaptogramError` if that cannot be done."""
        ...

    def reset(self) -> Transport:
        """Restart the board and open its port; the one that was open is closed."""
        ...

    def close(self) -> None:
        """End what was started for it."""
        ...


class VirtualAccess:
    """A virtual board that starts whenever its port is opened.

    Parameters
    ----------
    url : str
        Its name.
    start : callable
        Given how often it was started before, returns its port.
    """

    can_reset = True
    boots = True

    def __init__(
        self, url: str, start: Callable[[int], Transport], *, baudrate: int, virtual: bool
    ) -> None:
        self.url, self.baudrate, self.virtual = url, baudrate, virtual
        self._start = start
        self._starts = 0

    def open(self) -> Transport:
        """Power the board up."""
        self._starts += 1
        return self._start(self._starts - 1)

    def reset(self) -> Transport:
        """Power another board up, as the same one after a reset."""
        return self.open()

    def close(self) -> None:
        """Do nothing: a port that is closed is a board without power."""


class PortAccess:
    """A board behind a port that is there.

    Parameters
    ----------
    url : str
        Anything that pyserial opens.
    reset_command : str or None
        Shell command that restarts the board.
    boot_timeout_s : float
        How long it may take until its port is there again.
    dtr, rts : bool or None
        State of the modem lines while the suite runs; None: as the system leaves them.
    pulse : str or None
        ``"dtr"`` or ``"rts"``: the line whose pulse restarts the board.
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
    ) -> None:
        self.url, self.baudrate = url, baudrate
        self.can_reset = reset_command is not None or pulse is not None
        self._reset_command, self._boot_timeout_s = reset_command, boot_timeout_s
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
            _run(self._reset_command, self._boot_timeout_s)
        return _when_there(self.open, self._boot_timeout_s)

    def _set_lines(self, states: dict[str, bool], then: dict[str, bool] | None = None) -> None:
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

    def close(self) -> None:
        """Do nothing: the board is not ours."""


class SpawnAccess:
    """A process that is a board: a native build or an emulator, and says which port it opened.

    Parameters
    ----------
    command : str
        Command line, without a shell.
    port_regex : str
        Found in what it prints; its first group, or all of it, is the port's URL.
    boot_timeout_s : float
        How long it may take to say so.
    """

    virtual = False
    can_reset = True
    boots = True

    def __init__(
        self,
        command: str,
        *,
        port_regex: str = DEFAULT_PORT_REGEX,
        boot_timeout_s: float = 10.0,
        baudrate: int = DEFAULT_BAUDRATE,
    ) -> None:
        try:
            self._arguments = shlex.split(command)
            self._regex = re.compile(port_regex)
        except (ValueError, re.error) as error:
            raise ConfigurationError(f"--spawn {command!r}, {port_regex!r}: {error}") from error
        if not self._arguments:
            raise ConfigurationError("--spawn is empty; it names a program")
        self.url, self.baudrate = command, baudrate
        self._boot_timeout_s = boot_timeout_s
        self._process: subprocess.Popen[bytes] | None = None
        self._log: Path | None = None

    def open(self) -> Transport:
        """Open its port, starting it if it does not run."""
        if self._process is None or self._process.poll() is not None:
            return self.reset()
        return open_transport(self.url, baudrate=self.baudrate)

    def reset(self) -> Transport:
        """Start it anew and open its port."""
        self.close()
        self._start()
        self.url = self._wait_for_port()
        return _when_there(
            lambda: open_transport(self.url, baudrate=self.baudrate), self._boot_timeout_s
        )

    def _start(self) -> None:
        handle, name = tempfile.mkstemp(prefix="haptogram-spawn-")
        self._log = Path(name)
        # Into a file: a pipe that nobody empties would stop the board once it is full.
        with os.fdopen(handle, "wb") as log:
            try:
                self._process = subprocess.Popen(
                    self._arguments,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,  # so that all of it can be ended
                )
            except OSError as error:
                raise ConfigurationError(f"--spawn {self._arguments[0]}: {error}") from error

    def _wait_for_port(self) -> str:
        assert self._process is not None  # _start has set it
        end_s = time.monotonic() + self._boot_timeout_s
        while True:
            ended = self._process.poll() is not None
            said = self._said()
            if found := self._regex.search(said):
                return found[1] if found.groups() else found[0]
            if ended or time.monotonic() > end_s:
                how = "ended" if ended else f"was silent for {self._boot_timeout_s:g} s"
                last = " ".join(said.split())[-200:] or "nothing"
                raise ConfigurationError(
                    f"{self._arguments[0]} {how} before it named a port that matches "
                    f"{self._regex.pattern!r}; it said: {last}"
                )
            time.sleep(_POLL_S)

    def _said(self) -> str:
        return self._log.read_text(errors="replace") if self._log else ""

    def close(self) -> None:
        """End the process and everything that it started."""
        process, self._process = self._process, None
        if process is not None:
            _end_group(process)
        if self._log is not None:
            self._log.unlink(missing_ok=True)
            self._log = None


def _end_group(process: subprocess.Popen[bytes]) -> None:
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
        except ProcessLookupError:
            break
        try:
            process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            continue
        break
    process.wait(_STOP_S)


def _run(command: str, timeout_s: float) -> None:
    """Run a shell command of the user; :class:`ConfigurationError` if it fails."""
    try:
        done = subprocess.run(
            command,
            shell=True,
            timeout=max(timeout_s, 1.0),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise ConfigurationError(f"--reset-cmd took more than {timeout_s:g} s") from error
    if done.returncode:
        said = " ".join(done.stdout.decode(errors="replace").split())[-200:]
        raise ConfigurationError(f"--reset-cmd ended with status {done.returncode}: {said}")


def _when_there(open_port: Callable[[], Transport], timeout_s: float) -> Transport:
    """Open a port as soon as it is there."""
    end_s = time.monotonic() + timeout_s
    while True:
        try:
            return open_port()
        except LinkError:
            if time.monotonic() > end_s:
                raise
            time.sleep(_POLL_S)

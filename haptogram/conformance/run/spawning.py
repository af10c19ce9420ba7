"""A board that is a process: started, asked for its port, ended with everything that it began."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import threading
import time
from typing import IO, Final

from haptogram.driver.line.port import DEFAULT_BAUDRATE, Transport, open_transport
from haptogram.errors import ConfigurationError

from .access import when_there

DEFAULT_PORT_REGEX: Final = r"(?:listening on|redirected to|PTY is|pty:?) +(/\S+)"
_POLL_S: Final = 0.02
_STOP_S: Final = 5.0
_LAST_WORDS_S: Final = 1.0
_KEPT_BYTES: Final = 1 << 16


class _Said:
    """What a process prints: its beginning and its end, so that nothing grows without bound.

    All of it is taken: a pipe that nobody empties would stop the board once it is full.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self._first = self._last = b""
        self._stream = stream
        self._thread = threading.Thread(target=self._drain, name="haptogram-spawn", daemon=True)
        self._thread.start()

    def _drain(self) -> None:
        with self._stream as stream:
            while data := os.read(stream.fileno(), _KEPT_BYTES):
                room = _KEPT_BYTES - len(self._first)
                self._first += data[:room]
                self._last = (self._last + data[room:])[-_KEPT_BYTES:]

    def find(self, pattern: re.Pattern[str]) -> re.Match[str] | None:
        """Return where *pattern* is found first, in what is kept."""
        return pattern.search(self._first.decode(errors="replace")) or pattern.search(
            self._last.decode(errors="replace")
        )

    def end(self, timeout_s: float) -> str:
        """Wait until the process has said everything; return the last of it, on one line."""
        self._thread.join(timeout_s)
        return " ".join((self._first + self._last).decode(errors="replace").split())[-200:]


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

    def open(self) -> Transport:
        """Open its port, starting it if it does not run."""
        if self._process is None or self._process.poll() is not None:
            return self.reset()
        return open_transport(self.url, baudrate=self.baudrate)

    def reset(self) -> Transport:
        """Start it anew and open its port."""
        self.close()
        self.url = self._wait_for_port(self._start())
        return when_there(
            lambda: open_transport(self.url, baudrate=self.baudrate), self._boot_timeout_s
        )

    def _start(self) -> _Said:
        try:
            self._process = subprocess.Popen(
                self._arguments,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # so that all of it can be ended
            )
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"--spawn {self._arguments[0]}: {error}") from error
        assert self._process.stdout is not None  # PIPE
        return _Said(self._process.stdout)

    def _wait_for_port(self, said: _Said) -> str:
        assert self._process is not None  # _start has set it
        end_s = time.monotonic() + self._boot_timeout_s
        while True:
            ended = self._process.poll() is not None
            if ended:
                said.end(_LAST_WORDS_S)
            if found := said.find(self._regex):
                return found[1] if found.groups() else found[0]
            if ended or time.monotonic() > end_s:
                how = "ended" if ended else f"went on for {self._boot_timeout_s:g} s"
                last = said.end(0) or "nothing"
                raise ConfigurationError(
                    f"{self._arguments[0]} {how} before it named a port that matches "
                    f"{self._regex.pattern!r}; it said: {last}"
                )
            time.sleep(_POLL_S)

    def close(self) -> None:
        """End the process and everything that it started."""
        process, self._process = self._process, None
        if process is not None:
            _end_group(process)


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

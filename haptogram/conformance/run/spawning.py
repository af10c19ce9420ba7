"""A board that runs as a process: its start, the port that it prints, and its end."""

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
from haptogram.errors import ConfigurationError, plain_reason
from haptogram.machine.interrupts import DelayedInterrupts

from .access import access_fault_raiser, open_access_port

DEFAULT_PORT_REGEX: Final = r"(?:listening on|redirected to|PTY is|pty:?) +((?:socket:/)?/\S+)"
_POLL_S: Final = 0.002
_STOP_S: Final = 5.0
_LAST_WORDS_S: Final = 1.0
_KEPT_BYTES: Final = 1 << 16


class _SpawnAccessOutput:
    """The first and the last 64 KiB of the text that a process prints.

    A thread reads everything: a full pipe would stop the board.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self._first = self._last = b""
        self._stream = stream
        self._thread = threading.Thread(target=self._drain, name="haptogram-spawn", daemon=True)
        self._thread.start()

    def _drain(self) -> None:
        """Read the output of the program to its end; keep the first and the last 64 KiB."""
        with self._stream as stream:
            while data := os.read(stream.fileno(), _KEPT_BYTES):
                room = _KEPT_BYTES - len(self._first)
                self._first += data[:room]
                self._last = (self._last + data[room:])[-_KEPT_BYTES:]

    def find(self, pattern: re.Pattern[str]) -> re.Match[str] | None:
        """Return the first match of *pattern* in the kept text."""
        return pattern.search(self._first.decode(errors="replace")) or pattern.search(
            self._last.decode(errors="replace")
        )

    def end(self, timeout_s: float) -> str:
        """Wait for the end of the text; return its last 200 characters on one line."""
        self._thread.join(timeout_s)
        return " ".join((self._first + self._last).decode(errors="replace").split())[-200:]


class SpawnAccess:
    """A board that runs as a process, native or in an emulator, and prints its port.

    Parameters
    ----------
    command : str
        Command line, without a shell.
    port_regex : str
        Matches the text that the process prints; the first group, or the match, is the URL.
    boot_timeout_s : float
        Longest wait for that text, and then for an answer.
    fault_command : str or None
        Shell command that lets the hardware of the board fail; BOARD_PID is the process.
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
        fault_command: str | None = None,
    ) -> None:
        self.raise_fault = access_fault_raiser(
            fault_command, lambda: getattr(self._process, "pid", None)
        )
        try:
            self._arguments = shlex.split(command)
            self._regex = re.compile(port_regex)
        except (ValueError, re.error) as error:
            raise ConfigurationError(f"--spawn {command!r}, {port_regex!r}: {error}") from error
        if not self._arguments:
            raise ConfigurationError("--spawn is empty; it names a program")
        self.url, self.baudrate = command, baudrate
        self.boot_timeout_s = boot_timeout_s
        self._process: subprocess.Popen[bytes] | None = None
        self._output: _SpawnAccessOutput | None = None

    def open(self) -> Transport:
        """Open its port, starting it if it does not run."""
        if self._process is None or self._process.poll() is not None:
            return self.reset()
        return open_transport(self.url, baudrate=self.baudrate)

    def reset(self) -> Transport:
        """Restart the process and open its port."""
        self.close()
        self.url = self._wait_for_port(self._start())
        return open_access_port(
            lambda: open_transport(self.url, baudrate=self.baudrate), self.boot_timeout_s
        )

    def _start(self) -> _SpawnAccessOutput:
        """Start the program in a process group of its own; return its output."""
        interrupts = DelayedInterrupts()  # one that came before there is a process would leave it
        interrupts.install()
        try:
            with interrupts:
                self._process = subprocess.Popen(
                    self._arguments,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,  # so that all of it can be ended
                )
                assert self._process.stdout is not None  # PIPE
                self._output = _SpawnAccessOutput(self._process.stdout)
        except (OSError, ValueError) as error:
            raise ConfigurationError(
                f"--spawn {self._arguments[0]} cannot be started: {plain_reason(error)}"
            ) from error
        finally:
            interrupts.remove()
        return self._output

    def _wait_for_port(self, output: _SpawnAccessOutput) -> str:
        """Return the port that the program prints; raise if it ends, or prints none in time.

        In time is within `boot_timeout_s`.
        """
        assert self._process is not None  # _start has set it
        end_s = time.monotonic() + self.boot_timeout_s
        while True:
            ended = self._process.poll() is not None
            if ended:
                output.end(_LAST_WORDS_S)
            if found := output.find(self._regex):
                return found[1] if found.groups() else found[0]
            if ended or time.monotonic() > end_s:
                how = "ended" if ended else f"went on for {self.boot_timeout_s:g} s"
                last = output.end(0) or "nothing"
                raise ConfigurationError(
                    f"{self._arguments[0]} {how} before it named a port that matches "
                    f"{self._regex.pattern!r}; it printed: {last}; --port-regex says how a port "
                    "is named, --boot-timeout how long it may take"
                )
            time.sleep(_POLL_S)

    def last_words(self) -> str:
        """Return the end of the process, with the last that it printed; empty if it runs."""
        process, output = self._process, self._output
        if process is None or output is None:
            return ""
        try:
            status = process.wait(_LAST_WORDS_S)  # it may be on its way to its end
        except subprocess.TimeoutExpired:
            return ""
        last = output.end(_LAST_WORDS_S) or "nothing"
        return f"{self._arguments[0]} ended with status {status}; it printed: {last}"

    def close(self) -> None:
        """End the process and everything that it started."""
        process, self._process = self._process, None
        if process is not None:
            _end_process_group(process)


def _end_process_group(process: subprocess.Popen[bytes]) -> None:
    """Terminate a process with all its children; kill them if they have not ended in 5 s."""
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

"""The process of a virtual board, its start and its end; or the board in this program."""

from __future__ import annotations

import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import serial

from haptogram.errors import ConfigurationError, LinkLostError
from haptogram.machine.view_process import child_process_environment
from haptogram.settings.board import BoardConfig
from haptogram.settings.board_url import SCHEME, PortConfig, write_board_url

_PROGRAM: Final = "python -m sim_device: "
_REFUSED: Final = 2
_READY: Final = "listening on "
_LONGEST_START_S: Final = 600.0  # it may compile, on a machine with much else to do
_SLOW_S: Final = 10.0  # an interpreter with numpy takes seconds on a busy machine: then it is told
_STARTING: Final = "starting: "
_INTERPRETER: Final = "starting the Python interpreter"
#: Time after which a board that is told to end has ended: it gives its last records 120 s.
ENDS_WITHIN_S: Final = 150.0
_POLL_S: Final = 0.01
#: Package in which pyserial finds the URL: a name, as whoever drives a board imports none.
_HANDLER: Final = "sim_device"
_NS_PER_S: Final = 1e9


class BoardProcess:
    """Runs ``python -m sim_device``.

    Parameters
    ----------
    arguments : sequence of str
        Options of the command.
    log : Path
        File that takes the output of the process.

    Attributes
    ----------
    pid : int
        Number of the process.
    """

    def __init__(self, arguments: Sequence[str], log: Path) -> None:
        self._log = log
        # Into a file: a pipe that nobody empties would stop the board once it is full.
        with log.open("wb") as output:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "sim_device", "--until-eof", *arguments],
                stdin=subprocess.PIPE,  # never written to: it ends with us, whatever ends us
                stdout=output,
                stderr=subprocess.STDOUT,
                env=child_process_environment(),
                start_new_session=True,  # Ctrl-C is for the host: the board must hear its MUTE
            )
        self.pid = self._process.pid
        self.now_s, self.sleep = time.monotonic, time.sleep

    def wait_until_ready(self) -> None:
        """Wait until the board listens.

        A slow start is told on standard error, with what the process is at.

        Raises
        ------
        ConfigurationError
            The process ended, or hangs: the text holds its last line.
        """
        begin_s = time.monotonic()
        told_s = begin_s + _SLOW_S
        while _READY not in self.log():
            if not self.is_running():
                raise ConfigurationError(self.how_it_ended())
            now_s = time.monotonic()
            if now_s > begin_s + _LONGEST_START_S:
                raise ConfigurationError(
                    f"the virtual board hangs: it does not listen after {_LONGEST_START_S:g} s "
                    f"({self._step()})"
                )
            if now_s > told_s:
                told_s += _SLOW_S
                waited = f"after {now_s - begin_s:.0f} s (slow or busy machine): {self._step()}"
                sys.stderr.write(f"the virtual board is still starting {waited}\n")
            time.sleep(_POLL_S)

    def _step(self) -> str:
        """Return what the starting process does now, by the last line of its log.

        Without a line the interpreter starts.
        """
        *_, last = ["", *self.log().splitlines()]
        return last.rpartition(_STARTING)[2] or _INTERPRETER

    def is_running(self) -> bool:
        """Return True if the process runs."""
        return self._process.poll() is None

    def how_it_ended(self, patience_s: float = 0.0) -> str | None:
        """Return in one line how the process ended; None: it runs after *patience_s*."""
        try:
            status = self._process.wait(patience_s)
        except subprocess.TimeoutExpired:
            return None
        if status < 0:
            return f"the virtual board was ended by {signal.Signals(-status).name}"
        *_, said = ["it said nothing", *self.log().split("\n")[:-1]]
        if status == _REFUSED and said.startswith(_PROGRAM):  # a reason of the user's own options
            return said.removeprefix(_PROGRAM)
        return f"the virtual board ended with status {status}: {said}"

    def log(self) -> str:
        """Return the output of the process so far."""
        return self._log.read_text(errors="replace") if self._log.exists() else ""

    def close_pipe(self) -> None:
        """End the board as our own end would: it tells every latch, but rebuilds no field."""
        if self._process.stdin is not None:
            self._process.stdin.close()

    def terminate(self) -> None:
        """Ask the process to end in order; do nothing if it has ended."""
        self._process.terminate()

    def stop(self) -> int:
        """End the process in order and return its status.

        Raises
        ------
        LinkLostError
            The process did not end in time, and was killed.
        """
        self.terminate()
        try:
            return self._process.wait(ENDS_WITHIN_S)
        except subprocess.TimeoutExpired as error:
            self.kill()
            text = f"the virtual board did not end within {ENDS_WITHIN_S:g} s"
            raise LinkLostError(text) from error

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait(ENDS_WITHIN_S)


# --- In this program -----------------------------------------------------------------------------


def _closed_board_port() -> Any:  # the stubs of pyserial know nothing of this port
    """Return a closed port of the virtual board's URL scheme."""
    return serial.serial_for_url(SCHEME, do_not_open=True, timeout=0)


class BoardInProgram:
    """Powers up a board whose time passes while a caller waits for it.

    It has the methods of :class:`BoardProcess`.

    Parameters
    ----------
    config : BoardConfig
        The board.
    backdoor : Path
        File that takes the records.
    reconstruct : bool
        Whether the records hold the field.

    Attributes
    ----------
    url : str
        URL by which pyserial opens a port to it, in this program, as long as it runs.
    """

    def __init__(self, config: BoardConfig, backdoor: Path, *, reconstruct: bool) -> None:
        if _HANDLER not in serial.protocol_handler_packages:
            serial.protocol_handler_packages.append(_HANDLER)
        name = secrets.token_hex(8)
        self.url = write_board_url(PortConfig(clock="virtual", shared=name))
        self._port = _closed_board_port()
        self._port.config = PortConfig(
            clock="virtual", backdoor=str(backdoor), reconstruct=reconstruct, board=config
        )
        self._port.shared_as = name
        self._port.open()
        self.pid = os.getpid()

    def now_s(self) -> float:
        """Return the time since its power-up."""
        return float(self._port.now_ns()) / _NS_PER_S

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        if self.is_running():
            self._port.wait_until_ns(self._port.now_ns() + round(seconds * _NS_PER_S))

    def is_running(self) -> bool:
        """Return True if it has not been ended."""
        return bool(self._port.is_open)

    def how_it_ended(self, patience_s: float = 0.0) -> str | None:  # noqa: ARG002  nothing to wait for
        """Return that it was ended; None: it runs."""
        return None if self.is_running() else "the virtual board was ended"

    def log(self) -> str:
        """Return nothing: it logs to this program."""
        return ""

    def terminate(self) -> None:
        """End it; do nothing if it has ended."""
        self._port.close()

    def stop(self) -> int:
        """End it and return 0."""
        self.terminate()
        return 0

    kill = close_pipe = terminate

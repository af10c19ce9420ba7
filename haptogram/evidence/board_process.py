"""The process of a virtual board: its start, its pipe, its log and its end."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError, LinkLostError
from haptogram.machine.view_process import child_process_environment

_PROGRAM: Final = "python -m sim_device: "
_REFUSED: Final = 2
_READY: Final = "listening on "
_START_S: Final = 60.0  # an interpreter with numpy takes seconds on a busy machine
_STOP_S: Final = 45.0  # the board takes up to 20 s to rebuild what it still owes
_POLL_S: Final = 0.01


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

    def wait_until_ready(self) -> None:
        """Wait until the board listens.

        Raises
        ------
        ConfigurationError
            The process ended, or was not ready in time: the text holds its last line.
        """
        end_s = time.monotonic() + _START_S
        while _READY not in self.log():
            if not self.is_running():
                raise ConfigurationError(self.how_it_ended())
            if time.monotonic() > end_s:
                raise ConfigurationError(
                    f"the virtual board was not ready within {_START_S:g} s: {self.log().strip()}"
                )
            time.sleep(_POLL_S)

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
            return self._process.wait(_STOP_S)
        except subprocess.TimeoutExpired as error:
            self.kill()
            raise LinkLostError(f"the virtual board did not end within {_STOP_S:g} s") from error

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait(_STOP_S)

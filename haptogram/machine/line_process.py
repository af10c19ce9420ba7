"""A process that is spoken to in lines of text, and answers in lines of text."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import tempfile
import weakref
from collections.abc import Callable, Sequence
from typing import IO, Final

from haptogram.errors import LinkLostError, plain_reason
from haptogram.machine.waiter import DescriptorWaiter

_CHUNK: Final = 1 << 16  # capacity of a pipe
_MOST_BYTES: Final = 1 << 28  # largest answer
_LAST_WORDS_S: Final = 1.0
_LAST_WORDS: Final = 4096  # bytes of them


class LineProcess:
    """A process that answers whatever is written to it.

    It is ended with this object, and with the program: its standard input comes to an end.

    Parameters
    ----------
    command : sequence of str
        Program and arguments.
    name : str
        Name of the process in errors.
    failure : callable
        Makes the exception that :meth:`ask` raises from its text.
    patience_s : float
        Longest silence within an answer.

    Raises
    ------
    LinkLostError
        Or what *failure* makes: if it cannot be started; from :meth:`ask`, if it has ended or is
        silent for too long.
    """

    def __init__(
        self,
        command: Sequence[str],
        name: str = "the board's process",
        failure: Callable[[str], Exception] = LinkLostError,
        patience_s: float = 20.0,
    ) -> None:
        self._name, self._failure, self._patience_s = name, failure, patience_s
        try:
            self._words = tempfile.TemporaryFile()  # noqa: SIM115  a pipe that nobody reads would fill
        except OSError as error:
            raise failure(f"{name} cannot be started: {plain_reason(error)}") from error
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._words,
                start_new_session=True,  # Ctrl-C is for this program, which then ends it
            )
        except (OSError, ValueError) as error:
            self._words.close()
            raise failure(f"{name} cannot be started: {plain_reason(error)}") from error
        self.close = weakref.finalize(self, _end_line_process, self._process, self._words)

    @property
    def runs(self) -> bool:
        """True while the process answers."""
        return self._process.poll() is None

    def ask(self, text: bytes, is_whole: Callable[[bytearray], bool]) -> bytes:
        """Write *text*; return what comes back, as soon as that is a whole answer."""
        assert self._process.stdin is not None  # PIPE
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(text)
            self._process.stdin.flush()
        except OSError as error:
            raise self._failure(f"{self._name} has ended: {self.complaint()}") from error
        answer, descriptor, waiter = bytearray(), self._process.stdout.fileno(), DescriptorWaiter()
        while not is_whole(answer):
            if not waiter.wait([descriptor], timeout_s=self._patience_s):
                _kill_line_process(self._process)
                raise self._failure(
                    f"{self._name} did not answer for {self._patience_s:g} s{_end_of(answer)}"
                )
            data = os.read(descriptor, _CHUNK)
            if not data:
                raise self._failure(f"{self._name} has ended: {self.complaint()}")
            answer += data
            if len(answer) > _MOST_BYTES:
                _kill_line_process(self._process)
                raise self._failure(f"{self._name} did not come to an end{_end_of(answer)}")
        return bytes(answer)

    def complaint(self) -> str:
        """End the process; return the last line of its standard error, or its status."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_LAST_WORDS_S)
        _kill_line_process(self._process)
        size = self._words.seek(0, os.SEEK_END)
        self._words.seek(max(0, size - _LAST_WORDS))
        lines = self._words.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"status {self._process.wait()}"


def _end_of(answer: bytearray) -> str:
    """Return ", after '...'" with the last line of a broken answer; '' if there is none."""
    lines = answer[-_LAST_WORDS:].decode(errors="replace").splitlines()
    return f", after {lines[-1][-60:]!r}" if lines else ""


def _kill_line_process(process: subprocess.Popen[bytes]) -> None:
    """End the process with all that it has started."""
    if process.poll() is None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _end_line_process(process: subprocess.Popen[bytes], words: IO[bytes]) -> None:
    """Kill the process, and close its pipes and the file of its messages."""
    _kill_line_process(process)
    for stream in (process.stdin, process.stdout, words):
        if stream is not None:
            with contextlib.suppress(OSError):  # of bytes that it does not take any more
                stream.close()

"""The back door of a board that runs: its records as they come, from a file or a local socket."""

from __future__ import annotations

import json
import os
import socket
import time
from typing import Any, Final

from haptogram.errors import ConfigurationError, plain_reason, unreadable_file
from haptogram.machine.closing import ClosedByWith

UNIX_PREFIX: Final = "unix:"
_AT_A_TIME: Final = 1 << 20  # bytes: about a thousand latches
_LONGEST_LINE: Final = 1 << 22
_POLL_S: Final = 0.01


class BackdoorReader(ClosedByWith):
    """Reads the records of one board, and never waits for them.

    Parameters
    ----------
    source : str
        ``unix:PATH`` of the socket that a board listens on, or a file that it appends to.

    Attributes
    ----------
    is_open : bool
        Whether more records may come: a file may grow as long as it is read.

    Raises
    ------
    ConfigurationError
        There is no such socket or file.

    Examples
    --------
    >>> BackdoorReader("unix:/nowhere")
    Traceback (most recent call last):
        ...
    haptogram.errors.ConfigurationError: no board listens at unix:/nowhere (there is no such \
directory): start one with haptogram board --backdoor unix:/nowhere
    """

    def __init__(self, source: str) -> None:
        self.is_open = True
        self._source = source
        self._unread = b""
        self._lines = 0
        is_socket = source.startswith(UNIX_PREFIX)
        self._input: _BackdoorSocketReader | _BackdoorFileStream = (
            _BackdoorSocketReader(source) if is_socket else _BackdoorFileStream(source)
        )

    def read(self) -> list[dict[str, Any]]:
        """Return the records that came since the last call, about a thousand at most.

        Raises
        ------
        ConfigurationError
            A line that is no record; it is named by its number.
        """
        while data := self._input.receive():
            *lines, self._unread = (self._unread + data).split(b"\n")
            if len(self._unread) > _LONGEST_LINE:
                raise ConfigurationError(f"{self._source}: line {self._lines + 1} has no end")
            if lines:
                return [self._record(line) for line in lines]
        self.is_open = data is not None
        return []

    def read_first(self, patience_s: float = 5.0) -> list[dict[str, Any]]:
        """Return the first records, as soon as there is one.

        Raises
        ------
        ConfigurationError
            None comes for *patience_s*.
        """
        end_s = time.monotonic() + patience_s
        while not (records := self.read()):
            if time.monotonic() > end_s or not self.is_open:
                raise ConfigurationError(f"{self._source}: no record of a back door came")
            time.sleep(_POLL_S)
        return records

    def close(self) -> None:
        """Close the file or the connection."""
        self.is_open = False
        self._input.close()

    def _record(self, line: bytes) -> dict[str, Any]:
        self._lines += 1
        try:
            record: dict[str, Any] = json.loads(line)
            record["kind"]
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            raise ConfigurationError(
                f"{self._source}: line {self._lines} is no record of a back door"
            ) from error
        return record


class _BackdoorSocketReader:
    def __init__(self, source: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._socket.connect(source.removeprefix(UNIX_PREFIX))
        except OSError as error:
            self.close()
            raise ConfigurationError(
                f"no board listens at {source} ({plain_reason(error)}): start one with "
                f"haptogram board --backdoor {source}"
            ) from error
        self._socket.setblocking(False)

    def receive(self) -> bytes | None:
        """Return the bytes that have come; None: no more will come."""
        try:
            return self._socket.recv(_AT_A_TIME) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def close(self) -> None:
        self._socket.close()


def _open_backdoor_reader(path: str, flags: int) -> int:
    """Open a file, or a pipe whether or not a board has begun to write to it."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


class _BackdoorFileStream:
    def __init__(self, path: str) -> None:
        try:
            self._file = open(path, "rb", buffering=0, opener=_open_backdoor_reader)  # noqa: SIM115  closed by close()
        except OSError as error:
            raise unreadable_file(path, error) from error

    def receive(self) -> bytes | None:
        """Return the bytes that were appended."""
        return self._file.read(_AT_A_TIME) or b""

    def close(self) -> None:
        self._file.close()

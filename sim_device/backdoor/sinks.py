"""Sinks of the back door's records: a file, or the clients of a local socket."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError, writing_file
from haptogram.machine.files import make_folder_of

from ..line.socket_server import UnixListener

_LOG: Final = logging.getLogger(__name__)
UNIX_PREFIX: Final = "unix:"
CLIENT_BUFFER: Final = 8 << 20  # bytes that a client may fall behind before it is dropped


def open_backdoor_sink(
    target: str, wait: Callable[[], bool] | None = None
) -> FileSink | SocketSink:
    """Return the sink that *target* names: a file, or ``unix:PATH``.

    A FIFO is open when somebody reads it. Between two looks for a reader *wait* waits, and tells
    whether the sink is wanted any longer; by default the system waits.

    Raises
    ------
    ConfigurationError
        If it cannot be opened.
    """
    if target.startswith(UNIX_PREFIX):
        return SocketSink(UnixListener(target.removeprefix(UNIX_PREFIX)))
    return FileSink(target, wait)


def _opened_backdoor(path: str, wait: Callable[[], bool] | None) -> int:
    """Open the file at *path* to append to it, and return its descriptor.

    A FIFO is opened when somebody reads it: *wait* waits between two looks, and False from it ends
    that with ConfigurationError. None: the system waits.
    """
    if wait is None or not Path(path).is_fifo():
        return os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
    while True:
        try:
            descriptor = os.open(path, os.O_WRONLY | os.O_NONBLOCK)
        except OSError as error:
            if error.errno != errno.ENXIO:
                raise
            if not wait():
                raise ConfigurationError(f"nobody reads {path}, and the board has ended") from error
        else:
            os.set_blocking(descriptor, True)
            return descriptor


class FileSink:
    """Appends to a file; a line is there as soon as it was written."""

    def __init__(self, path: str, wait: Callable[[], bool] | None = None) -> None:
        self._path = path
        with writing_file(path, "backdoor"):
            make_folder_of(Path(path))
            self._file = os.fdopen(_opened_backdoor(path, wait), "ab", buffering=0)

    def write(self, line: bytes) -> None:
        """Append one line.

        Raises
        ------
        ConfigurationError
            If the file takes no more: the disc is full.
        """
        with writing_file(self._path, "backdoor"):
            while line:
                line = line[self._file.write(line) :]

    def serve(self) -> None:
        """Do nothing: a file waits for nobody."""

    @property
    def pending(self) -> int:
        """Return 0: a file takes everything."""
        return 0

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class SocketSink:
    """Sends to every client the first record, and then all that come while it is connected.

    A client that falls :data:`CLIENT_BUFFER` bytes behind is dropped, which the log says: the
    others, and the board, must not wait for it.
    """

    def __init__(self, listener: UnixListener) -> None:
        self._listener = listener
        self._first = b""
        self._unsent: dict[int, bytearray] = {}

    def write(self, line: bytes) -> None:
        """Send one line to every client."""
        self._first = self._first or line
        for unsent in self._unsent.values():
            unsent += line
        self.serve()

    def serve(self) -> None:
        """Take clients in, and send them what they take."""
        while (client := self._listener.accept()) is not None:
            self._unsent[client] = bytearray(self._first)
        for client, unsent in list(self._unsent.items()):
            if not _send_backdoor_records(client, unsent):
                self._drop(client)
            elif len(unsent) > CLIENT_BUFFER:
                _LOG.warning("a client of the back door is %d bytes behind: dropped", len(unsent))
                self._drop(client)

    @property
    def pending(self) -> int:
        """Bytes that the clients have not taken yet."""
        return sum(map(len, self._unsent.values()))

    def close(self) -> None:
        """Stop listening, and let the clients go."""
        self._listener.close()
        for client in list(self._unsent):
            self._drop(client)

    def _drop(self, client: int) -> None:
        """Close the connection of a client, with its unsent records."""
        del self._unsent[client]
        with contextlib.suppress(OSError):
            os.close(client)


def _send_backdoor_records(client: int, unsent: bytearray) -> bool:
    """Send what *client* takes of *unsent* now, and delete it; return False if it is gone."""
    try:
        while unsent:
            del unsent[: os.write(client, unsent)]
    except BlockingIOError:
        return True
    except OSError:
        return False
    return True

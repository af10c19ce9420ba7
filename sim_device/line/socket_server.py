"""Sockets that listen: who is taken in, and the local socket of the back door."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from pathlib import Path
from typing import Any, Final

from haptogram.errors import ConfigurationError, plain_reason
from haptogram.machine.files import make_folder_of

from .port import PortLostError

# accept(2): no client waits, or the client that waited has gone, or its network has
_NO_CLIENT: Final = (
    *(errno.EAGAIN, errno.EWOULDBLOCK, errno.ECONNABORTED, errno.EINTR, errno.EPROTO),
    *(errno.ENETDOWN, errno.ENETUNREACH, errno.EHOSTDOWN, errno.EHOSTUNREACH),
)


def admitted_client(server: socket.socket, name: str) -> tuple[socket.socket, Any] | None:
    """Return a non-blocking client that waits at a listening socket, with its address, or None.

    Raises
    ------
    PortLostError
        If nobody can be taken in; *name* is the path or the address of the socket.
    """
    try:
        client, address = server.accept()
    except OSError as error:
        if error.errno in _NO_CLIENT:
            return None
        why = f"no client can be taken in: {plain_reason(error)}"
        raise PortLostError(f"{name}: {why}") from error
    client.setblocking(False)
    return client, address


class UnixListener:
    """A local socket whose clients only listen; see :class:`~sim_device.backdoor.sinks.SocketSink`.

    Parameters
    ----------
    path : str
        Name of the socket in the file system; one that nobody listens on is replaced.

    Raises
    ------
    ConfigurationError
        If the name cannot be used.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.setblocking(False)
        try:
            make_folder_of(Path(path))
            _remove_stale_socket(path)
            self._socket.bind(path)
            self._socket.listen()
        except OSError as error:
            self._socket.close()
            raise ConfigurationError(
                f"backdoor unix:{path}: cannot listen there: {plain_reason(error)}"
            ) from error

    def accept(self) -> int | None:
        """Return a non-blocking descriptor of a client that waits, or None."""
        admitted = admitted_client(self._socket, f"unix:{self._path}")
        return None if admitted is None else admitted[0].detach()

    def close(self) -> None:
        """Stop listening and remove the name."""
        self._socket.close()
        with contextlib.suppress(OSError):
            os.unlink(self._path)


def _remove_stale_socket(path: str) -> None:
    """Remove a socket that nobody listens on: its owner was killed."""
    if not Path(path).is_socket():
        return
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(path)
        except ConnectionRefusedError:
            os.unlink(path)

"""Sockets that listen: who is taken in, and the local socket of the back door."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import socket
import time
from pathlib import Path
from typing import Any, Final

from haptogram.errors import ConfigurationError, plain_reason
from haptogram.machine.files import make_folder_of

from .port import PortLostError

_LOG: Final = logging.getLogger(__name__)
# accept(2): no client waits, or the client that waited has gone, or its network has
_NO_CLIENT: Final = (
    *(errno.EAGAIN, errno.EWOULDBLOCK, errno.ECONNABORTED, errno.EINTR, errno.EPROTO),
    *(errno.ENETDOWN, errno.ENETUNREACH, errno.EHOSTDOWN, errno.EHOSTUNREACH),
)
_SHORTAGE: Final = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_PATIENCE_NS: Final = 200_000_000  # time until descriptors may be available again


class SocketDoorman:
    """Takes clients in at a listening socket, and waits where descriptors have run out.

    Parameters
    ----------
    server : socket.socket
        Listens, non-blocking.
    name : str
        Path or address of the socket, for messages.

    Attributes
    ----------
    refused : int
        How often no descriptor was left for a client.
    """

    def __init__(self, server: socket.socket, name: str) -> None:
        self._server, self._name = server, name
        self._is_short = False
        self.refused = 0
        self.due_ns: int | None = None

    @property
    def is_looking(self) -> bool:
        """True if a waiting client is seen now; else at :attr:`due_ns`."""
        return self.due_ns is None or time.monotonic_ns() >= self.due_ns

    def admit(self) -> tuple[socket.socket, Any] | None:
        """Return a non-blocking client that waits, with its address, or None.

        Raises
        ------
        PortLostError
            If nobody can be taken in any more.
        """
        if not self.is_looking:
            return None
        self.due_ns = None
        try:
            client, address = self._server.accept()
        except OSError as error:
            self._handle_accept_error(error)
            return None
        if self._is_short:
            _LOG.warning("%s: clients are taken in again", self._name)
        self._is_short = False
        client.setblocking(False)
        return client, address

    def _handle_accept_error(self, error: OSError) -> None:
        """Ignore the error if no client came, wait if the system lacks resources; else raise.

        The wait for resources is 200 ms.
        """
        if error.errno in _NO_CLIENT:
            return
        if error.errno not in _SHORTAGE:
            why = f"no client can be taken in: {plain_reason(error)}"
            raise PortLostError(f"{self._name}: {why}") from error
        self.refused += 1
        self.due_ns = time.monotonic_ns() + _PATIENCE_NS
        if not self._is_short:  # logged once, until a client gets in
            _LOG.warning("%s: no client can be taken in: %s", self._name, plain_reason(error))
        self._is_short = True


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
        self._doorman = SocketDoorman(self._socket, f"unix:{path}")

    def accept(self) -> int | None:
        """Return a non-blocking descriptor of a client that waits, or None."""
        admitted = self._doorman.admit()
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

"""A TCP server as the board's port."""

from __future__ import annotations

import errno
import logging
import socket
from typing import Final

from haptogram.errors import ConfigurationError, plain_reason

from .port import BoardPort
from .socket_server import SocketDoorman

_LOG: Final = logging.getLogger(__name__)
_GONE: Final = (errno.EIO, errno.EPIPE, errno.ECONNRESET, errno.ENXIO, errno.ENODEV)


class TcpPort(BoardPort):
    """A TCP server for one client at a time; another one is turned away.

    Parameters
    ----------
    host, port
        Where to listen, by IPv6 if the host is an address with colons; port 0 takes any that is
        free.

    Raises
    ------
    ConfigurationError
        If the address cannot be used.
    """

    def __init__(self, host: str, port: int) -> None:
        try:
            self._server = socket.create_server((host, port), family=_tcp_family(host))
        except (OSError, OverflowError) as error:
            raise ConfigurationError(
                f"tcp {_tcp_address(host, port)}: cannot listen there: {plain_reason(error)}; "
                "name another"
            ) from error
        self._server.setblocking(False)
        self._client: socket.socket | None = None
        self._departed = False
        self._is_there = True
        super().__init__(-1, f"socket://{_tcp_address(*self._server.getsockname()[:2])}")
        self._doorman = SocketDoorman(self._server, self.description)

    @property
    def due_ns(self) -> int | None:
        """When a client may be taken in again, if descriptors had run out."""
        return self._doorman.due_ns

    def reading(self) -> list[int]:
        """Return the server, unless nobody can be taken in, and the client where there is one."""
        server = [self._server.fileno()] if self._doorman.is_looking else []
        return [*server, *([self._fd] if self._client else [])]

    def read(self, limit: int) -> bytes:
        """Take a client in where one waits, and return what the present one sent."""
        self._accept()
        if self._departed:
            return b""  # the board must know that one has left before it gets bytes of the next
        if self._client is None or limit <= 0:
            return b""
        try:
            data = self._client.recv(limit)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop_client()
        return data

    def write(self, data: bytes) -> None:
        """Hand over *data*; without a client it is lost, as on a cable without one."""
        if self._client is not None:
            super().write(data)

    def take_departure(self) -> bool:
        """Return True if a client has gone since the last call."""
        departed, self._departed = self._departed, False
        return departed

    def plug(self, is_there: bool) -> None:
        """Let the client go and take none in, or take one in again."""
        self._is_there = is_there
        if not is_there:
            self._drop_client()

    def close(self) -> None:
        """Close the client and the server."""
        if self._client is not None:
            self._client.close()
        self._server.close()

    def _accept(self) -> None:
        """Admit a waiting client, if there is one; send it away while another is connected."""
        if (admitted := self._doorman.admit()) is None:
            return
        client, address = admitted
        if self._client is not None and _has_tcp_client_left(self._client):
            self._drop_client()
        if self._client is not None or not self._is_there:
            why = "there is one already" if self._client is not None else "the port is gone"
            _LOG.info("client %s turned away: %s", _tcp_address(*address[:2]), why)
            client.close()
            return
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client, self._fd = client, client.fileno()
        _LOG.info("client %s connected", _tcp_address(*address[:2]))

    def _drop_client(self) -> None:
        """Close the connection of the client, if there is one, with its unsent bytes."""
        if self._client is not None:
            self._client.close()
            self._client, self._fd, self._unsent = None, -1, b""
            self._departed = True
            _LOG.info("client gone")

    def _lost(self, error: OSError) -> bytes:
        """Drop a client whose connection is lost and return no bytes; raise for other errors."""
        if error.errno not in _GONE:
            return super()._lost(error)
        self._drop_client()
        return b""


def _tcp_family(host: str) -> socket.AddressFamily:
    """Return the address family of a host: IPv6 if it has a colon."""
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def _tcp_address(host: str, port: int) -> str:
    """Return HOST:PORT as text, with brackets around an IPv6 address."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _has_tcp_client_left(client: socket.socket) -> bool:
    """Return True if *client* has closed its end and all that it sent has been read.

    Also if its connection is broken.
    """
    try:
        return not client.recv(1, socket.MSG_PEEK)
    except BlockingIOError:
        return False
    except OSError:
        return True

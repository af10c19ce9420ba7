"""Where the bytes come and go: pseudo-terminal, TCP, serial port.  Owns file descriptors.

Every port is non-blocking and keeps what the other side does not take in a bounded buffer: while
anything is ``pending``, the caller holds back, and the board's own output limit does the rest.
"""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import socket
import time
from pathlib import Path
from typing import Any, Final

import serial

from haptogram.errors import ConfigurationError, HaptogramError
from haptogram.machine.posix import posix_module

from .pty_link import INSTEAD_OF_PTY, PtyLink

_LOG: Final = logging.getLogger(__name__)
_CLOSED: Final = -1
# accept(2): nobody waits, or who waited has gone, or his network has
_NO_CLIENT: Final = (
    *(errno.EAGAIN, errno.EWOULDBLOCK, errno.ECONNABORTED, errno.EINTR, errno.EPROTO),
    *(errno.ENETDOWN, errno.ENETUNREACH, errno.EHOSTDOWN, errno.EHOSTUNREACH),
)
_SHORTAGE: Final = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_PATIENCE_NS: Final = 200_000_000  # until descriptors may be there again
_GONE: Final = (errno.EIO, errno.EPIPE, errno.ECONNRESET, errno.ENXIO, errno.ENODEV)


class PortLostError(HaptogramError):
    """The port went away and will not come back: a cable was pulled."""


class Doorman:
    """Takes clients in at a listening socket, and waits where descriptors have run out.

    Parameters
    ----------
    server : socket.socket
        Listens, non-blocking.
    name : str
        What it listens on, for messages.

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
        """Whether a client that waits would be seen now; else at :attr:`due_ns`."""
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
            self._excuse(error)
            return None
        if self._is_short:
            _LOG.warning("%s: clients are taken in again", self._name)
        self._is_short = False
        client.setblocking(False)
        return client, address

    def _excuse(self, error: OSError) -> None:
        if error.errno in _NO_CLIENT:
            return
        if error.errno not in _SHORTAGE:
            why = f"no client can be taken in: {error.strerror}"
            raise PortLostError(f"{self._name}: {why}") from error
        self.refused += 1
        self.due_ns = time.monotonic_ns() + _PATIENCE_NS
        if not self._is_short:  # told once, until somebody gets in
            _LOG.warning("%s: no client can be taken in: %s", self._name, error.strerror)
        self._is_short = True


class Port:
    """A file descriptor that bytes go through.

    Attributes
    ----------
    description : str
        What a host has to open.
    """

    def __init__(self, fd: int, description: str) -> None:
        self._fd = fd
        self._unsent = b""
        self.description = description

    @property
    def due_ns(self) -> int | None:
        """When it has to be looked at, on the monotonic clock, though nothing comes; or None."""
        return None

    @property
    def pending(self) -> int:
        """Bytes that the other side has not taken yet."""
        return len(self._unsent)

    def reading(self) -> list[int]:
        """Return the file descriptors to wait on for input."""
        return [self._fd]

    def writing(self) -> list[int]:
        """Return the file descriptors to wait on while something is pending."""
        return [self._fd] if self._unsent else []

    def read(self, limit: int) -> bytes:
        """Return what has come, at most *limit* bytes; empty if nothing has.

        Raises
        ------
        PortLostError
            If the port is gone for good.
        """
        if limit <= 0:
            return b""
        try:
            data = os.read(self._fd, limit)
        except BlockingIOError:
            return b""
        except OSError as error:
            return self._lost(error)
        return data or self._lost(OSError(errno.EIO, "the other side is gone"))

    def write(self, data: bytes) -> None:
        """Hand over *data*, or keep what is not taken; see :attr:`pending`."""
        self._unsent += data
        if not self._unsent:
            return
        try:
            self._unsent = self._unsent[os.write(self._fd, self._unsent) :]
        except BlockingIOError:
            return
        except OSError as error:
            self._lost(error)

    def take_departure(self) -> bool:
        """Return whether the client has gone since the last call, where that can be told."""
        return False

    def plug(self, is_there: bool) -> None:
        """Let the port vanish, as if a cable were pulled, or come back, where it can do that."""

    def close(self) -> None:
        """Close the port and remove what it left in the file system."""
        with contextlib.suppress(OSError):
            os.close(self._fd)

    def _lost(self, error: OSError) -> bytes:
        """Decide what *error* means; here: the port is gone."""
        raise PortLostError(f"{self.description}: {error.strerror}") from error


class PtyPort(Port):
    """A pseudo-terminal with a stable name.

    The board keeps one descriptor of the slave side open, so that clients may come and go: without
    it, reading would fail with EIO from the moment that the first one closes.

    Parameters
    ----------
    link : path
        Name of the symbolic link to the pseudo-terminal.

    Raises
    ------
    ConfigurationError
        If a live board holds the link, or something else is in its place.
    """

    def __init__(self, link: str | Path) -> None:
        self._link = PtyLink(Path(link))
        super().__init__(_CLOSED, str(link))
        self._slave = _CLOSED
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        pty, tty = (posix_module(name, "a pty port", INSTEAD_OF_PTY) for name in ("pty", "tty"))
        self._fd, self._slave = pty.openpty()
        for fd in (self._fd, self._slave):
            tty.setraw(fd)  # cooked, a terminal would echo, and turn 0A into 0D 0A
        os.set_blocking(self._fd, False)
        self._link.point_to(os.ttyname(self._slave))

    def reading(self) -> list[int]:
        """Return the file descriptors to wait on for input: none while it is gone."""
        return [] if self._fd == _CLOSED else super().reading()

    def read(self, limit: int) -> bytes:
        """Return what has come; nothing while the port is gone."""
        return b"" if self._fd == _CLOSED else super().read(limit)

    def write(self, data: bytes) -> None:
        """Hand over *data*; it is lost while the port is gone."""
        if self._fd != _CLOSED:
            super().write(data)

    def plug(self, is_there: bool) -> None:
        """Close both sides and remove the link, or open another pair under the same link."""
        if is_there and self._fd == _CLOSED:
            self._open()
        elif not is_there:
            self._link.withdraw()
            self._close_both()

    def close(self) -> None:
        """Remove the link, then close both sides."""
        self._link.release()
        self._close_both()

    def _close_both(self) -> None:
        for fd in {self._fd, self._slave} - {_CLOSED}:
            with contextlib.suppress(OSError):
                os.close(fd)
        self._fd = self._slave = _CLOSED
        self._unsent = b""

    def _lost(self, error: OSError) -> bytes:
        if error.errno == errno.EIO:  # a client closed: only said where our slave did not count
            return b""
        return super()._lost(error)


class TcpPort(Port):
    """A TCP server for one client at a time; another one is turned away.

    Parameters
    ----------
    host, port
        Where to listen; port 0 takes any that is free.

    Raises
    ------
    ConfigurationError
        If the address cannot be used.
    """

    def __init__(self, host: str, port: int) -> None:
        try:
            self._server = socket.create_server((host, port))
        except (OSError, OverflowError) as error:
            raise ConfigurationError(f"cannot listen on {host}:{port}: {error}") from error
        self._server.setblocking(False)
        self._client: socket.socket | None = None
        self._departed = False
        self._is_there = True
        name = self._server.getsockname()
        super().__init__(-1, f"socket://{name[0]}:{name[1]}")
        self._doorman = Doorman(self._server, self.description)

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
        """Return whether a client has gone since the last call."""
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
        if (admitted := self._doorman.admit()) is None:
            return
        client, address = admitted
        if self._client is not None or not self._is_there:
            why = "there is one already" if self._client is not None else "the port is gone"
            _LOG.info("client %s:%d turned away: %s", *address[:2], why)
            client.close()
            return
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client, self._fd = client, client.fileno()
        _LOG.info("client %s:%d connected", *address[:2])

    def _drop_client(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client, self._fd, self._unsent = None, -1, b""
            self._departed = True
            _LOG.info("client gone")

    def _lost(self, error: OSError) -> bytes:
        if error.errno not in _GONE:
            return super()._lost(error)
        self._drop_client()
        return b""


class SerialPort(Port):
    """A real serial port: the board sits at the far end of a cable.

    Raises
    ------
    ConfigurationError
        If the port cannot be opened.
    """

    def __init__(self, name: str, baud: int) -> None:
        try:
            self._serial = serial.Serial(name, baud, timeout=0, exclusive=True)
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"cannot open {name}: {error}") from error
        super().__init__(self._serial.fileno(), name)
        os.set_blocking(self._fd, False)
        _tell_end_from_silence(self._fd)

    def close(self) -> None:
        """Close the port."""
        self._serial.close()


def _tell_end_from_silence(fd: int) -> None:
    """Let a read without data fail, not return nothing, which a pulled cable does as well."""
    termios = posix_module("termios", "a serial port of the virtual board", INSTEAD_OF_PTY)
    settings = termios.tcgetattr(fd)
    settings[6][termios.VMIN] = 1
    termios.tcsetattr(fd, termios.TCSANOW, settings)


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
            _remove_stale_socket(path)
            self._socket.bind(path)
            self._socket.listen()
        except OSError as error:
            self._socket.close()
            raise ConfigurationError(f"cannot listen on unix:{path}: {error}") from error
        self._doorman = Doorman(self._socket, f"unix:{path}")

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

"""Bytes to and from a port, with bounded waits and the port's own clock.

A :class:`Transport` is the one place where the host waits.  Whether its time is that of the wall or
the virtual time of an emulated board, the caller cannot tell and does not need to.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import stat
import time
from collections.abc import Callable, Iterator
from typing import Any, Final, Protocol
from urllib.parse import urlsplit

import serial

from haptogram import errors
from haptogram.machine.waiter import DescriptorWaiter
from haptogram.settings.arguments import check_number, check_whole, shown_argument
from haptogram.settings.board_url import SCHEME

DEFAULT_BAUDRATE: Final = 3_000_000
_MOST_BAUDRATE: Final = 1_000_000_000  # a line without a rate, such as a pty, can be taken as fast
_CHUNK: Final = 65_536
_UNREGISTERED: Final = "; sim_device.register_url_handler() makes it known"
_GONE: Final = (OSError, ValueError, TypeError)  # errors of a lost or closed port
_BUSY: Final = frozenset({errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK})
_ABSENT: Final = frozenset({errno.ENOENT, errno.ENODEV, errno.ENXIO})
_NETWORKED: Final = ("socket", "rfc2217")
_UNREACHED: Final = frozenset({errno.EHOSTUNREACH, errno.ENETUNREACH})


class Transport(Protocol):
    """A port that is open."""

    @property
    def url(self) -> str:
        """URL by which the port was opened."""

    def now_ns(self) -> int:
        """Return the time on the clock of this port: monotonic, nanoseconds."""

    def read_available(self, deadline_ns: int) -> bytes:
        """Return received bytes as soon as there are any, ``b""`` at the deadline.

        Raises
        ------
        LinkLostError
            If the port is gone.
        """

    def write_some(self, data: bytes) -> int:
        """Hand over as many bytes as the port takes at once; return how many these were.

        Raises
        ------
        LinkLostError
            If the port is gone.
        """

    def close(self) -> None:
        """Close the port; never raises."""


def check_port(port: object, baudrate: int, timeout_s: float) -> None:
    """Refuse a port that is neither a URL nor a Transport, before anything is opened."""
    methods = ("url", "now_ns", "read_available", "write_some", "close")
    if not (isinstance(port, str) and port) and not all(hasattr(port, name) for name in methods):
        raise errors.ConfigurationError(
            f"port is {shown_argument(port)}, must be a URL such as '/dev/ttyUSB0', "
            "or an open Transport"
        )
    check_whole("baudrate", baudrate, 1, _MOST_BAUDRATE)
    check_number("timeout_s", timeout_s, 0.001, 3600.0)


class FdTransport:
    """A port with a file descriptor: opened by pyserial, read and written directly.

    pyserial's own ``read`` and ``write`` cost up to three system calls each and can report a
    timeout for bytes that were written; the descriptor costs one.

    Parameters
    ----------
    port : serial.SerialBase
        Open, non-blocking port.
    url : str
        Its name, for messages.
    """

    def __init__(self, port: serial.SerialBase, url: str) -> None:
        self._port = port
        self._fd = int(port.fileno())
        self._waiter = DescriptorWaiter()
        self.url = url

    def now_ns(self) -> int:
        """Return the time of the monotonic clock."""
        return time.monotonic_ns()

    def read_available(self, deadline_ns: int) -> bytes:
        """Return received bytes; see :class:`Transport`."""
        wait_s = max(0, deadline_ns - time.monotonic_ns()) / 1e9
        try:
            if not self._waiter.wait([self._fd], timeout_s=wait_s):
                return b""
            data = os.read(self._fd, _CHUNK)
        except _GONE as error:
            raise _lost_transport(self.url, error) from error
        if not data:
            raise errors.LinkLostError(f"{self.url}: the other end closed the port")
        return data

    def write_some(self, data: bytes) -> int:
        """Hand over as many bytes as the port takes; see :class:`Transport`."""
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0
        except _GONE as error:
            raise _lost_transport(self.url, error) from error

    def close(self) -> None:
        """Close the port."""
        self._fd = -1
        _close_transport(self._port)


class PyserialTransport:
    """A port without a file descriptor, through pyserial's own methods.

    A port that has a method ``now_ns`` brings its own clock (virtual time): there, a blocking read
    is what makes time pass. One that has ``read_until_ns`` reads by a deadline of that clock.

    Parameters
    ----------
    port : serial.SerialBase
        Open port.
    url : str
        Its name, for messages.
    """

    def __init__(self, port: Any, url: str) -> None:  # the stubs of SerialBase lack in_waiting
        self._port = port
        self._port.write_timeout = 0
        clock = getattr(port, "now_ns", None)
        self.now_ns: Callable[[], int] = clock if callable(clock) else time.monotonic_ns
        self._read_until_ns: Callable[[int], bytes] | None = getattr(port, "read_until_ns", None)
        self.url = url

    def read_available(self, deadline_ns: int) -> bytes:
        """Return received bytes; see :class:`Transport`."""
        try:
            if self._read_until_ns is not None:  # all at once
                return self._read_until_ns(deadline_ns)
            data = self._read(self._port.in_waiting)
            while not data and (wait_ns := deadline_ns - self.now_ns()) > 0:
                self._port.timeout = wait_ns / 1e9
                data = self._read(1)
            return data + self._read(self._port.in_waiting) if data else b""
        except errors.LinkError:
            raise
        except _GONE as error:
            raise _lost_transport(self.url, error) from error

    def _read(self, size: int) -> bytes:
        """Return up to *size* bytes that wait at the port."""
        return bytes(self._port.read(size)) if size else b""

    def write_some(self, data: bytes) -> int:
        """Hand over as many bytes as the port takes; see :class:`Transport`."""
        try:
            # Some handlers return nothing, and mean that they took everything.
            written = self._port.write(data)
            return len(data) if written is None else int(written)
        except serial.SerialTimeoutException:
            return 0
        except errors.LinkError:
            raise
        except _GONE as error:
            raise _lost_transport(self.url, error) from error

    def close(self) -> None:
        """Close the port."""
        _close_transport(self._port)


class ClosedTransport:
    """A port that its driver has closed: using it is an error that says so.

    Parameters
    ----------
    port : Transport
        The port, closed by now; its clock goes on.
    """

    def __init__(self, port: Transport) -> None:
        self.url = port.url
        self.now_ns = port.now_ns

    def read_available(self, deadline_ns: int) -> bytes:  # noqa: ARG002  nothing comes
        """Refuse to read."""
        raise self.error()

    def write_some(self, data: bytes) -> int:  # noqa: ARG002  nothing goes
        """Refuse to write."""
        raise self.error()

    def error(self) -> errors.LinkLostError:
        """Return the error of whoever uses the port."""
        return errors.LinkLostError(f"{self.url}: this driver was closed; open another one")

    def close(self) -> None:
        """Do nothing: it is closed."""


def open_transport(url: str, *, baudrate: int = DEFAULT_BAUDRATE) -> Transport:
    """Open a port for this program alone.

    Parameters
    ----------
    url : str
        Anything that ``serial.serial_for_url`` takes, but ``rfc2217://``: ``/dev/ttyUSB0``,
        ``/dev/pts/7``, ``socket://host:port``, ``haptogram://`` (once registered).
    baudrate : int
        Bits per second; a port without a line takes no notice.

    Raises
    ------
    PortNotFoundError
        There is no such port, or nothing listens there.
    PortBusyError
        Another program holds it.
    LinkError
        It cannot be opened for another reason (permission, not a serial port).
    ConfigurationError
        *url* or *baudrate* make no sense, or pyserial cannot write there without waiting.
    """
    check_whole("baudrate", baudrate, 1, _MOST_BAUDRATE)
    _check_transport_address(url)
    port = _open_serial_transport(url, baudrate)
    try:
        port.fileno()
        if _writes_by_itself(port):
            return PyserialTransport(port, url)
    except (AttributeError, OSError):  # io.UnsupportedOperation is an OSError
        try:
            return PyserialTransport(port, url)
        except NotImplementedError as error:  # of rfc2217://
            port.close()
            text = f"port {url!r}: {error}; take socket://HOST:PORT"
            raise errors.ConfigurationError(text) from error
    _send_at_once(port)
    return FdTransport(port, url)


def _writes_by_itself(port: Any) -> bool:
    """Return True if the port does more with the bytes than its descriptor would: ``spy://``."""
    return isinstance(port, serial.Serial) and type(port).write is not serial.Serial.write


def _send_at_once(port: Any) -> None:
    """Disable Nagle's algorithm on a TCP port; do nothing for another port.

    Nagle's algorithm keeps a small write back until the last one is acknowledged, which takes a
    Linux host up to 40 ms.
    """
    if not stat.S_ISSOCK(os.fstat(port.fileno()).st_mode):
        return
    with contextlib.suppress(OSError), socket.socket(fileno=os.dup(port.fileno())) as line:
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # OSError: it is not TCP


def _check_transport_address(url: str) -> None:
    """Refuse a URL of a network port without host and port; pyserial's own error is jargon."""
    scheme = url.partition("://")[0].lower()
    if scheme not in _NETWORKED:
        return
    try:
        parts = urlsplit(url)
        is_whole = bool(parts.hostname and parts.port)
    except ValueError:  # a port that is no number, or too large; half an IPv6 address
        is_whole = False
    if not is_whole:
        raise errors.ConfigurationError(f"port {url!r}, must be {scheme}://HOST:PORT")


def _open_serial_transport(url: str, baudrate: int) -> Any:
    """Open a serial port for this program alone; an error says why it did not open."""
    try:
        # exclusive: a second program that asks for the lock gets PortBusyError, not half the bytes.
        return serial.serial_for_url(url, baudrate=baudrate, timeout=0, exclusive=True)
    except OSError as error:  # SerialException is one
        raise _transport_opening_error(url, error) from error
    except errors.ConfigurationError:
        raise
    except ValueError as error:
        hint = _UNREGISTERED if url.startswith(SCHEME) else ""
        raise errors.ConfigurationError(
            f"port {url!r} at {baudrate} baud: {_transport_error_line(error)}{hint}"
        ) from error


def _transport_opening_error(url: str, error: OSError) -> errors.LinkError:
    """Return the error that says why *url* did not open."""
    codes = {found.errno for found in _transport_error_chain(error) if isinstance(found, OSError)}
    if codes & _BUSY:
        return errors.PortBusyError(f"{url}: another program holds this port")
    if errno.ECONNREFUSED in codes:
        return errors.PortNotFoundError(f"{url}: nothing listens there: the connection was refused")
    if codes & _UNREACHED:
        return errors.PortNotFoundError(f"{url}: that host cannot be reached")
    if any(isinstance(found, socket.gaierror) for found in _transport_error_chain(error)):
        return errors.PortNotFoundError(f"{url}: there is no such host")
    if errno.EISDIR in codes:
        return errors.LinkError(f"{url}: it is a folder; name a port, such as /dev/ttyUSB0")
    if codes & _ABSENT:
        return errors.PortNotFoundError(f"{url}: there is no such port")
    # termios.error is no OSError, and has its code as an argument.
    if any(found.args[:1] == (errno.ENOTTY,) for found in _transport_error_chain(error)):
        return errors.LinkError(f"{url}: it is no serial port; name one, such as /dev/ttyUSB0")
    return errors.LinkError(f"{url}: the port cannot be opened: {errors.plain_reason(error)}")


def _transport_error_chain(error: BaseException | None) -> Iterator[BaseException]:
    """Yield *error* and its causes, outermost first; without a cause, its context."""
    while error is not None:
        yield error
        error = error.__context__ if error.__cause__ is None else error.__cause__


def _transport_error_line(error: BaseException) -> str:
    """Return the text of an error on one line."""
    return " ".join(str(error).split())


def _lost_transport(url: str, error: BaseException) -> errors.LinkLostError:
    """Return the error that the port *url* was lost while open."""
    return errors.LinkLostError(f"{url}: the port is gone: {_transport_error_line(error)}")


def _close_transport(port: Any) -> None:
    """Close a port, and the socket that pyserial leaves open."""
    held = getattr(port, "_socket", None)  # pyserial leaves one open that was reset
    with contextlib.suppress(OSError, ValueError):
        port.close()
    if held is not None:
        held.close()

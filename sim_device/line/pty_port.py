"""A pseudo-terminal as the board's port."""

from __future__ import annotations

import contextlib
import errno
import os
import struct
import sys
from pathlib import Path
from typing import Final

from haptogram.machine.posix import posix_module

from .port import BoardPort
from .pty_link import INSTEAD_OF_PTY, PtyLink

_CLOSED: Final = -1
UNTOUCHED_BAUD: Final = 38_400  # default rate of a new pseudo-terminal
_TCGETS2: Final = 0x802C542A  # asm-generic/ioctls.h: as the names of termios have no odd rates
_TERMIOS2: Final = struct.Struct("4IB19x2I")  # flags, line, characters, rates in and out


class PtyPort(BoardPort):
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
        """Open a pseudo-terminal in raw mode, and point the link to it."""
        pty, tty = (posix_module(name, "a pty port", INSTEAD_OF_PTY) for name in ("pty", "tty"))
        self._fd, self._slave = pty.openpty()
        for fd in (self._fd, self._slave):
            tty.setraw(fd)  # cooked, a terminal would echo, and turn 0A into 0D 0A
        os.set_blocking(self._fd, False)
        self._link.point_to(os.ttyname(self._slave))

    @property
    def client_baud(self) -> int | None:
        """Rate that the client has set; None: none, or the system does not tell."""
        baud = None if self._slave == _CLOSED else baud_of_pty(self._slave)
        return None if baud == UNTOUCHED_BAUD else baud

    def reading(self) -> list[int]:
        """Return the file descriptors to wait on for input: none while it is gone."""
        return [] if self._fd == _CLOSED else super().reading()

    def read(self, limit: int) -> bytes:
        """Return the received bytes; none while the port is gone."""
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
        """Close both ends of the pseudo-terminal."""
        for fd in {self._fd, self._slave} - {_CLOSED}:
            with contextlib.suppress(OSError):
                os.close(fd)
        self._fd = self._slave = _CLOSED
        self._unsent = b""

    def _lost(self, error: OSError) -> bytes:
        """Return no bytes if the error means that a client closed; else raise PortLostError."""
        if error.errno == errno.EIO:  # a client closed: only said where our slave did not count
            return b""
        return super()._lost(error)


def baud_of_pty(descriptor: int) -> int | None:
    """Return the rate at which *descriptor* sends, or None where the system does not tell.

    A pseudo-terminal carries bytes at any rate, so a client with a wrong one would never notice; a
    real board would understand nothing.
    """
    if not sys.platform.startswith("linux"):
        return None
    fcntl = posix_module("fcntl", "a pty port", INSTEAD_OF_PTY)
    with contextlib.suppress(OSError):
        told = fcntl.ioctl(descriptor, _TCGETS2, bytes(_TERMIOS2.size))
        return int(_TERMIOS2.unpack(told)[-1])
    return None

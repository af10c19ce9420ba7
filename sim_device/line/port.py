"""A port of the board: a file descriptor that bytes go through.

Every port is non-blocking and keeps what the other side does not take in a bounded buffer: while
anything is ``pending``, the caller holds back, and the board's own output limit does the rest.
"""

from __future__ import annotations

import contextlib
import errno
import os

from haptogram.errors import HaptogramError, plain_reason


class PortLostError(HaptogramError):
    """The port went away and will not come back: a cable was pulled."""


class BoardPort:
    """A file descriptor that bytes go through.

    Attributes
    ----------
    description : str
        Path or address that a host opens.
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
    def client_baud(self) -> int | None:
        """Rate that the client has set, where the port knows it and a client has set one."""
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
        """Return the received bytes, at most *limit*; empty if there are none.

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
        """Return True if the client is known to have gone since the last call."""
        return False

    def plug(self, is_there: bool) -> None:
        """Let the port vanish, as if a cable were pulled, or come back, where it can do that."""

    def close(self) -> None:
        """Close the port and remove what it left in the file system."""
        with contextlib.suppress(OSError):
            os.close(self._fd)

    def _lost(self, error: OSError) -> bytes:
        """Raise PortLostError; subclasses may treat an error as end of connection."""
        raise PortLostError(f"{self.description}: {plain_reason(error)}") from error

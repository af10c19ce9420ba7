"""A serial port as the board's port: the board sits at the far end of a cable."""

from __future__ import annotations

import os

import serial

from haptogram.errors import ConfigurationError, plain_reason
from haptogram.machine.posix import posix_module

from .port import BoardPort
from .pty_link import INSTEAD_OF_PTY


class SerialPort(BoardPort):
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
            raise ConfigurationError(
                f"serial {name} cannot be opened: {plain_reason(error)}"
            ) from error
        super().__init__(self._serial.fileno(), name)
        os.set_blocking(self._fd, False)
        _set_vmin(self._fd)

    def close(self) -> None:
        """Close the port."""
        self._serial.close()


def _set_vmin(fd: int) -> None:
    """Make a read wait for a byte, so that an empty one means that the port is gone."""
    termios = posix_module("termios", "a serial port of the virtual board", INSTEAD_OF_PTY)
    settings = termios.tcgetattr(fd)
    settings[6][termios.VMIN] = 1
    termios.tcsetattr(fd, termios.TCSANOW, settings)

"""The rate that a client has set on a pseudo-terminal.

A pseudo-terminal carries bytes at any rate, so a client with a wrong one would never notice; a real
board would understand nothing.
"""

from __future__ import annotations

import contextlib
import struct
import sys
from typing import Final

from haptogram.machine.posix import posix_module

from .pty_link import INSTEAD_OF_PTY

UNTOUCHED_BAUD: Final = 38_400  # default rate of a new pseudo-terminal
_TCGETS2: Final = 0x802C542A  # asm-generic/ioctls.h: as the names of termios have no odd rates
_TERMIOS2: Final = struct.Struct("4IB19x2I")  # flags, line, characters, rates in and out


def baud_of_pty(descriptor: int) -> int | None:
    """Return the rate at which *descriptor* sends, or None where the system does not tell."""
    if not sys.platform.startswith("linux"):
        return None
    fcntl = posix_module("fcntl", "a pty port", INSTEAD_OF_PTY)
    with contextlib.suppress(OSError):
        told = fcntl.ioctl(descriptor, _TCGETS2, bytes(_TERMIOS2.size))
        return int(_TERMIOS2.unpack(told)[-1])
    return None

"""The debugger's port of QEMU: a processor is stopped, sent elsewhere and let go."""

from __future__ import annotations

import re
import socket
from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError

_PATIENCE_S: Final = 10.0
_PC: Final = 15
#: A packet; one that begins with T says that the processor has stopped.
_ANSWER: Final = re.compile(rb"\$(?!T)([^#]*)#..")


def send_processor_to(address: int, port: Path) -> None:
    """Let the processor go on at *address*, whatever it was doing.

    Parameters
    ----------
    address : int
        Of an instruction.
    port : Path
        UNIX socket of ``emulate --gdb``.

    Raises
    ------
    ConfigurationError
        If nothing answers there, or the debugger's port refuses.
    """
    try:
        with socket.socket(socket.AF_UNIX) as line:
            line.settimeout(_PATIENCE_S)
            line.connect(str(port))  # the processor stops
            _asked(line, "qXfer:features:read:target.xml:0,fff")  # or P is refused
            for words in (f"P{_PC:x}={address.to_bytes(4, 'little').hex()}", "D"):
                if (answer := _asked(line, words)) != "OK":
                    raise ConfigurationError(f"{port}: {words} was answered by {answer!r}, not OK")
    except OSError as error:
        raise ConfigurationError(f"{port}: no debugger's port of QEMU answers: {error}") from error


def _asked(line: socket.socket, words: str) -> str:
    """Send a packet of gdb's remote protocol; return what the answer says."""
    line.sendall(f"${words}#{sum(words.encode()) % 256:02x}".encode())
    said = b""
    while not (found := _ANSWER.search(said)):
        piece = line.recv(4096)
        if not piece:
            raise ConnectionError("it closed the connection")
        said += piece
    line.sendall(b"+")
    return found[1].decode(errors="replace")

"""A program that finds a pseudo-terminal in the place of a serial device.  Linux.

Programs that list serial ports look for ``/dev/ttyS*`` and, as jSerialComm does, for a ``product``
file in sysfs; a pseudo-terminal has neither. The program is therefore started in a mount namespace
of its own, in which the pseudo-terminal lies over a serial device, and a file system in memory over
a folder below ``/sys/devices``. Nobody else sees this, and it ends with the program. No rights are
needed where the system permits user namespaces; the program then sees itself as root.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError

_DEVICES: Final = tuple(f"/dev/tty{name}" for name in ("S0", "S1", "S2", "S3", "USB0", "ACM0"))
# Folders of the kernel's event sources: no program looks into them for devices.
_FOLDERS: Final = tuple(f"/sys/devices/{name}" for name in ("software", "breakpoint", "tracepoint"))
_PRODUCT: Final = "Haptogram virtual board"
_READY: Final = b"ready"
_STOP_S: Final = 5.0
_LAST_WORDS_S: Final = 0.2  # time from the end of its pipe to the end of the process
# Runs in the namespace, with the standard library alone, and becomes the program.
_SCRIPT: Final = """
import os, pathlib, subprocess, sys
terminal, device, folder, product, status, errors, *command = sys.argv[1:]
subprocess.run(["mount", "--bind", terminal, device], check=True)
subprocess.run(["mount", "-t", "tmpfs", "none", folder], check=True)
port = pathlib.Path(folder, "tty", os.path.basename(device))
port.joinpath("device").mkdir(parents=True)
for where in (port, port.parent, port.parent.parent):
    where.joinpath("product").write_text(product + chr(10))
os.write(int(status), b"ready")
os.close(int(status))
os.dup2(int(errors), 2)
os.close(int(errors))
os.execvp(command[0], command)
"""
_INSTEAD: Final = "leave --as-device out, start with --link PATH, and give the program that path"


class DeviceClient:
    """Starts a program for which the pseudo-terminal *terminal* is a serial device.

    Parameters
    ----------
    terminal : str
        Name of the pseudo-terminal.
    command : sequence of str
        The program and its arguments.

    Attributes
    ----------
    device : str
        Name of the device in the program's eyes.
    alive : int or None
        Descriptor of a pipe that ends with the program and all that it has started; None: closed.

    Raises
    ------
    ConfigurationError
        If the system does not permit it, or there is no such program.
    """

    def __init__(self, terminal: str, command: Sequence[str]) -> None:
        if shutil.which(command[0]) is None:
            raise ConfigurationError(f"--as-device: there is no program {command[0]}")
        self.device = _first_existing_program(_DEVICES, "serial device")
        folder = _first_existing_program(_FOLDERS, "folder below /sys/devices")
        unshare = shutil.which("unshare")
        if unshare is None:
            raise ConfigurationError(f"--as-device needs the program unshare; or {_INSTEAD}")
        self.alive: int | None
        self.alive, its_end = os.pipe()
        status, its_status = os.pipe()
        its_errors = os.dup(2)  # while it is set up, the system's own messages go nowhere
        set_up = [sys.executable, "-I", "-c", _SCRIPT, terminal, self.device, folder, _PRODUCT]
        try:
            self._process = subprocess.Popen(
                [unshare, "-rm", *set_up, str(its_status), str(its_errors), *command],
                stderr=subprocess.DEVNULL,
                pass_fds=(its_status, its_errors, its_end),
            )
        finally:
            for descriptor in (its_status, its_errors, its_end):
                os.close(descriptor)
        with os.fdopen(status, "rb") as told:
            if told.read() != _READY:
                self.close()
                raise ConfigurationError(
                    "--as-device: this system permits no private mount namespace, or no mount in "
                    f"it; {_INSTEAD}"
                )

    def close(self) -> int | None:
        """Return the exit status of the program, from 128 on after a signal; None: it was ended."""
        if self.alive is not None:
            os.close(self.alive)
            self.alive = None
        with contextlib.suppress(subprocess.TimeoutExpired):
            status = self._process.wait(_LAST_WORDS_S)
            return status if status >= 0 else 128 - status
        self._process.terminate()
        try:
            self._process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        return None


def _first_existing_program(names: Sequence[str], what: str) -> str:
    """Return the first program that exists; raise ConfigurationError, naming *what*, if none."""
    for name in names:
        if Path(name).exists():
            return name
    raise ConfigurationError(f"--as-device: this system has no {what} to take over; {_INSTEAD}")

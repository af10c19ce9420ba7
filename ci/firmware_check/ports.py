"""The ports of the C board that an emulator runs, and the tools that they take."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError, unwritable_file

FOLDER: Final = Path(__file__).resolve().parents[2] / "protocol" / "c" / "ports"
EMULATE: Final = FOLDER / "emulate"
PACKAGES: Final = "qemu-system-arm gcc-arm-none-eabi libnewlib-arm-none-eabi make"
_PROGRAMS: Final = ("qemu-system-arm", "arm-none-eabi-gcc", "make")
_BUILD_S: Final = 300.0


@dataclass(frozen=True)
class Port:
    """Firmware of one chip.

    Attributes
    ----------
    name : str
        Target of ``make -C protocol/c/ports``.
    machine : str
        Name of the machine in QEMU.
    baud : int
        Rate that the emulated line keeps up with: its UART takes so many bytes, not more.
    has_watchdog : bool
        Whether QEMU's machine has the watchdog of the chip.
    """

    name: str
    machine: str
    baud: int
    has_watchdog: bool


PORTS: Final = {
    port.name: port
    for port in (
        Port("musca_b1", "musca-b1", 1_000_000, has_watchdog=True),
        # A byte of this USART is a turn of QEMU's main loop: 50 µs or more.
        Port("netduinoplus2", "netduinoplus2", 115_200, has_watchdog=False),
    )
}


def missing_tool() -> str:
    """Return a sentence about the first tool that is missing, or an empty string."""
    gone = next((name for name in _PROGRAMS if shutil.which(name) is None), "")
    if not gone and not _has_newlib():
        gone = "newlib for arm-none-eabi (nano.specs)"
    if not gone:
        return ""
    install = f"apt-get install --no-install-recommends {PACKAGES}"
    return f"{gone} is not installed; Debian, Ubuntu: {install}"


def _has_newlib() -> bool:
    command = ["arm-none-eabi-gcc", "--print-file-name=nano.specs"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return Path(done.stdout.strip()).is_absolute()


def install() -> None:
    """Install the tools by apt-get, as root or by sudo.

    Raises
    ------
    ConfigurationError
        If there is no apt-get, or it fails; its last line says why.
    """
    before = [] if os.geteuid() == 0 else ["sudo"]
    commands = (["update"], ["install", "--yes", "--no-install-recommends", *PACKAGES.split()])
    for words in commands:
        command = [*before, "apt-get", *words]
        try:
            done = subprocess.run(
                command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
            )
        except OSError as error:
            raise ConfigurationError(
                f"--install needs {command[0]}, of Debian or Ubuntu: install {PACKAGES} by hand"
            ) from error
        if done.returncode:
            last = " ".join(done.stdout.splitlines()[-1:]) or "nothing was printed"
            raise ConfigurationError(f"{' '.join(command[:3])} failed: {last}")


def build(port: Port, folder: Path, **variables: str) -> Path:
    """Build the firmware of *port* into *folder*; return its ELF file.

    Parameters
    ----------
    port : Port
        What is built.
    folder : Path
        Where; it is made if it is not there.
    **variables
        Variables of ``protocol/c/ports/Makefile``, as ``DEFINES``.

    Raises
    ------
    ConfigurationError
        If it does not compile; the output of make is in ``folder/build.log``.  If the folder
        cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable_file(folder, error, "--out") from error
    log = folder / "build.log"
    settings = [f"{name}={value}" for name, value in variables.items()]
    command = ["make", "-C", str(FOLDER), f"BUILD={folder.resolve()}", *settings, port.name]
    with log.open("w", encoding="utf-8") as output:
        make = subprocess.Popen(
            command, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
        )
        try:
            status = make.wait(_BUILD_S)
        except BaseException as error:  # Ctrl-C, SIGTERM: the compiler ends with make
            os.killpg(make.pid, signal.SIGTERM)
            make.wait()
            if isinstance(error, subprocess.TimeoutExpired):
                raise ConfigurationError(f"make takes over {_BUILD_S:g} s: see {log}") from error
            raise
    if status:
        raise ConfigurationError(f"the firmware {port.name} does not compile: see {log}")
    return folder / f"{port.name}.elf"

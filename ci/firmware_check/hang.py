"""HG-6.12: a main loop that hangs must not leave the output on."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import Final

from haptogram import Driver
from haptogram.driver.line.port import open_transport
from haptogram.errors import ConfigurationError, HaptogramError

from .emulator import Emulator
from .enable_pin import EnablePin
from .memory import symbol
from .ports import Port
from .steps import BOOT_S, Step

#: A branch to itself, as every firmware has one behind its reset.
_ENDLESS: Final = b"\xfe\xe7"
_PATIENCE_S: Final = 30.0
_LONGEST_MS: Final = 10_000  # of hold and lease: neither ends the output here
_PASSED: Final = "OK: a main loop that hangs is reset with the output off"
_LIMIT_S: Final = 2.0  # HG-6.12/1


def hang(port: Port, firmware: Path, folder: Path, patience_s: float = _PATIENCE_S) -> Step:
    """Send the processor into an endless loop while the board sounds; see whether that ends.

    It is the firmware as it is: the debugger's port does it, mostly while interrupts are off.

    Parameters
    ----------
    port : Port
        Chip of the board.
    firmware : Path
        ELF file.
    folder : Path
        Where the log of the enable pin is written.
    patience_s : float
        How long the output may stay on: more than the watchdog's time, on a busy machine.
    """
    log, start_s = folder / "hang.txt", time.monotonic()
    log.unlink(missing_ok=True)
    if not port.has_watchdog:
        return Step("hang", 0, 0.0, "NOT-OBSERVED: QEMU lacks the watchdog of this chip", log)
    with Emulator(port.machine, firmware, log=log.resolve()) as emulator:
        found = _judge(emulator, firmware, EnablePin(port, log), patience_s)
    status = int(found.startswith("FAILED"))
    return Step("hang", status, time.monotonic() - start_s, found, log)


def _judge(emulator: Emulator, firmware: Path, pin: EnablePin, patience_s: float) -> str:
    """Return the verdict in a line; the time is that of the workstation, and only told."""
    before = emulator.wait_for_board(BOOT_S)
    driver = Driver(open_transport(emulator.url))
    try:
        driver.configure(hold_ms=_LONGEST_MS, host_timeout_ms=_LONGEST_MS)
        driver.arm()
        driver.focus((0.0, 0.0, 0.15))
        if not pin.wait_for(level=True, patience_s=_PATIENCE_S):
            raise ConfigurationError(f"{pin.log}: the pin that enables the output stays off")
        place = _endless_loop(emulator, firmware)
        hung_s = time.monotonic()
        emulator.go_on_at(place)
        if not pin.wait_for(level=False, patience_s=patience_s):
            return f"FAILED: a main loop that hangs leaves the output on for {patience_s:g} s"
        off_s = time.monotonic() - hung_s
    finally:
        with contextlib.suppress(HaptogramError):  # it hangs, or has another session
            driver.close()
    try:
        after = emulator.wait_for_board(BOOT_S)
    except ConfigurationError:
        return "FAILED: the output is off, and the board does not start again"
    if after.boot_id == before.boot_id:
        return "FAILED: the main loop did not hang"
    return f"{_PASSED} after {off_s:.1f} s of this machine, {_LIMIT_S:g} s is the most"


def _endless_loop(emulator: Emulator, firmware: Path) -> int:
    """Return the address of the branch to itself behind the reset that a fault asks for."""
    address, size = symbol(firmware, "fault_handler")
    start = address & ~1
    code = emulator.memory(start, size)
    for at in range(0, size, 2):
        if code[at : at + 2] == _ENDLESS:
            return start + at
    raise ConfigurationError(
        f"{firmware}: fault_handler holds no branch to itself ({_ENDLESS.hex()}), where the main "
        "loop would hang: build it with the CFLAGS of protocol/c/ports/Makefile"
    )

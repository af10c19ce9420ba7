"""The pin that enables the output of firmware in QEMU, by the log of what was written to it."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from .ports import Port

_POLL_S: Final = 0.05
#: How the log names a write to the pin, and its value for on and for off.
_WRITES: Final = {
    "netduinoplus2": (r"GPIOB: .*write.*offset 0x0*18, value (\w+)", 1, 0x10000),
    "musca_b1": (r"gpio: .*write.*offset 0x0*4, value (\w+)", 1, 0),
}


@dataclass(frozen=True)
class EnablePin:
    """The pin that gates all transducers.

    Attributes
    ----------
    port : Port
        Chip of the board.
    log : Path
        What ``emulate --log`` writes.
    """

    port: Port
    log: Path

    def levels(self) -> list[bool]:
        """Return every level that was written, in order."""
        pattern, on, off = _WRITES[self.port.name]
        text = self.log.read_text("utf-8", "replace") if self.log.exists() else ""
        return [{on: True, off: False}[int(value, 16)] for value in re.findall(pattern, text)]

    def wait_for(self, level: bool, patience_s: float) -> bool:
        """Wait until the last level is this one; return whether it came."""
        end_s = time.monotonic() + patience_s
        while time.monotonic() < end_s:
            if self.levels()[-1:] == [level]:
                return True
            time.sleep(_POLL_S)
        return False

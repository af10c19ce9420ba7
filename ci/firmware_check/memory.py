"""Flash, memory and stack of firmware: from its ELF file, and from the chip after a run."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from haptogram.errors import ConfigurationError

from .emulator import Emulator

_UNUSED: Final = b"\xc5"  # startup.c fills the stack with it


@dataclass(frozen=True)
class Footprint:
    """Bytes that firmware takes.

    Attributes
    ----------
    flash, static : int
        Code and constants; variables, without the stack.
    stack, stack_used : int
        What is set aside for the stack, and how deep it was.
    """

    flash: int
    static: int
    stack: int
    stack_used: int

    def __str__(self) -> str:
        return (
            f"flash {self.flash} bytes, static memory {self.static} bytes, "
            f"stack {self.stack_used} of {self.stack} bytes used"
        )


def footprint(firmware: Path, emulator: Emulator) -> Footprint:
    """Measure *firmware*, which has run in *emulator*."""
    symbols = _symbols(firmware)
    bottom, size = symbols["stack_bottom"], symbols["stack_top"] - symbols["stack_bottom"]
    memory = emulator.memory(bottom, size)
    unused = len(memory) - len(memory.lstrip(_UNUSED))
    text, data, bss = _sections(firmware)
    return Footprint(text + data, data + bss - size, size, size - unused)


def symbol(firmware: Path, name: str) -> tuple[int, int]:
    """Return address and size in bytes of a variable or function of *firmware*."""
    lines = _output("arm-none-eabi-nm", "--print-size", str(firmware)).splitlines()
    for fields in map(str.split, lines):
        if fields[-1] == name and len(fields) == 4:
            return int(fields[0], 16), int(fields[1], 16)
    raise ConfigurationError(f"{firmware}: has no symbol {name} with a size; is it stripped?")


def _symbols(firmware: Path) -> dict[str, int]:
    lines = _output("arm-none-eabi-nm", str(firmware)).splitlines()
    fields = [line.split() for line in lines]
    return {parts[2]: int(parts[0], 16) for parts in fields if len(parts) == 3}


def _sections(firmware: Path) -> tuple[int, int, int]:
    """Return the bytes of code and constants, of variables with a value, and of the others."""
    row = _output("arm-none-eabi-size", str(firmware)).splitlines()[1].split()
    return int(row[0]), int(row[1]), int(row[2])


def _output(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        said = " ".join(done.stderr.split()) or "it says nothing"
        raise ConfigurationError(f"{command[0]} failed: {said}")
    return done.stdout

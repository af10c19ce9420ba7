"""The head of a VCD file, in which a capture of pins and lines is written."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final, TextIO

_FIRST_SIGN: Final = 33  # of the printable ones that identifiers are made of
_SIGNS: Final = 94


def vcd_identifier(number: int) -> str:
    """Return the identifier of variable *number*: the shortest that no other one has."""
    sign = chr(_FIRST_SIGN + number % _SIGNS)
    return sign if number < _SIGNS else vcd_identifier(number // _SIGNS - 1) + sign


def write_vcd_head(file: TextIO, names: Sequence[str], high: Collection[str]) -> None:
    """Declare a variable of one bit for each name; those in *high* are 1 at the time 0."""
    file.write("$timescale 1 ns $end\n$scope module pins $end\n")
    for number, name in enumerate(names):
        file.write(f"$var wire 1 {vcd_identifier(number)} {name} $end\n")
    file.write("$upscope $end\n$enddefinitions $end\n#0\n$dumpvars\n")
    for number, name in enumerate(names):
        file.write(f"{int(name in high)}{vcd_identifier(number)}\n")
    file.write("$end\n")

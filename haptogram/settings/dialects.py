"""Names and titles of the wires of other boards, for help texts: their codecs load much more."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

#: The wire of this project.
OWN_DIALECT: Final = "haptogram"
#: Title by name, of the dialects of :mod:`haptogram_protocol.dialects.table`.
DIALECT_TITLES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "sonicsurface": "SonicSurface, primary and secondary firmware",
        "sonicsurface-tactile": "SonicSurface, tactile firmware",
        "ultraino-fpga": "Ultraino SimpleFPGA",
        "ultraino-fpga-128": "Ultraino SimpleFPGA_128",
        "ultraino-fpga-chained": "Ultraino ChainedFPGA",
        "ultraino-mega64": "Ultraino Arduino MEGA64",
        "ultraino-nano8": "Ultraino Arduino Nano8",
        "ultraino-nano16": "Ultraino Arduino Nano16",
        "interactlab": "InteractLab / OpenMPD, FPGA 3.4.2",
        "autd3": 'AUTD3, TCP link "Remote" of autd3 38',
    }
)

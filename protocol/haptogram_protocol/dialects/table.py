"""Every dialect of a foreign board, by name."""

from __future__ import annotations

from typing import Final

from .autd3.link import AUTD3
from .codec import Dialect
from .interactlab import INTERACTLAB
from .sonicsurface import SONICSURFACE, TACTILE
from .ultraino.arduino.dialects import MEGA64, NANO8, NANO16
from .ultraino.fpga import CHAINED, SIMPLE, SIMPLE_128

DIALECTS: Final[dict[str, Dialect]] = {
    dialect.name: dialect
    for dialect in (
        SONICSURFACE,
        TACTILE,
        SIMPLE,
        SIMPLE_128,
        CHAINED,
        MEGA64,
        NANO8,
        NANO16,
        INTERACTLAB,
        AUTD3,
    )
}

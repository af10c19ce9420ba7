"""The dialect ``autd3``: the link, one to four devices in a row, and their options."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Final

from haptogram.acoustics.model.boards.grids import AUTD3 as ONE_DEVICE
from haptogram.acoustics.model.boards.grids import autd_row
from haptogram.acoustics.model.boards.layout import BoardLayout
from haptogram.settings.option import Settings, option
from haptogram_protocol.dialects.autd3 import link

from ..emulation import Emulation
from .unit import PERIOD_US, PERIODS_BETWEEN_LATCHES, Autd3Unit

MAX_DEVICES: Final = 4  # an array has 1024 elements at the most


@dataclass(frozen=True, kw_only=True)
class Devices(Settings):
    """Options of the dialect."""

    devices: int = option(
        1, unit="N", low=1, high=MAX_DEVICES, help="devices, 192 mm apart along x"
    )
    system_ns: int = option(
        0,
        unit="NS",
        low=0,
        high=2**63 - 1,
        help="system time at power-up, for clients that name times: since 2000-01-01 UTC",
    )
    latch_us: int = option(
        PERIODS_BETWEEN_LATCHES * PERIOD_US,
        unit="US",
        low=PERIOD_US,
        high=1_000_000,
        help="time between latches that sequences and modulation make by themselves",
    )


def _autd3_layout(options: Devices) -> BoardLayout:
    if options.devices == 1:
        return ONE_DEVICE
    return dataclasses.replace(
        ONE_DEVICE,
        name=f"autd3-{options.devices}",
        title=f"{options.devices} AUTD3 units in a row, first element of the first at the origin",
        array=lambda: autd_row(options.devices),
    )


AUTD3: Final = Emulation(
    dialect=link.AUTD3,
    end=lambda _: link.Autd3BoardEnd(),
    unit=lambda options, now_us: Autd3Unit(
        now_us,
        devices=options.devices,
        system_ns=options.system_ns,
        periods_between_latches=options.latch_us // PERIOD_US,
    ),
    layout=_autd3_layout,
    options=Devices,
    boards=lambda options: options.devices,
)
EMULATIONS: Final = (AUTD3,)

"""The options of a modulation, which ``haptogram verify`` and ``haptogram modulation`` share."""

from __future__ import annotations

import argparse

from haptogram.settings.shape import ModulationConfig

from ..shell.positions import position_mm
from ..shell.setting_types import setting_type


def add_modulation(group: argparse._ArgumentGroup) -> None:
    """Add them; one that is not given is None."""
    group.add_argument(
        "--modulation-hz",
        type=setting_type("modulation_hz"),
        metavar="HZ",
        help="frequency of am and lm; rounds per second of stm; at most half the frame rate "
        f"[{ModulationConfig.modulation_hz:g}]",
    )
    group.add_argument(
        "--depth",
        type=setting_type("depth"),
        metavar="SHARE",
        help="of am: 1 swings between full force and none, 0 not at all; a sine in the force, not "
        f"in the pressure [{ModulationConfig.depth:g}]",
    )
    group.add_argument(
        "--shift-mm",
        type=position_mm,
        metavar="X,Y,Z",
        help="of lm: how far and which way the focus swings to both sides "
        f"[{','.join(f'{value:g}' for value in ModulationConfig.shift_mm)}]",
    )
    group.add_argument(
        "--dwell-ms",
        type=setting_type("dwell_ms"),
        metavar="MS",
        help="how long each point is held, in whole frames [one frame]",
    )

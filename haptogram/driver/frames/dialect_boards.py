"""The boards of another wire, as a host takes them: their display, array and mounting."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from haptogram.acoustics import AcousticModel, Calibration, Medium, Transducer
from haptogram.acoustics.model.boards.table import LAYOUTS
from haptogram.errors import ConfigurationError
from haptogram.settings.arguments import check_whole, shown_argument
from haptogram_protocol.dialects.codec import Dialect, Display
from haptogram_protocol.errors import LocalProtocolError

_HIGHEST_CHANNEL: Final = 0xFFFF  # highest channel of any dialect


def checked_display_channels(channels: Any) -> tuple[int, ...]:
    """Return *channels* as whole numbers; whether the boards have them, their display decides.

    Raises
    ------
    ConfigurationError
        If they are no sequence of whole numbers from 0 on.
    """
    is_row = isinstance(channels, np.ndarray) and channels.ndim == 1
    is_list = isinstance(channels, Sequence) and not isinstance(channels, str | bytes)
    if not (is_row or is_list) or len(channels) == 0:
        raise ConfigurationError(
            f"channels is {shown_argument(channels)}, must be a sequence of whole numbers, one for "
            "each element"
        )
    return tuple(
        check_whole(f"channels[{place}]", channel, 0, _HIGHEST_CHANNEL)
        for place, channel in enumerate(channels)
    )


def dialect_display_of(dialect: Dialect, boards: int) -> Display:
    """Return the display of *boards* boards of *dialect*.

    Raises
    ------
    ConfigurationError
        If this program does not drive that wire, or not that number of boards.
    """
    if dialect.display is None:
        raise ConfigurationError(
            f"dialect {dialect.name} can be emulated and not driven: its wire says nothing of how "
            "a host shows phases (Dialect.display, docs/dialects.md)"
        )
    try:
        display = dialect.display(boards)
    except LocalProtocolError as error:
        raise ConfigurationError(f"dialect {dialect.name}: {error}") from error
    if display.channels < boards * dialect.channels:
        raise ConfigurationError(
            f"dialect {dialect.name}: {boards} boards are needed for so many elements; the wire "
            f"drives {display.channels // dialect.channels}, of {dialect.channels} channels each"
        )
    return display


def assumed_dialect_frames_model(dialect: Dialect, medium: Medium | None = None) -> AcousticModel:
    """Return the boards' own array, as their clients have it, in *medium*.

    Raises
    ------
    ConfigurationError
        If their array is not known here.
    """
    if dialect.layout not in LAYOUTS:
        raise ConfigurationError(
            f"model is None, and the array of dialect {dialect.name} is not known here: give one"
        )
    array = LAYOUTS[dialect.layout].array()
    return AcousticModel(array, medium or Medium.air(), Transducer())


def mounted_display_model(model: AcousticModel, display: Display) -> AcousticModel:
    """Return *model* with the emitters mounted as the boards of *display* have them."""
    count = model.array.count
    phases_rad = math.tau * np.array(display.mounting[:count])
    return model.calibrated(Calibration(np.ones(count), phases_rad, model.array.positions_m))

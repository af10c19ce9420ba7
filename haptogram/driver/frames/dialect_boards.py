"""The boards of another wire, as a host takes them: their display, array and mounting."""

from __future__ import annotations

import math

import numpy as np

from haptogram.acoustics import AcousticModel, Calibration, Medium, Transducer
from haptogram.acoustics.model.boards.table import LAYOUT_OF_DIALECT
from haptogram.errors import ConfigurationError
from haptogram_protocol.dialects.codec import Dialect, Display
from haptogram_protocol.errors import LocalProtocolError


def dialect_display_of(dialect: Dialect, boards: int) -> Display:
    """Return the display of so many boards of *dialect*.

    Raises
    ------
    ConfigurationError
        If this program does not drive that wire, or not so many boards.
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


def assumed_dialect_model(dialect: Dialect, medium: Medium | None = None) -> AcousticModel:
    """Return the boards' own array, as their clients have it, in *medium*.

    Raises
    ------
    ConfigurationError
        If nobody here knows their array.
    """
    if dialect.name not in LAYOUT_OF_DIALECT:
        raise ConfigurationError(
            f"model is None, and the array of dialect {dialect.name} is not known here: give one"
        )
    array = LAYOUT_OF_DIALECT[dialect.name].array()
    return AcousticModel(array, medium or Medium.air(), Transducer())


def mounted_model(model: AcousticModel, display: Display) -> AcousticModel:
    """Return *model* with the emitters mounted as the boards of *display* have them."""
    count = model.array.count
    phases_rad = math.tau * np.array(display.mounting[:count])
    return model.calibrated(Calibration(np.ones(count), phases_rad, model.array.positions_m))

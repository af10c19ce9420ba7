"""A board from the words of a command line or a URL."""

from __future__ import annotations

from typing import Final

from haptogram.acoustics import AcousticModel, Medium, Transducer, TransducerArray
from haptogram.errors import ConfigurationError

from .settings import BoardSettings

MAX_SEED: Final = 2**64 - 1


def board_settings(
    *,
    array: str = "16x16",
    pitch_mm: float = 10.0,
    temperature_c: float = 20.0,
    seed: int = 0,
    baud: int | None = None,
) -> BoardSettings:
    """Return the settings of a board.

    Parameters
    ----------
    array : str
        ``NXxNY`` or the name of a CSV file.
    pitch_mm : float
        Pitch of a grid, millimetres.
    temperature_c : float
        Temperature of the air that the board radiates into, degrees Celsius.

    Raises
    ------
    ConfigurationError
        If a value is out of its limits; the text names both.
    """
    if not 0 <= seed <= MAX_SEED:
        raise ConfigurationError(f"seed is {seed}, must be 0 to {MAX_SEED}")
    transducer = Transducer()
    model = AcousticModel(
        TransducerArray.parse(array, pitch_m=pitch_mm * 1e-3),
        Medium.air(temperature_c, frequency_hz=transducer.frequency_hz),
        transducer,
    )
    return BoardSettings(model=model, seed=seed, baud=baud)

"""A board from the words of a command line or a URL."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from haptogram.acoustics import AcousticModel, Calibration, Medium, Transducer, TransducerArray
from haptogram.errors import ConfigurationError
from haptogram.settings.line import LineSettings

from .board.settings import BoardSettings

MAX_SEED: Final = 2**64 - 1
_MAX_LATENCY_MS: Final = 255  # of the timer's eight bits


def board_settings(
    *,
    array: str = "16x16",
    pitch_mm: float = 10.0,
    temperature_c: float = 20.0,
    calibration: str | Path | None = None,
    seed: int = 0,
    baud: int | None = None,
    baud_error_ppm: int = 0,
    rx_fifo: int | None = None,
    rx_poll_us: int | None = None,
    latency_ms: float | None = None,
    host_buffer: int | None = None,
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
    calibration : path, optional
        CSV file that says how its elements really are (:class:`haptogram.acoustics.Calibration`).
    baud, baud_error_ppm, rx_fifo, rx_poll_us, latency_ms, host_buffer
        The line; see :class:`~haptogram.settings.line.LineSettings`.

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
    line = _line(baud_error_ppm, rx_fifo, rx_poll_us, latency_ms, host_buffer)
    elements = None if calibration is None else Calibration.from_file(calibration)
    return BoardSettings(model=model, calibration=elements, seed=seed, baud=baud, line=line)


def _line(
    baud_error_ppm: int,
    rx_fifo: int | None,
    rx_poll_us: int | None,
    latency_ms: float | None,
    host_buffer: int | None,
) -> LineSettings:
    if rx_poll_us is not None and rx_fifo is None:
        raise ConfigurationError("rx_poll_us says how often a FIFO is emptied: give rx_fifo too")
    if latency_ms is not None and not 0 < latency_ms <= _MAX_LATENCY_MS:
        raise ConfigurationError(
            f"latency_ms is {latency_ms:g}, must be above 0, at most {_MAX_LATENCY_MS}"
        )
    given = {} if rx_poll_us is None else {"rx_poll_us": rx_poll_us}
    return LineSettings(
        baud_error_ppm=baud_error_ppm,
        rx_fifo=rx_fifo,
        latency_us=None if latency_ms is None else max(1, round(latency_ms * 1000)),
        host_buffer=host_buffer,
        **given,
    )

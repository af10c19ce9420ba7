"""What a board is: fixed at power-up, told to the host in HELLO_REPLY."""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Final

from haptogram.acoustics import AcousticModel
from haptogram.errors import ConfigurationError
from haptogram.settings.line import LineSettings
from haptogram_protocol.messages import Feature, PhaseFormat

if TYPE_CHECKING:
    from haptogram.acoustics import Calibration

BOOT_US: Final = 2**32 - 10_000_000  # the 32-bit clock of every run wraps 10 s after power-up
MAX_BAUD: Final = 50_000_000
ALL_FEATURES: Final = (
    Feature.AMPLITUDE
    | Feature.POINTS
    | Feature.SEQUENCE_PHASES
    | Feature.SEQUENCE_POINTS
    | Feature.CONFIG
    | Feature.CORRECTION
    | Feature.READ_LATCHED
    | Feature.READ_RADIATED
    | Feature.TRACE
    | Feature.TRACE_DRIVE
    | Feature.TRACE_RING
)


@dataclass(frozen=True, kw_only=True)
class BoardSettings:
    """Hardware and limits of one board.

    Attributes
    ----------
    model : AcousticModel
        Array, air and transducers as the firmware knows them: what the host is told, and what the
        drives of focal points are computed with.
    calibration : Calibration or None
        How its elements really are; None: as the firmware knows them.
    seed : int
        Everything about this board that looks random follows from it.
    queue_depth : int
        Stream frames that may wait for their t_apply.
    max_horizon_us : int
        How far ahead t_apply may lie.
    boot_us : int
        Unwrapped device time at power-up.
    baud : int or None
        Rate of the line, for the share of it that STATUS may take; None: no limit.
    line : LineSettings
        What else the line is: FIFOs, USB adapter, error of the rate.
    phase_formats : tuple of PhaseFormat
        Resolutions that PHASES frames may have.

    Raises
    ------
    ConfigurationError
        If the carrier period is not a whole number of microseconds, a limit does not fit its field
        of HELLO_REPLY, or the calibration is not of this array.
    """

    model: AcousticModel = field(default_factory=AcousticModel.default)
    calibration: Calibration | None = None
    seed: int = 0
    features: Feature = ALL_FEATURES
    phase_formats: tuple[PhaseFormat, ...] = tuple(PhaseFormat)
    queue_depth: int = 128
    max_horizon_us: int = 10_000_000
    boot_us: int = BOOT_US
    baud: int | None = None
    line: LineSettings = field(default_factory=LineSettings)
    clock_ppm: int = 50
    trace_ring: int = 4096
    max_points: int = 8
    max_sequence_frames: int = 65_536
    max_upload_bytes: int = 32 << 20
    max_stored_bytes: int = 64 << 20
    max_playback_rate_hz: int = 10_000
    max_unattended_ms: int = 600_000
    upload_window: int = 4
    max_chunk: int = 2048
    rx_window: int = 16_384
    firmware: str = "haptogram-sim 1"

    def __post_init__(self) -> None:
        carrier = self.model.frequency_hz
        if carrier <= 0 or 1e6 % carrier:
            raise ConfigurationError(
                f"carrier of {carrier:g} Hz; its period must be a whole number of microseconds"
            )
        for name, limit in _LIMITS.items():
            value = getattr(self, name)
            if value is not None and not 1 <= value <= limit:
                raise ConfigurationError(f"{name} is {value}, must be 1 to {limit}")
        self.line.check(self.baud)
        if self.calibration is not None:
            self.calibration.moved(self.model.array)

    @cached_property
    def truth(self) -> AcousticModel:
        """What the board radiates with: its model, with the elements as they really are."""
        return self.model if self.calibration is None else self.model.calibrated(self.calibration)

    @property
    def carrier_hz(self) -> int:
        """Carrier frequency."""
        return round(self.model.frequency_hz)

    @property
    def carrier_us(self) -> int:
        """Carrier period: drives are latched on its multiples."""
        return 1_000_000 // self.carrier_hz

    @property
    def count(self) -> int:
        """Number of transducers, N."""
        return self.model.array.count

    @property
    def boot_id(self) -> int:
        """Number that tells one power-up from another."""
        return random.Random(self.seed).getrandbits(32)


_LIMITS: Final = {
    "baud": MAX_BAUD,
    "queue_depth": 0xFFFF,
    "max_horizon_us": 2**31 - 1,
    "trace_ring": 0xFFFF,
    "max_points": 0xFF,
    "max_sequence_frames": 2**32 - 1,
    "max_upload_bytes": 2**32 - 1,
    "max_playback_rate_hz": 40_000,
    "max_unattended_ms": 2**32 - 1,
    "upload_window": 0xFFFF,
    "max_chunk": 0xFFFF,
}

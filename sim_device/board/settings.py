"""Hardware and limits of a board: fixed at power-up, reported to the host in HELLO_REPLY."""

from __future__ import annotations

import random
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Self

from haptogram.acoustics import AcousticModel, Calibration, Medium, Transducer, TransducerArray
from haptogram.errors import ConfigurationError
from haptogram.settings.board import DEFAULT_ARRAY, MOST_LEAD_US, BoardConfig
from haptogram.settings.frozen import dataclass, field
from haptogram.settings.line import LineSettings
from haptogram_protocol.messages import Feature

BOOT_US: Final = 2**32 - 10_000_000  # the 32-bit clock of every run wraps 10 s after power-up
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
class Wiring:
    """The dialect of a board, and which of its channels drive the emitters of the array.

    Attributes
    ----------
    dialect : str
        Name of the dialect.
    steps : int
        Steps of a phase in a period of the carrier.
    channels : tuple of int
        For each emitter of the array the channel that drives it, counted over all boards.
    channel_count : int
        Channels of all boards; one that drives no emitter may be driven all the same.
    bauds : tuple of int
        Rates at which such boards are built, the usual one first; empty: no serial line.
    client_axes : tuple of 3 tuples of 3 float
        Rows of the rotation R of the axes in which the clients of this dialect think: a point x of
        theirs lies at R x in the axes of the array.

    Raises
    ------
    ConfigurationError
        If an emitter has a channel that is not there.
    """

    dialect: str
    steps: int
    channels: tuple[int, ...]
    channel_count: int
    bauds: tuple[int, ...] = ()
    client_axes: tuple[tuple[float, ...], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    def __post_init__(self) -> None:
        if not all(0 <= channel < self.channel_count for channel in self.channels):
            raise ConfigurationError(
                f"array of {len(self.channels)} elements on channels up to {max(self.channels)}; "
                f"the boards of {self.dialect} have {self.channel_count} channels: give an array "
                "that fits, or more boards"
            )


@dataclass(frozen=True, kw_only=True)
class BoardSettings:
    """Hardware and limits of one board.

    Attributes
    ----------
    model : AcousticModel
        Array, air and transducers as the firmware knows them: the board tells them to the host, and
        computes the drives of focal points with them.
    calibration : Calibration or None
        Gain, phase and position of the elements as they really are; None: as in the model.
    seed : int
        Seed of everything random.
    queue_depth : int
        Stream frames that may wait for their t_apply.
    max_horizon_us : int
        Largest distance of t_apply in the future.
    latch_lead_us, point_time_us : int
        Time from the arrival of a stream frame to its latch, and what each focal point adds to it.
    boot_us : int
        Unwrapped device time at power-up.
    line : LineSettings
        The line to the host.
    wiring : Wiring or None
        Of a board that speaks another dialect; None: Haptogram's own.
    simulator : str or None
        Command line of the process that simulates the board; None: it is emulated here.
    simulator_capture : Path or None
        File that takes down what its pins and its line do.

    Raises
    ------
    ConfigurationError
        If the carrier period is not a whole number of microseconds, a limit does not fit its field
        of HELLO_REPLY, the store has no room for the longest upload, or the calibration is not of
        this array.
    """

    model: AcousticModel = field(default_factory=AcousticModel.default)
    calibration: Calibration | None = None
    seed: int = 0
    features: Feature = ALL_FEATURES
    queue_depth: int = 128
    max_horizon_us: int = 10_000_000
    latch_lead_us: int = 0
    point_time_us: int = 0
    boot_us: int = BOOT_US
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
    wiring: Wiring | None = None
    simulator: str | None = None
    simulator_capture: Path | None = None

    def __post_init__(self) -> None:
        carrier = self.model.frequency_hz
        if carrier <= 0 or 1e6 % carrier:
            raise ConfigurationError(
                f"carrier of {carrier:g} Hz; its period must be a whole number of microseconds"
            )
        for name, (limit, users) in _LIMITS.items():
            value, least = getattr(self, name), int(not users or bool(self.features & users))
            if not least <= value <= limit:
                raise ConfigurationError(f"{name} is {value}, must be {least} to {limit}")
        if self.max_stored_bytes < self.max_upload_bytes:
            raise ConfigurationError(
                f"max_stored_bytes is {self.max_stored_bytes}, must be max_upload_bytes, "
                f"{self.max_upload_bytes}, or more"
            )
        for name in ("latch_lead_us", "point_time_us"):
            value = getattr(self, name)
            if not 0 <= value <= MOST_LEAD_US:
                raise ConfigurationError(f"{name} is {value}, must be 0 to {MOST_LEAD_US}")
        if self.calibration is not None:
            self.calibration.moved(self.model.array)

    @classmethod
    def of(cls, config: BoardConfig) -> Self:
        """Return the board that *config* describes: its array, its air and its elements.

        Raises
        ------
        ConfigurationError
            If the array or the calibration cannot be read.
        """
        transducer = Transducer()
        model = AcousticModel(
            TransducerArray.parse(config.array or DEFAULT_ARRAY, pitch_m=config.pitch_mm * 1e-3),
            Medium.air(config.temperature_c, frequency_hz=transducer.frequency_hz),
            transducer,
        )
        file = config.calibration
        elements = None if file is None else Calibration.from_file(file)
        return cls(
            model=model,
            calibration=elements,
            seed=config.seed,
            line=config.line,
            simulator=config.simulator,
            simulator_capture=config.simulator_capture,
            latch_lead_us=config.latch_lead_us,
            point_time_us=config.point_time_us,
            max_playback_rate_hz=config.max_playback_rate_hz,
        )

    @cached_property
    def truth(self) -> AcousticModel:
        """The model with the elements as they really are: the board radiates with it."""
        return self.model if self.calibration is None else self.model.calibrated(self.calibration)

    @property
    def carrier_hz(self) -> int:
        """Carrier frequency."""
        return round(self.model.frequency_hz)

    @cached_property
    def carrier_us(self) -> int:
        """Carrier period: drives are latched on its multiples."""
        return 1_000_000 // self.carrier_hz

    @cached_property
    def count(self) -> int:
        """Number of transducers, N."""
        return self.model.array.count

    @property
    def boot_id(self) -> int:
        """Number that tells one power-up from another."""
        return random.Random(self.seed).getrandbits(32)


_POINTS: Final = Feature.POINTS | Feature.SEQUENCE_POINTS
_SEQUENCES: Final = Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS
_UPLOADS: Final = _SEQUENCES | Feature.CORRECTION
#: Most of each limit, and the capabilities without which it may be 0; none named: it may not.
_LIMITS: Final = {
    "queue_depth": (0xFFFF, Feature(0)),
    "max_horizon_us": (2**31 - 1, Feature(0)),
    "trace_ring": (0xFFFF, Feature.TRACE_RING),
    "max_points": (0xFF, _POINTS),
    "max_sequence_frames": (2**32 - 1, _SEQUENCES),
    "max_upload_bytes": (2**32 - 1, _UPLOADS),
    "max_playback_rate_hz": (2**32 - 1, _SEQUENCES),
    "max_unattended_ms": (2**32 - 1, _SEQUENCES),
    "upload_window": (0xFFFF, _UPLOADS),
    "max_chunk": (0xFFFF, _UPLOADS),
}


def board_settings(**options: Any) -> BoardSettings:
    """Return a board from options by name; see :class:`~haptogram.settings.board.BoardConfig`.

    Raises
    ------
    ConfigurationError
        If a value is outside its limits; the message names both.

    Examples
    --------
    >>> board_settings(array="8x8", baud=3_000_000).count
    64
    """
    return BoardSettings.of(BoardConfig.of(**options))

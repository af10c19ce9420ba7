"""Operations of a device of AUTD3, as the payload of a frame carries them.

Little-endian throughout. Source: shinolab/autd3-rs, folder ``autd3-driver/src/firmware``:
``tag.rs`` 1f88399, ``operation/implement/*.rs`` 364a5bc, 450fe2a, 27530f8, 3574fc8 (layouts) and
``cpu/error.rs`` 3574fc8 (error codes).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from ..codec import Operation

CHANNELS: Final = 249  # 18 x 14 - 3 emitters a device


class Tag(IntEnum):
    """First byte of an operation, of those that are understood here."""

    NOP = 0x00
    CLEAR = 0x01
    SYNC = 0x02
    FIRMWARE_INFO = 0x03
    MODULATION = 0x10
    MODULATION_SWAP = 0x11
    SILENCER = 0x21
    GAIN = 0x30
    GAIN_SWAP = 0x31
    FOCI_STM = 0x42
    FOCI_STM_SWAP = 0x44


class InfoType(IntEnum):
    """Number that a firmware information operation asks for."""

    CPU_MAJOR = 1
    CPU_MINOR = 2
    FPGA_MAJOR = 3
    FPGA_MINOR = 4
    FPGA_FUNCTIONS = 5
    CLEAR = 6


class TransitionMode(IntEnum):
    """When a segment takes over (``autd3-core/src/firmware/transition_mode.rs`` ec9829a)."""

    SYNC_INDEX = 0x00
    SYSTEM_TIME = 0x01
    GPIO = 0x02
    EXT = 0xF0
    LATER = 0xFE
    IMMEDIATE = 0xFF


class ErrorCode(IntEnum):
    """High nibble of a device's acknowledgement."""

    NONE = 0
    NOT_SUPPORTED_TAG = 1
    INVALID_MESSAGE_ID = 2
    INVALID_INFO_TYPE = 3
    INVALID_GAIN_STM_MODE = 4
    INVALID_SEGMENT_TRANSITION = 5
    MISS_TRANSITION_TIME = 6
    INVALID_SILENCER_SETTINGS = 7
    INVALID_TRANSITION_MODE = 8


@dataclass(frozen=True, slots=True)
class Nop(Operation):
    """Do nothing."""


@dataclass(frozen=True, slots=True)
class Clear(Operation):
    """Return to the state of power-up."""


@dataclass(frozen=True, slots=True)
class Sync(Operation):
    """Take the clock of the link."""


@dataclass(frozen=True, slots=True)
class FirmwareInfo(Operation):
    """Answer with one number of the firmware, an :class:`InfoType`; others are refused."""

    kind: int


@dataclass(frozen=True, slots=True)
class Silencer(Operation):
    """Limit how fast intensity and phase change.

    Attributes
    ----------
    update_rate : bool
        True if the values are steps per update, False if they are periods until completion.
    strict : bool
        With completion times: refuse faster sampling.
    intensity, phase : int
        The values, 0 to 65 535.
    """

    update_rate: bool
    strict: bool
    intensity: int
    phase: int


@dataclass(frozen=True, slots=True)
class Gain(Operation):
    """A pattern for a segment.

    Attributes
    ----------
    segment : int
        Segment that takes the pattern.
    update : bool
        Show the segment.
    drives : bytes
        For each channel its phase (1/256 period) and its intensity: 498 bytes.
    """

    segment: int
    update: bool
    drives: bytes


@dataclass(frozen=True, slots=True)
class ModulationStart:
    """Head of the first part of a modulation.

    Attributes
    ----------
    transition_mode : int
        A :class:`TransitionMode`; others are for the device to refuse.
    divider : int
        Samples come at 40 kHz / *divider*.
    repeat : int
        Repetitions; 65 535 is endless.
    transition_value : int
        Time in nanoseconds or number of a pin, by the mode.
    """

    transition_mode: int
    divider: int
    repeat: int
    transition_value: int


@dataclass(frozen=True, slots=True)
class Modulation(Operation):
    """Samples of a modulation, or a part of them.

    Attributes
    ----------
    segment : int
        0 or 1.
    samples : bytes
        Intensities; at most 255 with a *start*, 618 without.
    start : ModulationStart or None
        Head, in the first part.
    end, update : bool
        This is the last part; show the segment.
    """

    segment: int
    samples: bytes
    start: ModulationStart | None
    end: bool
    update: bool


@dataclass(frozen=True, slots=True)
class FociStart:
    """Head of the first part of a sequence of foci, as :class:`ModulationStart`.

    Attributes
    ----------
    foci_of_pattern : int
        Foci at the same time, 1 to 8.
    sound_speed : int
        In 1/64 m/s.
    """

    transition_mode: int
    foci_of_pattern: int
    sound_speed: int
    divider: int
    repeat: int
    transition_value: int


@dataclass(frozen=True, slots=True)
class FociSTM(Operation):
    """Foci of a sequence, or a part of them.

    Attributes
    ----------
    segment : int
        Segment that takes the foci.
    patterns : int
        Patterns in this part, 0 to 255.
    foci : bytes
        8 bytes for each focus of each pattern: x, y, z of 18 bits, signed, in 0.025 mm, lowest
        bits first; then 8 bits: intensity in the first focus of a pattern, phase offset in others.
    start : FociStart or None
        Head, in the first part.
    end, update : bool
        This is the last part; show the segment.
    """

    segment: int
    patterns: int
    foci: bytes
    start: FociStart | None
    end: bool
    update: bool


@dataclass(frozen=True, slots=True)
class SwapSegment(Operation):
    """Show another segment.

    Attributes
    ----------
    tag : Tag
        ``MODULATION_SWAP``, ``GAIN_SWAP`` or ``FOCI_STM_SWAP``.
    segment : int
        Segment to show.
    transition_mode, transition_value : int
        As in :class:`ModulationStart`; 0 for a gain, whose operation does not have them.
    """

    tag: Tag
    segment: int
    transition_mode: int = 0
    transition_value: int = 0


@dataclass(frozen=True, slots=True)
class Unsupported(Operation):
    """An operation of a device that is not emulated, or of none."""

    tag: int


@dataclass(frozen=True, slots=True)
class Truncated(Operation):
    """An operation that does not end within its frame; *tag* is -1 if it does not even begin.

    Not known: what a device does with it, which reads on after the frame.
    """

    tag: int


def autd3_refusal(operation: Operation) -> ErrorCode:
    """Return the error that *operation* gives on any device, whatever its state."""
    if isinstance(operation, Unsupported | Truncated):
        return ErrorCode.NOT_SUPPORTED_TAG
    if isinstance(operation, FirmwareInfo) and operation.kind not in list(InfoType):
        return ErrorCode.INVALID_INFO_TYPE
    return ErrorCode.NONE


def autd3_error_text(error: int) -> str:
    """Return the name of an error code, or its number if it has none."""
    known = error in ErrorCode._value2member_map_
    return f"error {error}" + (f", {ErrorCode(error).name}" if known else "")

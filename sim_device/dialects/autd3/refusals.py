"""Why a device refuses an operation: the errors that depend on its state, as pure functions.

Source: shinolab/autd3-rs, ``autd3-firmware-emulator/src/cpu/operation``: ``mod.rs`` 09ddb55
(transition modes), ``silencer.rs`` 2c2a019, ``gain.rs`` and ``stm/foci.rs`` (segments),
``modulation.rs`` (times). Firmware of 38 does not check numbers of segments above 1 and transition
modes that do not exist; here they have the error of their kind.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from haptogram_protocol.dialects.autd3.operations import ErrorCode, Silencer, TransitionMode

ENDLESS: Final = 0xFFFF
SEGMENTS: Final = 2
MARGIN_NS: Final = 10_000_000  # least time by which a swap must be ahead
_WAITING: Final = (TransitionMode.SYNC_INDEX, TransitionMode.SYSTEM_TIME, TransitionMode.GPIO)
_PROMPT: Final = (TransitionMode.IMMEDIATE, TransitionMode.EXT)


@dataclass(frozen=True, slots=True)
class Autd3Limits:
    """Limits of a strict silencer on dividers; the default of power-up.

    Attributes
    ----------
    strict : bool
        Whether it demands anything.
    intensity, phase : int
        Periods that a change takes: the smallest dividers of modulation and of sequences.
    """

    strict: bool = True
    intensity: int = 10
    phase: int = 40

    @classmethod
    def of(cls, silencer: Silencer, before: Autd3Limits) -> Autd3Limits:
        """Return the limits that *silencer* sets after *before*."""
        if silencer.update_rate:
            return cls(False, before.intensity, before.phase)
        return cls(silencer.strict, silencer.intensity, silencer.phase)


def autd3_segment_refusal(segment: int, *, is_of_kind: bool = True) -> ErrorCode:
    """Return error 5 if there is no such segment, or if it holds another kind of data."""
    if segment < SEGMENTS and is_of_kind:
        return ErrorCode.NONE
    return ErrorCode.INVALID_SEGMENT_TRANSITION


def autd3_time_refusal(mode: int, value_ns: int, now_ns: int) -> ErrorCode:
    """Return error 6 if the system time to swap is less than 10 ms ahead of *now_ns*."""
    if mode == TransitionMode.SYSTEM_TIME and value_ns < now_ns + MARGIN_NS:
        return ErrorCode.MISS_TRANSITION_TIME
    return ErrorCode.NONE


def autd3_silencer_refusal(
    limits: Autd3Limits, sequence_divider: int, modulation_divider: int
) -> ErrorCode:
    """Return error 7 if a strict silencer finds a divider too small."""
    too_fast = (
        modulation_divider < limits.intensity
        or sequence_divider < limits.intensity
        or sequence_divider < limits.phase
    )
    if limits.strict and too_fast:
        return ErrorCode.INVALID_SILENCER_SETTINGS
    return ErrorCode.NONE


def autd3_transition_refusal(current: int, segment: int, repeat: int, mode: int) -> ErrorCode:
    """Return error 8 if *mode* does not go with a change from *current* to *segment*.

    A segment that is out already, or that repeats without end, cannot wait for a moment to start;
    one that repeats *repeat* + 1 times must.
    """
    if mode == TransitionMode.LATER:
        return ErrorCode.NONE
    allowed = _PROMPT if current == segment or repeat == ENDLESS else _WAITING
    return ErrorCode.NONE if mode in allowed else ErrorCode.INVALID_TRANSITION_MODE

"""Rules of SPEC.md as data: capabilities and bounds.  SPEC.md chapters 7 and 14.

Boards and the conformance suite read them; the tables of SPEC.md are made of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from .messages import DriveKind, Feature, MessageType, TraceMode, UploadKind

_T: Final = MessageType

# --- Capabilities ------------------------------------------------------------------------------

PLAYBACK: Final = Feature.SEQUENCE_PHASES | Feature.SEQUENCE_POINTS
UPLOADS: Final = PLAYBACK | Feature.CORRECTION
READ_BACKS: Final = Feature.READ_LATCHED | Feature.READ_RADIATED
#: For each type that not every board takes: the capabilities of which it needs one.
TYPE_CAPABILITIES: Final[Mapping[MessageType, Feature]] = {
    _T.DRIVES: Feature.AMPLITUDE,
    _T.POINTS: Feature.POINTS,
    _T.SET_CONFIG: Feature.CONFIG,
    _T.READ_DRIVE: READ_BACKS,
    _T.UPLOAD_BEGIN: UPLOADS,
    _T.UPLOAD_CHUNK: UPLOADS,
    _T.UPLOAD_COMMIT: UPLOADS,
    _T.PLAY: PLAYBACK,
    _T.STOP: PLAYBACK,
    _T.READ_TRACE: Feature.TRACE_RING,
}
#: For each value that not every board takes: the capability that it needs.
UPLOAD_CAPABILITIES: Final[Mapping[UploadKind, Feature]] = {
    UploadKind.PHASES: Feature.SEQUENCE_PHASES,
    UploadKind.POINTS: Feature.SEQUENCE_POINTS,
    UploadKind.CORRECTION: Feature.CORRECTION,
}
READ_CAPABILITIES: Final[Mapping[DriveKind, Feature]] = {
    DriveKind.LATCHED: Feature.READ_LATCHED,
    DriveKind.RADIATED: Feature.READ_RADIATED,
}
TRACE_CAPABILITIES: Final[Mapping[TraceMode, Feature]] = {
    TraceMode.OFF: Feature(0),
    TraceMode.CRC: Feature.TRACE,
    TraceMode.DRIVE: Feature.TRACE_DRIVE,
    TraceMode.RING: Feature.TRACE_RING,
}


def unsupported_types(features: Feature) -> frozenset[MessageType]:
    """Return the types that a board with these *features* does not know.  HG-1.2/2."""
    return frozenset(kind for kind, any_of in TYPE_CAPABILITIES.items() if not any_of & features)


# --- Bounds ------------------------------------------------------------------------------------

#: Least and most of the settings that have bounds; ``status_period_ms`` may be 0 too.  HG-7.1.
CONFIG_BOUNDS: Final[Mapping[str, tuple[int, int]]] = {
    "hold_ms": (1, 10_000),
    "ramp_ms": (0, 2_000),
    "host_timeout_ms": (20, 10_000),
    "status_period_ms": (10, 65_535),
    "late_window_us": (0, 100_000),
    "sound_speed_mm_s": (300_000, 380_000),
    "trace_divider": (1, 65_535),
}

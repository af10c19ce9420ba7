"""Rules of SPEC.md as data: capabilities, bounds, refusals, effects.  SPEC.md chapter 14.

Boards and the conformance suite read them; the tables of SPEC.md are made of them.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from .messages import DriveKind, ErrorCode, Feature, MessageType, TraceMode, UploadKind

_T: Final = MessageType
_E: Final = ErrorCode

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

# --- Refusals ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Refusal:
    """A reason to refuse a request.

    Attributes
    ----------
    defect : str
        The defect, in words.
    code : ErrorCode
        Code of the answer.
    detail : str
        Detail of the answer.
    clause : str
        Clause that demands it.
    """

    defect: str
    code: ErrorCode
    detail: str
    clause: str


#: What refuses a request before it is compared with the remembered one, by step of HG-3.8.
LINK_REFUSALS: Final[Mapping[int, tuple[Refusal, ...]]] = {
    5: (Refusal("type not known, or its capability missing", _E.UNSUPPORTED, "type", "HG-3.3/3"),),
    6: (
        Refusal(
            "not of the open session (not HELLO, MUTE)",
            _E.STALE_SESSION,
            "open session, 0: none",
            "HG-4.12/1",
        ),
    ),
    8: (Refusal("must-understand flags (not MUTE)", _E.UNSUPPORTED, "these bits", "HG-3.4/1"),),
    9: (
        Refusal(
            "length (not MUTE)", _E.BAD_LENGTH, "length of the type, 0 if it varies", "HG-3.2/4"
        ),
    ),
    10: (
        Refusal("HELLO: another major version", _E.VERSION, "major version", "HG-4.4/1"),
        Refusal("HELLO: nonce 0", _E.BAD_VALUE, "2", "HG-4.1/3"),
    ),
    11: (
        Refusal(
            "number used before, other bytes (not HELLO, MUTE, UPLOAD_CHUNK)",
            _E.SEQUENCE_REUSED,
            "number",
            "HG-4.9/2",
        ),
    ),
}
_STATE: Final = "output state"
_OFFSET: Final = "offset of the field"
#: What refuses a request after step 11, in this order; other requests are never refused there.
REFUSALS: Final[Mapping[MessageType, tuple[Refusal, ...]]] = {
    _T.ARM: (Refusal("state FAULT, or a MUTE has overtaken it", _E.BAD_STATE, _STATE, "HG-6.2/1"),),
    _T.DISARM: (Refusal("the fault lasts", _E.FAULT, "the board's own number", "HG-6.6/3"),),
    _T.SET_CONFIG: (
        Refusal("`trace_mode` in no table or not advertised", _E.BAD_VALUE, "16", "HG-7.1/6"),
        Refusal("a field outside its bounds, the first one", _E.BAD_VALUE, _OFFSET, "HG-7.1/1"),
    ),
    _T.GET_GEOMETRY: (Refusal("`first` is N or more", _E.NOT_FOUND, "N", "HG-7.5/2"),),
    _T.READ_DRIVE: (
        Refusal("`kind` in no table", _E.BAD_VALUE, "0", "HG-3.2/5"),
        Refusal("`kind` not advertised", _E.UNSUPPORTED, "type", "HG-1.2/2"),
        Refusal("`first` is N or more", _E.NOT_FOUND, "N", "HG-8.6/2"),
    ),
    _T.UPLOAD_BEGIN: (
        Refusal("`kind` in no table", _E.BAD_VALUE, "0", "HG-3.2/5"),
        Refusal("`target` plays, whatever `kind`", _E.BAD_STATE, _STATE, "HG-7.2/5"),
        Refusal("`kind` not advertised", _E.UNSUPPORTED, "type", "HG-1.2/2"),
        Refusal("`points_per_frame` does not fit `kind`", _E.BAD_VALUE, "1", "HG-7.2/3"),
        Refusal("`target` does not fit `kind`", _E.BAD_VALUE, "2", "HG-7.2/3"),
        Refusal("`size` is no whole frames", _E.BAD_LENGTH, "bytes in a frame", "HG-7.2/2"),
        Refusal("no room for the bytes", _E.TOO_LARGE, "limit in bytes", "HG-7.2/1"),
        Refusal("no room for the frames", _E.TOO_LARGE, "limit in frames", "HG-7.2/1"),
    ),
    _T.UPLOAD_CHUNK: (
        Refusal("no upload", _E.BAD_STATE, _STATE, "HG-7.3/4"),
        Refusal("longer than `max_chunk`", _E.BAD_LENGTH, "`max_chunk`", "HG-7.3/3"),
        Refusal("ends past the announced size", _E.BAD_VALUE, "0", "HG-7.3/4"),
        Refusal("begins behind `received`", _E.INCOMPLETE, "`received`", "HG-7.3/1"),
    ),
    _T.UPLOAD_COMMIT: (
        Refusal("no upload", _E.BAD_STATE, _STATE, "HG-7.4/4"),
        Refusal("`target` of another upload", _E.BAD_VALUE, "0", "HG-7.4/4"),
        Refusal("`target` plays", _E.BAD_STATE, _STATE, "HG-7.4/4"),
        Refusal("bytes are missing", _E.INCOMPLETE, "first of them", "HG-7.4/2"),
        Refusal("CRC-32 of the bytes", _E.CRC_MISMATCH, "their CRC-32", "HG-7.4/3"),
    ),
    _T.PLAY: (
        Refusal("not ARMED, or a sequence plays", _E.BAD_STATE, _STATE, "HG-7.6/1"),
        Refusal("no such sequence", _E.NOT_FOUND, "stored sequences", "HG-7.6/1"),
        Refusal("`period_us` too short", _E.BAD_VALUE, "2", "HG-7.6/2"),
        Refusal("`unattended_ms` 0 or too long", _E.BAD_VALUE, "10", "HG-7.6/2"),
        Refusal("start too early or beyond the horizon", _E.BAD_VALUE, "0", "HG-7.6/2"),
    ),
}

# --- Effects -----------------------------------------------------------------------------------


class Held(enum.StrEnum):
    """Parts of what a board holds that an input may change."""

    LEASE = "lease"
    HOLD = "hold"
    QUEUE = "queue"
    PLAYBACK = "playback"
    UPLOAD = "upload"
    NUMBERS = "numbers, remembered reply"
    LATCH = "last latch, ring"
    DIVIDER = "divider"
    MARGINS = "margins"
    STATUS = "status timer"
    STORED = "sequences, configuration, correction"


_OFF: Final[Mapping[Held, str]] = {
    Held.LEASE: "stops",
    Held.HOLD: "stops",
    Held.QUEUE: "flushed",
    Held.PLAYBACK: "ends",
}
#: For each input what it does to what a board holds; what is not named it leaves as it is.
EFFECTS: Final[Mapping[str, Mapping[Held, str]]] = {
    "reset": dict.fromkeys(Held, "as new") | {Held.STORED: "default; CONFIG_KEPT: HG-7.1/4"},
    "HELLO, another nonce": {
        **_OFF,
        Held.UPLOAD: "abandoned",
        Held.NUMBERS: "anew, forgotten",
        Held.LATCH: "none, empty",
        Held.DIVIDER: "anew",
        Held.STATUS: "anew",
    },
    "HELLO, open nonce": {},
    "ARM": {Held.LEASE: "anew", Held.NUMBERS: "requests"},
    "MUTE, any session": {**_OFF, Held.NUMBERS: "requests, if of the session; not remembered"},
    "DISARM": {**_OFF, Held.NUMBERS: "requests"},
    "a fault of the hardware": _OFF,
    "end of a ramp": _OFF,
    "frame of the open session, any": {Held.LEASE: "anew, if ARMED"},
    "stream frame accepted": {
        Held.LEASE: "anew",
        Held.QUEUE: "one more; IMMEDIATE: flushed before",
        Held.NUMBERS: "stream",
        Held.MARGINS: "one more; not IMMEDIATE",
    },
    "stream frame dropped": {
        Held.LEASE: "anew, if ARMED",
        Held.NUMBERS: "stream; not `duplicate`",
        Held.MARGINS: "one more from step 13 on",
    },
    "latch": {
        Held.HOLD: "anew",
        Held.QUEUE: "one less, of the stream",
        Held.PLAYBACK: "one further, of a sequence",
        Held.LATCH: "this one; one more in mode RING",
        Held.DIVIDER: "one more in mode DRIVE",
    },
    "SET_CONFIG": {
        Held.LEASE: "anew, new length",
        Held.HOLD: "new length from the last latch",
        Held.NUMBERS: "requests",
        Held.DIVIDER: "anew",
        Held.STATUS: "anew",
        Held.STORED: "configuration",
    },
    "PLAY": {
        Held.LEASE: "anew, `unattended_ms`",
        Held.QUEUE: "flushed",
        Held.PLAYBACK: "begins",
        Held.NUMBERS: "requests",
    },
    "STOP of a playback": {
        Held.LEASE: "anew, `host_timeout_ms`",
        Held.PLAYBACK: "ends",
        Held.NUMBERS: "requests",
    },
    "last frame of a playback, besides its latch": {
        Held.LEASE: "anew, `host_timeout_ms`",
        Held.PLAYBACK: "ends",
    },
    "UPLOAD_BEGIN": {
        Held.LEASE: "anew, if ARMED",
        Held.UPLOAD: "this one, empty",
        Held.NUMBERS: "requests",
    },
    "UPLOAD_CHUNK": {
        Held.LEASE: "anew, if ARMED",
        Held.UPLOAD: "its bytes",
        Held.NUMBERS: "requests; not remembered",
    },
    "UPLOAD_COMMIT": {
        Held.LEASE: "anew, if ARMED",
        Held.UPLOAD: "done",
        Held.NUMBERS: "requests",
        Held.STORED: "the sequence or correction",
    },
    "GET_STATUS": {
        Held.LEASE: "anew, if ARMED",
        Held.NUMBERS: "requests",
        Held.MARGINS: "anew",
    },
    "STATUS sent": {Held.MARGINS: "anew", Held.STATUS: "anew"},
    "any other request, carried out": {Held.LEASE: "anew, if ARMED", Held.NUMBERS: "requests"},
    "request refused behind step 11": {Held.LEASE: "anew, if ARMED", Held.NUMBERS: "requests"},
    "request refused in steps 5 to 11": {Held.LEASE: "anew, if ARMED and of the session"},
}

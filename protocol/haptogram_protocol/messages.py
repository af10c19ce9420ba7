"""Every message of the protocol: one frozen dataclass each.  SPEC.md chapters 3 to 10.

Defining a message adds it: nothing lists it a second time.

``serialize`` returns the payload, ``deserialize`` reads it; the ten header bytes are a record of
their own. A wrong length, or a value outside its range, raises :class:`RemoteProtocolError` and no
other error. The rules about when a message may be sent live in :mod:`.connection`.
"""

from __future__ import annotations

import enum
import functools
import re
import struct
from typing import ClassVar, Final, Self

from .documented import DocumentedEnum, DocumentedFlag
from .errors import LocalProtocolError, RemoteProtocolError
from .record import Record, nested, record, repeated, tail, wire
from .state import MuteReason, OutputState

# --- Header, types, flags, errors: chapters 3 and 10 ----------------------------------------------

VERSION_MAJOR: Final = 2  # HG-4.2
VERSION_MINOR: Final = 0
MAX_TRANSDUCERS: Final = 1024  # HG-5.1
FIRST_STREAM_SEQ: Final = 0xFFF0  # HG-3.6: so that every run crosses the wrap
_WORD: Final = re.compile("(?<!^)(?=[A-Z])")  # where a word of a name begins
RESPONSE_OFFSET: Final = 0x40  # HG-3.3: type of a response = type of its request + 0x40


STREAM_RANGE: Final = range(0x00, 0x40)
REQUEST_RANGE: Final = range(0x40, 0x80)
RESPONSE_RANGE: Final = range(0x80, 0xC0)
EVENT_RANGE: Final = range(0xC0, 0x100)
MUST_UNDERSTAND: Final = 0xF0  # HG-3.4
_FULL_AMPLITUDE: Final = 255  # amplitude code


class MessageType(enum.IntEnum):
    """Type byte.  HG-3.3: 00-3F stream, 40-7F request, 80-BF response, C0-FF event."""

    PHASES = 0x01
    DRIVES = 0x02
    POINTS = 0x03

    HELLO = 0x40
    ARM = 0x41
    MUTE = 0x42
    DISARM = 0x43
    PING = 0x44
    GET_STATUS = 0x45
    GET_CONFIG = 0x46
    SET_CONFIG = 0x47
    GET_GEOMETRY = 0x48
    READ_DRIVE = 0x49
    UPLOAD_BEGIN = 0x4A
    UPLOAD_CHUNK = 0x4B
    UPLOAD_COMMIT = 0x4C
    PLAY = 0x4D
    STOP = 0x4E
    READ_TRACE = 0x4F

    HELLO_REPLY = 0x80
    ARM_REPLY = 0x81
    MUTE_REPLY = 0x82
    DISARM_REPLY = 0x83
    PONG = 0x84
    STATUS_REPLY = 0x85
    CONFIG_REPLY = 0x86
    SET_CONFIG_REPLY = 0x87
    GEOMETRY_REPLY = 0x88
    DRIVE_REPLY = 0x89
    UPLOAD_BEGIN_REPLY = 0x8A
    UPLOAD_CHUNK_REPLY = 0x8B
    UPLOAD_COMMIT_REPLY = 0x8C
    PLAY_REPLY = 0x8D
    STOP_REPLY = 0x8E
    TRACE_REPLY = 0x8F
    ERROR = 0xBF

    STATUS = 0xC0
    TRACE = 0xC1
    TRACE_PLAYBACK = 0xC2
    TRACE_DRIVE = 0xC3
    STATE_CHANGED = 0xC4
    PLAYBACK_ENDED = 0xC5


class Flag(DocumentedFlag):
    """Header flags.  HG-3.4: a receiver must understand the high nibble, may ignore the low one."""

    LATE = 0x01, "trace: the frame was late, within the late window (HG-5.7/6)"
    IMMEDIATE = 0x10, "stream, PLAY: t_apply is not used, act as soon as the frame is complete"


class ErrorCode(DocumentedEnum):
    """Why a request was refused.  HG-10.2."""

    UNSUPPORTED = 1, "unknown request or must-understand flag; detail: the type or the flags"
    BAD_LENGTH = 2, "detail: the length that the type calls for (0: variable)"
    BAD_VALUE = 3, "detail: byte offset of the field in the payload"
    BAD_STATE = 4, "detail: the output state"
    STALE_SESSION = 5, "detail: the board's session (0: none)"
    SEQUENCE_REUSED = 6, "seq of an earlier request, other bytes; detail: seq"
    VERSION = 7, "HELLO of another major version; detail: the board's major version"
    BUSY = 8, "detail: milliseconds after which to ask again"
    TOO_LARGE = 9, "detail: the limit"
    INCOMPLETE = 10, "bytes of an upload are missing; detail: the first of them"
    CRC_MISMATCH = 11, "upload; detail: the CRC-32 that the board computed"
    FAULT = 12, "hardware fault; detail: board-specific"
    NOT_FOUND = 13, "no such sequence, no such transducer; detail: how many there are"


@record
class Header(Record):
    """The ten bytes before every payload.  HG-3.1."""

    type: int = wire("B", "message type")
    flags: int = wire("B", "high nibble: must be understood; low nibble: may be ignored")
    seq: int = wire("H", "sequence number, modulo 2^16; stream and control count apart")
    time_us: int = wire("I", "t_apply (host) or t_device (board), device clock, modulo 2^32")
    session: int = wire("H", "nonce of the session; 0: none (HG-3.7)")

    @classmethod
    def of_body(cls, body: bytes) -> Self:
        """Return the header that a body begins with.

        Raises
        ------
        RemoteProtocolError
            If the body is shorter.
        """
        if len(body) < cls.LAYOUT.size:
            return cls.unpack(body)
        return cls(*cls.LAYOUT.unpack_from(body))


class Message(Record):
    """Base of every payload.

    Attributes
    ----------
    TYPE : MessageType
        Type byte of the message: the one of its name, such as ``GET_CONFIG`` of ``GetConfig``.
    """

    __slots__ = ()
    TYPE: ClassVar[MessageType]

    def __init_subclass__(cls) -> None:
        name = _WORD.sub("_", cls.__name__).upper()
        if name in MessageType.__members__:
            cls.TYPE = MessageType[name]

    def serialize(self) -> bytes:
        """Return the payload.

        Raises
        ------
        LocalProtocolError
            If a value does not fit its field.
        """
        return self.pack()

    @classmethod
    def deserialize(cls, payload: bytes) -> Self:
        """Return the message whose payload is *payload*.

        Raises
        ------
        RemoteProtocolError
            With the reason ``bad_length``, or ``bad_value`` and the offset of the field.
        """
        return cls.unpack(payload)


@record
class Ack(Message):
    """Done; the output state after it."""

    state: OutputState = wire("B", "output state", enum=OutputState)


@record
class Error(Message):
    """The request was refused; this layout is frozen across major versions.  HG-10.1."""

    request: int = wire("B", "type of the request")
    code: int = wire("B", "error code")
    detail: int = wire("I", "number that belongs to the code")


def signed_difference(a: int, b: int, bits: int) -> int:
    """Return ``a - b`` modulo ``2**bits`` as a signed number: positive if *a* is ahead.  HG-3.6."""
    half = 1 << (bits - 1)
    return ((a - b + half) & ((1 << bits) - 1)) - half


def unwrap(value: int, near: int, bits: int) -> int:
    """Return the number closest to *near* that is *value* modulo ``2**bits``.  HG-3.6."""
    half = 1 << (bits - 1)  # as signed_difference has it: a frame asks for it
    return near + ((value - near + half) & ((1 << bits) - 1)) - half


# --- Session, output state and time: chapters 4 and 6 ---------------------------------------------


class Feature(DocumentedFlag):
    """Capabilities in HELLO_REPLY.  HG-4.5."""

    AMPLITUDE = 1 << 0, "DRIVES frames; ramps and the amplitude ceiling are graded"
    POINTS = 1 << 1, "POINTS frames: the board computes the drive"
    SEQUENCE_PHASES = 1 << 2, "playback of uploaded phase frames"
    SEQUENCE_POINTS = 1 << 3, "playback of uploaded focal points"
    CONFIG = 1 << 4, "SET_CONFIG"
    CORRECTION = 1 << 5, "per-transducer phase correction"
    READ_LATCHED = 1 << 6, "READ_DRIVE of the latched drive"
    READ_RADIATED = 1 << 7, "READ_DRIVE of the radiated drive"
    TRACE = 1 << 8, "TRACE and TRACE_PLAYBACK events"
    TRACE_DRIVE = 1 << 9, "TRACE_DRIVE events"
    TRACE_RING = 1 << 10, "READ_TRACE"
    SYNC_IN = 1 << 11, "reserved: several boards on one trigger"
    COMMIT = 1 << 12, "reserved: one latch for several frames"
    CONFIG_KEPT = 1 << 13, "the configuration survives a reset"


@record
class Hello(Message):
    """Open a session; this layout is frozen across major versions.  HG-4.1."""

    major: int = wire("B", "major version of the host")
    minor: int = wire("B", "minor version of the host")
    nonce: int = wire("H", "session asked for, never 0, chosen at random")
    reserved: int = wire("I", "0; a board takes any value", default=0)


@record
class HelloReply(Message):
    """Identity and capabilities of the board; frozen up to ``reserved``.  HG-4.3."""

    major: int = wire("B", "major version of the board")
    minor: int = wire("B", "minor version of the board")
    nonce: int = wire("H", "session now open")
    reserved: int = wire("I", "0; a host takes any value")
    features: int = wire("I", "capability bits")
    clock_hz: int = wire("I", "ticks of the device clock per second; 1000000")
    clock_ppm: int = wire("H", "largest error of that clock, parts per million")
    carrier_hz: int = wire("I", "carrier frequency, Hz")
    transducers: int = wire("H", "number of transducers, N")
    grid_nx: int = wire("H", "columns of the grid, 0 if it is none")
    grid_ny: int = wire("H", "rows of the grid, 0 if it is none")
    pitch_um: int = wire("I", "pitch of the grid, micrometres, 0 if it is none")
    geometry_hash: int = wire("I", "CRC-32 over the geometry records in order")
    sound_speed_mm_s: int = wire("I", "sound speed used for POINTS, mm/s")
    max_points: int = wire("B", "focal points in one POINTS frame, at most")
    state: OutputState = wire("B", "output state", enum=OutputState)
    queue_depth: int = wire("H", "frames that may wait for their t_apply")
    trace_ring: int = wire("H", "latches that the trace ring keeps")
    max_horizon_us: int = wire("I", "how far ahead t_apply may lie, microseconds")
    rx_window: int = wire("I", "encoded bytes that the board can take without a pause")
    max_frame_rate_hz: int = wire("I", "latches per second from the stream, at most")
    max_sequence_frames: int = wire("I", "frames in one sequence, at most")
    max_upload_bytes: int = wire("I", "bytes in one upload, at most")
    max_playback_rate_hz: int = wire("I", "frames per second in playback, at most")
    max_unattended_ms: int = wire("I", "longest playback without a frame from the host")
    upload_window: int = wire("H", "upload chunks that may be unanswered at a time")
    max_chunk: int = wire("H", "bytes of data in one upload chunk, at most")
    latch_lead_us: int = wire("I", "time from a frame's arrival to its latch, microseconds")
    point_time_us: int = wire("I", "time that each focal point adds to it, microseconds")
    boot_id: int = wire("I", "changes with every reset")
    config_crc: int = wire("I", "CRC-32 of configuration and phase correction")
    firmware: str = wire("16s", "name and version of the firmware, UTF-8, zero-padded")


@record
class Arm(Message):
    """Allow output.  HG-6.3."""


@record
class Mute(Message):
    """Switch the output off, now, from any session.  HG-6.4."""


@record
class Disarm(Message):
    """Switch the output off and forbid it.  HG-6.5."""


@record
class ArmReply(Ack):
    """Answer to ARM."""


@record
class MuteReply(Ack):
    """Answer to MUTE."""


@record
class DisarmReply(Ack):
    """Answer to DISARM."""


@record
class Ping(Message):
    """Ask for the device time.  HG-6.9."""

    echo: int = wire("Q", "any number; comes back")


@record
class Pong(Message):
    """The device time.  HG-6.9."""

    echo: int = wire("Q", "the number from the PING")
    t_rx_us: int = wire("I", "device time of the PING's closing delimiter")
    t_tx_us: int = wire("I", "device time of the first byte of this frame")


@record
class StateChanged(Message):
    """The output state changed without a request.  HG-6.8."""

    state: OutputState = wire("B", "output state", enum=OutputState)
    reason: MuteReason = wire("B", "why", enum=MuteReason)


# --- Stream, host to board: chapter 5 -------------------------------------------------------------


@record
class Phases(Message):
    """Phases of every transducer at full amplitude.  HG-5.2."""

    data: bytes = tail("N phases u8, 256 steps a turn")


@record
class Drives(Message):
    """Phase and amplitude of every transducer.  HG-5.3."""

    data: bytes = tail("N phases u8, then N amplitudes u8, linear in pressure, 255 = full", unit=2)


@record
class FocalPoint(Record):
    """One focal point.  HG-5.4."""

    x_um: int = wire("i", "position, micrometres from the array's centre")
    y_um: int = wire("i", "position, micrometres")
    z_um: int = wire("i", "position, micrometres, along the emission side")
    amplitude: int = wire("H", "share of the drive, 65535 = full")
    phase: int = wire("H", "phase of the pressure at the point, 1/65536 of a turn, lag positive")


@record
class Points(Message):
    """Focal points whose drive the board computes.  HG-5.4."""

    points: tuple[FocalPoint, ...] = repeated(FocalPoint, "focal points", least=1)


def drive_codes(message: Message, transducers: int) -> tuple[bytes, bytes] | None:
    r"""Return the phase and amplitude codes that a frame asks for.

    Returns
    -------
    tuple of (N,) bytes, or None
        None for a message that holds no drive, and for POINTS, whose drive the board computes.

    Raises
    ------
    RemoteProtocolError
        If there are not N phases, and amplitudes (``bad_length``).

    Examples
    --------
    >>> drive_codes(Phases(bytes([1, 2])), 2)
    (b'\x01\x02', b'\xff\xff')
    """
    if not isinstance(message, (Phases, Drives)):
        return None
    count = transducers * (1 if isinstance(message, Phases) else 2)
    if len(message.data) != count:
        raise RemoteProtocolError(
            f"{len(message.data)} bytes of codes; {transducers} transducers take {count}",
            reason="bad_length",
        )
    amplitudes = message.data[transducers:] or _full_amplitudes(transducers)
    return message.data[:transducers], amplitudes


@functools.cache
def _full_amplitudes(transducers: int) -> bytes:
    """Return the amplitude code 255 for each transducer."""
    return bytes([_FULL_AMPLITUDE]) * transducers


# --- Configuration and geometry: chapter 7 --------------------------------------------------------


class TraceMode(DocumentedEnum):
    """Report of a board about every latch.  HG-8.1."""

    OFF = 0, "nothing"
    CRC = 1, "TRACE or TRACE_PLAYBACK for every latch"
    DRIVE = 2, "TRACE_DRIVE for every trace_divider-th latch"
    RING = 3, "no event; the last trace_ring latches are kept for READ_TRACE"


@record
class Config(Record):
    """Settings of a board.  HG-7.1."""

    hold_ms: int = wire("H", "how long the last drive is held without a new latch", default=200)
    ramp_ms: int = wire("H", "how long the ramp to silence takes", default=50)
    host_timeout_ms: int = wire(
        "H", "lease: renewed by any valid frame of the session", default=500
    )
    status_period_ms: int = wire("H", "time between two STATUS events, 0: none", default=100)
    late_window_us: int = wire("I", "lateness up to which a frame is still latched", default=0)
    sound_speed_mm_s: int = wire("I", "sound speed used for POINTS, mm/s", default=343_987)
    trace_mode: TraceMode = wire("B", "trace of latches", enum=TraceMode, default=TraceMode.OFF)
    amplitude_ceiling: int = wire("B", "largest amplitude radiated, 255 = full", default=255)
    trace_divider: int = wire("H", "TRACE_DRIVE of every k-th latch", default=1)


@record
class GetConfig(Message):
    """Ask for the configuration."""


@record
class SetConfig(Message):
    """Set the whole configuration.  HG-7.1."""

    config: Config = nested(Config, "configuration")


@record
class _ConfigBody(Message):
    config_crc: int = wire("I", "CRC-32 of configuration and phase correction")
    config: Config = nested(Config, "configuration in force")


@record
class ConfigReply(_ConfigBody):
    """Answer to GET_CONFIG."""


@record
class SetConfigReply(_ConfigBody):
    """Answer to SET_CONFIG."""


@record
class Element(Record):
    """Position and normal of one transducer.  HG-7.5."""

    x_um: int = wire("i", "position, micrometres from the array's centre")
    y_um: int = wire("i", "position, micrometres")
    z_um: int = wire("i", "position, micrometres")
    nx: int = wire("h", "unit normal, 32767 = 1")
    ny: int = wire("h", "unit normal")
    nz: int = wire("h", "unit normal")


@record
class GetGeometry(Message):
    """Ask for positions and normals.  HG-7.5."""

    first: int = wire("H", "first transducer asked for")
    count: int = wire("H", "transducers asked for")


@record
class GeometryReply(Message):
    """Positions and normals, as many as fit.  HG-7.5."""

    total: int = wire("H", "number of transducers of the board")
    first: int = wire("H", "first transducer in this reply")
    elements: tuple[Element, ...] = repeated(Element, "transducers, in order")


# --- Uploads and playback on the board's clock: chapter 7 -----------------------------------------


class UploadKind(DocumentedEnum):
    """Content of an upload.  HG-7.2."""

    PHASES = 1, "sequence, N bytes a frame: 8-bit phases, every amplitude 255"
    POINTS = 2, "sequence, points_per_frame x 16 bytes a frame: focal points"
    CORRECTION = 3, "phase correction, N bytes: 1/256 of a turn each"


@record
class UploadBegin(Message):
    """Announce an upload.  HG-7.2."""

    kind: UploadKind = wire("B", "1 phases, 2 points, 3 phase correction", enum=UploadKind)
    points_per_frame: int = wire("B", "kind 2: focal points in every frame; else 0")
    target: int = wire("H", "sequence id, 1 or more; kind 3: 0")
    size: int = wire("I", "bytes to come")
    crc: int = wire("I", "CRC-32 of these bytes")


@record
class UploadBeginReply(Message):
    """The board is ready for the upload.  HG-7.2."""

    max_chunk: int = wire("H", "bytes of data in one chunk, at most")
    window: int = wire("H", "chunks that may be unanswered at a time")


@record
class UploadChunk(Message):
    """Part of an upload, at an absolute offset: sending it twice does no harm.  HG-7.3."""

    offset: int = wire("I", "where these bytes belong")
    data: bytes = tail("bytes of the upload")


@record
class UploadChunkReply(Message):
    """Progress of the upload.  HG-7.3."""

    received: int = wire("I", "bytes that are there, from the start")


@record
class UploadCommit(Message):
    """Take the upload, whole or not at all.  HG-7.4."""

    target: int = wire("H", "as in UPLOAD_BEGIN")


@record
class UploadCommitReply(Message):
    """The upload is in force.  HG-7.4."""

    frames: int = wire("I", "frames in the sequence; kind 3: number of transducers")


@record
class Play(Message):
    """Play a sequence on the board's clock, from the header's t_apply on.  HG-7.6."""

    sequence: int = wire("H", "sequence id")
    period_us: int = wire("I", "time from one frame to the next, microseconds")
    loops: int = wire("I", "how often; 0: until STOP")
    unattended_ms: int = wire("I", "replaces host_timeout_ms while this plays")


@record
class PlayReply(Ack):
    """Answer to PLAY."""


@record
class Stop(Message):
    """End playback; the last drive is held for ``hold_ms``.  HG-7.7."""


@record
class StopReply(Ack):
    """Answer to STOP."""


@record
class PlaybackEnded(Message):
    """A sequence ended, by itself or by STOP, MUTE, a timer.  HG-7.8."""

    sequence: int = wire("H", "sequence id")
    loops: int = wire("I", "whole passes played")
    frames: int = wire("I", "frames latched")


# --- Latched drives, read-back and trace: chapter 8 -----------------------------------------------


class DriveKind(DocumentedEnum):
    """Which drive a read-back shows.  HG-8.6."""

    LATCHED = 0, "registers, before correction, ceiling and ramp"
    RADIATED = 1, "what drives the transducers, after all of them"


@record
class LatchKey(Record):
    """Which drive: the join key of host and board within a session.  HG-8.2."""

    sequence: int = wire("H", "sequence id, 0: the stream")
    loop: int = wire("I", "pass of the sequence, from 0; stream: 0")
    index: int = wire("I", "frame of the sequence; stream: unwrapped sequence number")


@record
class ReadDrive(Message):
    """Ask for the drive at the transducers.  HG-8.6."""

    kind: DriveKind = wire("B", "0 latched, 1 radiated", enum=DriveKind)
    first: int = wire("H", "first transducer asked for")
    count: int = wire("H", "transducers asked for")


@record
class DriveReply(Message):
    """Phase and amplitude, as they are at one moment.  HG-8.6."""

    kind: DriveKind = wire("B", "0 latched, 1 radiated", enum=DriveKind)
    key: LatchKey = nested(LatchKey, "the drive that is latched")
    t_latch_us: int = wire("I", "device time of that latch")
    first: int = wire("H", "first transducer in this reply")
    data: bytes = tail("n phases u8, then n amplitudes u8", unit=2)


@record
class Trace(Message):
    """A stream frame was latched at the header's t_device.  HG-8.3."""

    index: int = wire("I", "unwrapped sequence number of the stream frame")
    crc: int = wire("I", "CRC-32 of the latched drive: N phases u8, N amplitudes u8")


@record
class TracePlayback(Message):
    """A frame of a sequence was latched at the header's t_device.  HG-8.3."""

    key: LatchKey = nested(LatchKey, "which frame")
    crc: int = wire("I", "CRC-32 of the latched drive: N phases u8, N amplitudes u8")


@record
class TraceDrive(Message):
    """A drive was latched at the header's t_device, in full.  HG-8.4."""

    key: LatchKey = nested(LatchKey, "which frame")
    data: bytes = tail("N phases u8, then N amplitudes u8", unit=2)


@record
class TraceRecord(Record):
    """One latch in the trace ring.  HG-8.5."""

    number: int = wire("I", "count of latches since the session began")
    key: LatchKey = nested(LatchKey, "which frame")
    t_latch_us: int = wire("I", "device time of the latch")
    crc: int = wire("I", "CRC-32 of the latched drive: N phases u8, N amplitudes u8")
    flags: int = wire("B", "bit 0: late")


@record
class ReadTrace(Message):
    """Ask for latches from the trace ring.  HG-8.5."""

    first: int = wire("I", "number of the first latch asked for")
    count: int = wire("H", "latches asked for")


@record
class TraceReply(Message):
    """Latches from the trace ring, as many as fit.  HG-8.5."""

    oldest: int = wire("I", "number of the oldest latch that the ring still holds")
    next: int = wire("I", "number that the next latch will get")
    records: tuple[TraceRecord, ...] = repeated(TraceRecord, "latches, oldest first")


# --- Counters and arrival margin: chapter 9 -------------------------------------------------------


@record
class Counters(Record):
    """Counters of the board since it started, each modulo 2^32.  HG-9.2."""

    frames: int = wire("I", "frames with a valid CRC")
    accepted: int = wire("I", "stream frames taken into the queue")
    latched: int = wire("I", "drives latched, from stream and playback")
    late: int = wire("I", "of these, latched late, within the late window")
    dropped_late: int = wire("I", "stream frames that came too late for their t_apply")
    dropped_future: int = wire("I", "stream frames beyond the horizon")
    dropped_order: int = wire("I", "stream frames whose t_apply is not after the last queued one")
    dropped_full: int = wire("I", "stream frames that met a full queue")
    dropped_state: int = wire("I", "stream frames while not armed, or while a sequence plays")
    flushed: int = wire(
        "I", "queued frames discarded, or replaced by a later one on the same carrier period"
    )
    duplicate: int = wire("I", "stream frames numbered up to 32 before the one expected")
    gap: int = wire("I", "stream sequence numbers that never came")
    stale_session: int = wire("I", "stream frames of another session")
    crc: int = wire("I", "frames whose CRC is wrong")
    cobs: int = wire("I", "frames that are not COBS")
    short: int = wire("I", "frames shorter than header and CRC")
    oversize: int = wire("I", "runs of bytes longer than any frame")
    bad_length: int = wire("I", "stream frames whose payload has a wrong length")
    bad_value: int = wire("I", "stream frames with a value outside its range")
    unknown_type: int = wire(
        "I", "frames of a type that no request has and the board does not take"
    )
    unsupported: int = wire("I", "stream frames with must-understand flags that are not known")
    requests: int = wire("I", "requests, carried out or refused, whatever refused them")
    repeated: int = wire("I", "requests, HELLO among them, answered again from memory")
    trace_dropped: int = wire("I", "trace events that found no room on the line")
    timeouts: int = wire("I", "mutes by a timer")


#: Counters that grow while nothing is wrong.
GROWING_COUNTERS: Final = frozenset({"frames", "accepted", "requests", "latched"})


@record
class _StatusBody(Message):
    state: OutputState = wire("B", "output state", enum=OutputState)
    reason: MuteReason = wire("B", "why the output is off", enum=MuteReason)
    queued: int = wire("H", "frames that wait for their t_apply")
    free_bytes: int = wire("I", "encoded bytes that the board can take now")
    last_seq: int = wire("I", "unwrapped sequence number of the last latched stream frame")
    last_latch_us: int = wire("I", "device time of the last latch")
    margins: int = wire("H", "stream frames that the two margins speak of; then they start anew")
    margin_min_us: int = wire("i", "least margin, t_apply - ready, since the last status")
    margin_mean_us: int = wire("i", "mean margin, t_apply - ready, since the last status")
    config_crc: int = wire("I", "CRC-32 of configuration and phase correction")
    counters: Counters = nested(Counters, "counters")


@record
class Status(_StatusBody):
    """Counters and arrival margin, sent by itself every ``status_period_ms``.  HG-9.1."""


@record
class GetStatus(Message):
    """Ask for the status."""


@record
class StatusReply(_StatusBody):
    """Answer to GET_STATUS."""


# --- From bytes and to bytes --------------------------------------------------------------------

_KINDS: Final = [
    kind
    for kind in list(globals().values())
    if isinstance(kind, type) and issubclass(kind, Message) and hasattr(kind, "TYPE")
]
#: Message by type byte, in the order of the types.
MESSAGES: Final[dict[int, type[Message]]] = {
    int(kind.TYPE): kind for kind in sorted(_KINDS, key=lambda kind: kind.TYPE)
}


def parse_body(body: bytes) -> tuple[Header, Message]:
    """Return header and message of a frame whose CRC was right.

    Fields that a later minor version adds to a response or event are ignored (HG-11.3).

    Parameters
    ----------
    body : bytes
        Header and payload, as a :class:`~haptogram_protocol.framing.FrameDecoder` returns them.

    Raises
    ------
    RemoteProtocolError
        With the reason ``unknown_type``, ``bad_length`` or ``bad_value``.
    """
    header = Header.of_body(body)
    return header, parse_payload(header, body)


def parse_payload(header: Header, body: bytes) -> Message:
    """Return the message after *header*; see :func:`parse_body`."""
    message = MESSAGES.get(header.type)
    if message is None:
        raise RemoteProtocolError(
            f"message type {header.type:#04x} is unknown", reason="unknown_type"
        )
    grows = header.type >= RESPONSE_RANGE.start and not message.TAIL
    size = Header.LAYOUT.size
    return message.deserialize(body[size : size + message.LAYOUT.size if grows else None])


def build_body(message: Message, *, flags: int, seq: int, time_us: int, session: int) -> bytes:
    """Return header and payload of a frame, for :func:`~haptogram_protocol.framing.encode_frame`.

    Parameters
    ----------
    message : Message
        Payload.
    flags : int
        Sum of :class:`Flag` bits.
    seq : int
        Sequence number; taken modulo 2^16.
    time_us : int
        Device time in microseconds; taken modulo 2^32.
    session : int
        Nonce of the session, 0 to 65535.

    Raises
    ------
    LocalProtocolError
        If a value does not fit its field.
    """
    kind, time_us = message.TYPE, time_us & 0xFFFFFFFF
    try:
        header = Header.LAYOUT.pack(kind, flags, seq & 0xFFFF, time_us, session)
    except struct.error as error:
        raise LocalProtocolError(f"header of {kind.name} does not fit: {error}") from error
    return header + message.serialize()

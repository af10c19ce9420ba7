"""Every message of the protocol: one frozen dataclass each.  SPEC.md chapters 3 to 8.

``serialize`` gives the payload, ``deserialize`` takes it; the ten header bytes are a record of
their own.  A wrong length or a value outside its range is a :class:`RemoteProtocolError` and
nothing else.
"""

from __future__ import annotations

import enum
from typing import ClassVar, Final, Self

from .errors import LocalProtocolError, RemoteProtocolError
from .record import Record, nested, record, wire
from .state import MuteReason, OutputState

VERSION_MAJOR: Final = 1  # HG-4.2
VERSION_MINOR: Final = 0
MAX_TRANSDUCERS: Final = 1024  # HG-5.1
FIRST_STREAM_SEQ: Final = 0xFFF0  # HG-3.6: so that every run crosses the wrap
RESPONSE_OFFSET: Final = 0x40  # HG-3.3: type of a response = type of its request + 0x40


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


class Flag(enum.IntFlag):
    """Header flags.  HG-3.4: a receiver must understand the high nibble, may ignore the low one."""

    LATE = 0x01  # trace: latched after its t_apply, within the late window
    IMMEDIATE = 0x10  # stream, PLAY: t_apply is not used, act as soon as the frame is complete


MUST_UNDERSTAND: Final = 0xF0
UNDERSTOOD: Final = int(Flag.IMMEDIATE)


class Feature(enum.IntFlag):
    """Capabilities in HELLO_REPLY.  HG-4.5."""

    AMPLITUDE = 1 << 0  # DRIVES frames; ramps and the amplitude ceiling are graded
    POINTS = 1 << 1  # POINTS frames: the board computes the drive
    SEQUENCE_PHASES = 1 << 2  # playback of uploaded phase frames
    SEQUENCE_POINTS = 1 << 3  # playback of uploaded focal points
    CONFIG = 1 << 4  # SET_CONFIG
    CORRECTION = 1 << 5  # per-transducer phase correction
    READ_LATCHED = 1 << 6  # READ_DRIVE of the latched drive
    READ_RADIATED = 1 << 7  # READ_DRIVE of the radiated drive
    TRACE = 1 << 8  # TRACE and TRACE_PLAYBACK events
    TRACE_DRIVE = 1 << 9  # TRACE_DRIVE events
    TRACE_RING = 1 << 10  # READ_TRACE
    SYNC_IN = 1 << 11  # reserved: several boards on one trigger
    COMMIT = 1 << 12  # reserved: one latch for several frames
    CONFIG_KEPT = 1 << 13  # the configuration survives a reset


class PhaseFormat(enum.IntEnum):
    """Bits per phase.  HG-5.2."""

    BITS_8 = 8
    BITS_6 = 6
    BITS_5 = 5


class ErrorCode(enum.IntEnum):
    """Why a request was refused.  HG-10.2."""

    UNSUPPORTED = 1  # unknown request or must-understand flag; detail: the type or the flags
    BAD_LENGTH = 2  # detail: the length that the type calls for (0: variable)
    BAD_VALUE = 3  # detail: byte offset of the field in the payload
    BAD_STATE = 4  # detail: the output state
    STALE_SESSION = 5  # detail: the board's session (0: none)
    SEQUENCE_REUSED = 6  # same seq as the last request, other bytes; detail: seq
    VERSION = 7  # HELLO of another major version; detail: the board's major version
    BUSY = 8  # detail: milliseconds after which to ask again
    TOO_LARGE = 9  # detail: the limit
    INCOMPLETE = 10  # upload with a gap; detail: first byte that is missing
    CRC_MISMATCH = 11  # upload; detail: the CRC-32 that the board computed
    FAULT = 12  # hardware fault; detail: board-specific
    NOT_FOUND = 13  # no such sequence, no such transducer; detail: how many there are


class TraceMode(enum.IntEnum):
    """What a board reports of every latch.  HG-8.1."""

    OFF = 0
    CRC = 1
    DRIVE = 2
    RING = 3


class UploadKind(enum.IntEnum):
    """What an upload holds.  HG-7.2."""

    PHASES = 1
    POINTS = 2
    CORRECTION = 3


class DriveKind(enum.IntEnum):
    """Which drive a read-back shows.  HG-8.6."""

    LATCHED = 0
    RADIATED = 1


@record
class Header(Record):
    """The ten bytes before every payload.  HG-3.1."""

    type: int = wire("B", "message type")
    flags: int = wire("B", "high nibble: must be understood; low nibble: may be ignored")
    seq: int = wire("H", "sequence number, modulo 2^16; stream and control count apart")
    time_us: int = wire("I", "t_apply (host) or t_device (board), device clock, modulo 2^32")
    session: int = wire("H", "nonce of the session; 0 only in HELLO, MUTE and ERROR")


class Message(Record):
    """Base of every payload.  ``TYPE`` is its type byte."""

    __slots__ = ()
    TYPE: ClassVar[MessageType]

    def serialize(self) -> bytes:
        """Return the payload; :class:`LocalProtocolError` if a value does not fit."""
        return self.pack()

    @classmethod
    def deserialize(cls, payload: bytes) -> Self:
        """Return the message; :class:`RemoteProtocolError` (``bad_length``, ``bad_value``)."""
        return cls.unpack(payload)


class _Tailed(Message):
    """A fixed part and a tail of bytes in the field ``data``, in units of ``tail_unit`` bytes."""

    __slots__ = ()
    data: bytes

    def serialize(self) -> bytes:
        return self.pack() + self.data

    @classmethod
    def deserialize(cls, payload: bytes) -> Self:
        size = cls.LAYOUT.size
        if len(payload) < size:
            raise RemoteProtocolError(
                f"{cls.__name__} of {len(payload)} bytes; it has {size} or more", reason="bad_length"
            )
        return cls(**cls._values(payload), data=payload[size:])


# --- Stream, host to board (chapter 5) ---------------------------------------------------------


def packed_size(transducers: int, bits: int) -> int:
    """Return the bytes that *transducers* phases of *bits* take."""
    return (transducers * bits + 7) // 8


def pack_phases(codes: bytes, bits: int) -> bytes:
    """Pack phase codes, first transducer in the lowest bits.  HG-5.2.

    Parameters
    ----------
    codes : (N,) bytes
        One code per transducer, each below ``2**bits``.

    Raises
    ------
    LocalProtocolError
        If a code does not fit.
    """
    if bits == 8:
        return codes
    if codes and max(codes) >> bits:
        raise LocalProtocolError(f"phase code {max(codes)}; {bits} bits hold {2**bits - 1}")
    # A number in base 2^bits, the first transducer its last digit: Python's integers pack it.
    digits = "".join(f"{code:0{bits}b}" for code in reversed(codes))
    return int(digits or "0", 2).to_bytes(packed_size(len(codes), bits), "little")


def unpack_phases(packed: bytes, bits: int, transducers: int) -> bytes:
    """Return one phase code per transducer.  HG-5.2.

    Raises
    ------
    RemoteProtocolError
        If the length is not that of *transducers* phases (``bad_length``), or a spare bit of the
        last byte is set (``bad_value``).
    """
    if len(packed) != packed_size(transducers, bits):
        raise RemoteProtocolError(
            f"{len(packed)} bytes of phases; {transducers} x {bits} bits take "
            f"{packed_size(transducers, bits)}",
            reason="bad_length",
        )
    if bits == 8:
        return packed
    digits = f"{int.from_bytes(packed, 'little'):0{len(packed) * 8}b}"
    used = transducers * bits
    if "1" in digits[: len(digits) - used]:
        raise RemoteProtocolError("a spare bit behind the last phase is set", reason="bad_value")
    digits = digits[len(digits) - used :]
    return bytes(int(digits[i : i + bits], 2) for i in range(used - bits, -1, -bits))


@record
class Phases(_Tailed):
    """Phases of every transducer at full amplitude.  HG-5.2."""

    TYPE: ClassVar[MessageType] = MessageType.PHASES
    bits: PhaseFormat = wire("B", "bits per phase: 8, 6 or 5", enum=PhaseFormat)
    bank: int = wire("B", "bank of transducers; 0 in this version")
    data: bytes  # packed phases


@record
class Drives(_Tailed):
    """Phase and amplitude of every transducer.  HG-5.3."""

    TYPE: ClassVar[MessageType] = MessageType.DRIVES
    bits: PhaseFormat = wire("B", "bits per phase: 8", enum=PhaseFormat)
    bank: int = wire("B", "bank of transducers; 0 in this version")
    data: bytes  # N phases u8, then N amplitudes u8 (linear in pressure, 255 = full)


@record
class FocalPoint(Record):
    """One focal point.  HG-5.4."""

    x_um: int = wire("i", "position, micrometres from the array's centre")
    y_um: int = wire("i", "position, micrometres")
    z_um: int = wire("i", "position, micrometres, along the emission side")
    amplitude: int = wire("H", "share of the drive, 65535 = full")
    phase: int = wire("H", "phase of the pressure at the point, 1/65536 of a turn, lag positive")


def _points_from(data: bytes, what: str) -> tuple[FocalPoint, ...]:
    size = FocalPoint.LAYOUT.size
    if not data or len(data) % size:
        raise RemoteProtocolError(
            f"{what} of {len(data)} bytes; a focal point takes {size}", reason="bad_length"
        )
    return tuple(FocalPoint.unpack(data[i : i + size]) for i in range(0, len(data), size))


@record
class Points(Message):
    """Focal points whose drive the board computes.  HG-5.4."""

    TYPE: ClassVar[MessageType] = MessageType.POINTS
    points: tuple[FocalPoint, ...]

    def serialize(self) -> bytes:
        if not self.points:
            raise LocalProtocolError("a POINTS frame holds 1 focal point or more, not 0")
        return b"".join(point.pack() for point in self.points)

    @classmethod
    def deserialize(cls, payload: bytes) -> Self:
        return cls(_points_from(payload, "POINTS"))


# --- Session, output state and time (chapters 4 and 6) -----------------------------------------


@record
class Hello(Message):
    """Open a session.  HG-4.1; this layout is frozen across major versions."""

    TYPE: ClassVar[MessageType] = MessageType.HELLO
    major: int = wire("B", "major version of the host")
    minor: int = wire("B", "minor version of the host")
    nonce: int = wire("H", "session asked for, never 0, chosen at random")
    description_hash: int = wire("I", "CRC-32 of the host's description of the protocol")


@record
class HelloReply(Message):
    """What the board is and can.  HG-4.3; the fields up to the hash are frozen."""

    TYPE: ClassVar[MessageType] = MessageType.HELLO_REPLY
    major: int = wire("B", "major version of the board")
    minor: int = wire("B", "minor version of the board")
    nonce: int = wire("H", "session now open")
    description_hash: int = wire("I", "CRC-32 of the board's description of the protocol")
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
    phase_formats: int = wire("B", "bit 0: 8 bits, bit 1: 6 bits, bit 2: 5 bits per phase")
    max_points: int = wire("B", "focal points in one POINTS frame, at most")
    banks: int = wire("B", "banks of transducers; 1 in this version")
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
    boot_id: int = wire("I", "changes with every reset")
    config_crc: int = wire("I", "CRC-32 of configuration and phase correction")
    firmware: str = wire("16s", "name and version of the firmware, UTF-8, zero-padded")


PHASE_FORMAT_BIT: Final = {PhaseFormat.BITS_8: 1, PhaseFormat.BITS_6: 2, PhaseFormat.BITS_5: 4}


@record
class Arm(Message):
    """Allow output.  HG-6.3."""

    TYPE: ClassVar[MessageType] = MessageType.ARM


@record
class Mute(Message):
    """Switch the output off, now, from any session.  HG-6.4."""

    TYPE: ClassVar[MessageType] = MessageType.MUTE


@record
class Disarm(Message):
    """Switch the output off and forbid it.  HG-6.5."""

    TYPE: ClassVar[MessageType] = MessageType.DISARM


@record
class _Ack(Message):
    """Done; the output state after it."""

    state: OutputState = wire("B", "output state", enum=OutputState)


@record
class ArmReply(_Ack):
    """Answer to ARM."""

    TYPE: ClassVar[MessageType] = MessageType.ARM_REPLY


@record
class MuteReply(_Ack):
    """Answer to MUTE."""

    TYPE: ClassVar[MessageType] = MessageType.MUTE_REPLY


@record
class DisarmReply(_Ack):
    """Answer to DISARM."""

    TYPE: ClassVar[MessageType] = MessageType.DISARM_REPLY


@record
class Ping(Message):
    """Ask for the device time.  HG-6.9."""

    TYPE: ClassVar[MessageType] = MessageType.PING
    echo: int = wire("Q", "any number; comes back")


@record
class Pong(Message):
    """The device time.  HG-6.9."""

    TYPE: ClassVar[MessageType] = MessageType.PONG
    echo: int = wire("Q", "the number from the PING")
    t_rx_us: int = wire("I", "device time of the PING's closing delimiter")
    t_tx_us: int = wire("I", "device time of the first byte of this frame")


# --- Status (chapter 9) ------------------------------------------------------------------------


@record
class Counters(Record):
    """What the board counted since it started, each modulo 2^32.  HG-9.2."""

    frames: int = wire("I", "frames with a valid CRC")
    latched: int = wire("I", "drives latched, from stream and playback")
    late: int = wire("I", "of these, latched late, within the late window")
    dropped_late: int = wire("I", "stream frames whose t_apply had passed")
    dropped_future: int = wire("I", "stream frames beyond the horizon")
    dropped_order: int = wire("I", "stream frames whose t_apply is not after the last queued one")
    dropped_full: int = wire("I", "stream frames that met a full queue")
    dropped_state: int = wire("I", "stream frames while not armed, or while a sequence plays")
    flushed: int = wire("I", "queued frames discarded by MUTE, DISARM, HELLO, PLAY or IMMEDIATE")
    duplicate: int = wire("I", "stream frames seen before, or older than the newest")
    gap: int = wire("I", "stream sequence numbers that never came")
    stale_session: int = wire("I", "frames of another session")
    crc: int = wire("I", "frames whose CRC is wrong")
    cobs: int = wire("I", "frames that are not COBS")
    short: int = wire("I", "frames shorter than header and CRC")
    oversize: int = wire("I", "runs of bytes longer than any frame")
    bad_length: int = wire("I", "frames whose payload has a wrong length")
    bad_value: int = wire("I", "frames with a value outside its range")
    unknown_type: int = wire("I", "frames of an unknown stream, response or event type")
    unsupported: int = wire("I", "unknown requests, and frames with an unknown must-understand flag")
    requests: int = wire("I", "requests carried out")
    repeated: int = wire("I", "requests answered again from memory")
    trace_dropped: int = wire("I", "trace events that found no room on the line")
    timeouts: int = wire("I", "mutes by a timer")


@record
class _StatusBody(Message):
    state: OutputState = wire("B", "output state", enum=OutputState)
    reason: MuteReason = wire("B", "why the output is off", enum=MuteReason)
    queued: int = wire("H", "frames that wait for their t_apply")
    free_bytes: int = wire("I", "encoded bytes that the board can take now")
    last_seq: int = wire("I", "unwrapped sequence number of the last latched stream frame")
    last_latch_us: int = wire("I", "device time of the last latch")
    margins: int = wire("H", "stream frames that the two margins speak of; then they start anew")
    margin_min_us: int = wire("i", "least t_apply - arrival since the last status")
    margin_mean_us: int = wire("i", "mean t_apply - arrival since the last status")
    config_crc: int = wire("I", "CRC-32 of configuration and phase correction")
    counters: Counters = nested(Counters, "counters")


@record
class Status(_StatusBody):
    """Counters and arrival margin, sent by itself every ``status_period_ms``.  HG-9.1."""

    TYPE: ClassVar[MessageType] = MessageType.STATUS


@record
class GetStatus(Message):
    """Ask for the status."""

    TYPE: ClassVar[MessageType] = MessageType.GET_STATUS


@record
class StatusReply(_StatusBody):
    """Answer to GET_STATUS."""

    TYPE: ClassVar[MessageType] = MessageType.STATUS_REPLY


# --- Configuration and geometry (chapter 7) ----------------------------------------------------


@record
class Config(Record):
    """What can be set.  HG-7.1."""

    hold_ms: int = wire("H", "how long the last drive is held without a new latch", default=200)
    ramp_ms: int = wire("H", "how long the ramp to silence takes", default=50)
    host_timeout_ms: int = wire("H", "lease: renewed by any valid frame of the session", default=500)
    status_period_ms: int = wire("H", "time between two STATUS events, 0: none", default=100)
    late_window_us: int = wire("I", "lateness up to which a frame is still latched", default=0)
    sound_speed_mm_s: int = wire("I", "sound speed used for POINTS, mm/s", default=343_200)
    trace_mode: TraceMode = wire("B", "trace of latches", enum=TraceMode, default=TraceMode.OFF)
    amplitude_ceiling: int = wire("B", "largest amplitude radiated, 255 = full", default=255)
    trace_divider: int = wire("H", "TRACE_DRIVE of every k-th latch", default=1)


@record
class GetConfig(Message):
    """Ask for the configuration."""

    TYPE: ClassVar[MessageType] = MessageType.GET_CONFIG


@record
class SetConfig(Message):
    """Set the whole configuration.  HG-7.1."""

    TYPE: ClassVar[MessageType] = MessageType.SET_CONFIG
    config: Config = nested(Config, "configuration")


@record
class _ConfigBody(Message):
    config_crc: int = wire("I", "CRC-32 of configuration and phase correction")
    config: Config = nested(Config, "configuration in force")


@record
class ConfigReply(_ConfigBody):
    """Answer to GET_CONFIG."""

    TYPE: ClassVar[MessageType] = MessageType.CONFIG_REPLY


@record
class SetConfigReply(_ConfigBody):
    """Answer to SET_CONFIG."""

    TYPE: ClassVar[MessageType] = MessageType.SET_CONFIG_REPLY


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

    TYPE: ClassVar[MessageType] = MessageType.GET_GEOMETRY
    first: int = wire("H", "first transducer asked for")
    count: int = wire("H", "transducers asked for")


@record
class GeometryReply(Message):
    """Positions and normals, as many as fit.  HG-7.5."""

    TYPE: ClassVar[MessageType] = MessageType.GEOMETRY_REPLY
    total: int = wire("H", "number of transducers of the board")
    first: int = wire("H", "first transducer in this reply")
    elements: tuple[Element, ...]

    def serialize(self) -> bytes:
        return self.pack() + b"".join(element.pack() for element in self.elements)

    @classmethod
    def deserialize(cls, payload: bytes) -> Self:
        fixed, size = cls.LAYOUT.size, Element.LAYOUT.size
        if len(payload) < fixed or (len(payload) - fixed) % size:
            raise RemoteProtocolError(
                f"GEOMETRY_REPLY of {len(payload)} bytes; {fixed} and {size} per transducer",
                reason="bad_length",
            )
        tail = range(fixed, len(payload), size)
        elements = tuple(Element.unpack(payload[i : i + size]) for i in tail)
        return cls(**cls._values(payload), elements=elements)


# --- Uploads and playback (chapter 7) ----------------------------------------------------------


@record
class UploadBegin(Message):
    """Announce an upload.  HG-7.2."""

    TYPE: ClassVar[MessageType] = MessageType.UPLOAD_BEGIN
    kind: UploadKind = wire("B", "1 phases, 2 points, 3 phase correction", enum=UploadKind)
    points_per_frame: int = wire("B", "kind 2: focal points in every frame; else 0")
    target: int = wire("H", "sequence id, 1 or more; kind 3: 0")
    size: int = wire("I", "bytes to come")
    crc: int = wire("I", "CRC-32 of these bytes")


@record
class UploadBeginReply(Message):
    """The board is ready for the upload.  HG-7.2."""

    TYPE: ClassVar[MessageType] = MessageType.UPLOAD_BEGIN_REPLY
    max_chunk: int = wire("H", "bytes of data in one chunk, at most")
    window: int = wire("H", "chunks that may be unanswered at a time")


@record
class UploadChunk(_Tailed):
    """Part of an upload, at an absolute offset: sending it twice does no harm.  HG-7.3."""

    TYPE: ClassVar[MessageType] = MessageType.UPLOAD_CHUNK
    offset: int = wire("I", "where these bytes belong")
    data: bytes


@record
class UploadChunkReply(Message):
    """How much of the upload is there.  HG-7.3."""

    TYPE: ClassVar[MessageType] = MessageType.UPLOAD_CHUNK_REPLY
    received: int = wire("I", "bytes from the start without a gap")


@record
class UploadCommit(Message):
    """Take the upload, whole or not at all.  HG-7.4."""

    TYPE: ClassVar[MessageType] = MessageType.UPLOAD_COMMIT
    target: int = wire("H", "as in UPLOAD_BEGIN")


@record
class UploadCommitReply(Message):
    """The upload is in force.  HG-7.4."""

    TYPE: ClassVar[MessageType] = MessageType.UPLOAD_COMMIT_REPLY
    frames: int = wire("I", "frames in the sequence; kind 3: number of transducers")


@record
class Play(Message):
    """Play a sequence on the board's clock, from the header's t_apply on.  HG-7.6."""

    TYPE: ClassVar[MessageType] = MessageType.PLAY
    sequence: int = wire("H", "sequence id")
    period_us: int = wire("I", "time from one frame to the next, microseconds")
    loops: int = wire("I", "how often; 0: until STOP")
    unattended_ms: int = wire("I", "replaces host_timeout_ms while this plays")


@record
class PlayReply(_Ack):
    """Answer to PLAY."""

    TYPE: ClassVar[MessageType] = MessageType.PLAY_REPLY


@record
class Stop(Message):
    """End playback; the last drive is held for ``hold_ms``.  HG-7.7."""

    TYPE: ClassVar[MessageType] = MessageType.STOP


@record
class StopReply(_Ack):
    """Answer to STOP."""

    TYPE: ClassVar[MessageType] = MessageType.STOP_REPLY


# --- Evidence: read-back and trace (chapter 8) -------------------------------------------------


@record
class LatchKey(Record):
    """Which drive: the join key of host and board within a session.  HG-8.2."""

    sequence: int = wire("H", "sequence id, 0: the stream")
    loop: int = wire("I", "pass of the sequence, from 0; stream: 0")
    index: int = wire("I", "frame of the sequence; stream: unwrapped sequence number")


@record
class ReadDrive(Message):
    """Ask for the drive at the transducers.  HG-8.6."""

    TYPE: ClassVar[MessageType] = MessageType.READ_DRIVE
    kind: DriveKind = wire("B", "0 latched, 1 radiated", enum=DriveKind)
    first: int = wire("H", "first transducer asked for")
    count: int = wire("H", "transducers asked for")


def _split_drive(cls: type[Message], payload: bytes) -> bytes:
    tail = payload[cls.LAYOUT.size :]
    if len(payload) < cls.LAYOUT.size or len(tail) % 2:
        raise RemoteProtocolError(
            f"{cls.__name__} of {len(payload)} bytes; {cls.LAYOUT.size} and 2 per transducer",
            reason="bad_length",
        )
    return tail


@record
class DriveReply(_Tailed):
    """Phase and amplitude, as they are at one moment.  HG-8.6."""

    TYPE: ClassVar[MessageType] = MessageType.DRIVE_REPLY
    kind: DriveKind = wire("B", "0 latched, 1 radiated", enum=DriveKind)
    bits: int = wire("B", "bits per phase of the codes below")
    key: LatchKey = nested(LatchKey, "the drive that is latched")
    t_latch_us: int = wire("I", "device time of that latch")
    first: int = wire("H", "first transducer in this reply")
    data: bytes  # n phases u8, then n amplitudes u8

    @classmethod
    def deserialize(cls, payload: bytes) -> Self:
        data = _split_drive(cls, payload)
        return cls(**cls._values(payload), data=data)


@record
class Trace(Message):
    """A stream frame was latched at the header's t_device.  HG-8.3."""

    TYPE: ClassVar[MessageType] = MessageType.TRACE
    index: int = wire("I", "unwrapped sequence number of the stream frame")
    crc: int = wire("I", "CRC-32 of the latched drive: N phases u8, N amplitudes u8")


@record
class TracePlayback(Message):
    """A frame of a sequence was latched at the header's t_device.  HG-8.3."""

    TYPE: ClassVar[MessageType] = MessageType.TRACE_PLAYBACK
    key: LatchKey = nested(LatchKey, "which frame")
    crc: int = wire("I", "CRC-32 of the latched drive: N phases u8, N amplitudes u8")


@record
class TraceDrive(_Tailed):
    """A drive was latched at the header's t_device, in full.  HG-8.4."""

    TYPE: ClassVar[MessageType] = MessageType.TRACE_DRIVE
    key: LatchKey = nested(LatchKey, "which frame")
    bits: int = wire("B", "bits per phase of the codes below")
    data: bytes  # N phases u8, then N amplitudes u8

    @classmethod
    def deserialize(cls, payload: bytes) -> Self:
        data = _split_drive(cls, payload)
        return cls(**cls._values(payload), data=data)


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

    TYPE: ClassVar[MessageType] = MessageType.READ_TRACE
    first: int = wire("I", "number of the first latch asked for")
    count: int = wire("H", "latches asked for")


@record
class TraceReply(Message):
    """Latches from the trace ring, as many as fit.  HG-8.5."""

    TYPE: ClassVar[MessageType] = MessageType.TRACE_REPLY
    oldest: int = wire("I", "number of the oldest latch that the ring still holds")
    next: int = wire("I", "number that the next latch will get")
    records: tuple[TraceRecord, ...]

    def serialize(self) -> bytes:
        return self.pack() + b"".join(entry.pack() for entry in self.records)

    @classmethod
    def deserialize(cls, payload: bytes) -> Self:
        fixed, size = cls.LAYOUT.size, TraceRecord.LAYOUT.size
        if len(payload) < fixed or (len(payload) - fixed) % size:
            raise RemoteProtocolError(
                f"TRACE_REPLY of {len(payload)} bytes; {fixed} and {size} per latch",
                reason="bad_length",
            )
        tail = range(fixed, len(payload), size)
        records = tuple(TraceRecord.unpack(payload[i : i + size]) for i in tail)
        return cls(**cls._values(payload), records=records)


# --- Errors and notices (chapters 6 and 10) ----------------------------------------------------


@record
class Error(Message):
    """The request was refused.  HG-10.1; this layout is frozen across major versions."""

    TYPE: ClassVar[MessageType] = MessageType.ERROR
    request: int = wire("B", "type of the request")
    code: int = wire("B", "error code")
    detail: int = wire("I", "number that belongs to the code")


@record
class StateChanged(Message):
    """The output state changed without a request.  HG-6.8."""

    TYPE: ClassVar[MessageType] = MessageType.STATE_CHANGED
    state: OutputState = wire("B", "output state", enum=OutputState)
    reason: MuteReason = wire("B", "why", enum=MuteReason)


@record
class PlaybackEnded(Message):
    """A sequence ended, by itself or by STOP, MUTE, a timer.  HG-7.8."""

    TYPE: ClassVar[MessageType] = MessageType.PLAYBACK_ENDED
    sequence: int = wire("H", "sequence id")
    loops: int = wire("I", "whole passes played")
    frames: int = wire("I", "frames latched")


STREAM_RANGE: Final = range(0x00, 0x40)
REQUEST_RANGE: Final = range(0x40, 0x80)
RESPONSE_RANGE: Final = range(0x80, 0xC0)
EVENT_RANGE: Final = range(0xC0, 0x100)


def _all(base: type[Message]) -> list[type[Message]]:
    found = [base] if "TYPE" in vars(base) else []
    return found + [message for sub in base.__subclasses__() for message in _all(sub)]


MESSAGES: Final[dict[int, type[Message]]] = {int(m.TYPE): m for m in _all(Message)}


def parse_body(body: bytes) -> tuple[Header, Message]:
    """Return header and message of a frame body whose CRC was right.

    Raises
    ------
    RemoteProtocolError
        ``unknown_type``, ``bad_length`` or ``bad_value``.
    """
    size = Header.LAYOUT.size
    header = Header.unpack(body[:size])
    message = MESSAGES.get(header.type)
    if message is None:
        raise RemoteProtocolError(f"message type {header.type:#04x}", reason="unknown_type")
    return header, message.deserialize(body[size:])


def build_body(message: Message, *, flags: int, seq: int, time_us: int, session: int) -> bytes:
    """Return header and payload of a frame, ready for :func:`framing.encode_frame`."""
    header = Header(
        type=message.TYPE,
        flags=flags,
        seq=seq & 0xFFFF,
        time_us=time_us & 0xFFFFFFFF,
        session=session,
    )
    return header.pack() + message.serialize()

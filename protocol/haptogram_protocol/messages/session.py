"""Session, output state and time.  SPEC.md chapters 4 and 6."""

from __future__ import annotations

from ..documented import DocumentedFlag
from ..record import record, wire
from ..state import MuteReason, OutputState
from .header import Ack, Message


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

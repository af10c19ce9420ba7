"""Configuration and geometry.  SPEC.md chapter 7."""

from __future__ import annotations

from ..documented import DocumentedEnum
from ..record import Record, nested, record, repeated, wire
from .header import Message


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

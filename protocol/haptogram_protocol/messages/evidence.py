"""Latched drives: read-back and trace.  SPEC.md chapter 8."""

from __future__ import annotations

from ..documented import DocumentedEnum
from ..record import Record, nested, record, repeated, tail, wire
from .header import Message


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

"""The bytes of each operation of a device, there and back.

The layouts are tables of :mod:`struct`; their sources are in :mod:`.operations`.
"""

from __future__ import annotations

import dataclasses
import struct
from collections.abc import Callable
from typing import Any, Final

from ...errors import LocalProtocolError
from ..codec import Operation
from . import operations

PAYLOAD_BYTES: Final = 622

_BEGIN, _END, _UPDATE, _SEGMENT_1 = 1, 2, 4, 8
_FIXED_UPDATE_RATE, _STRICT = 1, 4
_FOCUS_BYTES: Final = 8
# Each begins with the tag, which is written and read apart.
_SILENCER: Final = struct.Struct("<xBHH")
_GAIN: Final = struct.Struct("<xBBx")
_MODULATION_START: Final = struct.Struct("<xBBBHHQ")
_MODULATION_PART: Final = struct.Struct("<xBH")
_FOCI_START: Final = struct.Struct("<xBBBBBHHH4xQ")
_FOCI_PART: Final = struct.Struct("<xBBB")
_GAIN_SWAP: Final = struct.Struct("<xB")
_SWAP_WITH_TRANSITION: Final = struct.Struct("<xBB5xQ")
_GAIN_BYTES: Final = 2 * operations.CHANNELS


def parse_autd3_operation(payload: bytes, at: int, foci_of_pattern: int) -> tuple[Operation, int]:
    """Return the operation at *at* of *payload*, and the foci of a pattern from there on.

    Parameters
    ----------
    payload : bytes
        The 622 bytes after the header of a frame.
    at : int
        Where the operation begins.
    foci_of_pattern : int
        As the last sequence's start said: a later part does not repeat it.
    """
    if at >= len(payload):
        return operations.Truncated(-1), foci_of_pattern
    tag = payload[at]
    reader = _READERS.get(tag)
    if reader is None:
        return operations.Unsupported(tag), foci_of_pattern
    try:
        operation = reader(payload, at, foci_of_pattern)
    except (struct.error, IndexError):
        return operations.Truncated(tag), foci_of_pattern
    if isinstance(operation, operations.FociSTM) and operation.start is not None:
        foci_of_pattern = operation.start.foci_of_pattern
    return operation, foci_of_pattern


def pack_autd3_operation(operation: Operation) -> bytes:
    """Return the bytes of *operation*, an even number of them.

    Raises
    ------
    LocalProtocolError
        If no device takes it, or its values do not fit.
    """
    if type(operation) not in _WRITERS:
        raise LocalProtocolError(f"no device of autd3 takes {operation!r}")
    tag, writer = _WRITERS[type(operation)]
    try:
        tag_byte = struct.pack("<B", getattr(operation, "tag", tag))
        packed = tag_byte + writer(operation)[1:]
    except struct.error as error:
        raise LocalProtocolError(f"{operation!r}: {error}") from error
    return packed + bytes(len(packed) % 2)


def _payload_slice(payload: bytes, start: int, size: int) -> bytes:
    """Return *size* bytes from *start* on; raise IndexError if there are fewer."""
    if start + size > len(payload):
        raise IndexError("the operation does not end within its frame")
    return payload[start : start + size]


def _autd3_head(
    payload: bytes, at: int, first: struct.Struct, later: struct.Struct
) -> tuple[tuple[int, ...], bool, int]:
    """Return the head of a part, True if it is the first one, and where its data begin.

    The head of the first part (*first*) is longer than that of others (*later*).
    """
    is_first = bool(payload[at + 1] & _BEGIN)
    layout = first if is_first else later
    return layout.unpack_from(payload, at), is_first, at + layout.size


def _packed_autd3_head(
    head: tuple[int, ...], start: Any, first: struct.Struct, later: struct.Struct
) -> bytes:
    """Return the packed head of a part; by *first* with the start parameters, else by *later*.

    *start* is None for a part after the first.
    """
    return later.pack(*head) if start is None else first.pack(*head, *dataclasses.astuple(start))


def _unpack_autd3_silencer(payload: bytes, at: int, _: int) -> operations.Silencer:
    """Return the silencer operation at *at*."""
    flags, *steps = _SILENCER.unpack_from(payload, at)
    return operations.Silencer(bool(flags & _FIXED_UPDATE_RATE), bool(flags & _STRICT), *steps)


def _pack_autd3_silencer(operation: operations.Silencer) -> bytes:
    """Return the bytes of a silencer operation."""
    flags = _FIXED_UPDATE_RATE * operation.update_rate | _STRICT * operation.strict
    return _SILENCER.pack(flags, operation.intensity, operation.phase)


def _unpack_autd3_gain(payload: bytes, at: int, _: int) -> operations.Gain:
    """Return the drive of one device at *at*; IndexError if it is cut off."""
    segment, flags = _GAIN.unpack_from(payload, at)
    drives = _payload_slice(payload, at + _GAIN.size, _GAIN_BYTES)
    return operations.Gain(segment, bool(flags & 1), drives)


def _pack_autd3_gain(operation: operations.Gain) -> bytes:
    """Return the bytes of the drive of one device."""
    if len(operation.drives) != _GAIN_BYTES:
        raise LocalProtocolError(f"{len(operation.drives)} bytes of drives, not {_GAIN_BYTES}")
    return _GAIN.pack(operation.segment, operation.update) + operation.drives


def _unpack_autd3_modulation(payload: bytes, at: int, _: int) -> operations.Modulation:
    """Return the part of a modulation at *at*; IndexError if it is cut off."""
    head, is_first, at = _autd3_head(payload, at, _MODULATION_START, _MODULATION_PART)
    flags, size, *rest = head
    start = operations.ModulationStart(*rest) if is_first else None
    samples, segment = _payload_slice(payload, at, size), int(bool(flags & _SEGMENT_1))
    return operations.Modulation(segment, samples, start, bool(flags & _END), bool(flags & _UPDATE))


def _pack_autd3_modulation(operation: operations.Modulation) -> bytes:
    """Return the bytes of a part of a modulation."""
    head = _autd3_flags(operation) | _SEGMENT_1 * operation.segment, len(operation.samples)
    packed = _packed_autd3_head(head, operation.start, _MODULATION_START, _MODULATION_PART)
    return packed + operation.samples


def _unpack_autd3_foci(payload: bytes, at: int, foci_of_pattern: int) -> operations.FociSTM:
    """Return the part of a sequence of foci at *at*; IndexError if it is cut off.

    A part after the first has no number of foci in a pattern: *foci_of_pattern* is that of the
    first.
    """
    head, is_first, at = _autd3_head(payload, at, _FOCI_START, _FOCI_PART)
    flags, patterns, segment, *rest = head
    start = operations.FociStart(*rest) if is_first else None
    of_pattern = foci_of_pattern if start is None else start.foci_of_pattern
    foci = _payload_slice(payload, at, patterns * of_pattern * _FOCUS_BYTES)
    ends, updates = bool(flags & _END), bool(flags & _UPDATE)
    return operations.FociSTM(segment, patterns, foci, start, ends, updates)


def _pack_autd3_foci(operation: operations.FociSTM) -> bytes:
    """Return the bytes of a part of a sequence of foci."""
    head = _autd3_flags(operation), operation.patterns, operation.segment
    return _packed_autd3_head(head, operation.start, _FOCI_START, _FOCI_PART) + operation.foci


def _autd3_flags(operation: operations.Modulation | operations.FociSTM) -> int:
    """Return the flags of a part as bits: begin, end and update."""
    begins = operation.start is not None
    return _BEGIN * begins | _END * operation.end | _UPDATE * operation.update


def _unpack_autd3_swap(payload: bytes, at: int, _: int) -> operations.SwapSegment:
    """Return the change of segment at *at*, by its tag with or without a transition."""
    tag = operations.Tag(payload[at])
    layout = _GAIN_SWAP if tag is operations.Tag.GAIN_SWAP else _SWAP_WITH_TRANSITION
    return operations.SwapSegment(tag, *layout.unpack_from(payload, at))


def _pack_autd3_swap(operation: operations.SwapSegment) -> bytes:
    """Return the bytes of a change of segment."""
    if operation.tag is operations.Tag.GAIN_SWAP:
        return _GAIN_SWAP.pack(operation.segment)
    rest = operation.transition_mode, operation.transition_value
    return _SWAP_WITH_TRANSITION.pack(operation.segment, *rest)


_READERS: Final[dict[int, Callable[[bytes, int, int], Operation]]] = {
    operations.Tag.NOP: lambda *_: operations.Nop(),
    operations.Tag.CLEAR: lambda *_: operations.Clear(),
    operations.Tag.SYNC: lambda *_: operations.Sync(),
    operations.Tag.FIRMWARE_INFO: lambda payload, at, _: operations.FirmwareInfo(payload[at + 1]),
    operations.Tag.MODULATION: _unpack_autd3_modulation,
    operations.Tag.MODULATION_SWAP: _unpack_autd3_swap,
    operations.Tag.SILENCER: _unpack_autd3_silencer,
    operations.Tag.GAIN: _unpack_autd3_gain,
    operations.Tag.GAIN_SWAP: _unpack_autd3_swap,
    operations.Tag.FOCI_STM: _unpack_autd3_foci,
    operations.Tag.FOCI_STM_SWAP: _unpack_autd3_swap,
}
# With a byte for the tag, which is that of the class or of the operation.
_WRITERS: Final[dict[type[Operation], tuple[int | None, Callable[[Any], bytes]]]] = {
    operations.Nop: (operations.Tag.NOP, lambda _: b"\0"),
    operations.Clear: (operations.Tag.CLEAR, lambda _: b"\0"),
    operations.Sync: (operations.Tag.SYNC, lambda _: b"\0"),
    operations.FirmwareInfo: (operations.Tag.FIRMWARE_INFO, lambda o: struct.pack("<xB", o.kind)),
    operations.Modulation: (operations.Tag.MODULATION, _pack_autd3_modulation),
    operations.Silencer: (operations.Tag.SILENCER, _pack_autd3_silencer),
    operations.Gain: (operations.Tag.GAIN, _pack_autd3_gain),
    operations.FociSTM: (operations.Tag.FOCI_STM, _pack_autd3_foci),
    operations.SwapSegment: (None, _pack_autd3_swap),
    operations.Unsupported: (None, lambda _: b"\0"),
}

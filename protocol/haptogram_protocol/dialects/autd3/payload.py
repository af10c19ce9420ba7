"""The bytes of each operation of a device, there and back.

The layouts are tables of :mod:`struct`; their sources are in :mod:`.operations`.
"""

from __future__ import annotations

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

_SILENCER: Final = struct.Struct("<xBHH")
_GAIN: Final = struct.Struct("<xBBx")
_MODULATION_START: Final = struct.Struct("<xBBBHHQ")
_MODULATION_PART: Final = struct.Struct("<xBH")
_FOCI_START: Final = struct.Struct("<xBBBBBHHH4xQ")
_FOCI_PART: Final = struct.Struct("<xBBB")
_SWAP_WITH_TRANSITION: Final = struct.Struct("<xBB5xQ")
_GAIN_BYTES: Final = 2 * operations.CHANNELS


def parse_autd3_operation(payload: bytes, at: int, foci_of_pattern: int) -> tuple[Operation, int]:
    """Return the operation at *at* of *payload*, and the foci of a pattern from there on.

    Parameters
    ----------
    payload : bytes
        The 622 bytes behind the header of a frame.
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
    writer = _WRITERS.get(type(operation))
    if writer is None:
        raise LocalProtocolError(f"no device of autd3 takes {operation!r}")
    try:
        packed = writer(operation)
    except struct.error as error:
        raise LocalProtocolError(f"{operation!r}: {error}") from error
    return packed + bytes(len(packed) % 2)


def _payload_slice(payload: bytes, start: int, size: int) -> bytes:
    if start + size > len(payload):
        raise IndexError("the operation does not end within its frame")
    return payload[start : start + size]


def _unpack_autd3_silencer(payload: bytes, at: int, _: int) -> operations.Silencer:
    flags, intensity, phase = _SILENCER.unpack_from(payload, at)
    return operations.Silencer(
        bool(flags & _FIXED_UPDATE_RATE), bool(flags & _STRICT), intensity, phase
    )


def _pack_autd3_silencer(operation: operations.Silencer) -> bytes:
    flags = _FIXED_UPDATE_RATE * operation.update_rate | _STRICT * operation.strict
    return _tagged_payload(
        operations.Tag.SILENCER, _SILENCER.pack(flags, operation.intensity, operation.phase)
    )


def _unpack_autd3_gain(payload: bytes, at: int, _: int) -> operations.Gain:
    segment, flags = _GAIN.unpack_from(payload, at)
    return operations.Gain(
        segment, bool(flags & 1), _payload_slice(payload, at + _GAIN.size, _GAIN_BYTES)
    )


def _pack_autd3_gain(operation: operations.Gain) -> bytes:
    if len(operation.drives) != _GAIN_BYTES:
        raise LocalProtocolError(f"{len(operation.drives)} bytes of drives, not {_GAIN_BYTES}")
    return _tagged_payload(
        operations.Tag.GAIN, _GAIN.pack(operation.segment, operation.update) + operation.drives
    )


def _unpack_autd3_modulation(payload: bytes, at: int, _: int) -> operations.Modulation:
    flags = payload[at + 1]
    start = None
    if flags & _BEGIN:
        _, size, mode, *rest = _MODULATION_START.unpack_from(payload, at)
        start = operations.ModulationStart(mode, *rest)
        at += _MODULATION_START.size
    else:
        _, size = _MODULATION_PART.unpack_from(payload, at)
        at += _MODULATION_PART.size
    segment = int(bool(flags & _SEGMENT_1))
    samples = _payload_slice(payload, at, size)
    return operations.Modulation(segment, samples, start, bool(flags & _END), bool(flags & _UPDATE))


def _pack_autd3_modulation(operation: operations.Modulation) -> bytes:
    flags = _autd3_flags(operation) | _SEGMENT_1 * operation.segment
    size, start = len(operation.samples), operation.start
    if start is None:
        head = _MODULATION_PART.pack(flags, size)
    else:
        rest = (start.transition_mode, start.divider, start.repeat, start.transition_value)
        head = _MODULATION_START.pack(flags, size, *rest)
    return _tagged_payload(operations.Tag.MODULATION, head + operation.samples)


def _unpack_autd3_foci(payload: bytes, at: int, foci_of_pattern: int) -> operations.FociSTM:
    flags = payload[at + 1]
    start = None
    if flags & _BEGIN:
        _, patterns, segment, *rest = _FOCI_START.unpack_from(payload, at)
        start = operations.FociStart(*rest)
        foci_of_pattern = start.foci_of_pattern
        at += _FOCI_START.size
    else:
        _, patterns, segment = _FOCI_PART.unpack_from(payload, at)
        at += _FOCI_PART.size
    foci = _payload_slice(payload, at, patterns * foci_of_pattern * _FOCUS_BYTES)
    return operations.FociSTM(
        segment, patterns, foci, start, bool(flags & _END), bool(flags & _UPDATE)
    )


def _pack_autd3_foci(operation: operations.FociSTM) -> bytes:
    head = (_autd3_flags(operation), operation.patterns, operation.segment)
    start = operation.start
    if start is None:
        return _tagged_payload(operations.Tag.FOCI_STM, _FOCI_PART.pack(*head) + operation.foci)
    packed = _FOCI_START.pack(
        *head,
        start.transition_mode,
        start.foci_of_pattern,
        start.sound_speed,
        start.divider,
        start.repeat,
        start.transition_value,
    )
    return _tagged_payload(operations.Tag.FOCI_STM, packed + operation.foci)


def _unpack_autd3_swap(payload: bytes, at: int, _: int) -> operations.SwapSegment:
    segment, mode, value = _SWAP_WITH_TRANSITION.unpack_from(payload, at)
    return operations.SwapSegment(operations.Tag(payload[at]), segment, mode, value)


def _unpack_autd3_gain_swap(payload: bytes, at: int, _: int) -> operations.SwapSegment:
    return operations.SwapSegment(operations.Tag.GAIN_SWAP, payload[at + 1])


def _pack_autd3_swap(operation: operations.SwapSegment) -> bytes:
    if operation.tag is operations.Tag.GAIN_SWAP:
        return struct.pack("<BB", operation.tag, operation.segment)
    rest = (operation.segment, operation.transition_mode, operation.transition_value)
    return _tagged_payload(operation.tag, _SWAP_WITH_TRANSITION.pack(*rest))


def _autd3_flags(operation: operations.Modulation | operations.FociSTM) -> int:
    begins = operation.start is not None
    return _BEGIN * begins | _END * operation.end | _UPDATE * operation.update


def _tagged_payload(tag: operations.Tag, packed: bytes) -> bytes:
    """Return *packed* with its first byte, which the layouts leave free, set to *tag*."""
    return bytes([tag]) + packed[1:]


_READERS: Final[dict[int, Callable[[bytes, int, int], Operation]]] = {
    operations.Tag.NOP: lambda *_: operations.Nop(),
    operations.Tag.CLEAR: lambda *_: operations.Clear(),
    operations.Tag.SYNC: lambda *_: operations.Sync(),
    operations.Tag.FIRMWARE_INFO: lambda payload, at, _: operations.FirmwareInfo(payload[at + 1]),
    operations.Tag.MODULATION: _unpack_autd3_modulation,
    operations.Tag.MODULATION_SWAP: _unpack_autd3_swap,
    operations.Tag.SILENCER: _unpack_autd3_silencer,
    operations.Tag.GAIN: _unpack_autd3_gain,
    operations.Tag.GAIN_SWAP: _unpack_autd3_gain_swap,
    operations.Tag.FOCI_STM: _unpack_autd3_foci,
    operations.Tag.FOCI_STM_SWAP: _unpack_autd3_swap,
}
_WRITERS: Final[dict[type[Operation], Callable[[Any], bytes]]] = {
    operations.Nop: lambda _: bytes([operations.Tag.NOP]),
    operations.Clear: lambda _: bytes([operations.Tag.CLEAR]),
    operations.Sync: lambda _: bytes([operations.Tag.SYNC]),
    operations.FirmwareInfo: lambda operation: struct.pack(
        "<BB", operations.Tag.FIRMWARE_INFO, operation.kind
    ),
    operations.Modulation: _pack_autd3_modulation,
    operations.Silencer: _pack_autd3_silencer,
    operations.Gain: _pack_autd3_gain,
    operations.FociSTM: _pack_autd3_foci,
    operations.SwapSegment: _pack_autd3_swap,
    operations.Unsupported: lambda operation: struct.pack("<B", operation.tag),
}

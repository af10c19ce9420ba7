"""The frame of 626 bytes for one device of AUTD3, and the two bytes that it answers.

====== =========== ===================================================================
offset size        field
====== =========== ===================================================================
0      1           message id, 0 to 15; a frame with the id of the last one is ignored
2      2           offset of a second operation in the payload; 0 if there is none
4      622         payload: one or two operations; what follows them is left over
====== =========== ===================================================================

The answer is a byte of data and the acknowledgement: error code in the high nibble, the last id in
the low one. Source: shinolab/autd3-rs, ``autd3-core/src/link/datagram/rx.rs`` f784de2 and
``header.rs`` ec9829a; ``ecat_recv`` of ``autd3-firmware-emulator/src/cpu/emulator.rs`` (of the
versions that refuse ids above 15).
"""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass
from typing import Final

from ...errors import LocalProtocolError
from ..codec import Operation
from .operations import ErrorCode, Truncated, Unsupported
from .payload import PAYLOAD_BYTES, pack_autd3_operation, parse_autd3_operation

_HEADER: Final = struct.Struct("<BxH")
DEVICE_FRAME_BYTES: Final = _HEADER.size + PAYLOAD_BYTES
MAX_MESSAGE_ID: Final = 15


@dataclass(frozen=True, slots=True)
class Autd3DeviceFrame:
    """Frame for one device.

    Attributes
    ----------
    message_id : int
        0 to 15; the device refuses others with ``INVALID_MESSAGE_ID``.
    operations : tuple of Operation
        One or two; none if the id is refused or that of the frame before.
    repeated : bool
        The id is that of the frame before, so the device ignores the frame.
    """

    message_id: int
    operations: tuple[Operation, ...]
    repeated: bool = False

    def pack(self) -> bytes:
        """Return the 626 bytes, zeros after the operations.

        Raises
        ------
        LocalProtocolError
            If there is not one operation or two, or they do not fit.
        """
        if not 0 <= self.message_id <= MAX_MESSAGE_ID:
            raise LocalProtocolError(f"message id {self.message_id}; it is 0 to {MAX_MESSAGE_ID}")
        if not 1 <= len(self.operations) <= 2:
            raise LocalProtocolError(f"{len(self.operations)} operations in a frame; it has 1 or 2")
        packed = [pack_autd3_operation(operation) for operation in self.operations]
        payload = b"".join(packed)
        if len(payload) > PAYLOAD_BYTES:
            raise LocalProtocolError(f"operations of {len(payload)} bytes; {PAYLOAD_BYTES} fit")
        second = len(packed[0]) if len(packed) > 1 else 0
        return _HEADER.pack(self.message_id, second) + payload.ljust(PAYLOAD_BYTES, b"\0")


@dataclass(frozen=True, slots=True)
class Autd3DeviceState:
    """Answer of one device.

    Attributes
    ----------
    message_id : int
        That of the last frame.
    error : int
        Its :class:`ErrorCode`.
    data : int
        A byte that firmware information asked for, or the state of the FPGA.
    """

    message_id: int
    error: int = ErrorCode.NONE
    data: int = 0

    def pack(self) -> bytes:
        """Return the two bytes; the id loses all but its low nibble, as on a device."""
        return bytes([self.data & 0xFF, self.error << 4 & 0xF0 | self.message_id & 0x0F])

    @classmethod
    def parse(cls, answer: bytes) -> Autd3DeviceState:
        """Return the state in the two bytes of *answer*."""
        data, acknowledgement = answer
        return cls(acknowledgement & 0x0F, acknowledgement >> 4, data)


class Autd3DeviceReader:
    """Reads the frames of one device, which depend on those before.

    Parameters
    ----------
    counters : Counter
        Counts ``frames_repeated``, ``message_ids_out_of_range``, ``operations_unsupported`` and
        ``operations_truncated``.
    """

    def __init__(self, counters: Counter[str]) -> None:
        self._counters = counters
        self._last_id: int | None = None
        self._foci_of_pattern = 1  # CPUEmulator::new

    def read(self, frame: bytes) -> Autd3DeviceFrame:
        """Return the content of the 626 bytes of *frame*."""
        message_id, second = _HEADER.unpack_from(frame)
        if message_id == self._last_id:
            self._counters["frames_repeated"] += 1
            return Autd3DeviceFrame(message_id, (), repeated=True)
        self._last_id = message_id
        if message_id > MAX_MESSAGE_ID:
            self._counters["message_ids_out_of_range"] += 1
            return Autd3DeviceFrame(message_id, ())
        payload = frame[_HEADER.size :]
        operations = [self._read_operation(payload, 0)]
        if second:
            operations.append(self._read_operation(payload, second))
        return Autd3DeviceFrame(message_id, tuple(operations))

    def _read_operation(self, payload: bytes, at: int) -> Operation:
        """Return the operation at *at*; count and name one that is unknown or truncated."""
        operation, self._foci_of_pattern = parse_autd3_operation(payload, at, self._foci_of_pattern)
        if isinstance(operation, Unsupported):
            self._counters["operations_unsupported"] += 1
        elif isinstance(operation, Truncated):
            self._counters["operations_truncated"] += 1
        return operation

"""The TCP link "Remote" of autd3 38: both ends.

===== ========================================================= ===============================
byte  host to board, little-endian                              answer
===== ========================================================= ===============================
10h   u16 version (1), "AUTD3REMOTE"                            00
01h   u32 n, n x 7 f32: position x y z, quaternion w x y z      00
02h   the same, to move devices                                 00
03h   n x 626 bytes, a frame for each device                    00
04h   nothing                                                   00, n x 2 bytes
05h   nothing                                                   00
any   what the server refuses                                   FF, u32 length, text in UTF-8
===== ========================================================= ===============================

The published server reads on after some refusals, as if the rest of a message were messages; here
the link ends with the first. Version 36 spoke gRPC on this link, and autd3-sdk (2026-06) has a new
protocol: both are named. Source: shinolab/autd3-rs, ``autd3-link-remote/src/link/blocking.rs``
f57d8ce and ``server.rs`` 552ca00.
"""

from __future__ import annotations

import re
import struct
from collections import Counter, deque
from collections.abc import Callable
from typing import Final

from ...errors import LocalProtocolError
from ..codec import Dialect, Operation, Reply, no_dialect_bytes_for
from . import messages
from .display import Autd3Display
from .frame import DEVICE_FRAME_BYTES, Autd3DeviceReader, Autd3DeviceState
from .operations import CHANNELS

MAX_DEVICES: Final = 64  # ours: the link has a u32
MAX_TEXT_BYTES: Final = 4096  # ours: the link has a u32
MAX_UNANSWERED: Final = 64  # ours: the client waits for each answer
_WIRE: Final = "autd3"
_MAGIC: Final = b"AUTD3REMOTE"
_OPEN, _UPDATE, _WRITE, _READ, _CLOSE, _HELLO = 1, 2, 3, 4, 5, 0x10
_OK, _ERROR = 0, 0xFF
# The first bytes of other versions: HTTP/2 (RFC 9113, 3.4); autd3-sdk 110b80c, link-remote/wire.rs
_STRANGERS: Final = {b"PRI ": "gRPC over HTTP/2, as autd3 36 and older", b"ARMT": "autd3-sdk"}
_STRANGER_BYTES: Final = 4
_HELLO_LAYOUT: Final = struct.Struct(f"<BH{len(_MAGIC)}s")
_COUNT: Final = struct.Struct("<xI")
_POSE: Final = struct.Struct("<7f")
_STATE_BYTES: Final = 2


class Autd3BoardEnd:
    """The board's end of one connection.

    Attributes
    ----------
    counters : Counter
        ``links_undecodable``, ``bytes_after_end``, and those of :class:`Autd3DeviceReader`.
    """

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self._buffer = bytearray()
        self._devices: list[Autd3DeviceReader] | None = None
        self._greeted = False
        self._ended = False
        self._needed = 1  # bytes in the buffer, before it is worth a look

    @property
    def pending(self) -> int:
        """Bytes of a message that has not ended: fewer than 64 frames and a byte."""
        return len(self._buffer)

    def receive_data(self, data: bytes) -> list[Operation]:
        """Return the operations that *data* completes."""
        found: list[Operation] = []
        self._buffer += data
        if len(self._buffer) >= self._needed:
            self._read_all(bytes(self._buffer), found)
        if self._ended and self._buffer:
            self.counters["bytes_after_end"] += len(self._buffer)
            self._buffer.clear()
        return found

    def next_frame_end(self, data: bytes, at: int) -> int:
        """Return the index after the bytes that the message needs next."""
        if self._ended:
            return len(data)
        return min(len(data), at + max(1, self._needed - len(self._buffer)))

    def send(self, message: Reply) -> bytes:
        """Return the bytes of a reply."""
        if isinstance(message, messages.Accepted):
            return bytes([_OK])
        if isinstance(message, messages.Autd3States):
            return bytes([_OK]) + b"".join(state.pack() for state in message.devices)
        if isinstance(message, messages.Autd3Refused):
            text = message.reason.encode("utf-8", "replace")[:MAX_TEXT_BYTES]
            return struct.pack("<BI", _ERROR, len(text)) + text
        raise no_dialect_bytes_for(message, _WIRE)

    def _read_all(self, received: bytes, found: list[Operation]) -> None:
        """Append all complete messages in *received* to *found*; keep the rest for later."""
        at = 0
        self._needed = 1
        while at < len(received) and not self._ended:
            operation, size = self._read(received, at)
            if operation is None:
                self._needed = size
                break
            found.append(operation)
            at += size
        del self._buffer[:at]

    def _read(self, received: bytes, at: int) -> tuple[Operation | None, int]:
        """Return the operation at *at* and its size in bytes.

        If it is incomplete: None, and how many bytes it has in all.
        """
        kind = received[at]
        readers: dict[int, Callable[[bytes, int], tuple[Operation | None, int]]] = {
            _OPEN: self._read_geometry,
            _UPDATE: self._read_geometry,
            _WRITE: self._read_frames,
            _READ: lambda *_: (messages.Read(), 1),
            _CLOSE: self._read_close,
        }
        if kind == _HELLO and not self._greeted:
            return self._read_hello(received, at)
        if not self._greeted:
            return self._read_stranger(received, at)
        if kind not in readers:
            return self._give_up(f"unknown message {kind:02X}h")
        if self._devices is None and kind not in (_OPEN, _CLOSE):
            return self._give_up(f"message {kind:02X}h before the devices are opened")
        return readers[kind](received, at)

    def _read_stranger(self, received: bytes, at: int) -> tuple[Operation | None, int]:
        """End the link: its bytes are no handshake; name the protocol if known.

        None, with the bytes needed to tell, if there are too few.
        """
        start = received[at : at + _STRANGER_BYTES]
        served = "served is the link of autd3 38"
        for magic, name in _STRANGERS.items():
            if magic.startswith(start) and len(start) < _STRANGER_BYTES:
                return None, _STRANGER_BYTES
            if start == magic:
                return self._give_up(f"the client speaks {name}; {served}")
        return self._give_up(f"message {received[at]:02X}h before the handshake; {served}")

    def _read_hello(self, received: bytes, at: int) -> tuple[Operation | None, int]:
        """Return the handshake and its size; end the link if it is of another version.

        None, with the bytes needed, if it is incomplete.
        """
        if len(received) < at + _HELLO_LAYOUT.size:
            return None, _HELLO_LAYOUT.size
        _, version, magic = _HELLO_LAYOUT.unpack_from(received, at)
        if magic != _MAGIC:
            return self._give_up("the handshake does not say AUTD3REMOTE")
        if version != messages.VERSION:
            return self._give_up(
                f"version {version} of the link; served is {messages.VERSION}, of autd3 38"
            )
        self._greeted = True
        return messages.Hello(version), _HELLO_LAYOUT.size

    def _read_geometry(self, received: bytes, at: int) -> tuple[Operation | None, int]:
        """Return the devices' poses and size; end the link if they are too many or there already.

        None, with the bytes needed, if they are incomplete.
        """
        if len(received) < at + _COUNT.size:
            return None, _COUNT.size
        (count,) = _COUNT.unpack_from(received, at)
        if not 1 <= count <= MAX_DEVICES:
            return self._give_up(f"{count} devices; served are 1 to {MAX_DEVICES}")
        end = at + _COUNT.size + count * _POSE.size
        if len(received) < end:
            return None, end - at
        poses = tuple(
            messages.Pose(values[:3], values[3:])
            for values in _POSE.iter_unpack(received[at + _COUNT.size : end])
        )
        if received[at] == _UPDATE:
            return messages.Update(poses), end - at
        if self._devices is not None:
            return self._give_up("the devices are open already")
        self._devices = [Autd3DeviceReader(self.counters) for _ in poses]
        return messages.Open(poses), end - at

    def _read_frames(self, received: bytes, at: int) -> tuple[Operation | None, int]:
        """Return one frame for each device and their size; None, with that size, if incomplete."""
        devices = self._devices or []
        size = 1 + len(devices) * DEVICE_FRAME_BYTES
        if len(received) < at + size:
            return None, size
        starts = range(at + 1, at + size, DEVICE_FRAME_BYTES)
        frames = tuple(
            device.read(received[start : start + DEVICE_FRAME_BYTES])
            for device, start in zip(devices, starts, strict=True)
        )
        return messages.Write(frames), size

    def _read_close(self, *_: object) -> tuple[Operation, int]:
        """Return the message that closes the link; it has no bytes behind its type."""
        self._ended = True
        return messages.Close(), 1

    def _give_up(self, reason: str) -> tuple[Operation, int]:
        """Count the link as undecodable and end it; return (Undecodable with *reason*, 0)."""
        self._ended = True
        self.counters["links_undecodable"] += 1
        return messages.Undecodable(reason), 0


class Autd3HostEnd:
    """The client's end of one connection.

    Attributes
    ----------
    counters : Counter
        ``bytes_unexpected``: no answer was due, or the answer is none of the link's.
    """

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self._buffer = bytearray()
        self._due: deque[int] = deque()  # for each answer the devices that it speaks of
        self._devices = 0

    @property
    def pending(self) -> int:
        """Bytes of a reply that has not ended."""
        return len(self._buffer)

    @property
    def due(self) -> int:
        """Answers that have not come."""
        return len(self._due)

    def send(self, message: Operation) -> bytes:
        """Return the bytes of *message*; its answer is then due.

        Raises
        ------
        LocalProtocolError
            If the link has no bytes for *message*, or too many answers are due.
        """
        if len(self._due) >= MAX_UNANSWERED:
            raise LocalProtocolError(f"{MAX_UNANSWERED} answers are due; read them first")
        packed = self._pack(message)
        self._due.append(self._devices if isinstance(message, messages.Read) else 0)
        return packed

    def receive_data(self, data: bytes) -> list[Reply]:
        """Return the replies that *data* completes."""
        found: list[Reply] = []
        received = bytes(self._buffer) + data if self._buffer else data
        at = 0
        while at < len(received):
            if not self._due or received[at] not in (_OK, _ERROR):
                self.counters["bytes_unexpected"] += 1
                at += 1
                continue
            reply, size = self._read(received, at)
            if reply is None:
                break
            found.append(reply)
            self._due.popleft()
            at += size
        self._buffer[:] = received[at:]
        return found

    def _pack(self, message: Operation) -> bytes:
        """Return the bytes of a message to the devices."""
        if isinstance(message, messages.Hello):
            return _HELLO_LAYOUT.pack(_HELLO, message.version, _MAGIC)
        if isinstance(message, messages.Open | messages.Update):
            return self._pack_geometry(message)
        if isinstance(message, messages.Write):
            if len(message.frames) != self._devices:
                raise LocalProtocolError(
                    f"{len(message.frames)} frames for {self._devices} open devices"
                )
            return bytes([_WRITE]) + b"".join(frame.pack() for frame in message.frames)
        if isinstance(message, messages.Read | messages.Close):
            return bytes([_READ if isinstance(message, messages.Read) else _CLOSE])
        raise no_dialect_bytes_for(message, _WIRE)

    def _pack_geometry(self, message: messages.Open | messages.Update) -> bytes:
        """Return the bytes of a message with the poses of the devices."""
        if not 1 <= len(message.devices) <= MAX_DEVICES:
            raise LocalProtocolError(
                f"{len(message.devices)} devices; 1 to {MAX_DEVICES} are served"
            )
        if isinstance(message, messages.Open):
            self._devices = len(message.devices)
        kind = _OPEN if isinstance(message, messages.Open) else _UPDATE
        poses = (_POSE.pack(*pose.position, *pose.rotation) for pose in message.devices)
        return struct.pack("<BI", kind, len(message.devices)) + b"".join(poses)

    def _read(self, received: bytes, at: int) -> tuple[Reply | None, int]:
        """Parse a reply at *at*; return it and its size, or (None, 0) if it is incomplete."""
        if received[at] == _ERROR:
            return self._read_refusal(received, at)
        devices = self._due[0]
        end = at + 1 + devices * _STATE_BYTES
        if len(received) < end:
            return None, 0
        if not devices:
            return messages.Accepted(), 1
        states = (
            Autd3DeviceState.parse(received[start : start + _STATE_BYTES])
            for start in range(at + 1, end, _STATE_BYTES)
        )
        return messages.Autd3States(tuple(states)), end - at

    def _read_refusal(self, received: bytes, at: int) -> tuple[Reply | None, int]:
        """Return a refusal with its text, and its size; (None, 0) if it is incomplete."""
        if len(received) < at + _COUNT.size:
            return None, 0
        (size,) = _COUNT.unpack_from(received, at)
        if size > MAX_TEXT_BYTES:
            return messages.Autd3Refused(
                f"a text of {size} bytes; up to {MAX_TEXT_BYTES} are read"
            ), _COUNT.size
        start = at + _COUNT.size
        if len(received) < start + size:
            return None, 0
        return messages.Autd3Refused(
            received[start : start + size].decode("utf-8", "replace")
        ), start + size - at


AUTD3: Final = Dialect(
    name=_WIRE,
    title='AUTD3, TCP link "Remote" of autd3 38',
    bauds=(),
    steps=256,
    channels=CHANNELS,
    frame_bytes=lambda boards: 1 + DEVICE_FRAME_BYTES * boards,
    board=Autd3BoardEnd,
    host=Autd3HostEnd,
    signature=re.compile(rb"\x10..AUTD3REMOTE", re.DOTALL),
    display=Autd3Display,
    layout="autd3",
)
DIALECTS: Final = (AUTD3,)

"""InteractLab, the board of OpenMPD: frames of 512 bytes with side data in bit 7.

A byte with bit 7 starts a frame; the 511 bytes after it belong to it whatever they are, so a lost
byte moves every frame after it. 256 phases of 7 bits, then 256 duties of 7 bits, in the order of
the pins. A pulse is high for counts in [phase, phase + duty) mod 128, and 64 is the full duty. The
board never answers. Serial at 250 000 baud, or FT245. Source: RMResearch/OpenMPD_Hardware d3b4e57,
``FPGA_3.4.2/src``, ``CommandReader.vhd`` and ``FrameBufferController.vhd``; client: levitate 3.0.0.

=============  ===============================================================================
bit 7 of byte
=============  ===============================================================================
0              start of the frame
1 to 24        colour of the LEDs, lowest bit first
25             apply the colour
26 to 33       divider of the frame rate (40 kHz / divider, 4 at power-up), lowest bit first
34             apply the divider
all others     no meaning
=============  ===============================================================================
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from ..errors import LocalProtocolError
from .codec import Codes, Dialect, Display, OneWayHostEnd, Operation, Reply, no_dialect_bytes_for

CHANNELS: Final = 256
FRAME_BYTES: Final = 2 * CHANNELS
FULL_DUTY: Final = 64
STEPS: Final = 128
SECOND_S: Final = 1.0  # from power-up to the first frame; silence that clears the FIFO
_WIRE: Final = "interactlab"
_BIT: Final = 0x80
_LOW_BITS: Final = bytes(byte & 0x7F for byte in range(256))
_SIDE: Final = bytes(byte >> 7 for byte in range(256))
_START: Final = re.compile(rb"[\x80-\xff]")
_COLOUR, _APPLY_COLOUR = slice(1, 25), 25
_DIVIDER, _APPLY_DIVIDER = slice(26, 34), 34
_MEANINGLESS: Final = slice(35, FRAME_BYTES)


@dataclass(frozen=True, slots=True)
class QueueFrame(Operation):
    """A frame for the FIFO of the board, which shows it by itself.

    Attributes
    ----------
    phases : bytes
        Delay of the rising edge of each pin, 0 to 127 steps of 1/128 period.
    duties : bytes
        Width of the pulse of each pin, 0 to 127 steps; 64 is full.
    colour : int or None
        24 bits for the LEDs, if the frame sets them.
    divider : int or None
        Frames come every *divider* periods of 25 µs from this one on, if it sets that; 0 to 255.
    """

    phases: bytes
    duties: bytes
    colour: int | None = None
    divider: int | None = None


@dataclass(frozen=True, slots=True)
class FifoCleared(Reply):
    """The board forgets the beginning of a frame; it has no bytes of its own."""


class InteractlabBoardEnd:
    """The board's end.

    Attributes
    ----------
    counters : Counter
        ``bytes_cleared`` (the board forgot the beginning of a frame),
        ``bytes_outside_frame`` (no start), ``duties_above_full``, ``start_bits_in_frame`` (bit 7
        where it means nothing: bytes are missing or belong to another array).
    """

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()
        self._frame = bytearray()

    @property
    def pending(self) -> int:
        """Bytes of a frame that has not ended, 511 at the most."""
        return len(self._frame)

    def receive_data(self, data: bytes) -> list[Operation]:
        """Return the frames that *data* completes."""
        found: list[Operation] = []
        at = 0
        while at < len(data):
            if not self._frame:
                at = self._find_start(data, at)
            part = data[at : at + FRAME_BYTES - len(self._frame)]
            self._frame += part
            at += len(part)
            if len(self._frame) == FRAME_BYTES:
                found.append(self._read(bytes(self._frame)))
                self._frame.clear()
        return found

    def next_frame_end(self, data: bytes, at: int) -> int:
        """Return the index after the last byte of the frame that goes on or starts next."""
        if not self._frame:
            match = _START.search(data, at)
            at = match.start() if match else len(data)
        return min(len(data), at + FRAME_BYTES - len(self._frame))

    def send(self, message: Reply) -> bytes:
        """Forget the beginning of a frame if *message* says so; return no bytes.

        Raises
        ------
        LocalProtocolError
            For anything else: the board never answers.
        """
        if not isinstance(message, FifoCleared):
            raise no_dialect_bytes_for(message, _WIRE)
        if self._frame:
            self.counters["bytes_cleared"] += len(self._frame)
            self._frame.clear()
        return b""

    def _find_start(self, data: bytes, at: int) -> int:
        """Return the index of the next frame's first byte, or the length of *data*.

        Bytes before it are counted as outside of a frame.
        """
        match = _START.search(data, at)
        start = match.start() if match else len(data)
        if start > at:
            self.counters["bytes_outside_frame"] += start - at
        return start

    def _read(self, frame: bytes) -> QueueFrame:
        """Decode a whole frame; count start bits within it and duties above the full one."""
        side = frame.translate(_SIDE)
        values = frame.translate(_LOW_BITS)
        duties = values[CHANNELS:]
        for kind, count in (
            ("start_bits_in_frame", side[_MEANINGLESS].count(1)),
            ("duties_above_full", len(duties.translate(None, bytes(range(FULL_DUTY + 1))))),
        ):
            if count:
                self.counters[kind] += count
        return QueueFrame(
            values[:CHANNELS],
            duties,
            _bits_to_int(side[_COLOUR]) if side[_APPLY_COLOUR] else None,
            _bits_to_int(side[_DIVIDER]) if side[_APPLY_DIVIDER] else None,
        )


class InteractlabHostEnd(OneWayHostEnd):
    """The host's end: the bytes of frames, and a board that never answers."""

    def send(self, message: Operation) -> bytes:
        """Return the 512 bytes of a frame.

        Raises
        ------
        LocalProtocolError
            If *message* is no frame, or its values do not fit.
        """
        if not isinstance(message, QueueFrame):
            raise no_dialect_bytes_for(message, _WIRE)
        _check_interactlab_operation(message)
        frame = bytearray(message.phases + message.duties)
        frame[0] |= _BIT
        if message.colour is not None:
            _set_frame_bits(frame, _COLOUR, message.colour)
            frame[_APPLY_COLOUR] |= _BIT
        if message.divider is not None:
            _set_frame_bits(frame, _DIVIDER, message.divider)
            frame[_APPLY_DIVIDER] |= _BIT
        return bytes(frame)


class InteractlabDisplay(Display):
    """Phases at full duty; the FIFO is empty before each frame, as serial lines are slow."""

    settle_s = SECOND_S
    forgets_s = SECOND_S

    def __init__(self) -> None:
        super().__init__(CHANNELS, STEPS)

    def frame(self, codes: Codes) -> list[Operation]:
        """Return the frame of *codes*."""
        duties = bytes(0 if code is None else FULL_DUTY for code in codes)
        return [QueueFrame(bytes(code or 0 for code in codes), duties)]

    def read(self, operations: Sequence[Operation]) -> list[int | None] | None:
        """Return the codes of the last frame."""
        frames = [operation for operation in operations if isinstance(operation, QueueFrame)]
        if not frames:
            return None
        pairs = zip(frames[-1].phases, frames[-1].duties, strict=True)
        return [phase if duty else None for phase, duty in pairs]


def _check_interactlab_operation(message: QueueFrame) -> None:
    """Raise LocalProtocolError for values of a frame beyond their bits.

    A phase or duty has 7 bits, and there is one for each channel; the colour has 24, the divider 8.
    """
    for name, values in (("phases", message.phases), ("duties", message.duties)):
        if len(values) != CHANNELS or max(values) >= _BIT:
            raise LocalProtocolError(f"{name}: {CHANNELS} values of 0 to 127, not {values.hex()}")
    for name, value, bits in (("colour", message.colour, 24), ("divider", message.divider, 8)):
        if value is not None and not 0 <= value < 1 << bits:
            raise LocalProtocolError(f"{name} {value}; it has {bits} bits")


def _bits_to_int(bits: bytes) -> int:
    """Return the integer of bits, each a byte of 0 or 1, least significant first."""
    return sum(bit << place for place, bit in enumerate(bits))


def _set_frame_bits(frame: bytearray, where: slice, value: int) -> None:
    """Write an integer into the marker bits of the bytes *where*, least significant first."""
    for place, at in enumerate(range(where.start, where.stop)):
        frame[at] |= (value >> place & 1) * _BIT


INTERACTLAB: Final = Dialect(
    name=_WIRE,
    title="InteractLab / OpenMPD, FPGA 3.4.2",
    bauds=(250_000,),
    steps=STEPS,
    channels=CHANNELS,
    frame_bytes=lambda boards: FRAME_BYTES * boards,
    board=InteractlabBoardEnd,
    host=InteractlabHostEnd,
    signature=re.compile(rb"[\x80-\xff].{255}[\x00-\x41]{256}", re.DOTALL),
    display=lambda _: InteractlabDisplay(),
    layout="interactlab",
)
DIALECTS: Final = (INTERACTLAB,)

"""A dialect of its own: 55h, a code of 0 to 15 for each of 16 channels (16: off), their sum."""

import functools
import re
from collections import Counter
from dataclasses import dataclass

from haptogram.acoustics import TransducerArray
from haptogram.acoustics.model.boards.layout import BoardLayout
from haptogram.acoustics.model.pulses import PulseDrive
from haptogram_protocol.dialects.codec import Dialect, OneWayHostEnd, Operation, Reply
from sim_device.board.events import PulseLatch
from sim_device.dialects.emulation import Emulation
from sim_device.dialects.unit import LatchingUnit


@dataclass(frozen=True)
class Show(Operation):
    codes: bytes


@dataclass(frozen=True)
class Answer(Reply):
    right: bool


class BoardEnd:  # 55h, 16 codes, their sum
    def __init__(self):
        self.counters, self._frame = Counter(), b""

    pending = property(lambda self: len(self._frame))

    def next_frame_end(self, data, at):
        return min(len(data), at + 18 - len(self._frame))

    def receive_data(self, data):
        self._frame, found = self._frame + data, []
        while (start := self._frame.find(b"\x55")) >= 0 and len(self._frame) >= start + 18:
            frame, self._frame = self._frame[start : start + 18], self._frame[start + 18 :]
            right = sum(frame[1:17]) & 0xFF == frame[17]
            self.counters["sums_wrong"] += not right
            found.append(Show(frame[1:17]) if right else Show(b""))
        self._frame = self._frame[-17:]
        return found

    def send(self, message):
        return b"\x06" if message.right else b"\x15"


class Board(LatchingUnit):
    def __init__(self, options, now_us):
        super().__init__()
        self._latches.append(PulseLatch(now_us, PulseDrive.off(16, 16), "power-up"))

    def take(self, operation, t_us):
        if operation.codes:
            widths = [8 * (code < 16) for code in operation.codes]
            pulses = PulseDrive([code & 15 for code in operation.codes], widths, 16)
            self._latches.append(PulseLatch(t_us, pulses, "frame"))
        return [Answer(bool(operation.codes))]


WIRE = Dialect(
    "ours",
    "Our board",
    (115_200,),
    16,
    16,
    lambda boards: 18,
    BoardEnd,
    OneWayHostEnd,
    re.compile(rb"\x55[\0-\x10]{16}"),
)
LAYOUT = BoardLayout("ours", "Our 4 x 4", "measured", functools.partial(TransducerArray.grid, 4, 4))
EMULATION = Emulation(WIRE, lambda options: BoardEnd(), Board, lambda options: LAYOUT)

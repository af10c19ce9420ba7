"""Phases on devices of AUTD3: a gain for each, and its acknowledgement."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from ..codec import Codes, Display, Operation, Reply
from .frame import MAX_MESSAGE_ID, Autd3DeviceFrame
from .messages import Autd3States, Close, Hello, Open, Pose, Read, Write
from .operations import CHANNELS, Clear, Gain

STEPS: Final = 256
FULL: Final = 255
_APART_MM: Final = 192.0
_UPRIGHT: Final = (1.0, 0.0, 0.0, 0.0)


class Autd3Display(Display):
    """Gains at full intensity for devices in a row along x; segment 0, no modulation.

    Parameters
    ----------
    devices : int
        How many there are.
    """

    def __init__(self, devices: int) -> None:
        super().__init__(devices * CHANNELS, STEPS)
        self._devices, self._message_id = devices, 0

    def opening(self) -> list[Operation]:
        """Return the handshake, the devices, and twice that they are to forget what they show.

        A device ignores a frame with the message id of the last one, which is not known here.
        """
        poses = tuple(Pose((_APART_MM * n, 0.0, 0.0), _UPRIGHT) for n in range(self._devices))
        clears = [Clear()] * self._devices
        return [Hello(), Open(poses), *self._written(clears), *self._written(clears)]

    def frame(self, codes: Codes) -> list[Operation]:
        """Return the gains of *codes*, and the question whether the devices took them."""
        drives = b"".join(bytes((0, 0) if code is None else (code, FULL)) for code in codes)
        size = 2 * CHANNELS
        starts = range(0, len(drives), size)
        return self._written([Gain(0, True, drives[at : at + size]) for at in starts])

    def read(self, operations: Sequence[Operation]) -> list[int | None] | None:
        """Return the codes of the last gains."""
        shown: list[int | None] | None = None
        for written in (o for o in operations if isinstance(o, Write)):
            gains = [o for frame in written.frames for o in frame.operations if isinstance(o, Gain)]
            if len(gains) == self._devices:
                drives = b"".join(gain.drives for gain in gains)
                pairs = zip(drives[::2], drives[1::2], strict=True)
                shown = [phase if intensity else None for phase, intensity in pairs]
        return shown

    def unfinished(self, replies: Sequence[Reply]) -> list[Operation]:
        """Return the question again, if a device acknowledges the frame before only."""
        states = [reply for reply in replies if isinstance(reply, Autd3States)]
        if not states or all(d.message_id == self._message_id for d in states[-1].devices):
            return []
        return [Read()]

    def closing(self) -> list[Operation]:
        """Return the end of the link."""
        return [Close()]

    def _written(self, operations: Sequence[Operation]) -> list[Operation]:
        """Return a Write that gives each device one of *operations*, in order, then a Read.

        All frames of the Write have the next message id.
        """
        self._message_id = (self._message_id + 1) % (MAX_MESSAGE_ID + 1)
        frames = tuple(Autd3DeviceFrame(self._message_id, (each,)) for each in operations)
        return [Write(frames), Read()]

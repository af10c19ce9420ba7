"""Boards of InteractLab: a FIFO of frames that empties by itself.

The first byte of the FIFO that the board reads starts a frame; it looks again *divider* periods of
25 µs later, and at once for a frame that comes while it has nothing to do. What is shown changes on
the next boundary of a period. An underrun keeps the last frame. A second after power-up the board
shows an off-frame, and reads only from then on. Whenever less than one frame has waited for a
second, the FIFO is cleared: every second while no frame comes, so a frame that is under way at such
a moment loses its beginning. What is left of it goes unread here; a real board, which counts bytes
and not frames, then shows every frame one too late until the FIFO is cleared again.

Back-pressure: with 28 frames in the FIFO the board stops reading its USB chip, and the client's
write waits. The FIFO has room for 32; a line without flow control loses what comes then. At 250 000
baud a frame takes 20.5 ms and is shown within 6.4 ms at the slowest, so the FIFO of a serial board
never fills.

Source: RMResearch/OpenMPD_Hardware d3b4e57, ``FPGA_3.4.2/src``: ``FrameBufferController.vhd``
(FIFO, timers), ``CommandReader.vhd`` (divider), ``AllChannels.vhd`` (double buffer), ``top.vhd``
(USB chip). Not emulated: the calibration of a single board, and the gamma correction of its LEDs.
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

from haptogram.acoustics.model.pulses import PulseDrive
from haptogram_protocol.dialects import interactlab as wire
from haptogram_protocol.dialects.codec import Operation, Reply

from ..board.events import PulseLatch
from .emulation import Emulation
from .unit import LatchingUnit

FIFO_FRAMES: Final = 32  # 16 384 bytes
READY_FRAMES: Final = 28
STEPS: Final = 128
PERIOD_US: Final = 25
SECOND_US: Final = 1_000_000
_READ_US: Final = 11  # 512 cycles of 50 MHz, rounded up
_POWER_UP_DIVIDER: Final = 4
_DIVIDER_OF_0: Final = 256  # the counter has 8 bits


class InteractlabUnit(LatchingUnit):
    """One board, powered up at *now_us*.

    Attributes
    ----------
    counters : Counter
        ``frames_beyond_fifo``: lost, because nothing held the client back.
    colour : int
        24 bits of the LEDs.
    """

    def __init__(self, now_us: int) -> None:
        super().__init__()
        self.colour = 0
        self._boot_us = now_us
        self._starts_us: int | None = now_us + SECOND_US
        self._fifo: deque[wire.QueueFrame] = deque()
        self._divider = _POWER_UP_DIVIDER
        self._looks_us: int | None = None  # None: idle, or not started
        self._clears_us: int | None = None  # None: a frame waits
        self._wakes_us: int | None = None  # before it clears, so that it has what came by then
        self._replies: list[Reply] = []
        self._wait_for_frame(now_us)
        off = PulseDrive.off(wire.CHANNELS, STEPS)
        self._latches = [PulseLatch(now_us, off, "power-up")]
        self._next: PulseLatch | None = None

    @property
    def room_bytes(self) -> int:
        """Bytes that the board takes from its USB chip now."""
        return max(0, READY_FRAMES - len(self._fifo)) * wire.FRAME_BYTES

    def take(self, operation: Operation, t_us: int) -> list[Reply]:
        """Queue a frame that is complete at *t_us*."""
        replies = self.advance_to(t_us)
        if not isinstance(operation, wire.QueueFrame):
            self.counters["operations_unknown"] += 1
        elif len(self._fifo) >= FIFO_FRAMES:
            self.counters["frames_beyond_fifo"] += 1
        else:
            self._fifo.append(operation)
            self._clears_us = self._wakes_us = None
            if self._is_idle:
                self._read(t_us)
        return replies

    def next_event_us(self) -> int | None:
        """Return when the board next starts, shows a frame, looks for one or clears its FIFO."""
        shows_us = None if self._next is None else self._next.t_latch_us
        times = (self._starts_us, shows_us, self._looks_us, self._wakes_us, self._clears_us)
        return min((time for time in times if time is not None), default=None)

    def advance_to(self, t_us: int) -> list[Reply]:
        """Let everything happen that is due up to *t_us*."""
        while (now_us := self.next_event_us()) is not None and now_us <= t_us:
            if self._next is not None and self._next.t_latch_us <= now_us:
                self._latches.append(self._next)
                self._next = None
            elif self._wakes_us == now_us:
                self._wakes_us = None
            elif self._clears_us == now_us:
                self._replies.append(wire.FifoCleared())
                self._wait_for_frame(now_us)
            elif self._starts_us == now_us:
                self._start(now_us)
            else:
                self._read_if_filled(now_us)
        replies, self._replies = self._replies, []
        return replies

    @property
    def _is_idle(self) -> bool:
        """Return True if neither a start nor a read is scheduled."""
        return self._starts_us is None and self._looks_us is None

    def _wait_for_frame(self, now_us: int) -> None:
        """Schedule to silence the output in one second, unless a frame arrives until then."""
        self._clears_us = now_us + SECOND_US
        self._wakes_us = self._clears_us - 1

    def _start(self, now_us: int) -> None:
        """Schedule a latch of silence 11 µs from now, at the next carrier period.

        The FIFO is looked at for the first time 11 µs from now, too.
        """
        self._starts_us = None
        self._next = PulseLatch(
            self._boundary(now_us + _READ_US), PulseDrive.off(wire.CHANNELS, STEPS), "off-frame"
        )
        self._looks_us = now_us + _READ_US

    def _read_if_filled(self, now_us: int) -> None:
        """Read the FIFO unless it is empty."""
        self._looks_us = None
        if self._fifo:
            self._read(now_us)

    def _read(self, now_us: int) -> None:
        """Take a frame from the FIFO; schedule its latch and the next read."""
        frame = self._fifo.popleft()
        if not self._fifo:
            self._wait_for_frame(now_us)
        self.colour = self.colour if frame.colour is None else frame.colour
        self._divider = self._divider if frame.divider is None else frame.divider
        shown_us = self._boundary(now_us + _READ_US)
        self._next = PulseLatch(shown_us, _interactlab_pulses(frame), "frame")
        self._looks_us = shown_us + PERIOD_US * ((self._divider or _DIVIDER_OF_0) - 1)

    def _boundary(self, t_us: int) -> int:
        """Return the first boundary of a carrier period at *t_us* or later, in µs."""
        return t_us + (self._boot_us - t_us) % PERIOD_US


def _interactlab_pulses(frame: wire.QueueFrame) -> PulseDrive:
    """Return the pulses of a frame's phases and duties, 128 steps in a period."""
    return PulseDrive(
        np.frombuffer(frame.phases, np.uint8), np.frombuffer(frame.duties, np.uint8), STEPS
    )


INTERACTLAB: Final = Emulation.of(wire.INTERACTLAB, lambda _, now_us: InteractlabUnit(now_us))
EMULATIONS: Final = (INTERACTLAB,)

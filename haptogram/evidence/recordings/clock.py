"""The one clock of a recording: device times, set beside those of the host."""

from __future__ import annotations

from typing import Final

from haptogram_protocol.annotation.frames import FrameAnnotator
from haptogram_protocol.messages import signed_difference, unwrap

_REPLIES: Final = 32  # the quickest of them tells the difference of the clocks
_WRAP: Final = 1 << 32


class RecordingClock:
    """Turns device times into those of the host.

    Parameters
    ----------
    start_ns : int
        Host time at which the line began.
    boot_ns : int or None
        Host time of the board's power-up, which makes its clock exact; None: the first replies
        tell it to within their time on the line, and without any the first device time is now.
    """

    def __init__(self, start_ns: int = 0, boot_ns: int | None = None) -> None:
        self.start_ns = start_ns
        self._boot_ns = boot_ns
        self._ahead_us: int | None = None  # device over host
        self._told_us: int | None = None  # the same, as replies tell it, without whole wraps
        self._replies = 0 if boot_ns is not None else _REPLIES
        self._annotator = FrameAnnotator()

    def power_up(self, boot_us: int) -> None:
        """Take the device time of the power-up."""
        if self._boot_ns is not None:
            self._ahead_us = boot_us - self._boot_ns // 1000

    def hear(self, t_ns: int, data: bytes) -> None:
        """Learn from bytes that the host read."""
        if not self._replies:
            return
        for piece in self._annotator.feed(data):
            if piece.header is not None:
                self._replies = max(0, self._replies - 1)
                ahead_us = piece.header.time_us - t_ns // 1000
                if self._told_us is None or signed_difference(ahead_us, self._told_us, 32) > 0:
                    self._told_us = ahead_us

    def host_ns(self, device_us: int, now_ns: int) -> int:
        """Return the host time of a device time; the difference is settled by the first one."""
        if self._ahead_us is None:
            self._replies = 0
            self._ahead_us = device_us - now_ns // 1000
            if self._told_us is not None:
                self._ahead_us = unwrap(self._told_us % _WRAP, self._ahead_us, 32)
        return max(0, (device_us - self._ahead_us) * 1000)

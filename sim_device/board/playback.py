"""Sequences that the board plays on its own clock.  SPEC.md chapter 7."""

from __future__ import annotations

from dataclasses import dataclass

from haptogram_protocol.messages import LatchKey

from .registers import Content
from .uploads import Upload


@dataclass(slots=True)
class BoardPlayback:
    """One run of a sequence; ``played`` counts the frames that were latched.

    Attributes
    ----------
    sequence : int
        Id of the sequence.
    frames : Upload
        The stored sequence.
    start_us, period_us : int
        Frame k is due at start + k period, never accumulated.
    loops : int
        How often; 0: until it is stopped.
    unattended_ms : int
        Replaces the host timeout meanwhile.
    """

    sequence: int
    frames: Upload
    start_us: int
    period_us: int
    loops: int
    unattended_ms: int
    played: int = 0

    @property
    def due_us(self) -> int:
        """When the next frame is due."""
        return self.start_us + self.played * self.period_us

    @property
    def key(self) -> LatchKey:
        """Which frame is next."""
        loop, index = divmod(self.played, len(self.frames))
        return LatchKey(sequence=self.sequence, loop=loop, index=index)

    @property
    def content(self) -> Content:
        """Content of the next frame."""
        return self.frames[self.played % len(self.frames)]

    @property
    def is_over(self) -> bool:
        """True if the last frame of the last loop was latched."""
        return self.loops > 0 and self.played >= self.loops * len(self.frames)

    @property
    def ends_next(self) -> bool:
        """True if the next frame is the last one of the last loop."""
        return self.loops > 0 and self.played + 1 >= self.loops * len(self.frames)

    @property
    def loops_done(self) -> int:
        """Whole passes played."""
        return self.played // len(self.frames)

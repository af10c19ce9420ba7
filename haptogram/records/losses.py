"""Reasons for frames that a board did not latch: they decide whose loss it is."""

from __future__ import annotations

from collections.abc import Mapping

from haptogram.settings.frozen import dataclass, field

from .frame import FrameKey


@dataclass(frozen=True, slots=True)
class FrameDrop:
    """A stream frame that came to the board whole, and that the board did not queue.

    Attributes
    ----------
    counter : str
        Counter of SPEC.md 9.2 that took it.
    t_received_us : int
        Device time at which its last byte was there.
    """

    counter: str
    t_received_us: int


@dataclass(frozen=True, slots=True)
class BoardLosses:
    """Reasons for frames that a board did not latch, on the clock of what was intended.

    Attributes
    ----------
    drops : mapping of FrameKey to FrameDrop
        Frames that it dropped, as the back door shows.
    timeouts_us, mutes_us : tuple of int
        When a timer of the board muted it, and when the host did.
    neglects_us : tuple of int
        Those of *timeouts_us* before which the host had sent nothing for as long as the lease.
    counters : mapping of str to int
        Growth of the counters of lost and damaged frames during the run.
    latched : int or None
        Growth of the counter of latches; None: it was not read.
    is_machine_in_between : bool
        Whether the board is a process that waits for a processor of this machine: then it can read
        late what the host sent in time.
    is_told_in_order : bool
        Whether all latches up to the last one are told: then no frame before that one was latched
        without being seen.
    """

    drops: Mapping[FrameKey, FrameDrop] = field(default_factory=dict)
    timeouts_us: tuple[int, ...] = ()
    mutes_us: tuple[int, ...] = ()
    neglects_us: tuple[int, ...] = ()
    counters: Mapping[str, int] = field(default_factory=dict)
    latched: int | None = None
    is_machine_in_between: bool = False
    is_told_in_order: bool = False

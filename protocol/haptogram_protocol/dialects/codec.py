"""The seam of every dialect: ends that take the bytes of a peer and give those of their messages.

A dialect has two ends. The board's end takes the bytes of a host and gives operations; the host's
end gives the bytes of operations and takes what the board answers. An end does no I/O and reads no
clock. Any bytes, in any chunks, give the same messages; what an end cannot understand is counted by
kind and never raised; what it holds back is bounded.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol, TypeAlias, TypeVar, runtime_checkable

from ..errors import LocalProtocolError


class Operation:
    """One thing that the bytes of a host ask of a board."""

    __slots__ = ()


class Reply:
    """One thing that the bytes of a board tell the host."""

    __slots__ = ()

    @property
    def refusal(self) -> str | None:
        """Why the board did not do what it was asked; None: it did."""
        return None


#: Step of the period at which the pulse of each channel begins; None: off.
Codes: TypeAlias = Sequence[int | None]


Sent_contra = TypeVar("Sent_contra", contravariant=True)
Received = TypeVar("Received")


class DialectEnd(Protocol[Sent_contra, Received]):
    """One end of a wire."""

    @property
    def counters(self) -> Counter[str]:
        """Counts of the bytes and frames that this end cannot understand, by kind."""

    @property
    def pending(self) -> int:
        """Bytes of a message that has not ended, which this end holds back."""

    def receive_data(self, data: bytes) -> list[Received]:
        """Return the messages that *data* completes, in the order of the wire."""

    def send(self, message: Sent_contra) -> bytes:
        """Return the bytes of *message*.

        Raises
        ------
        LocalProtocolError
            If this wire has no bytes for *message*.
        """


class HostEnd(DialectEnd[Operation, Reply], Protocol):
    """The host's end of a wire."""

    @property
    def due(self) -> int:
        """Answers that the host waits for."""


class BoardEnd(DialectEnd[Reply, Operation], Protocol):
    """The board's end of a wire, which a simulator feeds so that each message has its time."""

    def next_frame_end(self, data: bytes, at: int) -> int:
        """Return the index after the first byte of *data* from *at* on that may end a message.

        It is greater than *at*, and the length of *data* if no byte may; an end that cannot tell
        returns ``at + 1``.
        """


@runtime_checkable
class Commits(Protocol):
    """A board's end whose frames are shown by a command, which may come later."""

    @property
    def commit(self) -> str:
        """The command in words for a user: "FDh"."""

    @property
    def unfinished(self) -> int:
        """Bytes of the frame that has begun and is not whole; its start is one of them."""

    @property
    def uncommitted(self) -> int:
        """Whole frames since the last commit."""


class Display:
    """The way from phases to operations, for all boards of one line, as long as the link lasts.

    Attributes
    ----------
    channels : int
        Channels of all boards.
    steps : int
        Steps of a period that their outputs have.
    level : float
        Fundamental of their pulses, as a share of that of half a period.
    mounting : sequence of float
        For each channel the lag of its emitter, in periods, because of how it is mounted; empty: 0.
    unconnected : frozenset of int
        Channels that have no output.
    settle_s : float
        Time that the boards need after the opening, seconds.
    forgets_s : float
        Silence after which the boards may lose the beginning of a frame: one that is off goes
        ahead of the next one then.
    options : mapping of str to int
        Keywords with which :class:`Dialect` makes both ends for these boards.
    """

    level = 1.0
    mounting: Sequence[float] = ()
    unconnected: frozenset[int] = frozenset()
    settle_s = 0.0
    forgets_s = float("inf")
    options: Mapping[str, int] = MappingProxyType({})

    def __init__(self, channels: int, steps: int) -> None:
        self.channels, self.steps = channels, steps

    def opening(self) -> list[Operation]:
        """Return the operations after which every channel is off."""
        return self.off()

    def frame(self, codes: Codes) -> list[Operation]:
        """Return the operations that show *codes*, one of them for each channel."""
        raise NotImplementedError

    def read(self, operations: Sequence[Operation]) -> list[int | None] | None:
        """Return the codes that *operations* show in the end; None: no whole frame."""
        raise NotImplementedError

    def unfinished(self, replies: Sequence[Reply]) -> list[Operation]:  # noqa: ARG002  most boards never answer
        """Return the operations that ask again, if *replies* say that the boards are not done."""
        return []

    def off(self) -> list[Operation]:
        """Return the operations after which every channel is off."""
        return self.frame([None] * self.channels)

    def closing(self) -> list[Operation]:
        """Return the operations with which a host goes; every channel is off by then."""
        return []


@dataclass(frozen=True)
class Dialect:
    """A wire by its name and properties, with its two ends.

    Attributes
    ----------
    name : str
        Name by which users choose the dialect.
    title : str
        The boards, clients and versions that speak the dialect.
    bauds : tuple of int
        Speeds of the line, the usual one first; empty if the line is no serial one.
    steps : int
        Codes in a period of the carrier.
    channels : int
        Channels of one board.
    frame_bytes : callable
        From the number of boards on the line to the bytes of a frame for all of them, with the
        command that shows it; None of the amplitudes that some clients add.
    board, host : callable
        Make an end; options are keywords that the dialect's module describes.
    signature : re.Pattern
        Bytes that give the dialect away among others.
    display : callable or None
        From the number of boards on the line to how a host shows phases on them; None: this program
        emulates the boards and does not drive them.
    layout : str
        Name of the layout of its emitters, as its own programs have it; empty: not known here.
    """

    name: str
    title: str
    bauds: tuple[int, ...]
    steps: int
    channels: int
    frame_bytes: Callable[[int], int]
    board: Callable[..., BoardEnd]
    host: Callable[..., HostEnd]
    signature: re.Pattern[bytes]
    display: Callable[[int], Display] | None = None
    layout: str = ""


class OneWayHostEnd:
    """The receiving half of a host's end where boards never answer, or nothing of interest."""

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()

    @property
    def pending(self) -> int:
        """Nothing is held back."""
        return 0

    @property
    def due(self) -> int:
        """No answer is due."""
        return 0

    def receive_data(self, data: bytes) -> list[Reply]:
        """Count the bytes of *data*; none is a reply."""
        if data:
            self.counters["bytes_ignored"] += len(data)
        return []


def no_dialect_bytes_for(message: object, wire: str) -> LocalProtocolError:
    """Return the error of an end that was asked to send what its wire cannot say."""
    return LocalProtocolError(f"{wire} has no bytes for {message!r}")

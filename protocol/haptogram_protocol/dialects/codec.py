"""The seam of every dialect: ends that take the bytes of a peer and give those of their messages.

A dialect has two ends. The board's end takes the bytes of a host and gives operations; the host's
end gives the bytes of operations and takes what the board answers. An end does no I/O and reads no
clock. Any bytes, in any chunks, give the same messages; what an end cannot understand is counted by
kind and never raised; what it holds back is bounded.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar, runtime_checkable

from ..errors import LocalProtocolError

__all__ = [
    "BoardEnd",
    "Commits",
    "Dialect",
    "DialectEnd",
    "HostEnd",
    "OneWayHost",
    "Operation",
    "Reply",
    "no_dialect_bytes_for",
]


class Operation:
    """One thing that the bytes of a host ask of a board."""

    __slots__ = ()


class Reply:
    """One thing that the bytes of a board tell the host."""

    __slots__ = ()


Sent_contra = TypeVar("Sent_contra", contravariant=True)
Received = TypeVar("Received")


class DialectEnd(Protocol[Sent_contra, Received]):
    """One end of a wire."""

    @property
    def counters(self) -> Counter[str]:
        """Counts of the bytes and frames that this end cannot understand, by kind."""
        ...

    @property
    def pending(self) -> int:
        """Bytes of a message that has not ended, which this end holds back."""
        ...

    def receive_data(self, data: bytes) -> list[Received]:
        """Return the messages that *data* completes, in the order of the wire."""
        ...

    def send(self, message: Sent_contra) -> bytes:
        """Return the bytes of *message*.

        Raises
        ------
        LocalProtocolError
            If this wire has no bytes for *message*.
        """
        ...


HostEnd = DialectEnd[Operation, Reply]


class BoardEnd(DialectEnd[Reply, Operation], Protocol):
    """The board's end of a wire, which a simulator feeds so that each message has its time."""

    def next_end(self, data: bytes, at: int) -> int:
        """Return the index behind the first byte of *data* from *at* on that may end a message.

        It is greater than *at*, and the length of *data* if no byte may; an end that cannot tell
        returns ``at + 1``.
        """
        ...


@runtime_checkable
class Commits(Protocol):
    """A board's end whose frames end with a command that shows them, which may come later."""

    @property
    def is_uncommitted(self) -> bool:
        """True if there are bytes of a frame that no command has shown yet."""
        ...


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


class OneWayHost:
    """The receiving half of a host's end where boards never answer, or nothing of interest."""

    def __init__(self) -> None:
        self.counters: Counter[str] = Counter()

    @property
    def pending(self) -> int:
        """Nothing is held back."""
        return 0

    def receive_data(self, data: bytes) -> list[Reply]:
        """Count the bytes of *data*; none is a reply."""
        if data:
            self.counters["bytes_ignored"] += len(data)
        return []


def no_dialect_bytes_for(message: object, wire: str) -> LocalProtocolError:
    """Return the error of an end that was asked to send what its wire cannot say."""
    return LocalProtocolError(f"{wire} has no bytes for {message!r}")

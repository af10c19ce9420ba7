"""A board in virtual time that a process plays: a port to it, and its restart."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Final

from haptogram.driver.line.port import Transport
from haptogram_protocol.framing import DELIMITER

from ..explore.actions import is_mute_on_wire
from ..explore.stepped_process import LockstepProcess

#: Rate that cases reckon with where bytes take no time: the longest frame takes less than 1 µs.
NO_LINE_BAUD: Final = 50_000_000_000
_START_NS: Final = 1_004_000  # a carrier boundary: 2^32 - 10 s is none
_BEHIND_US: Final = 30  # time of a main loop for a frame while an interrupt takes the bytes


class SteppedAccessTransport:
    """A port to a stepped board; the host's clock is the board's virtual time.

    Parameters
    ----------
    process : LockstepProcess
        Board that has just started; it stays when the port is closed.

    Attributes
    ----------
    finds_mutes : bool or None
        Whether an interrupt finds MUTE ahead of the main loop, which then takes the frames of one
        write one after the other (HG-3.8/4), or MUTE keeps its place.  None: the bytes decide,
        half of them one way, and always the same way.
    """

    url = "steps://"
    finds_mutes: bool | None = None

    def __init__(self, process: LockstepProcess) -> None:
        self._process = process
        self._now_ns = _START_NS
        self._unread = self._begun = b""

    def now_ns(self) -> int:
        """Return the virtual time in nanoseconds after power-up."""
        return self._now_ns

    def write_some(self, data: bytes) -> int:
        """Let all of *data* arrive now."""
        *ended, begun = data.split(DELIMITER)
        pieces = [self._begun + piece if at == 0 else piece for at, piece in enumerate(ended)]
        self._begun = begun if ended else self._begun + begun
        mutes = [at for at, piece in enumerate(pieces) if is_mute_on_wire(piece + DELIMITER)]
        ahead = self.finds_mutes
        if ahead is None:  # a bit of the data, not derived from their CRC
            ahead = bool(hashlib.blake2b(data, digest_size=1).digest()[0] & 1)
        if mutes and ahead:
            self._overtake(mutes, [*(piece + DELIMITER for piece in ended), begun])
        else:
            self._unread += self._process.receive(self._now_ns // 1000, data)
        return len(data)

    def _overtake(self, mutes: Sequence[int], parts: Sequence[bytes]) -> None:
        """Process the MUTE frames of *parts* ahead of the bytes before them, then all of *parts*.

        *mutes* are the indices of those frames.
        """
        for mute in mutes:
            length = sum(map(len, parts[: mute + 1]))
            self._unread += self._process.find_mute(self._now_ns // 1000, length)
        for at, part in enumerate(parts):
            self._unread += self._process.receive(self._now_ns // 1000, part)
            if part != DELIMITER and at < mutes[-1]:
                self._now_ns += _BEHIND_US * 1000

    def read_available(self, deadline_ns: int) -> bytes:
        """Return the bytes that the board sends first, ``b""`` at the deadline."""
        if not self._unread and deadline_ns > self._now_ns:
            at_us, self._unread = self._process.advance_until_sent(deadline_ns // 1000)
            self._now_ns = max(self._now_ns, at_us * 1000 if self._unread else deadline_ns)
        data, self._unread = self._unread, b""
        return data

    def skip_ns(self, duration_ns: int) -> None:
        """Let time pass without a reader: the board's bytes have to wait at the board."""
        self._now_ns += duration_ns
        self._unread += self._process.advance(self._now_ns // 1000)

    def raise_hardware_fault(self) -> None:
        """Let the hardware of the board fail now."""
        self._unread += self._process.fault(self._now_ns // 1000)

    def close(self) -> None:
        """Do nothing: the process belongs to its :class:`SteppedAccess`."""


class SteppedAccess:
    """A board in virtual time, played by a process that restarts whenever its port is opened.

    Parameters
    ----------
    command : sequence of str
        Program and arguments.
    baudrate : int
        Line rate that cases reckon with; the bytes take no time.
    """

    virtual = True
    can_reset = True
    boots = True
    boot_timeout_s = 0.0

    def __init__(self, command: Sequence[str], *, baudrate: int = NO_LINE_BAUD) -> None:
        self.url, self.baudrate = command[0], baudrate
        self._command = command
        self._process: LockstepProcess | None = None
        self._transport: SteppedAccessTransport | None = None

    def open(self) -> Transport:
        """Power the board up."""
        if self._process is None or not self._process.runs:
            self.close()
            self._process = LockstepProcess(self._command)
        else:
            self._process.reset()
        self._transport = SteppedAccessTransport(self._process)
        return self._transport

    def raise_fault(self) -> None:
        """Let the hardware of the board fail now."""
        if self._transport is not None:
            self._transport.raise_hardware_fault()

    def reset(self) -> Transport:
        """Switch the board off and on."""
        return self.open()

    def last_words(self) -> str:
        """Return an empty string: what the process says of its end is raised where it is met."""
        return ""

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is not None:
            process.close()

"""The latches that a board reports: trace events, trace ring and read-back.

All of it is the firmware's own word, and marked so (:attr:`Evidence.SELF_REPORTED`).
"""

from __future__ import annotations

import functools

import numpy as np

from haptogram.acoustics import Drive
from haptogram.driver.line.link import Link, request_parts
from haptogram.driver.timing.clock import ClockEstimate
from haptogram.errors import ConfigurationError, WrongProtocolError
from haptogram.records.frame import Evidence, FrameKey, Observation
from haptogram_protocol import messages
from haptogram_protocol.connection import EventReceived

_READ_TRIES = 3  # tries to read a drive that is replaced meanwhile
_RING_READ = 0xFFFF  # latches asked for at a time; the board sends as many as fit
_HALF_TURN_NS = 2_100_000_000_000  # of the device clock: what is read back is in the past


class DriverTraceReader:
    """Turns the reports of the board into observations.

    Parameters
    ----------
    link : Link
        The open session.
    transducers : int
        Length of a drive.
    clock : ClockEstimate
        Unwraps the times.
    """

    def __init__(self, link: Link, transducers: int, clock: ClockEstimate) -> None:
        self._link = link
        self._transducers = transducers
        self._clock = clock
        self._next_in_ring = 0

    def take(self, event: EventReceived) -> Observation | None:
        """Return the latch that *event* reports, None if it reports something else."""
        message = event.message
        shown: bytes | int
        if isinstance(message, messages.Trace):
            key, shown = messages.LatchKey(0, 0, message.index), message.crc
        elif isinstance(message, messages.TracePlayback):
            key, shown = message.key, message.crc
        elif isinstance(message, messages.TraceDrive):
            key, shown = message.key, message.data
        else:
            return None
        header = event.header
        return self._latch(key, header.time_us, event.t_rx_us * 1000, shown, header.flags)

    def read_ring(self) -> tuple[list[Observation], int]:
        """Return the latches that were not read before, oldest first, as far as the ring has them.

        And the number of those that it has not.
        """
        found, first = list[Observation](), self._next_in_ring
        while True:
            reply = self._link.request(
                messages.ReadTrace(self._next_in_ring, _RING_READ), messages.TraceReply
            )
            near_ns = self._link.now_ns() - _HALF_TURN_NS
            found += [
                self._latch(record.key, record.t_latch_us, near_ns, record.crc, record.flags)
                for record in reply.records
            ]
            if not reply.records or reply.records[-1].number < self._next_in_ring:
                break
            self._next_in_ring = reply.records[-1].number + 1
            if self._next_in_ring >= reply.next:
                break
        return found, max(0, self._next_in_ring - first - len(found))

    def read_drive(self, kind: messages.DriveKind) -> Observation:
        """Return the drive at the transducers now, latched or radiated.

        Raises
        ------
        DeviceError
            The board cannot read it back, or nothing was latched.
        WrongProtocolError
            Every reading was overtaken by another latch.
        """
        for _ in range(_READ_TRIES):
            replies = request_parts(
                self._link,
                self._transducers,
                functools.partial(messages.ReadDrive, kind),
                messages.DriveReply,
                lambda part: len(part.data) // 2,
            )
            if len({(reply.key, reply.t_latch_us) for reply in replies}) == 1:
                halves = [(r.data[: len(r.data) // 2], r.data[len(r.data) // 2 :]) for r in replies]
                data = b"".join(b"".join(part) for part in zip(*halves, strict=True))
                key, t_us = replies[0].key, replies[0].t_latch_us  # a read-back tells no lateness
                return self._latch(key, t_us, self._link.now_ns() - _HALF_TURN_NS, data)
        raise WrongProtocolError(
            f"{self._link.url}: the drive changed during each of {_READ_TRIES} read-backs"
        )

    def _latch(
        self, key: messages.LatchKey, wire_us: int, near_ns: int, shown: bytes | int, flags: int = 0
    ) -> Observation:
        """Return the observation of a latch, with the drive or the CRC-32 that was traced."""
        drive = self._drive(shown) if isinstance(shown, bytes) else None
        crc = shown if isinstance(shown, int) else None
        return Observation(
            key=FrameKey(self._link.connection.session, key.sequence, key.loop, key.index),
            t_latch_us=messages.unwrap(wire_us, self._clock.to_device_us(near_ns), 32),
            late=bool(flags & messages.Flag.LATE),
            evidence=Evidence.SELF_REPORTED,
            drive=drive,
            drive_crc=drive.digest() if drive is not None else crc,
        )

    def _drive(self, data: bytes) -> Drive:
        """Return the drive of N phase codes and N amplitude codes, or raise."""
        codes = np.frombuffer(data, dtype=np.uint8)
        count = len(codes) // 2
        if count != self._transducers:
            raise WrongProtocolError(
                f"a drive of {count} transducers; the board has {self._transducers}"
            )
        try:
            return Drive(codes[:count], codes[count:])
        except ConfigurationError as error:
            raise WrongProtocolError(f"a drive that cannot be: {error}") from error

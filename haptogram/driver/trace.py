"""The latches that a board reports: trace events, trace ring and read-back.

All of it is the firmware's own word, and marked so (:attr:`Evidence.SELF_REPORTED`).
"""

from __future__ import annotations

import numpy as np

from haptogram.acoustics import Drive
from haptogram.driver.line.link import Link
from haptogram.driver.timing.clock import ClockEstimate
from haptogram.errors import ConfigurationError, WrongProtocolError
from haptogram.records.frame import Evidence, FrameKey, Observation
from haptogram_protocol import messages
from haptogram_protocol.connection import EventReceived

_READ_TRIES = 3  # of a drive that is replaced while it is read
_RING_READ = 0xFFFF  # latches asked for at a time; the board sends as many as fit


class DriverTraceReader:
    """Turns the reports of the board into observations.

    Parameters
    ----------
    session : int
        For the keys.
    transducers : int
        Length of a drive.
    clock : ClockEstimate
        Unwraps the times.
    """

    def __init__(self, session: int, transducers: int, clock: ClockEstimate) -> None:
        self._session = session
        self._transducers = transducers
        self._clock = clock
        self._next_in_ring = 0

    def take(self, event: EventReceived) -> Observation | None:
        """Return the latch that *event* reports, None if it reports something else."""
        message = event.message
        if isinstance(message, messages.Trace):
            key, drive, crc = messages.LatchKey(0, 0, message.index), None, message.crc
        elif isinstance(message, messages.TracePlayback):
            key, drive, crc = message.key, None, message.crc
        elif isinstance(message, messages.TraceDrive):
            drive = self._drive(message.data)
            key, crc = message.key, drive.digest()
        else:
            return None
        return Observation(
            key=self._key(key),
            t_latch_us=self._unwrap(event.header.time_us, event.t_rx_us * 1000),
            late=bool(event.header.flags & messages.Flag.LATE),
            evidence=Evidence.SELF_REPORTED,
            drive=drive,
            drive_crc=crc,
        )

    def read_ring(self, link: Link) -> list[Observation]:
        """Return the latches in the board's ring that were not read before, oldest first."""
        found: list[Observation] = []
        while True:
            reply = link.request(
                messages.ReadTrace(self._next_in_ring, _RING_READ), messages.TraceReply
            )
            now_ns = link.now_ns()
            found += [self._observation(record, now_ns) for record in reply.records]
            if not reply.records or reply.records[-1].number < self._next_in_ring:
                return found
            self._next_in_ring = reply.records[-1].number + 1
            if self._next_in_ring >= reply.next:
                return found

    def read_drive(self, link: Link, kind: messages.DriveKind) -> Observation:
        """Return the drive at the transducers now, latched or radiated.

        Raises
        ------
        DeviceError
            The board cannot read it back, or nothing was latched.
        WrongProtocolError
            Every reading was overtaken by another latch.
        """
        for _ in range(_READ_TRIES):
            replies = self._read_parts(link, kind)
            if len({(reply.key, reply.t_latch_us) for reply in replies}) == 1:
                return self._joined(replies, link.now_ns())
        raise WrongProtocolError(
            f"{link.url}: the drive changed during each of {_READ_TRIES} read-backs"
        )

    def _read_parts(self, link: Link, kind: messages.DriveKind) -> list[messages.DriveReply]:
        replies: list[messages.DriveReply] = []
        first = 0
        while first < self._transducers:
            reply = link.request(
                messages.ReadDrive(kind, first, self._transducers - first), messages.DriveReply
            )
            if reply.first != first or not reply.data:
                raise WrongProtocolError(
                    f"{link.url}: READ_DRIVE from {first} gave {len(reply.data) // 2} transducers "
                    f"from {reply.first}"
                )
            replies.append(reply)
            first += len(reply.data) // 2
        return replies

    def _joined(self, replies: list[messages.DriveReply], now_ns: int) -> Observation:
        """Join READ_DRIVE replies into one observation."""
        halves = [(r.data[: len(r.data) // 2], r.data[len(r.data) // 2 :]) for r in replies]
        data = b"".join(phases for phases, _ in halves) + b"".join(levels for _, levels in halves)
        drive = self._drive(data)
        return Observation(
            key=self._key(replies[0].key),
            t_latch_us=self._unwrap(replies[0].t_latch_us, now_ns),
            late=False,  # a read-back does not say
            evidence=Evidence.SELF_REPORTED,
            drive=drive,
            drive_crc=drive.digest(),
        )

    def _observation(self, record: messages.TraceRecord, now_ns: int) -> Observation:
        return Observation(
            key=self._key(record.key),
            t_latch_us=self._unwrap(record.t_latch_us, now_ns),
            late=bool(record.flags & messages.Flag.LATE),
            evidence=Evidence.SELF_REPORTED,
            drive_crc=record.crc,
        )

    def _key(self, key: messages.LatchKey) -> FrameKey:
        return FrameKey(self._session, key.sequence, key.loop, key.index)

    def _unwrap(self, wire_us: int, near_ns: int) -> int:
        """Extend a 32-bit device time by the current clock."""
        return messages.unwrap(wire_us, self._clock.to_device_us(near_ns), 32)

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

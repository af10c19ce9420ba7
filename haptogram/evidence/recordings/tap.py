"""Ports whose bytes are recorded on their way: for every command that opens one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from haptogram.driver.line.port import Transport

from .writer import RecordingWriter

_PAUSE_NS: Final = 1_000_000  # time from the last byte of a board to the beginning of the next


class RecordingTransport:
    """Writes down what passes through another transport.

    Parameters
    ----------
    transport : Transport
        An open port; is closed with this one.
    writer : RecordingWriter
        Is not closed with it.
    records : callable, optional
        Returns the records of the board's back door so far, where this program has them.
    offset_ns : int
        Added to the times of the port, so that several boards follow one another in one recording.
    begins : bool
        Whether the run has begun as soon as the board answers.

    Attributes
    ----------
    url : str
        Name of the port.
    last_ns : int
        Time of the last entry.
    """

    def __init__(
        self,
        transport: Transport,
        writer: RecordingWriter,
        records: Callable[[], Sequence[Mapping[str, Any]]] | None = None,
        *,
        offset_ns: int = 0,
        begins: bool = False,
    ) -> None:
        self.url = transport.url
        self.now_ns = transport.now_ns  # the very method: a driver calls it a dozen times a frame
        self.last_ns = transport.now_ns() + offset_ns
        self._transport, self._writer = transport, writer
        self._records, self._written = records, 0
        self._offset_ns, self._begins = offset_ns, begins

    def read_available(self, deadline_ns: int) -> bytes:
        """Return received bytes, written down."""
        data = self._transport.read_available(deadline_ns)
        if data:
            self.last_ns = self.now_ns() + self._offset_ns
            self._writer.to_host(self.last_ns, data)
            if self._begins:
                self._writer.begin()
        if self._records is not None:
            self.tell(self._records())
        return data

    def write_some(self, data: bytes) -> int:
        """Hand over bytes; those that the port took are written down."""
        written = self._transport.write_some(data)
        if written:
            self.last_ns = self.now_ns() + self._offset_ns
            self._writer.to_board(self.last_ns, bytes(data[:written]))
        return written

    def tell(self, records: Sequence[Mapping[str, Any]]) -> None:
        """Write the records of a back door that were not written before."""
        while self._written < len(records):
            self._written += 1  # before: an interrupt is heard when the record is written
            self._writer.record(records[self._written - 1])

    def hardware_fault(self) -> None:
        """Write that the hardware of the board is made to fail now."""
        self._writer.hardware_fault(self.now_ns() + self._offset_ns)

    def close(self) -> None:
        """Close the port."""
        self._transport.close()
        if self._records is not None:
            self.tell(self._records())


class RecordedBoards:
    """Writes one board after another into a recording, each after the last one in time.

    Parameters
    ----------
    writer : RecordingWriter
        The recording.
    """

    def __init__(self, writer: RecordingWriter) -> None:
        self._writer = writer
        self._last: RecordingTransport | None = None

    def __call__(
        self,
        transport: Transport,
        board: Mapping[str, Any] | None = None,
        records: Callable[[], Sequence[Mapping[str, Any]]] | None = None,
        *,
        just_powered: bool = False,
    ) -> Transport:
        """Return an open port, written down.

        Parameters
        ----------
        board : mapping, optional
            Options of a virtual board.
        records : callable, optional
            Returns the records of its back door so far.
        just_powered : bool
            Whether the board was powered up at this moment of the port's clock.
        """
        now_ns = transport.now_ns()
        least_ns = 0 if self._last is None else self._last.last_ns + _PAUSE_NS
        offset_ns = least_ns - now_ns  # a recording begins at 0
        boot_ns = now_ns + offset_ns if just_powered else None
        self._writer.opened(now_ns + offset_ns, board, boot_ns, paced=board is not None)
        self._last = RecordingTransport(
            transport, self._writer, records, offset_ns=offset_ns, begins=True
        )
        return self._last

    def hardware_fault(self) -> None:
        """Write that the hardware of the board that is open is made to fail now."""
        if self._last is not None:
            self._last.hardware_fault()

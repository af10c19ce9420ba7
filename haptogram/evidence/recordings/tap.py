"""A port whose bytes are recorded on their way: for every command that opens one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from haptogram.driver.line.port import Transport

from .writer import RecordingWriter


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
    ) -> None:
        self.url = transport.url
        self.now_ns = transport.now_ns  # the very method: a driver calls it a dozen times a frame
        self.last_ns = transport.now_ns() + offset_ns
        self._transport, self._writer = transport, writer
        self._records, self._told = records, 0
        self._offset_ns = offset_ns

    def read_available(self, deadline_ns: int) -> bytes:
        """Return received bytes, written down."""
        data = self._transport.read_available(deadline_ns)
        if data:
            self.last_ns = self.now_ns() + self._offset_ns
            self._writer.to_host(self.last_ns, data)
        if self._records is not None:
            self.tell_records()
        return data

    def write_some(self, data: bytes) -> int:
        """Hand over bytes; those that the port took are written down."""
        written = self._transport.write_some(data)
        if written:
            self.last_ns = self.now_ns() + self._offset_ns
            self._writer.to_board(self.last_ns, bytes(data[:written]))
        return written

    def tell_records(self) -> None:
        """Write the records of the back door that are new."""
        records = () if self._records is None else self._records()
        while self._told < len(records):
            self._writer.record(records[self._told])
            self._told += 1

    def close(self) -> None:
        """Close the port."""
        self._transport.close()
        self.tell_records()

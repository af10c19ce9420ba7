"""An open port to boards that speak another wire: operations as bytes, and the answers to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from haptogram.driver.line.budget import LineBudget
from haptogram.driver.line.port import ClosedTransport, Transport
from haptogram.errors import DeviceError, LinkLostError, NoAnswerError
from haptogram_protocol.dialects.codec import Dialect, Display, Operation, Reply

_NS_PER_S: Final = 1_000_000_000
_RETRY_NS: Final = 1_000_000  # how soon a port that took nothing, or a board, is asked again
_REFUSED: Final = 0  # error code of every refusal: these boards say why in words


class DialectLine:
    """The host's end of a line.

    Parameters
    ----------
    transport : Transport
        Open port; the line closes it.
    dialect : Dialect
        Its wire.
    display : Display
        The boards on it.
    baudrate : int or None
        Rate of the line; None: it has none.
    timeout_s : float
        How long the port may refuse to take a byte, and a board to answer.
    """

    def __init__(
        self,
        transport: Transport,
        dialect: Dialect,
        display: Display,
        *,
        baudrate: int | None,
        timeout_s: float,
    ) -> None:
        self._transport, self._display = transport, display
        self._host = dialect.host(**display.options)
        # What left the host is read back from its bytes, as a board would read it.
        self._as_board = dialect.board(**display.options)
        self._line = None if baudrate is None else LineBudget(baudrate)
        self._timeout_ns = round(timeout_s * _NS_PER_S)
        self._replies: list[Reply] = []
        self._unwritten = b""  # of a frame that was cut off: the next one comes after its rest

    @property
    def url(self) -> str:
        """Name of the port."""
        return self._transport.url

    def now_ns(self) -> int:
        """Return the time on the clock of the port."""
        return self._transport.now_ns()

    @property
    def free_ns(self) -> int:
        """When the last byte has left the line."""
        return self.now_ns() if self._line is None else max(self._line.free_ns, self.now_ns())

    def run_until(self, t_ns: int) -> None:
        """Take what the boards send until *t_ns*."""
        while self.now_ns() < t_ns:
            self._take(t_ns)

    def send(self, operations: Sequence[Operation]) -> list[int | None] | None:
        """Send *operations*, and return the codes that their bytes show; None: no whole frame.

        Raises
        ------
        LinkLostError
            The port is gone, or takes no byte.
        NoAnswerError, DeviceError
            A board did not answer in time, or refused.
        """
        self._replies.clear()
        seen = self._send(operations)
        deadline_ns = self.now_ns() + self._timeout_ns
        while again := self._display.unfinished(self._replies):
            self._check_time(deadline_ns, again[0])
            self.run_until(self.now_ns() + _RETRY_NS)
            self._send(again)
        return self._display.read(seen)

    def close(self) -> None:
        """Close the port; never raises."""
        self._transport.close()
        self._transport = ClosedTransport(self._transport)

    def _send(self, operations: Sequence[Operation]) -> list[Operation]:
        """Send *operations*, waiting for each reply; return those that a board decodes."""
        data, seen = b"", list[Operation]()
        for number, operation in enumerate(operations, 1):
            data += self._host.send(operation)
            if self._host.due or number == len(operations):
                self._write(data)
                seen += self._as_board.receive_data(data)
                self._wait_for_answer(operation)
                data = b""
        return seen

    def _wait_for_answer(self, operation: Operation) -> None:
        """Read until every due reply has arrived; raise NoAnswerError after the timeout.

        The error names *operation*, the last one sent.
        """
        deadline_ns = self.now_ns() + self._timeout_ns
        while self._host.due:
            self._check_time(deadline_ns, operation)
            self._take(deadline_ns)

    def _wait_for_room(self, size: int) -> None:
        """Wait until at most *size* unsent bytes are queued; at once if the rate is unknown."""
        if self._line is not None and self._line.unsent_bytes(self.now_ns()) > size:
            self.run_until(self._line.room_at_ns(size))

    def _write(self, data: bytes) -> None:
        """Write all bytes at the pace of the line; raise if the port takes none for the timeout."""
        self._wait_for_room(len(data))
        if self._line is not None:
            self._line.add(len(data), self.now_ns())
        deadline_ns = self.now_ns() + self._timeout_ns
        self._unwritten += data
        while self._unwritten:
            if taken := self._transport.write_some(self._unwritten):
                self._unwritten = self._unwritten[taken:]
                deadline_ns = self.now_ns() + self._timeout_ns
                continue
            if self.now_ns() >= deadline_ns:
                raise LinkLostError(
                    f"{self.url}: the port has taken no byte for {self._timeout_ns / _NS_PER_S:g} s"
                )
            self.run_until(self.now_ns() + _RETRY_NS)

    def _take(self, deadline_ns: int) -> None:
        """Read replies until the deadline; raise DeviceError if the board refuses an operation."""
        data = self._transport.read_available(deadline_ns)
        for reply in self._host.receive_data(data) if data else []:
            self._replies.append(reply)
            if (why := reply.refusal) is not None:
                raise DeviceError(f"{self.url}: the board refused: {why}", code=_REFUSED)

    def _check_time(self, deadline_ns: int, operation: Operation) -> None:
        """Raise NoAnswerError, naming *operation*, once the deadline for an answer has passed."""
        if self.now_ns() >= deadline_ns:
            raise NoAnswerError(
                f"{self.url}: no answer to {type(operation).__name__} within "
                f"{self._timeout_ns / _NS_PER_S:g} s"
            )

"""The host's end of a line of FPGA boards."""

from __future__ import annotations

from typing import Final

from ...errors import LocalProtocolError
from ..codec import OneWayHostEnd, Operation, no_dialect_bytes_for
from .cursor import FpgaChannelCursor
from .operations import SetAmplitudes, SetPhases
from .rules import FpgaByteRules


class FpgaHostEnd(OneWayHostEnd):
    """The host's end of the line: the bytes of operations, and boards that never answer.

    Parameters
    ----------
    rules : FpgaByteRules
        Meaning of the bytes.
    boards : int
        Boards on the line.
    """

    def __init__(self, rules: FpgaByteRules, boards: int = 1) -> None:
        super().__init__()
        self._rules = rules
        self._cursor = FpgaChannelCursor(boards)
        self._bytes: Final = {operation: byte for byte, operation in rules.commands.items()}

    def send(self, message: Operation) -> bytes:
        """Return the bytes of *message*.

        Raises
        ------
        LocalProtocolError
            If codes are out of range or would not reach the boards and channels that they name.
        """
        if isinstance(message, SetPhases | SetAmplitudes):
            self._check(message)
            self._cursor.advance_to(self._cursor.at + len(message.codes))
            return message.codes
        if message not in self._bytes:
            raise no_dialect_bytes_for(message, self._rules.wire)
        self._cursor.command(message)
        return bytes([self._bytes[message]])

    def _check(self, message: SetPhases | SetAmplitudes) -> None:
        cursor, rules = self._cursor, self._rules
        limit = rules.limit(type(message))
        if message.codes and max(message.codes) > limit:
            raise LocalProtocolError(
                f"code {max(message.codes)} for {rules.wire}; the largest one is {limit}"
            )
        if type(message) is not cursor.kind or message.boards != cursor.listening:
            raise LocalProtocolError(
                f"{type(message).__name__} for boards {message.boards}; on the line boards "
                f"{cursor.listening} listen for {cursor.kind.__name__}: select and begin first"
            )
        if message.first != cursor.at % rules.channels or len(message.codes) > (
            rules.channels - message.first
        ):
            raise LocalProtocolError(
                f"{len(message.codes)} codes from channel {message.first} on; the boards write "
                f"channel {cursor.at % rules.channels} next and have {rules.channels} channels"
            )

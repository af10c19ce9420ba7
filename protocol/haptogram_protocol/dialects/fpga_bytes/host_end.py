"""The host's end of a line of FPGA boards, and the frames of codes that show phases on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from ...errors import LocalProtocolError
from ..codec import Codes, Display, OneWayHostEnd, Operation, no_dialect_bytes_for
from .cursor import FpgaChannelCursor
from .operations import Begin, FpgaByteRules, Select, SetAmplitudes, SetPhases, Swap


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
        """Raise LocalProtocolError for codes above the limit, or out of turn on the line.

        Out of turn are another kind, boards that do not listen, or a channel that is not the next.
        """
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


class FpgaDisplay(Display):
    """Codes for one board, or for several that are selected one after the other.

    Parameters
    ----------
    rules : FpgaByteRules
        What bytes mean.
    steps : int
        Steps of a period.
    boards : int
        Boards on the line.

    Raises
    ------
    LocalProtocolError
        If the wire cannot select so many.
    """

    def __init__(self, rules: FpgaByteRules, steps: int, boards: int = 1) -> None:
        super().__init__(boards * rules.channels, steps)
        self._rules, self._boards = rules, boards
        self._selects = boards > 1 or not rules.starts
        if self._selects and Select(boards - 1) not in rules.commands.values():
            raise LocalProtocolError(f"{rules.wire} cannot select {boards} boards")
        self.options = {"boards": boards} if self._selects else {}

    def frame(self, codes: Codes) -> list[Operation]:
        """Return the codes of each board, and the swap that shows all of them."""
        size, off = self._rules.channels, self._rules.off
        wire = bytes(off if code is None else code for code in codes)
        made: list[Operation] = [Begin()] if self._rules.starts else []
        for board in range(self._boards):
            made += [Select(board)] if self._selects else []
            made.append(SetPhases((board,), 0, wire[board * size : (board + 1) * size]))
        return [*made, Swap()]

    def read(self, operations: Sequence[Operation]) -> list[int | None] | None:
        """Return the codes that the last swap shows."""
        size, written, shown = self._rules.channels, dict[int, int](), None
        for operation in operations:
            if isinstance(operation, SetPhases):
                for board in operation.boards:
                    first = board * size + operation.first
                    written |= dict(enumerate(operation.codes, first))
            elif isinstance(operation, Swap):
                shown, written = written, {}
        if shown is None or len(shown) < self.channels:
            return None
        codes = (shown[channel] for channel in range(self.channels))
        return [None if code == self._rules.off else code for code in codes]

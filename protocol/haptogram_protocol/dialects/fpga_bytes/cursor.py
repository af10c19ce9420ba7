"""The channels that the boards on a line of FPGAs write next."""

from __future__ import annotations

from ...errors import LocalProtocolError
from ..codec import Operation
from .operations import Begin, BeginAmplitudes, FpgaCodes, Select, SetAmplitudes, SetPhases, Swap


class FpgaChannelCursor:
    """The boards that listen, and the codes that each has taken since its channel 0.

    Parameters
    ----------
    boards : int
        Boards on the line.

    Attributes
    ----------
    listening : tuple of int
        Boards that take codes: all at power-up, and one or none after the first selection.
    written : list of int
        For each board the codes since its channel 0.
    kind : type
        Operation that codes belong to now.
    started : bool
        Whether a start came after the last swap.
    """

    def __init__(self, boards: int) -> None:
        if boards < 1:
            raise LocalProtocolError(f"{boards} boards; a wire has at least one")
        self.listening = tuple(range(boards))  # s_boardEnable is '1' at power-up
        self.written = [0] * boards
        self.kind: FpgaCodes = SetPhases
        self.started = False

    @property
    def at(self) -> int:
        """Codes that the listening boards have taken: all alike, for only power-up has several."""
        return self.written[self.listening[0]] if self.listening else 0

    def command(self, operation: Operation) -> None:
        """Follow *operation*."""
        kind = type(operation)
        if kind is Swap:
            self.written = [0] * len(self.written)
            self.kind, self.started = SetPhases, False
        elif isinstance(operation, Select):
            self.listening = (operation.board,) if operation.board < len(self.written) else ()
        elif (kind is Begin or kind is BeginAmplitudes) and self.listening:
            self.advance_to(0)
            self.kind = SetPhases if kind is Begin else SetAmplitudes
            self.started = True

    def advance_to(self, written: int) -> None:
        """Let the boards that listen have *written* codes."""
        for board in self.listening:
            self.written[board] = written

"""Phases on the FPGA boards of SonicSurface and Ultraino: a frame of codes, and the swap."""

from __future__ import annotations

from collections.abc import Sequence

from ...errors import LocalProtocolError
from ..codec import Codes, Display, Operation
from .operations import Begin, Select, SetPhases, Swap
from .rules import FpgaByteRules


class FpgaDisplay(Display):
    """Codes for one board, or for several that are selected one after the other.

    Parameters
    ----------
    rules : FpgaByteRules
        Meaning of the bytes.
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

"""The FPGA boards of SonicSurface and Ultraino: two buffers of codes that change places."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.model.pulses import PulseDrive
from haptogram_protocol.dialects.fpga_bytes import operations
from haptogram_protocol.dialects.fpga_bytes.operations import FpgaByteRules

from ..board.events import Modulation, PulseLatch
from .unit import LatchingUnit

POWER_UP: Final = "power-up"
_OUTPUTS: Final = 8  # outputs of a shift register
_LAST_OUTPUT: Final = 3  # the channel, modulo 8, whose bit is shifted last


@dataclass(frozen=True)
class Registers:
    """Registers that a firmware fills from codes.

    Attributes
    ----------
    rules : FpgaByteRules
        The bytes of its wire: channels, and the code that is off.
    steps : int
        Steps of the carrier that the outputs really have.
    width : int
        Steps for which a channel is high without an amplitude of its own.
    at_power_up : int
        Code in the buffer that radiates at power-up; the other one holds 0.
    correction : bytes
        Added to the code of each channel, modulo :attr:`FpgaByteRules.off`, if it is not off.
    modulation : callable or None
        From a :class:`ModulationStep` to the modulation that all channels have.
    late : bool
        Whether the last bit of each shift register comes one step late: channels n mod 8 = 3.
    """

    rules: FpgaByteRules
    steps: int
    width: int
    at_power_up: int = 0
    correction: bytes = b""
    modulation: Callable[[int], Modulation] | None = None
    late: bool = False


class DoubleBuffer(LatchingUnit):
    """All boards on a line, each with two buffers; see :class:`~.unit.Unit`.

    Codes go to the buffer that does not radiate. A swap exchanges the two, so that a second one
    brings the previous codes back. ``s_phaseCurrent`` and ``s_phasePrev`` of ``PhaseLine.vhd``,
    upnalab/SonicSurface 0c7b689.

    Parameters
    ----------
    registers : Registers
        The firmware.
    boards : int
        Boards on the line.
    now_us : int
        Device time at power-up.
    modulation_step : int
        Step of the modulation at power-up.

    Attributes
    ----------
    counters : Counter
        ``commits_of_old_codes``: swaps without a code since the swap before, so that the codes of
        the frame before that return.
    """

    def __init__(
        self, registers: Registers, boards: int, now_us: int, modulation_step: int = 0
    ) -> None:
        super().__init__()
        self._registers = registers
        shape = boards, registers.rules.channels
        self._shown = np.full(shape, registers.at_power_up, np.uint16)
        self._next = np.zeros(shape, np.uint16)
        full = registers.width
        self._shown_widths, self._next_widths = np.full(shape, full), np.full(shape, full)
        self._written = False
        self._clocked = True
        self._step = modulation_step
        self._handlers = {  # starts and selections are the codec's
            operations.Begin: self._begin,
            operations.SetPhases: self._set_phases,
            operations.SetAmplitudes: self._set_amplitudes,
            operations.Swap: self._swap,
            operations.Clocks: self._set_clocks,
            operations.ModulationStep: self._set_modulation,
        }
        self._latch(POWER_UP, now_us)

    def _begin(self, _: operations.Begin, __: int) -> None:
        """Reset the next frame to full amplitude on all channels."""
        self._next_widths[:] = self._registers.width

    def _set_phases(self, operation: operations.SetPhases, _: int) -> None:
        """Write phase codes, plus the board's correction, to the hidden buffer of each board."""
        codes = np.frombuffer(operation.codes, np.uint8).astype(np.uint16)
        place = slice(operation.first, operation.first + len(codes))
        if self._registers.correction:
            added = np.frombuffer(self._registers.correction, np.uint8)[place]
            off = self._registers.rules.off
            codes = np.where(codes == off, off, (codes + added) % off)
        for board in operation.boards:
            self._next[board, place] = codes
        self._written = True

    def _set_amplitudes(self, operation: operations.SetAmplitudes, _: int) -> None:
        """Write pulse widths to the hidden buffer of each board."""
        widths = np.frombuffer(operation.codes, np.uint8)
        place = slice(operation.first, operation.first + len(widths))
        for board in operation.boards:
            self._next_widths[board, place] = np.minimum(widths, self._registers.steps)
        self._written = True

    def _swap(self, _: operations.Swap, t_us: int) -> None:
        """Show the codes that were written, write to those shown before, and latch."""
        if not self._written:
            self.counters["commits_of_old_codes"] += 1
        self._shown, self._next = self._next, self._shown
        self._shown_widths, self._next_widths = self._next_widths, self._shown_widths
        self._written = False
        self._latch("swap", t_us)

    def _set_clocks(self, operation: operations.Clocks, t_us: int) -> None:
        """Let the clocks of all outputs run or stand still; record a latch if that is a change."""
        if operation.on != self._clocked:
            self._clocked = operation.on
            self._latch("clocks on" if operation.on else "clocks off", t_us)

    def _set_modulation(self, operation: operations.ModulationStep, t_us: int) -> None:
        """Set the step of the modulation, and latch if that changes it."""
        if operation.step != self._step:
            self._step = operation.step
            self._latch("modulation", t_us)

    def _latch(self, cause: str, t_us: int) -> None:
        """Append a latch of the shown pulses, with its *cause*, at *t_us*."""
        make = self._registers.modulation
        modulation = None if make is None else make(self._step)
        self._latches.append(PulseLatch(t_us, self._pulses(), cause, modulation=modulation))

    def _pulses(self) -> PulseDrive:
        """Return the pulses that the outputs have now."""
        registers = self._registers
        codes, widths = self._shown.ravel(), self._shown_widths.ravel()
        if not self._clocked:  # the shift registers stand still, and so do their outputs
            return PulseDrive.off(len(codes), registers.steps)
        off = registers.rules.off
        late = (np.arange(len(codes)) % _OUTPUTS == _LAST_OUTPUT) & registers.late
        rises = (codes * registers.steps // off + late) % registers.steps
        return PulseDrive(
            _buffered_values_where_on(codes, rises, off),
            _buffered_values_where_on(codes, widths.astype(np.uint16), off),
            registers.steps,
        )


def _buffered_values_where_on(
    codes: NDArray[np.uint16], values: NDArray[np.uint16], off: int
) -> NDArray[np.uint16]:
    """Return *values* (C,), but 0 where the code in *codes* (C,) is *off*."""
    return np.where(codes == off, 0, values).astype(np.uint16)

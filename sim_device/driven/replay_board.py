"""A virtual board that is fed recorded bytes, in virtual time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

from haptogram.records.latch import LatchRecord
from haptogram.settings.board import BoardConfig

from ..backdoor.recorder import InlineReconstructionWorker
from ..blueprint import blueprint_of
from ..simulation import Simulation

Seen: TypeAlias = LatchRecord | Mapping[str, Any]


class VirtualReplayBoard:
    """A board from its power-up on; times are nanoseconds since then.

    Parameters
    ----------
    config : BoardConfig
        The board.
    paced : bool, keyword-only
        Whether a simulated line carries the bytes.
    """

    def __init__(self, config: BoardConfig, *, paced: bool) -> None:
        blueprint = blueprint_of(config)
        self._seen: list[Seen] = []
        recorder = InlineReconstructionWorker(
            blueprint.settings,
            lambda record: self._seen.append(record),
            reconstruct=False,
            direct=lambda latch: self._seen.append(latch),
        )
        self._seen.clear()  # of the record of the board itself
        parts, faults = blueprint.parts, blueprint.faults
        self._simulation = Simulation(
            blueprint.settings, recorder, paced=paced, parts=parts, faults=faults
        )
        self.boot_us = blueprint.settings.boot_us

    def write(self, t_ns: int, data: bytes, waited_ns: int) -> None:
        """Put bytes on the line.

        See :class:`haptogram.evidence.recordings.replay.RecordingReplayBoard`.
        """
        simulation = self._simulation
        t_ns = max(t_ns, simulation.now_ns)
        taken = simulation.host_write(data, t_ns, waited_ns=waited_ns)
        while taken < len(data):
            next_ns = simulation.next_event_ns()
            if next_ns is None:
                return  # a line that is full for good takes no more of a host either
            taken += simulation.host_write(data[taken:], next_ns)
        simulation.advance_to(simulation.now_ns)

    def read(self, t_ns: int) -> bytes:
        """Return the bytes that have come up to *t_ns*."""
        self._simulation.advance_to(max(t_ns, self._simulation.now_ns))
        return self._simulation.host_read()

    def unplug(self, t_ns: int) -> None:
        """Lose what is on the line."""
        self._simulation.advance_to(max(t_ns, self._simulation.now_ns))
        self._simulation.unplug()

    def raise_hardware_fault(self, t_ns: int) -> None:
        """Let the hardware of the board fail."""
        self._simulation.advance_to(max(t_ns, self._simulation.now_ns))
        self._simulation.raise_hardware_fault()

    def take_records(self) -> list[Seen]:
        """Return latches and other records since the last call."""
        taken, self._seen = self._seen, []
        return taken

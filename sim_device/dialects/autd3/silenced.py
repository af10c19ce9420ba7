"""Devices whose silencers move phases and intensities, instead of letting them jump.

A latch whose cause is ``silencer`` is on its way; that of the operation, the index or the step of
the modulation comes when everything has arrived.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram_protocol.dialects.autd3.messages import Write
from haptogram_protocol.dialects.autd3.operations import CHANNELS
from haptogram_protocol.dialects.codec import Operation, Reply

from ...board.events import PulseLatch
from .device import Output
from .drive import FULL, autd3_pulses_of
from .silencer import Silencer
from .unit import Autd3Unit

ON_THE_WAY: Final = "silencer"


class Autd3SilencedUnit(Autd3Unit):
    """Devices with silencers; parameters are those of :class:`~.unit.Autd3Unit`."""

    def __init__(self, now_us: int, **options: Any) -> None:
        self._silencers = [Silencer(CHANNELS) for _ in range(options.get("devices", 1))]
        self._aims: list[Output] = []
        self._targets: list[tuple[NDArray[np.uint8], NDArray[np.uint8]]] = []
        self._moved: int | None = None  # last period whose step is made
        self._due: str | None = None  # cause of the latch when all have arrived
        super().__init__(now_us, **options)

    def take(self, operation: Operation, t_us: int) -> list[Reply]:
        """Do what the client asks; what was out until then has moved on."""
        self.advance_to(t_us)
        if isinstance(operation, Write):
            self._move_to(self._period_at(t_us))
        return super().take(operation, t_us)

    def next_event_us(self) -> int | None:
        """Return when a latch may be due: of an operation, of a change, or of an arrival."""
        waits = [wait for wait in (self._asked, self._changes) if wait is not None]
        return self._start_us(min(waits)) if waits else None

    def _look(self, period: int, cause: str | None = None) -> None:
        """Update the targets in *period*, and latch the next step towards them."""
        if self._asked is not None and self._asked <= period:
            self._asked = None
        self._move_to(period)
        cause = cause or self._cause(self._aims)
        self._outputs = self._aims
        self._due = cause or self._due
        left = self._periods_left()
        if self._due is not None and (left == 0 or cause == "power-up"):
            self._latch_now(period, self._due)
            self._due = None
        elif left != 0:
            self._latch_now(period, ON_THE_WAY)
        own = [device.next_change(period) for device in self._devices]
        changes = [max(change, self._free) for change in own if change is not None]
        if left is None or left > 0:
            changes.append(period + (self._gap if left is None else min(self._gap, left)))
        self._changes = min(changes, default=None)

    def _move_to(self, period: int) -> None:
        """Advance the silencer to *period*."""
        at = period if self._moved is None else self._moved + 1
        while at <= period:
            self._aim([device.output(at) for device in self._devices])
            own = [device.next_change(at) for device in self._devices]
            change = min((one for one in own if one is not None), default=period + 1)
            end = min(period + 1, change)
            for device, silencer, target in zip(
                self._devices, self._silencers, self._targets, strict=True
            ):
                silencer.move(*target, end - at, device.pace)
            at = end
        self._moved = max(period, period if self._moved is None else self._moved)

    def _aim(self, outputs: list[Output]) -> None:
        """Set the target phases and levels of the silencer."""
        if outputs == self._aims:
            return
        self._aims, self._targets = outputs, []
        for output in outputs:
            phases, intensities = output.patterns.drive(output.index)
            levels = intensities.astype(np.int64) * output.modulation // FULL
            self._targets.append((phases, levels.astype(np.uint8)))

    def _periods_left(self) -> int | None:
        left = [
            silencer.periods_left(device.pace)
            for device, silencer in zip(self._devices, self._silencers, strict=True)
        ]
        return None if None in left else max(n for n in left if n is not None)

    def _latch_now(self, period: int, cause: str) -> None:
        phases = np.concatenate([silencer.phases for silencer in self._silencers])
        intensities = np.concatenate([silencer.intensities for silencer in self._silencers])
        pulses = autd3_pulses_of(phases, intensities, np.full(len(phases), FULL, np.uint8))
        if pulses == self._pulses and cause in ("index", "modulation", ON_THE_WAY):
            return
        self._pulses = pulses
        self._free = period + self._gap
        t_us = self._start_us(period)
        self._latches.append(PulseLatch(t_us, pulses, cause, self._aims[0].index))

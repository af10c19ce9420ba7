"""All devices of AUTD3 behind one link, on one clock.

A latch is made when an operation shows other patterns, and whenever the pulses change by
themselves: by the index of a sequence, by a step of the modulation, by a segment that starts or
ends. What changes by itself makes a latch every 250 µs at the most: 4 000 a second, the rate at
which autd3 samples a modulation unless it is told otherwise. Of faster changes the latch shows the
last. Samples that change nothing are looked at twice in 250 µs at the most.

The devices are synchronised from power-up on, so Sync changes nothing. What the client says of
poses changes nothing: foci come in the coordinates of each device.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.model.boards.grids import AUTD3 as ONE_DEVICE
from haptogram.acoustics.model.boards.grids import autd_row
from haptogram.acoustics.model.boards.layout import BoardLayout
from haptogram.acoustics.model.pulses import PulseDrive
from haptogram.settings.option import Settings, option
from haptogram_protocol.dialects.autd3 import link, messages
from haptogram_protocol.dialects.autd3.operations import CHANNELS
from haptogram_protocol.dialects.codec import Operation, Reply

from ...board.events import PulseLatch
from ..emulation import Emulation
from ..unit import LatchingUnit
from .device import FULL, Autd3Device, Output
from .segments import PERIOD_NS

PERIODS_BETWEEN_LATCHES: Final = 10
MAX_KNOWN: Final = 1024  # most outputs whose pulses are kept
_NS_PER_US: Final = 1_000
PERIOD_US: Final = PERIOD_NS // _NS_PER_US
STEPS: Final = 512
MAX_DEVICES: Final = 4  # an array has 1024 elements at the most


@dataclass(frozen=True, kw_only=True)
class Devices(Settings):
    """Options of the dialect."""

    devices: int = option(
        1, unit="N", low=1, high=MAX_DEVICES, help="devices, 192 mm apart along x"
    )
    system_ns: int = option(
        0,
        unit="NS",
        low=0,
        high=2**63 - 1,
        help="system time at power-up, for clients that name times: since 2000-01-01 UTC",
    )
    latch_us: int = option(
        PERIODS_BETWEEN_LATCHES * PERIOD_US,
        unit="US",
        low=PERIOD_US,
        high=1_000_000,
        help="time between latches that sequences and modulation make by themselves",
    )


class Autd3Unit(LatchingUnit):
    """Devices that power up at *now_us*.

    Parameters
    ----------
    options : Devices
        How many there are: a client that opens another number is refused.  Times are rounded down
        to periods of 25 µs.
    now_us : int
        Device time of the power-up.

    Attributes
    ----------
    counters : Counter
        ``devices_differ``, ``operations_unknown``, and those of
        :class:`~sim_device.dialects.autd3.device.Autd3Device`.
    """

    def __init__(self, options: Devices, now_us: int) -> None:
        super().__init__()
        self._devices = [Autd3Device(self.counters) for _ in range(options.devices)]
        self._boot_us, self._boot_period = now_us, options.system_ns // PERIOD_NS
        self._gap = options.latch_us // PERIOD_US
        self._outputs: list[Output] = []
        self._pulses = PulseDrive.off(CHANNELS * options.devices, STEPS)
        self._known: dict[tuple[Output, ...], PulseDrive] = {}
        self._asked: int | None = None  # period in which what operations ask for takes effect
        self._changes: int | None = None  # period in which something changes by itself
        self._free = 0  # first period with a latch that no operation asked for
        self._idle = -self._gap  # period in which a change by itself last made no latch
        self._latch_if_changed(self._boot_period, "power-up")

    def take(self, operation: Operation, t_us: int) -> list[Reply]:
        """Do what the client asks; return the answer of the link."""
        self.advance_to(t_us)
        if isinstance(operation, messages.Hello | messages.Close):
            return [messages.Accepted()]
        if isinstance(operation, messages.Open | messages.Update):
            return [self._refuse_number(len(operation.devices)) or messages.Accepted()]
        if isinstance(operation, messages.Write):
            return [self._write(operation, t_us)]
        if isinstance(operation, messages.Read):
            return [messages.Autd3States(tuple(device.state for device in self._devices))]
        if isinstance(operation, messages.Undecodable):
            return [messages.Autd3Refused(operation.reason)]
        self.counters["operations_unknown"] += 1
        return []

    def next_event_us(self) -> int | None:
        """Return when the pulses next may change."""
        waits = [self._asked]
        if self._changes is not None:
            waits.append(max(self._changes, self._free))
        period = min((wait for wait in waits if wait is not None), default=None)
        return None if period is None else self._start_us(period)

    def advance_to(self, t_us: int) -> list[Reply]:
        """Let every change happen that is due up to *t_us*."""
        while (next_us := self.next_event_us()) is not None and next_us <= t_us:
            self._latch_if_changed(self._period_at(next_us))
        return []

    def _write(self, operation: messages.Write, t_us: int) -> Reply:
        """Give each device its frame; return a refusal unless there are as many frames."""
        if refused := self._refuse_number(len(operation.frames)):
            return refused
        now_ns = self._boot_period * PERIOD_NS + (t_us - self._boot_us) * _NS_PER_US
        for device, frame in zip(self._devices, operation.frames, strict=True):
            device.take(frame, now_ns)
        self._asked = self._period_at(t_us) + 1
        return messages.Accepted()

    def _refuse_number(self, asked: int) -> messages.Autd3Refused | None:
        """Return a refusal if *asked*, a number of devices, is not that of the board; else None."""
        if asked == len(self._devices):
            return None
        self.counters["devices_differ"] += 1
        return messages.Autd3Refused(
            f"{asked} devices are opened, this board has {len(self._devices)}"
        )

    def _latch_if_changed(self, period: int, cause: str | None = None) -> None:
        """Latch the outputs of the devices in carrier period *period*, if they have changed.

        They count as changed if *cause* is given; None: it is found out.
        """
        was_due = self._changes is not None and self._changes <= period
        if self._asked is not None and self._asked <= period:
            self._asked = None
        outputs = [device.output(period) for device in self._devices]
        cause = cause or self._cause(outputs)
        is_new = cause is not None and self._latch(outputs, period, cause)
        if was_due and not is_new:
            self._free, self._idle = max(self._free, self._idle + self._gap), period
        changes = [device.next_change(period) for device in self._devices]
        self._changes = min((change for change in changes if change is not None), default=None)

    def _cause(self, outputs: list[Output]) -> str | None:
        """Return why *outputs* differ from the last ones; None if they do not.

        It is the cause of new patterns, such as "gain", else "index" or "modulation".
        """
        pairs = list(zip(outputs, self._outputs, strict=True))
        for output, last in pairs:
            if output.patterns is not last.patterns:
                return output.patterns.cause
        if any(output.index != last.index for output, last in pairs):
            return "index"
        if any(output.modulation != last.modulation for output, last in pairs):
            return "modulation"
        return None

    def _latch(self, outputs: list[Output], period: int, cause: str) -> bool:
        """Latch *outputs* in carrier period *period*, with *cause*; return True.

        False, without a latch, if a step of index or modulation changes no pulse.
        """
        self._outputs = outputs
        pulses = self._pulses_of(tuple(outputs))
        if pulses == self._pulses and cause in ("index", "modulation"):
            return False
        self._pulses = pulses
        self._free = period + self._gap
        t_us = self._start_us(period)
        known = [output.patterns.phase_steps for output in outputs]
        steps = min((count for count in known if count is not None), default=None)
        latch = PulseLatch(t_us, pulses, cause, outputs[0].index, phase_steps=steps)
        self._latches.append(latch)
        return True

    def _pulses_of(self, outputs: tuple[Output, ...]) -> PulseDrive:
        """Return the pulses of all devices, cached by their outputs."""
        if outputs not in self._known:
            if len(self._known) >= MAX_KNOWN:
                self._known.clear()
            drives = [output.patterns.drive(output.index) for output in outputs]
            phases, intensities = zip(*drives, strict=True)
            levels = [np.full(CHANNELS, output.modulation, np.uint8) for output in outputs]
            self._known[outputs] = autd3_pulses_of(
                np.concatenate(phases), np.concatenate(intensities), np.concatenate(levels)
            )
        return self._known[outputs]

    def _period_at(self, t_us: int) -> int:
        """Return the number of the carrier period at a device time."""
        return self._boot_period + (t_us - self._boot_us) // PERIOD_US

    def _start_us(self, period: int) -> int:
        """Return the device time at which a carrier period starts."""
        return self._boot_us + (period - self._boot_period) * PERIOD_US


_WIDTHS: Final = np.array(
    [round(math.asin(intensity / FULL) / math.pi * STEPS) for intensity in range(FULL + 1)],
    dtype=np.int64,
)


def autd3_pulses_of(
    phases: NDArray[np.uint8], intensities: NDArray[np.uint8], modulation: NDArray[np.uint8]
) -> PulseDrive:
    """Return the pulses of (N,) channels, each symmetric around its phase.

    The FPGA computes 512 steps of a period from phases of 256. The width follows the intensity by
    an arcsine, so that the pressure is linear in it. Checked, all 249 channels, against
    ``pyautd3_emulator`` 38.0.1 (its phases, pulse widths and output voltage); the source is
    shinolab/autd3-firmware 03314c4, ``pwm_preconditioner.sv``. The table that PulseWidthEncoder
    would change, phase correction and output mask are not emulated.

    Parameters
    ----------
    phases : (N,) numpy.ndarray of uint8
        In 1/256 of a period.
    intensities, modulation : (N,) numpy.ndarray of uint8
        Their product over 255 is the intensity that is out.
    """
    widths = _WIDTHS[intensities.astype(np.int64) * modulation // FULL]
    rises = (2 * phases.astype(np.int64) - widths // 2) % STEPS
    return PulseDrive(np.where(widths > 0, rises, 0), widths, STEPS)


def _autd3_layout(options: Devices) -> BoardLayout:
    """Return the layout of one device, or of several in a row."""
    if options.devices == 1:
        return ONE_DEVICE
    return dataclasses.replace(
        ONE_DEVICE,
        name=f"autd3-{options.devices}",
        title=f"{options.devices} AUTD3 units in a row, first element of the first at the origin",
        array=lambda: autd_row(options.devices),
    )


AUTD3: Final = Emulation.of(
    link.AUTD3,
    Autd3Unit,
    layout=_autd3_layout,
    options=Devices,
    boards=lambda options: options.devices,
)
EMULATIONS: Final = (AUTD3,)

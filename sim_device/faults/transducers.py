"""The drive that each fault of transducers makes of the one that the board intends to radiate."""

from __future__ import annotations

import dataclasses
import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import Drive
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.model.drive import FULL_AMPLITUDE
from haptogram.errors import ConfigurationError
from haptogram.settings.faults.kinds import NOWHERE
from haptogram.settings.faults.plan import Fault

from ..board.events import AnyLatch, Latch
from ..board.settings import BoardSettings
from .line import Values

_CODES: Final = 256  # phase codes of a register


@dataclass(frozen=True, slots=True)
class FaultyPhasors:
    """Phases and amplitudes of all transducers.

    Attributes
    ----------
    turns : (N,) numpy.ndarray
        Lag in periods, 0 to 1; of what is silent as well.
    amplitudes : (N,) numpy.ndarray
        Share of the full amplitude.
    """

    turns: FloatArray
    amplitudes: FloatArray

    @classmethod
    def of_weights(cls, weights: ComplexArray) -> FaultyPhasors:
        """Return the phasors of complex weights."""
        return cls(np.angle(weights) / math.tau % 1.0, np.abs(weights))

    @classmethod
    def of_latch(cls, latch: AnyLatch) -> FaultyPhasors:
        """Return the phasors that *latch* radiates."""
        if isinstance(latch, Latch):
            drive = latch.radiated
            return cls(drive.phase_codes / _CODES, drive.amplitude_codes / FULL_AMPLITUDE)
        return cls.of_weights(latch.weights())

    def weights(self) -> ComplexArray:
        """Return the (N,) complex weights."""
        weights: ComplexArray = self.amplitudes * np.exp(1j * math.tau * self.turns)
        return weights

    def as_drive(self) -> Drive:
        """Return the drive in the 8 bits of the registers that is nearest."""
        phases = np.floor(self.turns * _CODES + 0.5) % _CODES
        amplitudes = np.floor(self.amplitudes * FULL_AMPLITUDE + 0.5)
        return Drive(phases.astype(np.uint8), amplitudes.astype(np.uint8))

    def on(self, latch: AnyLatch) -> AnyLatch:
        """Return *latch* as one that radiates this."""
        if isinstance(latch, Latch):
            return dataclasses.replace(latch, radiated=self.as_drive())
        return dataclasses.replace(latch, radiated=self.weights(), is_faulty=True)


BANK: Final = 64  # transducers that one driver chip feeds, one after the other


@dataclass(slots=True)
class FaultContext:
    """The latch that a fault acts on.

    Attributes
    ----------
    healthy : FaultyPhasors
        Drive without any fault.
    drive : FaultyPhasors
        Drive after the faults before this one.
    before : FaultyPhasors or None
        The previous drive without any fault.
    since_us : int
        Device time between the two.
    place : slice
        The faulty transducers.
    reached : (P,) complex numpy.ndarray or None
        Weights that slow transducers have reached: before the latch, and afterwards at its end.
    """

    healthy: FaultyPhasors
    drive: FaultyPhasors
    before: FaultyPhasors | None
    since_us: int
    place: slice
    reached: NDArray[np.complex128] | None = None


# Lag in periods and amplitude at the place: one for each transducer, or one for all of them.
_Shown: TypeAlias = tuple[FloatArray | float, FloatArray | float]
_Act: TypeAlias = Callable[[FaultContext, Values, random.Random], _Shown]


def _off_fault(now: FaultContext, _: Values, __: random.Random) -> _Shown:
    """Return (phases, amplitude 0): the phases in turns are those of the drive."""
    return now.drive.turns[now.place], 0.0


def _intermittent_fault(now: FaultContext, values: Values, source: random.Random) -> _Shown:
    """Return the transducer's drive, with probability "p" at amplitude 0."""
    silent = source.random() < values["p"]
    return now.drive.turns[now.place], 0.0 if silent else now.drive.amplitudes[now.place]


def _stuck_fault(now: FaultContext, values: Values, _: random.Random) -> _Shown:
    """Return the phase "code" of 256, whatever the drive, with the drive's amplitudes."""
    return round(values["code"]) / _CODES, now.drive.amplitudes[now.place]


def _delayed_fault(now: FaultContext, values: Values, _: random.Random) -> _Shown:
    """Return the transducer's drive with its phase increased by "code" 256ths of a turn."""
    turned = (now.drive.turns[now.place] + round(values["code"]) / _CODES) % 1.0
    return turned, now.drive.amplitudes[now.place]


def _garbage_fault(now: FaultContext, _: Values, source: random.Random) -> _Shown:
    """Return random phases with the drive's amplitudes."""
    count = now.place.stop - now.place.start
    codes = np.frombuffer(source.randbytes(count), np.uint8)
    return codes / _CODES, now.drive.amplitudes[now.place]


def _ok_fault(now: FaultContext, _: Values, __: random.Random) -> _Shown:
    """Return the transducer's drive without the faults that stand before this one."""
    return now.healthy.turns[now.place], now.healthy.amplitudes[now.place]


def _wrong_fault(now: FaultContext, _: Values, __: random.Random) -> _Shown:
    """Return the drive that the transducer had in the frame before; amplitude 0 in the first."""
    if now.before is None:
        return now.drive.turns[now.place], 0.0  # nothing has been there before
    return now.before.turns[now.place], now.before.amplitudes[now.place]


def _slow_fault(now: FaultContext, values: Values, _: random.Random) -> _Shown:
    """Return the drive as a transducer with time constant "us" reaches it within the frame.

    A frame is taken to last as long as the one before it; the first one is taken to be reached.
    """
    target = now.drive.weights()[now.place]
    if now.before is not None and now.reached is not None and values["us"] > 0:
        rest = math.exp(-now.since_us / values["us"])
        target = target + (now.reached - target) * rest
    now.reached = target
    shown = FaultyPhasors.of_weights(target)
    return shown.turns, shown.amplitudes


_DEVICE_FAULTS: Final[Mapping[str, _Act]] = MappingProxyType(
    {
        "device.ok": _ok_fault,
        "device.off": _off_fault,
        "device.dead": _off_fault,
        "device.stuck": _stuck_fault,
        "device.delayed": _delayed_fault,
        "device.intermittent": _intermittent_fault,
        "device.garbage": _garbage_fault,
        "device.wrong": _wrong_fault,
        "device.slow": _slow_fault,
    }
)


def faulty_drive(fault: Fault, now: FaultContext, source: random.Random) -> FaultyPhasors:
    """Return the drive that is radiated instead of ``now.drive``."""
    turns, amplitudes = now.drive.turns.copy(), now.drive.amplitudes.copy()
    act = _DEVICE_FAULTS[fault.name]
    turns[now.place], amplitudes[now.place] = act(now, fault.values, source)
    return FaultyPhasors(turns, amplitudes)


def fault_place(fault: Fault, settings: BoardSettings) -> slice:
    """Return the transducers that *fault* is in.

    Raises
    ------
    ConfigurationError
        If the array does not have them.
    """
    count = settings.count
    columns, rows = settings.model.array.grid_shape or (0, 0)
    ways = {"transducer": (1, count), "column": (rows, columns * rows), "bank": (BANK, count)}
    name = next(name for name in ways if fault.values[name] != NOWHERE)
    (width, limit), number = ways[name], round(fault.values[name])
    places = -(-limit // width) if width else 0  # of a column in an array that is no grid
    if number >= places:
        must = f"must be 0 to {places - 1}" if places else f"the array has no {name}: it is no grid"
        raise ConfigurationError(
            f"{fault.option} {fault.name} {name}={number}, {must} ({count} transducers, "
            f"{columns} columns, banks of {BANK})"
        )
    first = number * width
    return slice(first, min(first + width, limit))

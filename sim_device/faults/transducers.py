"""The drive that each fault of transducers makes of the one that the board intends to radiate."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import Drive
from haptogram.errors import ConfigurationError
from haptogram.settings.faults.kinds import NOWHERE
from haptogram.settings.faults.plan import Fault

from ..board.events import Latch
from ..board.settings import BoardSettings
from .line import Values

BANK: Final = 64  # transducers that one driver chip feeds, one after the other


@dataclass(slots=True)
class FaultContext:
    """The latch that a fault acts on.

    Attributes
    ----------
    healthy : Drive
        Drive without any fault.
    drive : Drive
        Drive after the faults before this one.
    before : Latch or None
        The previous latch.
    t_us : int
        Device time of this latch.
    place : slice
        The faulty transducers.
    reached : (P,) complex numpy.ndarray or None
        Weights that slow transducers have reached: before the latch, and afterwards at its end.
    """

    healthy: Drive
    drive: Drive
    before: Latch | None
    t_us: int
    place: slice
    reached: NDArray[np.complex128] | None = None


# Phase and amplitude codes of the place: one for each transducer, or one for all of them.
_Codes: TypeAlias = tuple[NDArray[np.uint8] | int, NDArray[np.uint8] | int]
_Act: TypeAlias = Callable[[FaultContext, Values, random.Random], _Codes]


def _off(now: FaultContext, _: Values, __: random.Random) -> _Codes:
    return now.drive.phase_codes[now.place], 0


def _intermittent(now: FaultContext, values: Values, source: random.Random) -> _Codes:
    silent = source.random() < values["p"]
    amplitudes = now.drive.amplitude_codes[now.place]
    return now.drive.phase_codes[now.place], 0 if silent else amplitudes


def _stuck(now: FaultContext, values: Values, _: random.Random) -> _Codes:
    return round(values["code"]), now.drive.amplitude_codes[now.place]


def _delayed(now: FaultContext, values: Values, _: random.Random) -> _Codes:
    turned = now.drive.phase_codes[now.place] + np.uint8(round(values["code"]))
    return turned, now.drive.amplitude_codes[now.place]


def _garbage(now: FaultContext, _: Values, source: random.Random) -> _Codes:
    count = now.place.stop - now.place.start
    phases = np.frombuffer(source.randbytes(count), np.uint8)
    return phases, now.drive.amplitude_codes[now.place]


def _ok(now: FaultContext, _: Values, __: random.Random) -> _Codes:
    return now.healthy.phase_codes[now.place], now.healthy.amplitude_codes[now.place]


def _wrong(now: FaultContext, _: Values, __: random.Random) -> _Codes:
    if now.before is None:
        return now.drive.phase_codes[now.place], 0  # nothing has been there before
    other = now.before.radiated
    return other.phase_codes[now.place], other.amplitude_codes[now.place]


def _slow(now: FaultContext, values: Values, _: random.Random) -> _Codes:
    """Follow the drive as a resonator does: with a time constant.

    The envelope is the one at the end of the frame, and a frame is taken to last as long as the
    one before it; the first one is taken to be in steady state.
    """
    target = now.drive.weights()[now.place]
    if now.before is not None and now.reached is not None and values["us"] > 0:
        rest = math.exp(-(now.t_us - now.before.t_latch_us) / values["us"])
        target = target + (now.reached - target) * rest
    now.reached = target
    shown = Drive.from_weights(target)
    return shown.phase_codes, shown.amplitude_codes


_DEVICE_FAULTS: Final[Mapping[str, _Act]] = MappingProxyType(
    {
        "device.ok": _ok,
        "device.off": _off,
        "device.dead": _off,
        "device.stuck": _stuck,
        "device.delayed": _delayed,
        "device.intermittent": _intermittent,
        "device.garbage": _garbage,
        "device.wrong": _wrong,
        "device.slow": _slow,
    }
)


def faulty(fault: Fault, now: FaultContext, source: random.Random) -> Drive:
    """Return what is radiated instead of ``now.drive``."""
    phases, amplitudes = now.drive.phase_codes.copy(), now.drive.amplitude_codes.copy()
    act = _DEVICE_FAULTS[fault.name]
    phases[now.place], amplitudes[now.place] = act(now, fault.values, source)
    return Drive(phases, amplitudes)


def place_of(fault: Fault, settings: BoardSettings) -> slice:
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
    width, limit = ways[name]
    first = round(fault.values[name]) * width
    if first >= limit:
        has = f"{count} transducers in {columns} columns, and banks of {BANK}"
        raise ConfigurationError(f"{fault.name}: no such place; the array has {has}")
    return slice(first, min(first + width, limit))

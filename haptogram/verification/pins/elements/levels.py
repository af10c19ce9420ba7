"""Amplitude of pins at one frequency, in time, where their carrier is not steady.

A transducer is a resonator and hears one frequency. Pulses of periods that are drawn out are no
longer in phase with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from haptogram.acoustics.arrays import FloatArray
from haptogram.records.pins import PinRecord

_WINDOW_S: Final = 0.5e-3  # ringing time of a transducer
_MOST_PINS: Final = 64
_QUIET: Final = 0.02  # largest level of silence, relative to the usual one
_FULL: Final = 0.95  # quantile of the windows that shows the undisturbed carrier
_LEAST_DB: Final = 0.5
_BUSY: Final = 0.5  # part of a window in which bytes arrive


@dataclass(frozen=True, eq=False, slots=True)
class LevelsInTime:
    """Amplitude of the pins over that of their undisturbed carrier, window by window.

    Attributes
    ----------
    times_s : (T,) numpy.ndarray
        Middles of the windows.
    levels_db : (T,) numpy.ndarray
        Root mean square over the pins, in dB; NaN: silence.
    is_busy : (T,) numpy.ndarray of bool or None
        Whether bytes arrive; None: the line of the host was not captured.
    """

    times_s: FloatArray
    levels_db: FloatArray
    is_busy: Any

    def as_dict(self) -> dict[str, list[float | None]]:
        """Return times and levels for JSON; null: silence."""
        levels = [round(db, 2) if math.isfinite(db) else None for db in self.levels_db.tolist()]
        return {"t_ms": [round(t * 1e3, 3) for t in self.times_s.tolist()], "level_db": levels}

    @property
    def text(self) -> str:
        """Loss of amplitude in words; empty: there is none."""
        known = np.isfinite(self.levels_db)
        if self.is_busy is not None and (self.is_busy & known).any():
            loss = float(np.median(self.levels_db[self.is_busy & known]))
            if loss < -_LEAST_DB:
                return f"while bytes arrive: {loss:.1f} dB"
        low = known & (self.levels_db < -_LEAST_DB)
        if not low.any():
            return ""
        share = 100.0 * low.sum() / known.sum()
        loss = float(np.median(self.levels_db[low]))
        why = "; capture to_board to know why" if self.is_busy is None else ""
        return f"for {share:.0f} % of the time: {loss:.1f} dB{why}"


def levels_of_pins_in_time(record: PinRecord) -> LevelsInTime | None:
    """Return the levels of the pins in time; None: the carrier is steady, and loses nothing."""
    if record.carrier is None or record.carrier.is_steady:
        return None
    end_s = float(record.seconds(np.array([record.end]))[0])
    count = max(1, int(end_s / _WINDOW_S))
    turn = math.tau / record.period_s
    squares: FloatArray = np.zeros(count)
    elements = sorted(record.pins)
    for element in elements[:: -(-len(elements) // _MOST_PINS)]:
        pin = record.pins[element]
        rises, falls = record.seconds(pin.rises), record.seconds(pin.falls)
        vectors = (np.exp(1j * turn * falls) - np.exp(1j * turn * rises)) / 2j
        places = np.minimum((rises / _WINDOW_S).astype(np.int64), count - 1)
        sums = np.bincount(places, vectors.real, count) + 1j * np.bincount(
            places, vectors.imag, count
        )
        squares += np.abs(sums) ** 2
    levels: FloatArray = np.sqrt(squares)
    full = float(np.quantile(levels, _FULL))
    ratio = levels / full if full > 0.0 else levels
    known = ratio > _QUIET
    decibels = np.full(count, np.nan)
    decibels[known] = 20.0 * np.log10(ratio[known])
    middles_s = np.array([(place + 0.5) * _WINDOW_S for place in range(count)])
    return LevelsInTime(middles_s, decibels, _busy_windows(record, count))


def _busy_windows(record: PinRecord, count: int) -> Any:
    """Return a mask (count,) of 0.5 ms windows that bytes of the host fill by more than half.

    None if there is no such window, or no line of the host in the capture.
    """
    if record.to_board is None or len(record.to_board.times) < 2:
        return None
    times_s = record.seconds(record.to_board.times)
    byte_s = float(np.median(np.diff(times_s)))
    places = np.clip((times_s / _WINDOW_S).astype(np.int64), 0, count - 1)
    busy = np.bincount(places, minlength=count) * byte_s > _BUSY * _WINDOW_S
    return busy if busy.any() else None

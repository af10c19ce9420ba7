"""By how much each pin is off in all frames, and the structure of it: ports, chains, outputs."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from haptogram.acoustics import Calibration, TransducerArray
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.model.calibration import MAX_GAIN
from haptogram.acoustics.solvers.focus_fit import wrapped_phases
from haptogram.records.pins import PinRecord

from .faults import PinDrives

_MODULI: Final = (2, 4, 8, 16, 32)
_BLOCKS: Final = (64, 32, 16, 8)
_FEWEST: Final = 3  # elements that make a structure
_NUMBERED: Final = re.compile(r"(.*?)[._\[ -]*[0-9]+\]?")


@dataclass(frozen=True, eq=False, slots=True)
class ElementOffsets:
    """The E pins of a capture, over all frames that were judged; NaN: none in which it sounds.

    Attributes
    ----------
    elements : tuple of int
        Their elements.
    channels : tuple of str
        Their channels.
    phase_rad, spread_rad : (E,) numpy.ndarray
        Mean lag behind the drives that were meant, and its standard deviation from frame to frame.
    gain, gain_spread : (E,) numpy.ndarray
        Amplitude over the one that was meant, and its standard deviation.
    duty : (E,) numpy.ndarray
        Share of a period for which the pin is driven, on average.
    known : (E,) numpy.ndarray of complex
        Gain and lag of each pin that were known, and taken off before.
    """

    elements: tuple[int, ...]
    channels: tuple[str, ...]
    phase_rad: FloatArray
    spread_rad: FloatArray
    gain: FloatArray
    gain_spread: FloatArray
    duty: FloatArray
    known: ComplexArray

    @classmethod
    def of(cls, record: PinRecord, drives: PinDrives, judged: Any) -> ElementOffsets:
        """Return the offsets of the (F, E) *drives* in the (F,) *judged* frames."""
        meant, seen = drives.run.weights[judged], drives.weights[judged]
        sounding = (np.abs(meant) > drives.limit_amplitude) & (np.abs(seen) > 0.0)
        turned = np.where(sounding, seen * np.conj(meant), 0.0)
        sizes = np.where(sounding, np.abs(seen) / np.where(sounding, np.abs(meant), 1.0), np.nan)
        phase = np.where(sounding.any(axis=0), np.angle(turned.sum(axis=0)), np.nan)
        away = np.where(sounding, wrapped_phases(np.angle(turned) - phase), np.nan)
        gain, gain_spread = _mean_and_spread(sizes)
        pins = [record.pins[element] for element in drives.run.elements]
        widths = [float(np.mean(p.falls - p.rises)) if len(p.rises) else math.nan for p in pins]
        return cls(
            drives.run.elements,
            tuple(pin.channel for pin in pins),
            phase,
            _mean_and_spread(away)[1],
            gain,
            gain_spread,
            np.array(widths),
            np.array([pin.response for pin in pins], dtype=np.complex128),
        )

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield the elements for JSON; phases are in degrees, null: nothing is known."""
        table = np.stack(
            [
                np.degrees(self.phase_rad),
                np.degrees(self.spread_rad),
                self.gain,
                self.gain_spread,
                self.duty,
            ],
            axis=1,
        )
        names = "phase_deg", "phase_spread_deg", "gain", "gain_spread", "duty"
        for element, channel, values in zip(
            self.elements, self.channels, table.tolist(), strict=True
        ):
            known = (round(value, 5) if math.isfinite(value) else None for value in values)
            yield {"element": element, "channel": channel, **dict(zip(names, known, strict=True))}


def _mean_and_spread(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation of each column of (F, E), without NaN."""
    known = np.isfinite(values)
    count = np.maximum(known.sum(axis=0), 1)
    none = ~known.any(axis=0)
    mean = np.where(known, values, 0.0).sum(axis=0) / count
    square = np.where(known, (values - mean) ** 2, 0.0).sum(axis=0) / count
    return np.where(none, np.nan, mean), np.where(none, np.nan, np.sqrt(square))


def calibration_of_pins(every: Sequence[ElementOffsets], array: TransducerArray) -> Calibration:
    """Return gain and lag of the elements of an array, as captures show them; places as they are.

    An element of which no capture shows anything is as it was meant.
    """
    gain, phase = np.ones(array.count), np.zeros(array.count)
    for one in every:
        gain[np.array(one.elements)[np.isnan(one.duty)]] = 0.0  # no pulse at all: dead
        shown = np.isfinite(one.phase_rad)
        places = np.array(one.elements)[shown]
        gain[places] = one.gain[shown] * np.abs(one.known[shown])
        phase[places] = wrapped_phases(one.phase_rad[shown] + np.angle(one.known[shown]))
    return Calibration(np.minimum(gain, MAX_GAIN), phase, array.positions_m)


# --- structure -----------------------------------------------------------------------------------


def structures_of_offsets(
    offsets: ElementOffsets, shifted: Sequence[int], limit_rad: float, steps: int
) -> tuple[list[str], set[int]]:
    """Return in words which *shifted* elements are off together, and all that this explains.

    Those of a port, of a remainder of their numbers, of a block.

    Parameters
    ----------
    shifted : sequence of int
        Elements that are off by a phase that is the same in every frame.
    limit_rad : float
        Phase that samples may hide.
    steps : int
        Steps of the board's phases in a period.
    """
    phases = dict(zip(offsets.elements, offsets.phase_rad.tolist(), strict=True))
    left = set(shifted)
    found: list[str] = []
    for classes in _classes_of_elements(offsets):
        lags = {
            name: lag
            for name, members in classes.items()
            if len(members) >= _FEWEST
            and (lag := _shared_lag(members, phases, limit_rad)) is not None
        }
        shared = [name for name in lags if left.issuperset(classes[name])]
        base, zero = "the others", 0.0
        if 2 * len(shared) > len(classes) and len(lags) == len(classes):
            base = next(iter(lags))  # no class is as most are: all lag behind the first
            zero, shared = lags[base], list(lags)
        for name in shared:
            lag = float(wrapped_phases(np.array([lags[name] - zero]))[0])
            many = f"{name} ({len(classes[name])} of {len(offsets.elements)} pins)"
            if name != base and abs(lag) > limit_rad:
                found.append(f"{many}: {_lag_text(lag, limit_rad, steps, base)}")
            left -= set(classes[name])
        if not left:
            break
    return found, set(shifted) - left


def _shared_lag(
    members: Sequence[int], phases: Mapping[int, float], limit_rad: float
) -> float | None:
    """Return the lag that all *members* have; None: they differ."""
    lags = np.array([phases[element] for element in members])
    lags = lags[np.isfinite(lags)]
    if not len(lags):
        return None
    middle = float(np.angle(np.exp(1j * lags).sum()))
    near = np.abs(wrapped_phases(lags - middle)).max() <= 2.0 * limit_rad
    return middle if near else None


def _classes_of_elements(offsets: ElementOffsets) -> Iterator[dict[str, list[int]]]:
    """Yield ways to divide the elements: by the names of their channels, remainders, blocks."""
    by_port: dict[str, list[int]] = defaultdict(list)
    for element, channel in zip(offsets.elements, offsets.channels, strict=True):
        stem = _NUMBERED.fullmatch(channel)
        by_port[f"port {channel if stem is None else stem[1]}"].append(element)
    if 1 < len(by_port) < len(offsets.elements):
        yield by_port
    for modulus in _MODULI:
        yield _classes(offsets.elements, lambda n, m=modulus: f"elements n mod {m} = {n % m}")
    for size in _BLOCKS:
        yield _classes(
            offsets.elements,
            lambda n, s=size: f"elements {n // s * s} to {n // s * s + s - 1}",
        )


def _classes(elements: Sequence[int], name: Any) -> dict[str, list[int]]:
    found: dict[str, list[int]] = defaultdict(list)
    for element in elements:
        found[name(element)].append(element)
    return found


def _lag_text(lag_rad: float, limit_rad: float, steps: int, base: str) -> str:
    degrees = math.degrees(lag_rad)
    count = round(lag_rad * steps / math.tau)
    step_rad = math.tau / steps
    if count and abs(lag_rad - count * step_rad) <= min(2.0 * limit_rad, step_rad / 4.0):
        many = "one step" if abs(count) == 1 else f"{abs(count)} steps"
        return f"{many} of {steps} {'late' if count > 0 else 'early'}, {degrees:+.1f} degrees"
    return f"{abs(degrees):.1f} degrees {'behind' if degrees > 0 else 'ahead of'} {base}"

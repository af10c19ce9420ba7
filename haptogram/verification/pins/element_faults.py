"""Faults of a pin over all frames of a capture, by name."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from haptogram.acoustics import TransducerArray
from haptogram.acoustics.arrays import ComplexArray, FloatArray

from .pin_weights import wrapped_angles
from .run_drives import Bools, RunDrives

_MOST: Final = 0.9  # share of frames that a name must explain
_FRAMES_COMPARED: Final = 256
_NAMED: Final = 8
_EXCHANGED: Final = 0.6  # share of pins that show an order of elements, not a wire


@dataclass(frozen=True, eq=False, slots=True)
class PinDrives:
    """The drives of E pins in F frames, on the phase of the drives that were meant.

    Attributes
    ----------
    run : RunDrives
        The drives that were meant.
    weights : (F, E) numpy.ndarray of complex
        The drives that were seen; NaN: not seen.
    before : (F,) numpy.ndarray of int
        Frame that was shown before each; -1: none.
    limit_rad : (F, E) numpy.ndarray
        Largest phase error that passes.
    limit_amplitude : float
        Largest error of an amplitude that passes.
    """

    run: RunDrives
    weights: ComplexArray
    before: np.ndarray
    limit_rad: FloatArray
    limit_amplitude: float

    def errors_rad(self, meant: ComplexArray, place: int) -> FloatArray:
        """Return the (F,) phase errors of one pin against *meant*; NaN where either is silent."""
        product = self.weights[:, place] * np.conj(meant)
        return np.where(np.abs(product) > 0.0, np.angle(product), np.nan)

    def right(self, meant: ComplexArray, place: int) -> Bools:
        """Return the (F,) frames in which one pin does what *meant* says."""
        seen = self.weights[:, place]
        size = np.abs(np.abs(seen) - np.abs(meant)) <= self.limit_amplitude
        errors = np.abs(self.errors_rad(meant, place))
        faint = np.abs(meant) <= self.limit_amplitude
        with np.errstate(invalid="ignore"):
            fine: Bools = size & (faint | (errors <= self.limit_rad[:, place]))
        return fine

    def all_right(self) -> Bools:
        """Return the (F, E) drives that are those that were meant."""
        meant = self.run.weights
        return np.stack([self.right(meant[:, e], e) for e in range(meant.shape[1])], axis=1)

    def every_error(self) -> tuple[FloatArray, FloatArray]:
        """Return the (F, E) errors of phase, in radians, and of amplitude; NaN: none to tell."""
        meant = self.run.weights
        phases = [self.errors_rad(meant[:, e], e) for e in range(meant.shape[1])]
        return np.stack(phases, axis=1), np.abs(np.abs(self.weights) - np.abs(meant))


def fault_of_pin(drives: PinDrives, place: int, judged: Bools) -> str:
    """Return the fault of a pin in words, by the (F,) *judged* frames.

    At least one of them is not right.
    """
    run = drives.run
    meant = run.weights[:, place]
    frames = np.flatnonzero(judged)
    seen = drives.weights[frames, place]
    wrong = ~drives.right(meant, place)[frames]
    count = f"in {int(wrong.sum())} of {len(frames)} frames"
    silent = (np.abs(seen) == 0.0) & (np.abs(meant[frames]) > 0.0)
    sounding = np.abs(meant[frames]) > drives.limit_amplitude
    if silent[sounding].all():
        return "dead: silent in every frame"
    if (silent | ~wrong).all():
        return f"silent {count}"
    old = run.weights[np.maximum(drives.before, 0), place]
    follows = drives.right(old, place) & (drives.before >= 0)
    if wrong.sum() > 1 and _share(follows[frames][wrong]) >= _MOST:
        return f"shows the drive of the frame before {count}"
    errors = drives.errors_rad(meant, place)[frames]
    known = np.isfinite(errors)
    limit = float(np.median(drives.limit_rad[frames, place]))
    if known.any() and (text := _constant_fault(seen[known], errors[known], limit, meant[frames])):
        return text
    if (other := _other_element(drives, place, frames)) is not None:
        return f"does what element {other} should"
    if _share(drives.right(np.conj(meant), place)[frames]) >= _MOST:
        return "opposite sign of the phase"
    sizes = np.abs(seen) - np.abs(meant[frames])
    if known.any() and (np.abs(errors[known]) <= drives.limit_rad[frames, place][known]).all():
        worst = sizes[np.abs(sizes).argmax()]
        return f"amplitude off {count}, by up to {worst:+.3f}"
    worst_deg = math.degrees(float(np.nanmax(np.abs(errors), initial=0.0)))
    return f"phase off {count}, by up to {worst_deg:.1f} degrees"


def _constant_fault(
    seen: ComplexArray, errors: FloatArray, limit: float, meant: ComplexArray
) -> str | None:
    """Return the name of an error, or of a phase, that is the same in every frame."""
    shift = float(np.angle(np.exp(1j * errors).sum()))
    if np.abs(wrapped_angles(errors - shift)).max() <= 2.0 * limit and abs(shift) > limit / 2.0:
        degrees = math.degrees(shift)
        if abs(abs(degrees) - 180.0) <= math.degrees(2.0 * limit):
            return "inverted: half a period off in every frame"
        return f"phase off by {degrees:+.1f} degrees in every frame"
    phases = np.angle(seen)
    middle = float(np.angle(np.exp(1j * phases).sum()))
    wanted = np.angle(meant[np.abs(meant) > 0.0])
    moves = np.abs(wrapped_angles(wanted - wanted[0])).max(initial=0.0) > 4.0 * limit
    if moves and np.abs(wrapped_angles(phases - middle)).max() <= 2.0 * limit:
        return f"stuck at a phase of {math.degrees(middle) % 360.0:.1f} degrees"
    return None


def _other_element(drives: PinDrives, place: int, frames: np.ndarray) -> int | None:
    """Return the element whose drives this pin shows; None: not one, or not one alone."""
    run = drives.run
    some = frames[:: max(1, len(frames) // _FRAMES_COMPARED)]
    seen = drives.weights[some, place]
    every = run.weights_of(range(run.phases.shape[1]), some)
    product = seen[:, None] * np.conj(every)
    near = np.abs(np.angle(product)) <= drives.limit_rad[some, place][:, None]
    near &= np.abs(np.abs(seen)[:, None] - np.abs(every)) <= drives.limit_amplitude
    shares = near.mean(axis=0)
    fitting = np.flatnonzero(shares >= _MOST)
    others = fitting[fitting != run.elements[place]]
    return int(others[0]) if len(others) == len(fitting) == 1 and len(some) > 1 else None


def _share(found: Bools) -> float:
    return float(found.mean()) if len(found) else 0.0


# --- several pins --------------------------------------------------------------------------------


def exchanged_orders(
    array: TransducerArray, others: Sequence[tuple[int, int]], captured: int
) -> str | None:
    """Return the order of elements that explains *others*, pairs of element and element shown."""
    if array.grid_shape is None or len(others) < _EXCHANGED * captured or len(others) < 2:
        return None
    grid = np.arange(array.count).reshape(array.grid_shape)
    orders = {
        "x mirrored": grid[::-1],
        "y mirrored": grid[:, ::-1],
        "x and y mirrored (turned by 180 degrees)": grid[::-1, ::-1],
        "x and y exchanged (transposed)": grid.T,
    }
    for name, order in orders.items():
        shown = order.ravel()
        if all(shown[element] == other for element, other in others):
            return name
    return None


def grouped_faults(faults: Sequence[tuple[int, str, str]]) -> Iterator[str]:
    """Yield a line for all pins with the same fault; *faults* are element, channel and words."""
    groups: dict[str, list[tuple[int, str]]] = defaultdict(list)
    for element, channel, text in faults:
        groups[text].append((element, channel))
    for text, pins in groups.items():
        names = ", ".join(f"{element} ({channel})" for element, channel in pins[:_NAMED])
        more = f" and {len(pins) - _NAMED} more" if len(pins) > _NAMED else ""
        yield f"element{'s' if len(pins) > 1 else ''} {names}{more}: {text}"

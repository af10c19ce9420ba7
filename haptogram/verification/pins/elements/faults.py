"""Faults of a pin over all frames of a capture, by name."""

from __future__ import annotations

import enum
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import TransducerArray
from haptogram.acoustics.arrays import ComplexArray, FloatArray
from haptogram.acoustics.solvers.focus_fit import wrapped_phases

from ...mixed_up import grid_orders
from ..run_drives import Bools, PinRunDrives

_MOST: Final = 0.9  # share of frames that a name must explain
_FRAMES_COMPARED: Final = 256
_FRAMES_TRIED: Final = 16
_LIKELY: Final = 0.5  # least share of the few frames that makes an element worth comparing in more
_ROWS: Final = 256  # frames that are compared at a time
_NAMED: Final = 8
_EVERY: Final = slice(None)
#: Outputs of chains of shift registers.
CHAINS: Final = (8, 16, 32)
_EXCHANGED: Final = 0.6  # share of pins that show an order of elements, not a wire


@dataclass(frozen=True, eq=False, slots=True)
class PinDrives:
    """The drives of E pins in F frames, on the phase of the drives that were meant.

    Attributes
    ----------
    run : PinRunDrives
        The drives that were meant.
    weights : (F, E) numpy.ndarray of complex
        The drives that were seen; NaN: not seen.
    before : (F,) numpy.ndarray of int
        Frame that was shown before each; -1: none.
    limit_rad : (F, E) numpy.ndarray
        Largest phase error that passes.
    limit_amplitude : float
        Largest error of an amplitude that passes.
    turns_rad : (F,) numpy.ndarray
        Phase of the pins on the clock of the capture, which the drives have no more.
    """

    run: PinRunDrives
    weights: ComplexArray
    before: np.ndarray
    limit_rad: FloatArray
    limit_amplitude: float
    turns_rad: FloatArray

    def errors_rad(self, meant: ComplexArray, place: int) -> FloatArray:
        """Return the (F,) phase errors of one pin against *meant*; NaN where either is silent."""
        product = self.weights[:, place] * np.conj(meant)
        return np.where(np.abs(product) > 0.0, np.angle(product), np.nan)

    def shows(
        self, seen: ComplexArray, meant: ComplexArray, rows: Any, columns: Any = _EVERY
    ) -> Bools:
        """Return which drives *seen* are those *meant*, within the limits of frames and pins.

        The phase of a drive too faint to be told from silence does not count.
        """
        sizes, product = np.abs(meant), seen * np.conj(meant)
        length = np.abs(product)
        # The angle of the product is within the limit: compared by its cosine.
        near = (
            product.real >= np.cos(np.minimum(self.limit_rad[rows][..., columns], np.pi)) * length
        )
        near = (near & (length > 0.0)) | (sizes <= self.limit_amplitude)
        shown: Bools = near & (np.abs(np.abs(seen) - sizes) <= self.limit_amplitude)
        return shown

    def right(self, meant: ComplexArray, place: int) -> Bools:
        """Return the (F,) frames in which one pin does what *meant* says."""
        return self.shows(self.weights[:, place], meant, _EVERY, place)

    def all_right(self) -> Bools:
        """Return the (F, E) drives that are those that were meant."""
        meant = self.run.weights
        parts = [slice(begin, begin + _ROWS) for begin in range(0, len(meant), _ROWS)]
        return np.concatenate([self.shows(self.weights[p], meant[p], p) for p in parts])

    def every_error(self) -> tuple[FloatArray, FloatArray]:
        """Return the (F, E) errors of phase, in radians, and of amplitude; NaN: none to tell."""
        meant = self.run.weights
        phases = [self.errors_rad(meant[:, e], e) for e in range(meant.shape[1])]
        return np.stack(phases, axis=1), np.abs(np.abs(self.weights) - np.abs(meant))


class PinFaultKind(enum.Enum):
    """Kind of a fault, and the check that it fails."""

    DEAD = "dead", "pins"
    INVERTED = "inverted", "pins"
    SILENT = "silent", "amplitudes"
    AMPLITUDE = "amplitude", "amplitudes"
    BEHIND = "behind", "phases"
    SHIFTED = "shifted", "phases"
    STUCK = "stuck", "phases"
    OTHER_ELEMENT = "other element", "phases"
    SIGN = "sign", "phases"
    PHASE = "phase", "phases"

    @property
    def check(self) -> str:
        """Check of a verdict that this fault fails."""
        return self.value[1]


@dataclass(frozen=True, slots=True)
class PinFault:
    """Fault of a pin.

    Attributes
    ----------
    kind : PinFaultKind
        Kind of the fault.
    text : str
        The same in words, with figures.
    other : int or None
        Element whose drives the pin shows.
    """

    kind: PinFaultKind
    text: str
    other: int | None = None


def faults_of_pins(drives: PinDrives, places: Sequence[int], judged: Bools) -> dict[int, PinFault]:
    """Return the fault of each pin at these *places*, by the (F,) *judged* frames.

    At least one of these frames is not right at each of the pins.
    """
    frames = np.flatnonzero(judged)
    found = {place: _plain_pin_fault(drives, place, frames) for place in places}
    rest = [place for place, fault in found.items() if fault is None]
    others = _exchanged_elements(drives, rest, frames)
    named = {place: fault for place, fault in found.items() if fault is not None}
    for place in rest:
        other = others.get(place)
        if other is None:
            named[place] = _remaining_pin_fault(drives, place, frames)
        else:
            text = f"does what element {other} should"
            named[place] = PinFault(PinFaultKind.OTHER_ELEMENT, text, other)
    return named


def _plain_pin_fault(drives: PinDrives, place: int, frames: NDArray[np.intp]) -> PinFault | None:
    """Return the fault that the pin in column *place* shows in *frames*; None for no such fault.

    These are dead, silent, a frame behind (in 90 % of its wrong frames), or a constant error.
    """
    run = drives.run
    meant = run.weights[:, place]
    seen = drives.weights[frames, place]
    wrong = ~drives.right(meant, place)[frames]
    count = _wrong_count_text(wrong)
    silent = (np.abs(seen) == 0.0) & (np.abs(meant[frames]) > 0.0)
    sounding = np.abs(meant[frames]) > drives.limit_amplitude
    if silent[sounding].all():
        return PinFault(PinFaultKind.DEAD, "dead: silent in every frame")
    if (silent | ~wrong).all():
        return PinFault(PinFaultKind.SILENT, f"silent {count}")
    old = run.weights[np.maximum(drives.before, 0), place]
    follows = drives.right(old, place) & (drives.before >= 0)
    if wrong.sum() > 1 and _share_true(follows[frames][wrong]) >= _MOST:
        return PinFault(PinFaultKind.BEHIND, f"shows the drive of the frame before {count}")
    errors = drives.errors_rad(meant, place)[frames]
    known = np.isfinite(errors)
    limit = float(np.median(drives.limit_rad[frames, place]))
    return (
        _constant_pin_fault(seen[known], errors[known], limit, meant[frames])
        if known.any()
        else None
    )


def _wrong_count_text(wrong: Bools) -> str:
    """Return "in N of M frames", N the True values of the mask *wrong*."""
    return f"in {int(wrong.sum())} of {len(wrong)} frames"


def _remaining_pin_fault(drives: PinDrives, place: int, frames: NDArray[np.intp]) -> PinFault:
    """Return by exclusion the fault of the pin in column *place*: sign, amplitude or phase."""
    meant = drives.run.weights[:, place]
    if _share_true(drives.right(np.conj(meant), place)[frames]) >= _MOST:
        return PinFault(PinFaultKind.SIGN, "opposite sign of the phase")
    count = _wrong_count_text(~drives.right(meant, place)[frames])
    errors = drives.errors_rad(meant, place)[frames]
    known = np.isfinite(errors)
    sizes = np.abs(drives.weights[frames, place]) - np.abs(meant[frames])
    if known.any() and (np.abs(errors[known]) <= drives.limit_rad[frames, place][known]).all():
        worst = sizes[np.abs(sizes).argmax()]
        return PinFault(PinFaultKind.AMPLITUDE, f"amplitude off {count}, by up to {worst:+.3f}")
    worst_deg = math.degrees(float(np.nanmax(np.abs(errors), initial=0.0)))
    return PinFault(PinFaultKind.PHASE, f"phase off {count}, by up to {worst_deg:.1f} degrees")


def _constant_pin_fault(
    seen: ComplexArray, errors: FloatArray, limit: float, meant: ComplexArray
) -> PinFault | None:
    """Return the fault of one phase error, or one phase, in all frames; None if they vary.

    *seen* and *meant* are the drives of the pin, *errors* their phase errors in rad. Values within
    twice *limit* of their mean do not vary.
    """
    shift = float(np.angle(np.exp(1j * errors).sum()))
    if np.abs(wrapped_phases(errors - shift)).max() <= 2.0 * limit and abs(shift) > limit / 2.0:
        degrees = math.degrees(shift)
        if abs(abs(degrees) - 180.0) <= math.degrees(2.0 * limit):
            text = "inverted: half a period off in every frame"
            return PinFault(PinFaultKind.INVERTED, text)
        return PinFault(PinFaultKind.SHIFTED, f"phase off by {degrees:+.1f} degrees in every frame")
    phases = np.angle(seen)
    middle = float(np.angle(np.exp(1j * phases).sum()))
    wanted = np.angle(meant[np.abs(meant) > 0.0])
    moves = np.abs(wrapped_phases(wanted - wanted[0])).max(initial=0.0) > 4.0 * limit
    if moves and np.abs(wrapped_phases(phases - middle)).max() <= 2.0 * limit:
        degrees = math.degrees(middle) % 360.0
        return PinFault(PinFaultKind.STUCK, f"stuck at a phase of {degrees:.1f} degrees")
    return None


def _exchanged_elements(
    drives: PinDrives, places: Sequence[int], frames: NDArray[np.intp]
) -> dict[int, int]:
    """Return, by pin, the one other element whose drives it shows in 90 % of the frames.

    Pins for which none or several match are left out. Some 16 frames rule out most elements; the
    others are compared in some 256.
    """
    run = drives.run
    some = frames[:: max(1, len(frames) // _FRAMES_COMPARED)]
    if len(some) < 2 or not places:
        return {}
    few = some[:: max(1, len(some) // _FRAMES_TRIED)]
    every = run.weights_of(range(run.phases.shape[1]), few)
    found = {}
    for place in places:
        column = drives.weights[:, [place]]
        share = drives.shows(column[few], every, few, [place]).mean(axis=0)
        likely = np.flatnonzero(share >= _LIKELY)
        others = run.weights_of(likely.tolist(), some)
        near = drives.shows(column[some], others, some, [place])
        fitting = likely[near.mean(axis=0) >= _MOST]
        if len(fitting) == 1 and fitting[0] != run.elements[place]:
            found[place] = int(fitting[0])
    return found


def _share_true(found: Bools) -> float:
    """Return the share of True values; 0 if there are none to count."""
    return float(found.mean()) if len(found) else 0.0


# --- several pins --------------------------------------------------------------------------------


def exchanged_pin_orders(
    array: TransducerArray, others: Sequence[tuple[int, int]], captured: int
) -> str | None:
    """Return the order of elements that explains *others*, pairs of element and element shown."""
    if array.grid_shape is None or len(others) < _EXCHANGED * captured or len(others) < 2:
        return None
    orders = grid_orders(np.arange(array.count).reshape(array.grid_shape))
    fitting = (n for n, order in orders if all(order[element] == o for element, o in others))
    return next(fitting, None)


def grouped_pin_faults(faults: Sequence[tuple[int, str, str]]) -> Iterator[str]:
    """Yield a line for all pins with the same fault; *faults* are element, channel and words."""
    groups: dict[str, list[tuple[int, str]]] = defaultdict(list)
    for element, channel, text in faults:
        groups[text].append((element, channel))
    for text, pins in groups.items():
        names = ", ".join(f"{element} ({channel})" for element, channel in pins[:_NAMED])
        more = f" and {len(pins) - _NAMED} more" if len(pins) > _NAMED else ""
        yield f"element{'s' if len(pins) > 1 else ''} {names}{more}: {text}"

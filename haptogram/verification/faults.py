"""What is wrong with a drive, by name: the latched codes against the intended ones.

Only names what the codes prove: a mirrored drive that equals the intended one (a target on the
symmetry plane) is a correct drive.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import AcousticModel, Drive, focus_phases
from haptogram.records import Intended

Codes: TypeAlias = NDArray[np.int64]

#: A drive that is wrong in no way that has a name here.
UNNAMED: Final = "most phases are not those intended"

_TURN: Final = 256  # codes in one turn, in the registers of the board
_NAMED_ELEMENTS: Final = 8  # more than these are counted, not listed
_FEW: Final = 0.25  # share of the elements that can be wrong one by one


def name_faults(model: AcousticModel, intended: Intended, latched: Drive) -> tuple[str, ...]:
    """Return what distinguishes *latched* from the drive that was intended; empty: nothing.

    Parameters
    ----------
    model : AcousticModel
        Array of the board; its grid gives columns, mirrors and transposition a meaning.
    intended : Intended
        With the drive that was expected in the registers, 8-bit codes.
    latched : Drive
        8-bit codes.
    """
    allowance = 1 if intended.board_computed else 0
    wanted, found = _phases(intended.drive), _phases(latched)
    silent = (latched.amplitude_codes == 0) & (intended.drive.amplitude_codes > 0)
    active = (latched.amplitude_codes > 0) & (intended.drive.amplitude_codes > 0)
    faults = [*_silences(model, silent), *_amplitudes(intended, latched, silent, allowance)]
    off = active & (np.abs(_signed(found - wanted)) > allowance)
    if off.any():
        faults += _phase_faults(model, intended, found, off, allowance)
    return tuple(faults)


def _phases(drive: Drive) -> Codes:
    return drive.phase_codes.astype(np.int64) << (8 - drive.phase_bits)


def _signed(difference: Codes) -> Codes:
    """Return a difference of codes in -128 .. 127."""
    return (difference + _TURN // 2) % _TURN - _TURN // 2


# --- Amplitudes --------------------------------------------------------------------------------


def _silences(model: AcousticModel, silent: NDArray[np.bool_]) -> Iterator[str]:
    if not silent.any():
        return
    if silent.all():
        yield "the whole array is silent"
        return
    yield from _by_column(model, silent, "dead")


def _by_column(model: AcousticModel, wrong: NDArray[np.bool_], what: str) -> Iterator[str]:
    """Name whole columns of the grid first, then what is left."""
    left = wrong.copy()
    if model.array.grid_shape is not None:
        grid = left.reshape(model.array.grid_shape)  # a view: columns are taken out of `left`
        for column in np.flatnonzero(grid.all(axis=1)) if grid.shape[1] > 1 else []:
            yield f"column {column} {what}"
            grid[column] = False
    if left.any():
        yield f"{_elements(model, np.flatnonzero(left))} {what}"


def _elements(model: AcousticModel, numbers: NDArray[np.intp]) -> str:
    if len(numbers) > _NAMED_ELEMENTS:
        return f"{len(numbers)} elements"
    names = ", ".join(_element(model, int(number)) for number in numbers)
    return f"element{'s' if len(numbers) > 1 else ''} {names}"


def _element(model: AcousticModel, number: int) -> str:
    if model.array.grid_shape is None:
        return str(number)
    return f"{number} ({number // model.array.grid_shape[1]}, {number % model.array.grid_shape[1]})"


def _amplitudes(
    intended: Intended, latched: Drive, silent: NDArray[np.bool_], allowance: int
) -> Iterator[str]:
    difference = latched.amplitude_codes.astype(int) - intended.drive.amplitude_codes.astype(int)
    wrong = (np.abs(difference) > allowance) & ~silent
    if wrong.any():
        worst = int(difference[np.abs(np.where(wrong, difference, 0)).argmax()])
        yield f"amplitude of {int(wrong.sum())} elements off, by up to {worst:+d}/255"


# --- Phases ------------------------------------------------------------------------------------


def _phase_faults(
    model: AcousticModel, intended: Intended, found: Codes, off: NDArray[np.bool_], allowance: int
) -> list[str]:
    wanted = _phases(intended.drive)
    step = _TURN >> intended.phase_bits
    if not allowance and _equal(found, _rounded_down(model, intended)):
        return ["phases rounded down instead of to the nearest code"]
    for name, candidate in _candidates(model, intended, wanted):
        # A board that mixes up the elements may round the halves its own way: a step is allowed.
        # What is within a step of the right drive proves nothing.
        if _same(found, candidate, step) and not _same(wanted, candidate, step):
            return [name]
    difference = _signed(found - wanted)
    pair = _swapped(model, wanted, found, off)
    if pair:
        return [pair]
    if off.mean() <= _FEW:
        return list(_single_elements(model, difference, off))
    stuck = _stuck_columns(model, found, off)
    return stuck or [UNNAMED]


def _equal(found: Codes, candidate: Codes | None) -> bool:
    return candidate is not None and np.array_equal(found, candidate)


def _same(found: Codes, candidate: Codes, allowance: int) -> bool:
    """Tell whether two sets of phases agree within *allowance*, up to a phase that all share."""
    difference = _signed(found - candidate)
    relative = _signed(difference - difference[0])
    return bool(np.ptp(relative) <= 2 * allowance)


def _rounded_down(model: AcousticModel, intended: Intended) -> Codes | None:
    """Return the codes of a focus without rounding; None if there are several foci."""
    if len(intended.foci) != 1:
        return None
    (focus,) = intended.foci
    phases_rad = focus_phases(model, np.array(focus.position_m)) + focus.phase_rad
    steps = 1 << intended.phase_bits
    codes: Codes = np.floor(phases_rad / (2.0 * np.pi) * steps).astype(np.int64) % steps
    return codes * (_TURN // steps)


def _candidates(
    model: AcousticModel, intended: Intended, wanted: Codes
) -> Iterator[tuple[str, Codes]]:
    """Yield what typical mistakes would have made of the drive, the simplest first."""
    yield "opposite sign of all phases", -wanted
    yield from _orders(model, wanted)
    if intended.phase_bits < 8:
        yield from _packings(wanted, intended.phase_bits)
    yield from (
        (f"{name}, and opposite sign", -candidate) for name, candidate in _orders(model, wanted)
    )


def _orders(model: AcousticModel, wanted: Codes) -> Iterator[tuple[str, Codes]]:
    """Yield the drive in other orders of the elements."""
    if model.array.grid_shape is not None:
        grid = wanted.reshape(model.array.grid_shape)
        turns: list[tuple[str, Callable[[Codes], Codes]]] = [
            ("x and y exchanged (transposed)", lambda g: g.T),
            ("x mirrored", lambda g: g[::-1]),
            ("y mirrored", lambda g: g[:, ::-1]),
            ("x and y mirrored (turned by 180 degrees)", lambda g: g[::-1, ::-1]),
            ("turned by 90 degrees", np.rot90),
            ("turned by 270 degrees", lambda g: np.rot90(g, 3)),
            ("every second column reversed", _serpentine),
        ]
        for name, turn in turns:
            yield name, np.ascontiguousarray(turn(grid)).ravel()
    for shift in range(1, len(wanted)):
        signed = shift if shift <= len(wanted) // 2 else shift - len(wanted)
        yield f"elements rolled by {signed:+d}", np.roll(wanted, shift)


def _serpentine(grid: Codes) -> Codes:
    result = grid.copy()
    result[1::2] = result[1::2, ::-1]
    return result


def _packings(wanted: Codes, bits: int) -> Iterator[tuple[str, Codes]]:
    """Yield what comes out if the packed bits are read with the highest bit first."""
    codes = wanted >> (8 - bits)
    stream = (codes[:, None] >> np.arange(bits)) & 1  # lowest bit first, as on the wire
    padded = np.zeros(-(-stream.size // 8) * 8, dtype=np.int64)
    padded[: stream.size] = stream.ravel()
    packed = padded.reshape(-1, 8)
    read = packed[:, ::-1].ravel()[: stream.size].reshape(-1, bits)
    yield "packed phases read highest bit first", read @ (1 << np.arange(bits)[::-1]) << (8 - bits)
    swapped = stream[:, ::-1]
    yield "bits of every phase in reverse order", swapped @ (1 << np.arange(bits)) << (8 - bits)


def _swapped(
    model: AcousticModel, wanted: Codes, found: Codes, off: NDArray[np.bool_]
) -> str | None:
    numbers = np.flatnonzero(off)
    if len(numbers) != 2:
        return None
    first, second = numbers
    if found[first] == wanted[second] and found[second] == wanted[first]:
        return f"{_elements(model, numbers)} swapped"
    return None


def _single_elements(
    model: AcousticModel, difference: Codes, off: NDArray[np.bool_]
) -> Iterator[str]:
    """Name elements that are wrong one by one, those with the same error together."""
    for step in sorted({int(d) for d in difference[off]}, key=abs):
        numbers = np.flatnonzero(off & (difference == step))
        inverted = step == -_TURN // 2
        yield f"{_elements(model, numbers)} {'inverted' if inverted else f'off by {step:+d} LSB'}"


def _stuck_columns(model: AcousticModel, found: Codes, off: NDArray[np.bool_]) -> list[str]:
    if model.array.grid_shape is None:
        return []
    grid, wrong = found.reshape(model.array.grid_shape), off.reshape(model.array.grid_shape)
    same = (grid == grid[:, :1]).all(axis=1) & wrong.any(axis=1)
    if not same.any() or wrong[~same].any():
        return []
    return [f"column {column} stuck at phase {grid[column, 0]}" for column in np.flatnonzero(same)]

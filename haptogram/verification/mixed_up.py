"""Drives that mistakes in the order, the sign, the packing or the shape of a drive would make.

Phases are whole numbers in units of the finest code, 1/65536 of a turn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import AcousticModel
from haptogram.acoustics.model.drive import MAX_PHASE_BITS, REGISTER_BITS
from haptogram.records.frame import Intended

Codes: TypeAlias = NDArray[np.int64]

TURN: Final = 1 << MAX_PHASE_BITS
_CHARGES: Final = (1, -1, 2, -2, 3, -3)
_LEAST_ELEMENTS: Final = 12  # least elements: with fewer, a half or a turn may be chance
_MIDDLE: Final = 1e-6  # distance from the middle, in m, within which an element has no direction
_CHANGES: Final = 2  # changes of sign around the middle of a twin trap
_UNEVEN: Final = 0.2  # share of the elements by which the halves of a twin trap may differ


class PhaseGrid(NamedTuple):
    """Grids of the phases of a drive.

    Attributes
    ----------
    steps : int
        Steps of the wire in a turn.
    registers : int
        Codes of the registers in a turn: 256, or more where the drive has more bits.
    """

    steps: int
    registers: int

    @classmethod
    def of(cls, intended: Intended) -> Self:
        """Return the grids of an intended drive."""
        return cls(intended.steps, 1 << max(REGISTER_BITS, intended.drive.phase_bits))

    @property
    def step(self) -> float:
        """Units in a step."""
        return TURN / self.steps

    @property
    def code(self) -> int:
        """Units in a code of the registers."""
        return TURN // self.registers

    def text(self, error: int) -> str:
        """Return an error in steps of the wire, or in codes where that is none."""
        whole = round(error / self.step)
        if abs(error - whole * self.step) < self.code:
            return f"{whole:+d} LSB"
        return f"{error // self.code:+d}/{self.registers} of a turn"


def mixed_up_drives(
    model: AcousticModel, intended: Intended, wanted: Codes
) -> Iterator[tuple[str, Codes]]:
    """Yield the drives that typical mistakes would have made, the simplest first."""
    yield "opposite sign of all phases", -wanted
    yield from _drive_fault_orders(model, wanted)
    yield from _drive_fault_copies(wanted)
    bits = intended.phase_bits
    turned = [wanted >> (MAX_PHASE_BITS - bits + bit) & 1 for bit in range(bits)]
    yield (
        "bits of every phase in reverse order",
        sum(on << (MAX_PHASE_BITS - 1 - bit) for bit, on in enumerate(turned)) + 0 * wanted,
    )
    for lost in range(1, bits):
        unit = 1 << (MAX_PHASE_BITS - bits + lost)
        yield (
            f"lowest {'bit' if lost == 1 else f'{lost} bits'} of every phase lost",
            wanted // unit * unit,
        )
    yield from (
        (f"{name}, and opposite sign", -candidate)
        for name, candidate in _drive_fault_orders(model, wanted)
    )


def _drive_fault_orders(model: AcousticModel, wanted: Codes) -> Iterator[tuple[str, Codes]]:
    """Yield wrong orders of the elements by name, each with the phase codes that it would show.

    On a grid: transposed, mirrored in x, y or both, turned by 90 and 270 degrees, every second
    column reversed. Without a grid: all elements reversed.
    """
    if model.array.grid_shape is None:
        yield "order of the elements reversed", wanted[::-1]
    else:
        yield from grid_orders(wanted.reshape(model.array.grid_shape))


def grid_orders(grid: Codes) -> Iterator[tuple[str, Codes]]:
    """Yield the values of a grid of elements in other orders of these, with their names."""
    turns: list[tuple[str, Callable[[Codes], Codes]]] = [
        ("x and y exchanged (transposed)", lambda g: g.T),
        ("x mirrored", lambda g: g[::-1]),
        ("y mirrored", lambda g: g[:, ::-1]),
        ("x and y mirrored (turned by 180 degrees)", lambda g: g[::-1, ::-1]),
        ("turned by 90 degrees", np.rot90),
        ("turned by 270 degrees", lambda g: np.rot90(g, 3)),
        ("every second column reversed", _serpentine_drive_order),
    ]
    for name, turn in turns:
        yield name, np.ascontiguousarray(turn(grid)).ravel()


def _drive_fault_copies(wanted: Codes) -> Iterator[tuple[str, Codes]]:
    """Yield two wrong drives by name: each pair of elements has the phase of its first, or second.

    Pairs are elements 0 and 1, 2 and 3, and so on.
    """
    pairs = wanted[: len(wanted) // 2 * 2].reshape(-1, 2)
    for kept, name in ((0, "before"), (1, "behind")):
        copied = wanted.copy()
        copied[: pairs.size] = np.repeat(pairs[:, kept], 2)
        yield f"every second element has the phase of the one {name} it", copied


def _serpentine_drive_order(grid: Codes) -> Codes:
    """Return the codes *grid* (nx, ny) with every column of odd x reversed in y."""
    result = grid.copy()
    result[1::2] = result[1::2, ::-1]
    return result


def shaped_drive_fault(
    model: AcousticModel, intended: Intended, difference: Codes, allowance: int
) -> list[str]:
    """Name a twin or a vortex in place of a focus, by the difference of the codes.

    The axis of a vortex goes through the middle of the array or the focus.
    """
    array, grid = model.array, PhaseGrid.of(intended)
    foci_m = [focus.position_m for focus in intended.foci[:1]]
    local = array.local_m(np.vstack([array.positions_m, *foci_m]))[:, :2]
    limit = grid.step / 2.0 + allowance + grid.code
    for middle in (np.zeros(2), *local[array.count :]):
        places = local[: array.count] - middle
        around = np.arctan2(places[:, 1], places[:, 0])
        seen = np.linalg.norm(places, axis=1) > _MIDDLE
        if seen.sum() < _LEAST_ELEMENTS:
            return []
        for charge in _CHARGES:
            turned = difference[seen] - charge * around[seen] * TURN / (2.0 * np.pi)
            if _code_range(turned) <= 2.0 * limit:
                return [f"vortex of charge {charge:+d} in place of a focus"]
        if _is_half_plane(difference[seen], around[seen]):
            return ["twin in place of a focus: one half of the elements inverted"]
    return []


def _code_range(codes: NDArray[np.float64]) -> float:
    """Return max - min of the phase codes, in codes, after their common phase is removed."""
    common = np.angle(np.exp(2j * np.pi * codes / TURN).sum()) * TURN / (2.0 * np.pi)
    return float(np.ptp((codes - common + TURN / 2.0) % TURN))


def _is_half_plane(difference: Codes, around: NDArray[np.float64]) -> bool:
    """Return True if the elements on one side of a line through the centre are half a turn off.

    *difference* (N,) has the errors in codes, *around* (N,) the direction in rad of each element
    from the centre. That side must hold 30 to 70 % of the elements.
    """
    turned = (difference - difference[0]) % TURN == TURN // 2
    if not turned.any() or ((difference - difference[0]) % (TURN // 2)).any():
        return False
    sides = turned[np.argsort(around)]
    is_once = int((sides != np.roll(sides, 1)).sum()) == _CHANGES
    return is_once and abs(float(turned.mean()) - 0.5) < _UNEVEN

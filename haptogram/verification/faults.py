"""Named faults of a drive: the latched codes against the intended ones.

Only names what the codes prove: a mirrored drive that equals the intended one (a target on the
symmetry plane) is a correct drive.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics import AcousticModel, Drive, focus_phases
from haptogram.acoustics.model.drive import MAX_PHASE_BITS
from haptogram.records.frame import Intended

from .groups import groups_of_elements
from .mixed_up import TURN, Codes, PhaseGrid, mixed_up_drives, shaped_drive_fault

#: A drive that is wrong in no way that has a name here.
UNNAMED: Final = "most phases are not those intended"

_NAMED_ELEMENTS: Final = 8  # most elements that are listed; more are counted
_NAMED_COLUMNS: Final = 3
_FEW: Final = 0.25  # share of the elements that can be wrong one by one
_MOST_UNITS: Final = 4  # most units that are each off by a phase of their own
_CHANCE_BITS: Final = 16  # improbability of a common property, as a power of two
_TWO: Final = 2


def name_drive_faults(model: AcousticModel, intended: Intended, latched: Drive) -> tuple[str, ...]:
    """Return the names of the faults of *latched* against the intended drive; empty: none.

    Parameters
    ----------
    model : AcousticModel
        Array of the board; its grid gives columns, mirrors and transposition a meaning.
    intended : Intended
        With the drive that was expected in the registers.
    latched : Drive
        Its codes are of the same registers.
    """
    allowance = 1 if intended.board_computed else 0
    wanted, found = _drive_fault_phases(intended.drive), _drive_fault_phases(latched)
    silent = (latched.amplitude_codes == 0) & (intended.drive.amplitude_codes > allowance)
    active = (latched.amplitude_codes > 0) & (intended.drive.amplitude_codes > 0)
    faults = [
        *_silent_element_drive_faults(model, silent),
        *_amplitude_drive_faults(intended, latched, silent, allowance),
    ]
    grid = PhaseGrid.of(intended)
    allowance *= grid.code
    off = active & (np.abs(_signed_drive_difference(found - wanted)) > allowance)
    if off.any():
        faults += _phase_drive_faults(model, intended, found, off, allowance, grid)
    return tuple(faults)


def drive_fault_candidates(model: AcousticModel, intended: Intended) -> Iterator[Codes]:
    """Yield the codes of the registers that known mistakes of a whole drive would have made."""
    wanted, grid = _drive_fault_phases(intended.drive), PhaseGrid.of(intended)
    for _, codes in mixed_up_drives(model, intended, wanted):
        yield codes // grid.code % grid.registers
    for step in range(1, grid.registers):
        yield (wanted // grid.code + step) % grid.registers
    if (down := _rounded_down_drive_fault(model, intended, grid)) is not None:
        yield down // grid.code


def _drive_fault_phases(drive: Drive) -> Codes:
    """Return the (N,) phase codes of a drive, scaled to 16 bits (65536 are a turn)."""
    return drive.phase_codes.astype(np.int64) << (MAX_PHASE_BITS - drive.phase_bits)


def _signed_drive_difference(difference: Codes) -> Codes:
    """Return differences of phase codes wrapped to -half a turn up to, not with, half a turn."""
    return (difference + TURN // 2) % TURN - TURN // 2


# --- Amplitudes --------------------------------------------------------------------------------


def _silent_element_drive_faults(model: AcousticModel, silent: NDArray[np.bool_]) -> Iterator[str]:
    """Name the elements of the mask *silent*, by columns and rows where possible; else nothing."""
    if silent.all():
        yield "the whole array is silent"
    elif silent.any():
        yield from _drive_faults_by_line(model, silent, "dead")


def _drive_faults_by_line(
    model: AcousticModel, wrong: NDArray[np.bool_], what: str
) -> Iterator[str]:
    """Name whole columns (one ix) and rows (one iy) of *wrong*, then elements, each with *what*."""
    left = wrong.copy()
    if model.array.grid_shape is not None:
        grid = left.reshape(model.array.grid_shape)  # a view: lines are taken out of `left`
        for name, lines in (("column", grid), ("row", grid.T)):
            for number in np.flatnonzero(lines.all(axis=1)) if lines.shape[1] > 1 else []:
                yield f"{name} {number} {what}"
                lines[number] = False
    if left.any():
        yield f"{faulty_elements_text(model, np.flatnonzero(left))} {what}"


def faulty_elements_text(model: AcousticModel, numbers: Sequence[int] | NDArray[np.intp]) -> str:
    """Return "element 17 (1, 1)", with the place in the grid where there is one."""
    if len(numbers) > _NAMED_ELEMENTS:
        return f"{len(numbers)} elements"
    names = ", ".join(_faulty_element_text(model, int(number)) for number in numbers)
    return f"element{'s' if len(numbers) > 1 else ''} {names}"


def _faulty_element_text(model: AcousticModel, number: int) -> str:
    """Return an element as "17 (1, 1)", number, column and row; "17" for an array without grid."""
    if model.array.grid_shape is None:
        return str(number)
    return f"{number} ({number // model.array.grid_shape[1]}, {number % model.array.grid_shape[1]})"


def _amplitude_drive_faults(
    intended: Intended, latched: Drive, silent: NDArray[np.bool_], allowance: int
) -> Iterator[str]:
    """Yield one text: how many amplitudes are over *allowance* codes off, and the worst error.

    The error of an amplitude is latched - intended. Elements of the mask *silent* do not count;
    nothing is yielded if no other is off.
    """
    difference = latched.amplitude_codes.astype(int) - intended.drive.amplitude_codes.astype(int)
    wrong = (np.abs(difference) > allowance) & ~silent
    if wrong.any():
        worst = int(difference[np.abs(np.where(wrong, difference, 0)).argmax()])
        count = int(wrong.sum())
        elements = "one element" if count == 1 else f"{count} elements"
        yield f"amplitude of {elements} off, by up to {worst:+d}/255"


# --- Phases ------------------------------------------------------------------------------------


def _phase_drive_faults(
    model: AcousticModel,
    intended: Intended,
    found: Codes,
    off: NDArray[np.bool_],
    allowance: int,
    grid: PhaseGrid,
) -> list[str]:
    """Name what explains the wrong phases of the mask *off*; UNNAMED alone if nothing does.

    *found* are the latched codes; they equal a hypothesis if at most *allowance* codes apart. Tried
    are rounding down (only if *allowance* is 0), one phase added to all, elements in a wrong order,
    opposite sign, groups of elements with one error, and single elements.
    """
    wanted = _drive_fault_phases(intended.drive)
    down = None if allowance else _rounded_down_drive_fault(model, intended, grid)
    if down is not None and np.array_equal(found, down):
        return ["phases rounded down instead of to the nearest code"]
    difference = _signed_drive_difference(found - wanted)
    if _is_same_faulty_drive(found, wanted, allowance):
        return [f"all phases off by {grid.text(int(difference[off][0]))}, the focus is not"]
    few = off.mean() <= _FEW
    named = _swapped_drive_fault(model, wanted, found, off) or _stuck_element_drive_faults(
        model, found, off, grid
    )
    if not named and not few:
        named = _mixed_up_drive_fault(model, intended, wanted, found, grid)
        named = named or shaped_drive_fault(model, intended, difference, allowance)
        named = named or _units_out_of_step(model, difference, grid)
    named = named or _shared_phase_fault(model, found, off, grid)
    if not named and few:
        named = list(_single_element_drive_faults(model, difference, off, grid))
    return named or [UNNAMED]


def _mixed_up_drive_fault(
    model: AcousticModel, intended: Intended, wanted: Codes, found: Codes, grid: PhaseGrid
) -> list[str]:
    """Name the wrong order, sign or packing of elements that makes *found* of *wanted*; else []."""
    # A board that mixes up the elements may round the halves its own way: then a step is allowed.
    for allowance in (0, -(-grid.registers // grid.steps) * grid.code):
        for name, candidate in mixed_up_drives(model, intended, wanted):
            # What is that near to the right drive proves nothing.
            if _is_same_faulty_drive(found, candidate, allowance) and not _is_same_faulty_drive(
                wanted, candidate, allowance
            ):
                return [name]
        for sign, suffix in ((1, ""), (-1, ", and opposite sign")):
            shift = _rolled_drive_fault(found, sign * wanted, allowance)
            if shift is not None:
                return [f"elements rolled by {shift:+d}{suffix}"]
    return []


def _is_same_faulty_drive(found: Codes, candidate: Codes, allowance: int) -> bool:
    """Return True if phase codes agree within ± *allowance* codes, up to a common phase."""
    difference = _signed_drive_difference(found - candidate)
    relative = _signed_drive_difference(difference - difference[0])
    return bool(np.ptp(relative) <= 2 * allowance)


def _rounded_down_drive_fault(
    model: AcousticModel, intended: Intended, grid: PhaseGrid
) -> Codes | None:
    """Return the (N,) 16-bit codes of one focus, rounded down to steps; None for several foci."""
    if len(intended.foci) != 1:
        return None
    (focus,) = intended.foci
    phases_rad = focus_phases(model, np.array(focus.position_m)) + focus.phase_rad
    codes = np.floor(phases_rad / (2.0 * np.pi) * grid.steps) % grid.steps
    found = np.floor(codes * (grid.registers / grid.steps) + 0.5).astype(np.int64)
    return found % grid.registers * grid.code


def _rolled_drive_fault(found: Codes, wanted: Codes, allowance: int) -> int | None:
    """Return k for which np.roll(*wanted*, k) equals *found*, from -N/2 to N/2; None if none does.

    Equal is within *allowance* codes, up to a phase common to all; 0 is not tried.
    """
    count = len(wanted)
    start = np.arange(1, count)
    # Three elements tell almost every shift apart; only what passes is compared as a whole.
    probes = np.array([0, count // 3, count // 2])
    error = _signed_drive_difference(found[probes] - wanted[(probes - start[:, None]) % count])
    likely = start[
        (np.abs(_signed_drive_difference(error - error[:, :1])) <= 2 * allowance).all(axis=1)
    ]
    for shift in sorted(likely, key=lambda shift: min(shift, count - shift)):
        if _is_same_faulty_drive(found, np.roll(wanted, shift), allowance):
            return int(shift if shift <= count // 2 else shift - count)
    return None


def _swapped_drive_fault(
    model: AcousticModel, wanted: Codes, found: Codes, off: NDArray[np.bool_]
) -> list[str]:
    """Name the two elements of *off* if each has the other's phase; [] if not, or not two."""
    numbers = np.flatnonzero(off)
    if len(numbers) != 2:
        return []
    first, second = numbers
    if found[first] == wanted[second] and found[second] == wanted[first]:
        return [f"{faulty_elements_text(model, numbers)} swapped"]
    return []


def _single_element_drive_faults(
    model: AcousticModel, difference: Codes, off: NDArray[np.bool_], grid: PhaseGrid
) -> Iterator[str]:
    """Name the elements of *off* by their phase error (found - wanted), equal errors together.

    If there are more than 8, groups with one error (by remainder or block of their numbers) are
    named first. If more than 8 different errors are left, the rest is named with the largest.
    """
    if off.sum() > _NAMED_ELEMENTS and not _are_lines(model, off):
        lags = dict(enumerate((difference * (np.pi * 2.0 / TURN)).tolist()))
        limit_rad = np.pi * grid.code / TURN
        shifted = np.flatnonzero(off).tolist()
        groups, explained = groups_of_elements(lags, shifted, limit_rad, grid.steps)
        yield from (group.text for group in groups)
        off = off & ~np.isin(np.arange(len(off)), list(explained))
    errors = sorted({int(d) for d in difference[off]}, key=abs)
    if len(errors) > _NAMED_ELEMENTS:
        yield from _drive_faults_by_line(model, off, f"off, by up to {grid.text(errors[-1])}")
        return
    for error in errors:
        wrong = off & (difference == error)
        what = "inverted" if error == -TURN // 2 else f"off by {grid.text(error)}"
        yield from _drive_faults_by_line(model, wrong, what)


def _are_lines(model: AcousticModel, off: NDArray[np.bool_]) -> bool:
    """Return True if *off* holds only up to 3 whole columns, or one row; False without a grid.

    Several rows are not lines: elements with the same remainder say more about the board.
    """
    if model.array.grid_shape is None:
        return False
    grid = off.reshape(model.array.grid_shape)
    return any(
        lines.any(axis=1).sum() <= most and (lines.any(axis=1) == lines.all(axis=1)).all()
        for lines, most in ((grid, _NAMED_COLUMNS), (grid.T, 1))
    )


def _units_out_of_step(model: AcousticModel, difference: Codes, grid: PhaseGrid) -> list[str]:
    """Name the elements of each phase error (found - wanted), if there are 1 to 3 different ones.

    Errors are relative to the commonest one. [] for more or none, for an error below two phase
    steps, or if as few values could come about by chance.
    """
    values, counts = np.unique(difference, return_counts=True)
    relative = _signed_drive_difference(difference - values[counts.argmax()])
    relative = _merge_rounding_errors(relative, grid.step)
    errors = [int(error) for error in np.unique(relative) if error]
    bits = len(difference) * np.log2(grid.steps / len(values))
    if (
        len(errors) >= _MOST_UNITS
        or bits < _CHANCE_BITS
        or min(map(abs, errors)) < _TWO * grid.step
    ):
        return []
    return [
        f"{_numbered_run_text(model, np.flatnonzero(relative == error))} "
        + ("inverted" if error == -TURN // 2 else f"off by {grid.text(error)}")
        for error in errors
    ]


def _merge_rounding_errors(errors: Codes, step: float) -> Codes:
    """Return phase errors (codes) with each one replaced by a commoner one within *step* of it.

    A phase that is added before rounding gives errors of one code more or less. Errors of less than
    two steps are returned unchanged.
    """
    joined, left = errors.copy(), np.abs(errors) >= _TWO * step
    values, counts = np.unique(errors[left], return_counts=True)
    for value in values[np.argsort(-counts, kind="stable")]:
        near = left & (np.abs(_signed_drive_difference(errors - value)) <= step)
        joined[near] = value
        left &= ~near
    return joined


def _numbered_run_text(model: AcousticModel, numbers: NDArray[np.intp]) -> str:
    """Return "elements 64 to 127" for 3 or more consecutive ones, else their list or number."""
    first, last = int(numbers[0]), int(numbers[-1])
    if len(numbers) > _TWO and last - first + 1 == len(numbers):
        return f"elements {first} to {last}"
    return faulty_elements_text(model, numbers)


def _shared_phase_fault(
    model: AcousticModel, found: Codes, off: NDArray[np.bool_], grid: PhaseGrid
) -> list[str]:
    """Name the elements of *off* that all share one phase; [] if not, or if chance explains it."""
    numbers = np.flatnonzero(off)
    bits = (len(numbers) - 1) * np.log2(grid.steps)
    if bits < _CHANCE_BITS or (found[numbers] != found[numbers[0]]).any():
        return []
    return [
        f"{faulty_elements_text(model, numbers)} stuck at phase {found[numbers[0]] // grid.code}"
    ]


def _stuck_element_drive_faults(
    model: AcousticModel, found: Codes, off: NDArray[np.bool_], phases: PhaseGrid
) -> list[str]:
    """Name columns or rows that have one phase each and hold every element of *off*; else []."""
    if model.array.grid_shape is None:
        return []
    grid, wrong = found.reshape(model.array.grid_shape), off.reshape(model.array.grid_shape)
    for name, codes, errors in (("column", grid, wrong), ("row", grid.T, wrong.T)):
        same = (codes == codes[:, :1]).all(axis=1) & (errors.sum(axis=1) > 1)
        if same.any() and not errors[~same].any():
            lines = np.flatnonzero(same)
            return [
                f"{name} {line} stuck at phase {codes[line, 0] // phases.code}" for line in lines
            ]
    return []

"""Mistakes of a client, as hypotheses that give the phases back that it meant.

A rearrangement says where each element's phase went, and for which places the phases were computed.
All names are in the axes of the client.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptogram.acoustics.arrays import FloatArray
from haptogram.acoustics.model.boards.layout import Z_UP, Rows
from haptogram.acoustics.model.model import AcousticModel

from .defect import Defect

_MOST_ROLL: Final = 4  # channels by which a map may be off
_MAX_BOARDS: Final = 4
_ROW_M: Final = 1e-4  # elements that are nearer than this along an axis are in one row
_UNITS: Final = (
    (1e-3, "the places are a thousand times nearer: metres are taken for millimetres"),
    (1e3, "the places are a thousand times further: millimetres are taken for metres"),
)

Part: TypeAlias = tuple[Defect, str]
Places: TypeAlias = FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class Rearrangement:
    """A mistake of a client, by what gives back the phases that it meant.

    Attributes
    ----------
    parts : tuple of (Defect, str)
        Its names; empty: no mistake.
    index : (N,) numpy.ndarray of int
        The channel at which the phase of each element is.
    sign : int
        -1 if all phases have the opposite sign.
    added_rad : (N,) numpy.ndarray
        Phase that the drive lacks at each element.
    move : callable
        From (T, 3) targets to the places that the phases were computed for.
    """

    parts: tuple[Part, ...]
    index: NDArray[np.intp]
    sign: int = 1
    added_rad: FloatArray | float = 0.0
    move: Callable[[Places], Places] = lambda places: places


def client_rearrangements(
    model: AcousticModel, board_channels: int, client_axes: Rows = Z_UP
) -> list[Rearrangement]:
    """Return every single mistake that has a name, the one that is none first.

    Parameters
    ----------
    board_channels : int
        Channels of one of the boards, whose elements follow each other.
    client_axes : rows
        Our axes in those of the client.
    """
    count, axes = model.array.count, np.array(client_axes)
    # Elements by board; one row if they are no number of whole boards.
    boards = np.arange(count).reshape(-1, count if count % board_channels else board_channels)
    same = boards.ravel()
    found = [Rearrangement((), same)]
    turns = _CoordinateTurns(model, axes)
    found += [Rearrangement((part,), same, move=move) for part, move in turns]
    found.append(Rearrangement(((Defect.SIGN, "of all elements"),), same, sign=-1))
    found += [
        Rearrangement(((Defect.CHANNELS, text),), index)
        for text, index in _other_channels(model, boards, axes)
        if not np.array_equal(index, same) and not turns.are_order(index)
    ]
    return found + list(_board_phase_offsets(boards))


class _CoordinateTurns:
    """Targets whose coordinates are mistaken, and elements that are turned onto each other.

    Elements turn around their centre, and coordinates around the origin of the client.
    """

    def __init__(self, model: AcousticModel, axes: FloatArray) -> None:
        self._array, self._axes = model.array, axes
        self._up = int(np.argmax(axes[2]))
        first, second = (axis for axis in range(3) if axis != self._up)
        self._plane = first, second

    def __iter__(self) -> Iterator[tuple[Part, Callable[[Places], Places]]]:
        for text, matrix in self._orders():
            part = Defect.ORDER, text
            yield part, self._around(matrix, self._array.centre_m)
            yield part, self._around(matrix, np.zeros(3))
        for order in itertools.permutations(range(3)):
            if order[self._up] != self._up:
                part = Defect.COORDINATES, _axes_text(order)
                yield part, self._around(np.eye(3)[list(order)], np.zeros(3))
        for factor, text in _UNITS:
            yield (Defect.UNITS, text), functools.partial(np.multiply, factor)

    def are_order(self, index: NDArray[np.intp]) -> bool:
        """Return True if elements taken in the order *index* lie as if turned or mirrored."""
        places, centre = self._array.positions_m, self._array.centre_m
        return any(
            np.allclose(self._around(matrix, centre)(places), places[index], atol=_ROW_M)
            for _, matrix in self._orders()
        )

    def _orders(self) -> Iterator[tuple[str, FloatArray]]:
        """Yield 7 orders of the elements in the array's plane, as names and matrices (3, 3).

        Either axis mirrored, both (180 degrees), axes exchanged, exchanged and mirrored, 90 and 270
        degrees; not the identity.
        """
        a, b = ("xyz"[axis] for axis in self._plane)
        for text, values in (
            (f"{a} mirrored", ((-1, 0), (0, 1))),
            (f"{b} mirrored", ((1, 0), (0, -1))),
            (f"{a} and {b} mirrored (turned by 180 degrees)", ((-1, 0), (0, -1))),
            (f"{a} and {b} exchanged (transposed)", ((0, 1), (1, 0))),
            (f"{a} and {b} exchanged and mirrored", ((0, -1), (-1, 0))),
            ("turned by 90 degrees", ((0, -1), (1, 0))),
            ("turned by 270 degrees", ((0, 1), (-1, 0))),
        ):
            matrix = np.eye(3)
            matrix[np.ix_(self._plane, self._plane)] = values
            yield text, matrix

    def _around(self, matrix: FloatArray, centre_m: FloatArray) -> Callable[[Places], Places]:
        """Return a function that maps places (T, 3) in m by *matrix* (3, 3), with *centre_m* fixed.

        *matrix* acts on coordinates in the client's axes.
        """
        axes = self._axes.T @ self._array.axes
        turn = axes.T @ matrix @ axes
        return lambda places: centre_m + (places - centre_m) @ turn.T


def _axes_text(order: Sequence[int]) -> str:
    """Return "y and z exchanged" for two axes, or the order in which all three are taken."""
    moved = ["xyz"[axis] for axis, other in enumerate(order) if axis != other]
    if len(moved) == 2:
        return f"{moved[0]} and {moved[1]} exchanged"
    return "x, y, z taken in the order " + ", ".join("xyz"[axis] for axis in order)


def _other_channels(
    model: AcousticModel, boards: NDArray[np.intp], axes: FloatArray
) -> Iterator[tuple[str, NDArray[np.intp]]]:
    """Yield mistakes in the map from elements to channels: name, and the channel used (N,).

    Channels off by 1 to 4 either way, two of up to 4 boards exchanged, and a map by rows or columns
    applied twice, not at all or backwards. *boards* (B, C) has the channels of each board, *axes*
    (3, 3) are the client's.
    """
    same = boards.ravel()
    for roll in range(1, _MOST_ROLL + 1):
        for way in (roll, -roll):
            yield f"the channels of all elements are off by {way:+d}", np.roll(same, -way)
    if len(boards) <= _MAX_BOARDS:
        for first, second in itertools.combinations(range(len(boards)), 2):
            order = np.arange(len(boards))
            order[[first, second]] = second, first
            text = f"order of the boards: {first + 1} and {second + 1} are exchanged"
            yield text, boards[order].ravel()
    known: set[bytes] = set()
    for by_rows in _element_maps(model, boards, axes):
        inverse = np.argsort(by_rows)
        for text, index in (
            ("the map from elements to channels is applied twice", by_rows),
            ("the map from elements to channels is left out", inverse),
            ("the map from elements to channels is applied the wrong way", inverse[inverse]),
        ):
            if index.tobytes() not in known:
                known.add(index.tobytes())
                yield text, index


def _element_maps(
    model: AcousticModel, boards: NDArray[np.intp], axes: FloatArray
) -> Iterator[NDArray[np.intp]]:
    """Yield (N,) the channel of each element, counted by rows or columns on each board.

    All 8 ways are yielded: from each corner, along either axis. *boards* (B, C) has the channels of
    each board, *axes* (3, 3) the client's.
    """
    places = model.array.positions_m @ axes
    first, second = (axis for axis in range(3) if axis != int(np.argmax(axes[2])))
    rounded = np.round(places / _ROW_M)
    for signs in itertools.product((1, -1), repeat=2):
        for inner, outer in ((first, second), (second, first)):
            keys = signs[0] * rounded[boards, inner], signs[1] * rounded[boards, outer]
            yield np.take_along_axis(boards, np.lexsort(keys), axis=1).ravel()


def _board_phase_offsets(boards: NDArray[np.intp]) -> Iterator[Rearrangement]:
    """Yield mistakes in each of which one of *boards* (B, C), not the first, lags half a turn.

    Nothing for a chain of more than 4 boards.
    """
    same = boards.ravel()
    for number, board in enumerate(boards[1:], 2) if len(boards) <= _MAX_BOARDS else ():
        text = f"half a turn between the boards: board {number} against the others"
        added = np.where(np.isin(same, board), math.pi, 0.0)
        yield Rearrangement(((Defect.BOARD_PHASE, text),), same, added_rad=added)

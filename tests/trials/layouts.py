"""Arrays at random: grids, lines, bowls, rings, plates that face each other; in any pose."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from .truth import Floats

Random = np.random.Generator

_MOST: Final = 400  # elements
_GOLDEN_RAD: Final = math.pi * (3.0 - math.sqrt(5.0))


@dataclass(frozen=True)
class Layout:
    """An array, in its own place: where it is, and how it is told to the program.

    Attributes
    ----------
    name : str
        Grid such as ``8x8``, or the name of a CSV file to be written.
    positions_m, normals : (N, 3)
        As the program shall have them.
    grid : (nx, ny) or None
    pitch_m : float
    centre_m : (3,)
        Of the elements.
    frame : (3, 3)
        The array's own axes as rows: two across, one along which it faces.
    kind : str
        A key of :data:`KINDS`; for the table.
    posed : bool
        Whether it was moved and turned.
    focus_m : (3,) or None
        Where the elements look, if they do not look one way.
    """

    name: str
    positions_m: Floats
    normals: Floats
    grid: tuple[int, int] | None
    pitch_m: float
    centre_m: Floats
    frame: Floats
    kind: str
    posed: bool = False
    focus_m: Floats | None = None

    @property
    def count(self) -> int:
        return len(self.positions_m)

    def write(self, folder: Path) -> str:
        """Return what the program takes as its array: the grid, or the file, which is written."""
        if not self.name.endswith(".csv"):
            return self.name
        rows = np.hstack([self.positions_m * 1e3, self.normals])
        lines = [",".join(repr(float(value)) for value in row) for row in rows]
        path = folder / self.name
        path.write_text("\n".join(["x,y,z,nx,ny,nz", *lines]) + "\n", encoding="utf-8")
        return str(path)


def layout_of(random: Random, seed: int) -> Layout:
    """An array of any kind, in any pose."""
    kind = str(random.choice(list(KINDS), p=[share for share, _ in KINDS.values()]))
    pitch = float(np.round(random.uniform(5.0, 12.0), 2)) * 1e-3
    layout = KINDS[kind][1](random, pitch)
    if layout.grid is None:
        layout = replace(layout, name=f"{kind.replace(' ', '')}{seed}.csv", kind=kind)
    return _posed(random, layout, seed)


def grid(nx: int, ny: int, pitch_m: float) -> Layout:
    """Element n = ix * ny + iy, around the origin, facing +z."""
    ix, iy = np.divmod(np.arange(nx * ny), ny)
    x, y = (ix - (nx - 1) / 2) * pitch_m, (iy - (ny - 1) / 2) * pitch_m
    positions = np.stack([x, y, np.zeros(nx * ny)], axis=1)
    kind = "line" if 1 in (nx, ny) else "grid"
    return _placed(positions, None, pitch_m, name=f"{nx}x{ny}", grid=(nx, ny), kind=kind)


def _placed(
    positions: Floats,
    normals: Floats | None,
    pitch_m: float,
    *,
    focus_m: Floats | None = None,
    name: str = "",
    grid: tuple[int, int] | None = None,
    kind: str = "",
) -> Layout:
    """Elements around any centre; facing +z where nothing else is said."""
    up = np.tile([0.0, 0.0, 1.0], (len(positions), 1)) if normals is None else normals
    facing = up.mean(axis=0)
    frame = np.eye(3)
    if np.abs(facing[:2]).max() > 1e-9:
        frame = _frame_along(facing)
    centre = positions.mean(axis=0) if grid is None else np.zeros(3)
    return Layout(name, positions, up, grid, pitch_m, centre, frame, kind, focus_m=focus_m)


def _frame_along(normal: Floats) -> Floats:
    z = normal / np.linalg.norm(normal)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _sides(random: Random) -> tuple[int, int]:
    if random.random() < 0.12:
        sides = [int(side) for side in random.integers(1, 5, 2)]
    elif random.random() < 0.25:
        sides = [int(random.integers(2, 21))] * 2
    else:
        sides = [int(side) for side in random.integers(2, 21, 2)]
    return sides[0], sides[1]


def _grid(random: Random, pitch: float) -> Layout:
    return grid(*_sides(random), pitch)


def _line(random: Random, pitch: float) -> Layout:
    sides = [1, int(random.integers(1, 21))]
    random.shuffle(sides)
    return grid(sides[0], sides[1], pitch)


def _jittered(random: Random, pitch: float) -> Layout:
    """A grid whose elements are up to a fifth of the pitch out of their places."""
    places = grid(*(int(side) for side in random.integers(3, 21, 2)), pitch).positions_m
    away = random.uniform(-0.2, 0.2, places.shape) * pitch * [1.0, 1.0, 0.3]
    return _placed(places + away, None, pitch)


def _bowl(random: Random, pitch: float) -> Layout:
    """A spherical cap on which every element faces the centre of the sphere."""
    radius = float(random.uniform(0.07, 0.30))
    opening = float(random.uniform(0.15, 0.85))  # half of the cap, in radians
    rings = max(1, int(radius * opening / pitch))
    directions = [(0.0, 0.0)] if random.random() < 0.5 else []
    for ring in range(1, rings + 1):
        polar = opening * ring / rings
        around = max(2, int(2.0 * math.pi * math.sin(polar) * radius / pitch))
        start = random.uniform(0.0, 2.0 * math.pi)
        if len(directions) + around > _MOST:
            break  # whole rings: it shall face along its axis
        directions += [(polar, start + 2.0 * math.pi * n / around) for n in range(around)]
    polar, turn = np.array(directions).T
    outward = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), -np.cos(polar)], axis=1
    )
    middle = np.array([0.0, 0.0, radius])
    layout = _placed(radius * outward + middle, -outward, pitch, focus_m=middle)
    return replace(layout, frame=np.eye(3))


def _ring(random: Random, pitch: float) -> Layout:
    """One to three circles in a plane."""
    places, radius = [], float(random.uniform(0.02, 0.05))
    for _ in range(int(random.integers(1, 4))):
        radius += float(random.uniform(1.0, 2.5)) * pitch
        count = int(2.0 * math.pi * radius / pitch)
        turn = random.uniform(0.0, math.pi) + 2.0 * math.pi * np.arange(count) / count
        places.append(np.stack([radius * np.cos(turn), radius * np.sin(turn), 0.0 * turn], axis=1))
    return _placed(np.vstack(places), None, pitch)


def _spiral(random: Random, pitch: float) -> Layout:
    """A sunflower."""
    n = np.arange(int(random.integers(16, 257)))
    radius, turn = 0.62 * pitch * np.sqrt(n + 0.5), n * _GOLDEN_RAD
    places = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros(len(n))], axis=1)
    return _placed(places, None, pitch)


def _sparse(random: Random, pitch: float) -> Layout:
    """Few elements anywhere on a wide disc, none nearer to another one than a pitch."""
    radius, places = float(random.uniform(0.04, 0.12)), np.zeros((0, 3))
    for _ in range(40 * int(random.integers(6, 61))):
        turn, far = random.uniform(0.0, 2.0 * math.pi), radius * math.sqrt(random.random())
        place = np.array([far * math.cos(turn), far * math.sin(turn), 0.0])
        if np.linalg.norm(places - place, axis=1).min(initial=1.0) > 2.0 * pitch:
            places = np.vstack([places, place])
    return _placed(places, None, pitch)


def _two_plates(random: Random, pitch: float, tilt_rad: float, apart_m: float) -> Layout:
    """Two grids that look at one point, each turned from the other by twice *tilt_rad*."""
    plate = grid(*(int(side) for side in random.integers(3, 13, 2)), pitch).positions_m
    positions, normals = [], []
    for sign in (1.0, -1.0):
        turn = rotation(np.array([0.0, 1.0, 0.0]), sign * tilt_rad)
        positions.append((plate - [0.0, 0.0, apart_m / 2.0]) @ turn.T)
        normals.append(np.tile([0.0, 0.0, 1.0] @ turn.T, (len(plate), 1)))
    return _placed(np.vstack(positions), np.vstack(normals), pitch, focus_m=np.zeros(3))


def _facing(random: Random, pitch: float) -> Layout:
    layout = _two_plates(random, pitch, math.pi / 2.0, float(random.uniform(0.07, 0.2)))
    back = rotation(np.array([0.0, 1.0, 0.0]), math.pi / 2.0)  # one looks up, the other one down
    return replace(
        layout,
        positions_m=layout.positions_m @ back.T,
        normals=layout.normals @ back.T,
        frame=np.eye(3),
    )


def _l_shape(random: Random, pitch: float) -> Layout:
    return _two_plates(random, pitch, math.pi / 4.0, 13.0 * pitch + float(random.uniform(0.0, 0.1)))


def _v_shape(random: Random, pitch: float) -> Layout:
    tilt = float(random.uniform(0.35, 0.7))
    return _two_plates(random, pitch, tilt, 13.0 * pitch / math.tan(tilt))


#: How often each kind is drawn, and what makes it.
KINDS: Final[dict[str, tuple[float, Callable[[Random, float], Layout]]]] = {
    "grid": (0.40, _grid),
    "line": (0.06, _line),
    "bowl": (0.12, _bowl),
    "jittered": (0.08, _jittered),
    "ring": (0.06, _ring),
    "facing pair": (0.08, _facing),
    "L": (0.05, _l_shape),
    "V": (0.05, _v_shape),
    "spiral": (0.05, _spiral),
    "sparse": (0.05, _sparse),
}


def _posed(random: Random, layout: Layout, seed: int) -> Layout:
    """Move and turn it: not at all, a little, or anyhow."""
    how = random.choice(["not", "tilted", "any"], p=[0.6, 0.15, 0.25])
    if how == "not":
        return layout
    angle = random.uniform(0.0, 0.35) if how == "tilted" else random.uniform(0.0, math.pi)
    turn = rotation(direction(random), angle)
    shift = direction(random) * random.uniform(0.0, 0.3)
    if random.random() < 0.2:
        turn = np.eye(3)  # moved only

    def moved(points: Floats) -> Floats:
        result: Floats = points @ turn.T + shift
        return result

    return replace(
        layout,
        name=f"posed{seed}.csv",
        positions_m=moved(layout.positions_m),
        normals=layout.normals @ turn.T,
        centre_m=moved(layout.centre_m),
        frame=layout.frame @ turn.T,
        posed=True,
        focus_m=None if layout.focus_m is None else moved(layout.focus_m),
    )


def direction(random: Random) -> Floats:
    vector = random.normal(size=3)
    unit: Floats = vector / np.linalg.norm(vector)
    return unit


def rotation(axis: Floats, angle_rad: float) -> Floats:
    """Rodrigues: the matrix that turns by an angle around a unit vector."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle_rad) * cross + (1.0 - math.cos(angle_rad)) * cross @ cross
